# SPDX-License-Identifier: Apache-2.0
"""A robot file from a description alone: which arm, from where to where, how it waits, and what has to be checked.

Arms are found by kinematics. Joints that move are the edges of a tree of rigid bodies. Bodies that carry several limbs
(trunk, base) stand still; a limb is what hangs on the last of them, up to the body that carries nothing but fingers.
Names decide only where kinematics leaves two readings: a leg that could be an arm, a wrist that could be a jaw.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from mild_core.errors import SetupError
from mild_core.retargeting.contact import RELENT, shoulder_and_reach_m
from mild_core.retargeting.robot_checks import DRIVES, FREE_JOINTS, arm_notes, check_reach
from mild_core.retargeting.robot_model.capsules import NEIGHBOURS, capsules_of, pair_clearances
from mild_core.retargeting.robot_model.chain import ASIDE_M, chain_of, frames_of, mount_of, named_side
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.kinematics import KinematicTree, forward_kinematics, read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import FIXED, LOOSE, SLIDING, TURNING, Joint, read_solids
from mild_core.shapes import FloatArray, read_only

Side = Literal["right", "left"]

TWIG = 0.2
"""What spans less than this share of the robot is no limb: a finger, a head, a wheel."""

MOST_JOINTS, LEAST_JOINTS = 7, 3
"""Of an arm; what turns before the last so many is taken for the trunk."""

JAW_M = 0.03
"""A link that a hand carries so much beyond the axis of the only joint behind it: that joint is a jaw, no wrist."""

TIP_M = 0.1
"""A finger reaches no further beyond its last joint."""

LEGS = re.compile(r"leg|hip|knee|ankle|foot|thigh|calf|shank|haa|hfe|kfe|rotor|wheel", re.IGNORECASE)
GRIPS = re.compile(r"grip|finger|jaw|thumb|claw|knuckle|clamp", re.IGNORECASE)
TOOLS = re.compile(r"tcp|tool|grasp|palm|hand|gripper|ee|end_?eff", re.IGNORECASE)
SENSORS = re.compile(
    r"camera|optical|sensor|laser|light|skin|inertial|collision|(^|_)(cam|imu|ft|com)(_|$)", re.IGNORECASE
)
FINGERS = re.compile(r"finger|thumb|jaw|claw|knuckle|mover|phalan|tip\d*(_|$)", re.IGNORECASE)

ACCELERATION_RAD_S2, JERK_RAD_S3, VELOCITY_RAD_S = 10.0, 300.0, 1.0
"""Proposed where the description has none: an arm of 10 kg bears the first two, and the third is slow."""

UNKNOWN_RAD = 1.5
"""To either side, for a joint whose limits are not known."""

FORWARD = 0.9
"""Cosine of the angle up to which a link's axes are those of REP-103."""

SHOULDER_HEIGHT_M = 1.1
"""Of a person who stands: a trunk that slides is proposed to bring the robot's shoulder there."""

BENCH = 0.5
"""A shoulder that is less than this share of the reach above the base stands on a bench."""

TRIED_POSES, SEED, KEPT, REFINED = 2000, 7, 12, 150
CLEAR_M, ALWAYS = 0.01, 0.8
"""Least distance between parts of the arm at home; pairs that overlap in more of all poses belong together."""

HANDS, STEPS, MET_M, MARGIN_RAD = 48, 150, 0.02, 0.01
"""Hands that are tried, and how: as `Contact` brings hands together, from home."""


@dataclass(frozen=True, eq=False)
class Limb:
    """A serial chain of joints that turn.

    Attributes:
        joints: From the first that turns to the last, those that copy others left out.
        tool_link: What meets a person's hand.
        side: "right", "left", or "" for one in the middle.
        length_m: From its first joint to its tool with all joints at zero, along the chain.
        leg: Whether it is taken for a leg.
    """

    joints: tuple[Joint, ...]
    tool_link: str
    side: str
    length_m: float
    leg: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Of its joints."""
        return tuple(joint.name for joint in self.joints)


@dataclass(frozen=True, eq=False)
class Proposal:
    """A robot file that works as it stands, and what speaks against it.

    Attributes:
        robot: As `read_robot` reads the file.
        side: "right", "left", or "" for an arm in the middle.
        reached: Hands ahead of the robot that the arm meets from home, ...
        reachable: ... of so many that it reaches from some posture.
        checks: What a person has to check, a sentence each.
        values: Keys of the file, in order.
    """

    robot: RobotModel
    side: str
    reached: int
    reachable: int
    checks: tuple[str, ...]
    values: Mapping[str, object] = field(repr=False)

    def text(self, description: str) -> str:
        """The robot file.

        Args:
            description: The URDF as the file shall name it.
        """
        lines = ["# Proposed from the description alone. To check:", *(f"# - {check}" for check in self.checks)]
        values = {**self.values, "description": description}
        rest = values.pop("rest")
        lines += [f"{key} = {_toml(value)}" for key, value in values.items()]
        if isinstance(rest, Mapping) and rest:
            lines += ["[rest] # joints that nothing commands", *(f"{_key(k)} = {_toml(v)}" for k, v in rest.items())]
        return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)


def _toml(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)


@dataclass(frozen=True, eq=False)
class _Bodies:
    """The tree of rigid bodies of a description; a body is named by its first link.

    Attributes:
        tree: The description's.
        at: Where each joint stands: at zero, or as near as its limits let it.
    """

    tree: KinematicTree
    at: Mapping[str, float]

    @staticmethod
    def of(tree: KinematicTree) -> _Bodies:
        return _Bodies(tree, {joint.name: _zero(joint) for joint in tree.by_child.values()})

    @cached_property
    def place_m(self) -> dict[str, FloatArray]:
        """(3,) where each link is, in the root's frame."""
        return {link: pose[:3, 3] for link, pose in self.pose.items()}

    @cached_property
    def pose(self) -> dict[str, FloatArray]:
        """(4, 4) of each link in the root's frame."""
        return {link: self.tree.pose(link, self.at) for link in self.tree.links}

    @cached_property
    def body(self) -> dict[str, str]:
        """Of each link the first link of its body."""
        found = {self.tree.root: self.tree.root}
        for link in self.tree.links:
            for joint in self.tree.chain(link):
                found[joint.child] = found[joint.parent] if joint.kind in FIXED else joint.child
        return found

    @cached_property
    def carried(self) -> dict[str, list[Joint]]:
        """The moving joints that hang on each body."""
        found: dict[str, list[Joint]] = {body: [] for body in self.body.values()}
        for joint in self.tree.by_child.values():
            if joint.kind not in FIXED:
                found[self.body[joint.parent]].append(joint)
        return found

    def links(self, body: str) -> list[str]:
        """All of one body."""
        return [link for link, first in self.body.items() if first == body]

    def below(self, body: str) -> list[str]:
        """All links of a body and of those that hang on it."""
        found, left = [], [body]
        while left:
            at = left.pop()
            found += self.links(at)
            left += [joint.child for joint in self.carried[at]]
        return found

    @cached_property
    def has_legs(self) -> bool:
        """Whether a limb is one."""
        limbs = [_limb(self, end) for end in _ends(self)]
        return any(limb.leg for limb in limbs if limb is not None)

    def span_m(self, joint: Joint) -> float:
        """How far what a joint carries reaches from it."""
        return max(math.dist(self.place_m[link], self.place_m[joint.child]) for link in self.below(joint.child))

    @cached_property
    def size_m(self) -> float:
        """The longest way through the robot, from its root along joints."""
        along = {self.tree.root: 0.0}
        for link in self.tree.links:
            for joint in self.tree.chain(link):
                along[joint.child] = along[joint.parent] + math.dist(
                    self.place_m[joint.child], self.place_m[joint.parent]
                )
        return max(along.values())

    def is_grip(self, joint: Joint) -> bool:
        """Whether the only joint that hangs on a body is a gripper's, not the next one of an arm."""
        if self.span_m(joint) >= TWIG * self.size_m:
            return False
        if joint.kind in SLIDING or joint.mimics or self.is_copied(joint):
            return True
        named = GRIPS.search(joint.name) or GRIPS.search(joint.child)
        return not self.carried[joint.child] and (bool(named) or self._is_jaw(joint))

    def is_copied(self, joint: Joint) -> bool:
        """Whether other joints do as it does."""
        return any(each.mimics == joint.name for each in self.tree.by_child.values())

    def _is_jaw(self, joint: Joint) -> bool:
        """A joint beyond whose axis its own carrier reaches out, and which turns across that way."""
        body = self.body[joint.parent]
        start, axis_at = self.place_m[body], self.place_m[joint.child]
        out = [self.place_m[link] for link in self.links(body) if not SENSORS.search(link)]
        way = axis_at - start
        length = float(np.linalg.norm(way))
        if length < 1e-6:
            return False
        beyond = max(float((point - axis_at) @ way) / length for point in out)
        turn = self.pose[joint.child][:3, :3] @ joint.axis
        return beyond > JAW_M and abs(float(turn @ way)) / length < 0.5


def _zero(joint: Joint) -> float:
    lower, upper, _ = joint.limits
    return 0.0 if math.isnan(lower) or lower <= 0.0 <= upper else lower if lower > 0.0 else upper


def find_limbs(path: Path) -> tuple[Limb, ...]:
    """Every limb of a description that has joints enough for an arm, the likeliest arms first.

    Raises:
        SetupError: The description is broken.
    """
    bodies = _Bodies.of(read_tree(path))
    found = [limb for end in _ends(bodies) if (limb := _limb(bodies, end)) is not None]
    legs = [limb.leg for limb in found]
    if found and all(legs) and not any(LEGS.search(name) for limb in found for name in limb.names):
        found = [replace(limb, leg=False) for limb in found]  # arms that hang; nothing else is there
    return tuple(sorted(found, key=lambda limb: (limb.leg, len(limb.joints) < FREE_JOINTS, -limb.length_m)))


def _ends(bodies: _Bodies) -> list[str]:
    """The last body of each limb: what it carries are fingers, or nothing."""
    least_m = TWIG * bodies.size_m
    found, left = [], [bodies.tree.root]
    while left:
        body = left.pop()
        carried = [joint for joint in bodies.carried[body] if not DRIVES.search(joint.name)]
        large = [joint for joint in carried if bodies.span_m(joint) >= least_m]
        if large and not (len(carried) == 1 and bodies.is_grip(carried[0])):
            left += [joint.child for joint in large]
        elif len(carried) == 1 and not bodies.is_grip(carried[0]):
            left.append(carried[0].child)
        elif body != bodies.body[bodies.tree.root]:
            found.append(body)
    return found


def _limb(bodies: _Bodies, end: str, tool: str = "") -> Limb | None:
    """The limb that ends in a body; None where too few joints turn."""
    tree = bodies.tree
    moving = [joint for joint in tree.chain(end) if joint.kind not in FIXED]
    first = 0
    for place, joint in enumerate(moving):
        siblings = [each for each in bodies.carried[bodies.body[joint.parent]] if each is not joint]
        limbs = [each for each in siblings if not DRIVES.search(each.name) and not _is_small(bodies, each)]
        if joint.kind not in TURNING:
            first = place + 1
        elif limbs:
            first = place
    joints = [joint for joint in moving[first:] if tree.followed(joint)[0] == joint.name]
    joints = joints[-MOST_JOINTS:]
    if len(joints) < LEAST_JOINTS:
        return None
    tool = tool or _tool(bodies, end)
    points = [bodies.place_m[joint.child] for joint in joints] + [bodies.place_m[tool]]
    length_m = sum(math.dist(one, other) for one, other in pairwise(points))
    names = [joint.name for joint in joints]
    named = sum(bool(LEGS.search(name)) for name in names) * 2 > len(names)
    return Limb(tuple(joints), tool, "", length_m, named or _stands(bodies, joints, end, length_m))


def _is_small(bodies: _Bodies, joint: Joint) -> bool:
    """Whether what hangs on a joint is small, beside a limb: a cover, a finger; heads are not, as necks have joints."""
    below = bodies.below(joint.child)
    return bodies.span_m(joint) < TWIG * bodies.size_m and not any(bodies.carried[bodies.body[link]] for link in below)


def _stands(bodies: _Bodies, joints: list[Joint], end: str, length_m: float) -> bool:
    """Whether a limb hangs down to the ground, where the robot has others that do not end there, or the like."""
    lowest = min(float(point[2]) for point in bodies.place_m.values())
    foot = min(float(bodies.place_m[link][2]) for link in bodies.below(end))
    hip = float(bodies.place_m[joints[0].child][2])
    return foot - lowest < 0.1 * length_m and hip - foot > 0.7 * length_m and len(bodies.carried[_trunk(bodies)]) > 1


def _trunk(bodies: _Bodies) -> str:
    """The first body that carries more than one joint."""
    at = bodies.tree.root
    while len(bodies.carried[at]) == 1:
        at = bodies.carried[at][0].child
    return at


def _tool(bodies: _Bodies, end: str) -> str:
    """The link of a hand that meets another: in front of its fingers, where there is one, and none that they move."""
    start, carried = bodies.place_m[end], bodies.carried[end]
    own = [link for link in bodies.links(end) if not SENSORS.search(link)] or [end]
    own = [link for link in own if not FINGERS.search(link)] or own
    if len(carried) == 1 and carried[0].kind in TURNING and not FINGERS.search(carried[0].child):
        own.append(carried[0].child)  # a hand that closes by one joint, on whose axis it lies
    fingers = [bodies.place_m[link] - start for joint in carried for link in bodies.below(joint.child)]
    farthest = max(own, key=lambda link: math.dist(bodies.place_m[link], start))
    way = np.mean(fingers, axis=0) if len(carried) > 1 else bodies.place_m[farthest] - start
    length = float(np.linalg.norm(way))
    if length < 1e-6:
        return max(own, key=lambda link: (bool(TOOLS.search(link)), -len(link)))
    ahead = {link: float((bodies.place_m[link] - start) @ way) / length for link in own}
    aside = {link: math.dist(bodies.place_m[link] - start, ahead[link] * way / length) for link in own}
    most = max(float(tip @ way) / length for tip in fingers) + TIP_M if len(carried) > 1 else math.inf
    inside = [link for link in own if ahead[link] <= most and aside[link] < ASIDE_M] or own
    return max(inside, key=lambda link: (round(ahead[link], 2), bool(TOOLS.search(link)), -len(link)))


def propose(path: Path, arm: str = "", tool: str = "") -> Proposal:
    """The robot file of one arm of a description.

    Args:
        path: The URDF.
        arm: "right", "left", or "" for the right one or the only one.
        tool: The link that shall meet people's hands, where another than the one found.

    Raises:
        SetupError: The description is broken, has no such arm or link, or the arm can reach no person.
    """
    bodies = _Bodies.of(read_tree(path))
    base = _base(bodies, found) if (found := [limb for limb in find_limbs(path) if not limb.leg]) else ""
    if tool:
        bodies.tree.chain(tool)  # says in one line what is wrong
        given = _limb(bodies, bodies.body[tool], tool)
        if given is None:
            problem = f"fewer than {LEAST_JOINTS} turning joints carry it"
            raise SetupError(f"--tool {tool}", problem, "name a link at the end of an arm")
        base = base or _base(bodies, [given])
        found = [given, *found]
    arms = [replace(limb, side=_side(bodies, limb, base)) for limb in found]
    chosen = arms[:1] if tool else [limb for limb in arms if limb.side == arm or not limb.side] if arm else []
    if not arm and not tool:
        chosen = [limb for limb in arms if limb.side != "left"] or arms
    if not chosen:
        raise _no_arm(path, arm, arms)
    return _proposed(bodies, base, chosen[0], [limb for limb in arms if not set(limb.names) & set(chosen[0].names)])


def _no_arm(path: Path, arm: str, arms: list[Limb]) -> SetupError:
    if arms:
        shown = ", ".join(f"a {limb.side or 'middle'} one ends in '{limb.tool_link}'" for limb in arms[:4])
        return SetupError(
            str(path), f"it has no {arm} arm", f"there are: {shown}; leave out --arm, or give --tool LINK"
        )
    legs = find_limbs(path)
    kind = f"its {len(legs)} limbs are legs ('{legs[0].names[0]}')" if legs else f"no limb has {LEAST_JOINTS} joints"
    return SetupError(str(path), f"it has no arm: {kind}", "give --tool LINK for what shall meet people's hands")


def _side(bodies: _Bodies, limb: Limb, base: str) -> str:
    """Where an arm is mounted, or else what its joints are called."""
    from_base = np.linalg.inv(bodies.pose[base])
    y = float((from_base @ bodies.pose[limb.joints[0].child])[1, 3])
    if abs(y) > ASIDE_M:
        return "left" if y > 0.0 else "right"
    return named_side(limb.names)


def _base(bodies: _Bodies, limbs: list[Limb]) -> str:
    """The link that stands in the world with axes as REP-103 has them: x to where the arms reach."""
    tree = bodies.tree
    joints = tree.chain(limbs[0].tool_link)
    loose = [place for place, joint in enumerate(joints) if joint.kind in LOOSE]
    root = joints[loose[-1]].child if loose else tree.root
    moved = {link for limb in limbs for link in bodies.below(limb.joints[0].child)}
    standing = [link for link in tree.links if link not in moved and (link == root or root in _above(tree, link))]
    forward = _forward(bodies, limbs, root)
    standing.sort(key=lambda link: len(tree.chain(link)))  # near to the root
    for link in standing:
        axes = bodies.pose[link][:3, :3]
        if float(axes[:, 0] @ forward) > FORWARD and float(axes[2, 2]) > FORWARD:
            return link
    return root


def _above(tree: KinematicTree, link: str) -> set[str]:
    return {joint.parent for joint in tree.chain(link)}


def _forward(bodies: _Bodies, limbs: list[Limb], root: str) -> FloatArray:
    """(3,) where a robot with two arms has its front, in the frame of the root: where both of them bend to.

    One arm alone says nothing of it: x of the root then.
    """
    front: FloatArray = bodies.pose[root][:3, 0].copy()
    first = limbs[0]
    twins = [limb for limb in limbs[1:] if len(limb.joints) == len(first.joints)]
    if not twins:
        return front
    shoulders = [bodies.place_m[limb.joints[0].child] for limb in (first, twins[0])]
    across = (shoulders[1] - shoulders[0])[:2]
    if np.linalg.norm(across) < ASIDE_M:
        return front
    ahead = np.array([across[1], -across[0], 0.0]) / np.linalg.norm(across)
    random = np.random.default_rng(SEED)
    way = np.zeros(3)
    for limb, shoulder in zip((first, twins[0]), shoulders, strict=True):
        lower, upper = np.array([_range(joint)[:2] for joint in limb.joints]).T
        poses = random.uniform(lower, upper, (200, len(limb.joints)))
        at = {**bodies.at, **dict(zip(limb.names, poses.T, strict=True))}
        way += (bodies.tree.pose(limb.tool_link, at)[:, :3, 3] - shoulder).mean(axis=0)
    front = ahead * (1.0 if float(way @ ahead) >= 0.0 else -1.0)
    return front


def _range(joint: Joint) -> tuple[float, float, float]:
    """Least and greatest position and speed of a joint, proposed where they are not known."""
    lower, upper, velocity = joint.limits
    if math.isnan(lower) or math.isnan(upper):
        most = math.pi if joint.kind == "continuous" else UNKNOWN_RAD
        lower, upper = -most, most
    return lower, upper, VELOCITY_RAD_S if math.isnan(velocity) else velocity


def _proposed(bodies: _Bodies, base: str, limb: Limb, others: list[Limb]) -> Proposal:
    """The robot of a limb; other arms wait as this one does."""
    rest = _rest(bodies, base, limb)
    for other in others:
        if other.side:  # a head looks straight ahead
            waiting = _Waiting(_robot(bodies, base, other, rest), other.side)
            rest.update(zip(other.names, waiting.best[0].round(2).tolist(), strict=True))
    robot = _robot(bodies, base, limb, {name: value for name, value in rest.items() if name not in limb.names})
    if robot.floor_m is None and not others and stands_on_bench(robot):
        robot = replace(robot, on_table=True, keeps_off_table=True)
    waiting = _Waiting(robot, limb.side)
    tried = [(Hands(replace(robot, home_rad=home)), home) for home in waiting.best[:3]]
    reach, home = max(tried, key=lambda each: each[0].met)
    robot = replace(robot, home_rad=read_only(home))
    robot = replace(robot, arm_links=_arm_links(robot))
    check_reach(robot)
    return Proposal(
        robot, limb.side, reach.met, reach.reachable, tuple(_checks(robot, limb, reach)), _values(robot, limb)
    )


def _robot(bodies: _Bodies, base: str, limb: Limb, rest: Mapping[str, float]) -> RobotModel:
    """The limb as a robot whose home is the middle of its joints."""
    lower, upper, velocity = (read_only(each) for each in np.array([_range(joint) for joint in limb.joints]).T)
    count = len(limb.joints)
    return RobotModel(
        name=re.sub(r"\W+", "_", Path(bodies.tree.source).stem).strip("_").lower() or "robot",
        joint_names=limb.names,
        lower_rad=lower,
        upper_rad=upper,
        velocity_rad_s=velocity,
        acceleration_rad_s2=read_only(np.full(count, ACCELERATION_RAD_S2)),
        jerk_rad_s3=read_only(np.full(count, JERK_RAD_S3)),
        home_rad=read_only((lower + upper) / 2.0),
        urdf_path=Path(bodies.tree.source),
        base_link=base,
        tool_link=limb.tool_link,
        rest=tuple((name, value) for name, value in rest.items() if name not in limb.names),
        floor_m=_floor_m(bodies, base),
    )


def _floor_m(bodies: _Bodies, base: str) -> float | None:
    """Height of the floor in the base frame, of a robot that has legs or wheels; None of an arm on a bench."""
    tree = bodies.tree
    grounded = [joint for joint in tree.by_child.values() if LEGS.search(joint.name) or DRIVES.search(joint.name)]
    if not grounded and not bodies.has_legs:
        return None
    from_base = np.linalg.inv(bodies.pose[base])
    heights = [float((from_base @ bodies.pose[link])[2, 3]) for link in tree.links]
    for solid in read_solids(Path(tree.source)):
        if solid.kind in ("cylinder", "sphere") and any(joint.child == solid.link for joint in grounded):
            centre = from_base @ bodies.pose[solid.link] @ solid.origin
            heights.append(float(centre[2, 3]) - solid.size_m[0])
    return round(min(heights), 3)


def _rest(bodies: _Bodies, base: str, limb: Limb) -> dict[str, float]:
    """Where joints stand that nothing commands: at zero, or as near as their limits let them.

    A trunk that slides is raised to the height of a person's shoulder.
    """
    tree = bodies.tree
    rest = {
        joint.name: bodies.at[joint.name]
        for joint in tree.by_child.values()
        if joint.kind not in FIXED and bodies.at[joint.name] != 0.0 and tree.followed(joint)[0] == joint.name
    }
    floor_m = _floor_m(bodies, base)
    if floor_m is None:
        return rest
    up = np.linalg.inv(bodies.pose[base])
    short_m = SHOULDER_HEIGHT_M - (float((up @ bodies.pose[limb.joints[0].child])[2, 3]) - floor_m)
    for joint in tree.chain(limb.joints[0].parent):
        rise = float((up[:3, :3] @ bodies.pose[joint.child][:3, :3] @ joint.axis)[2])
        lower, upper, _ = joint.limits
        if joint.kind in SLIDING and rise > FORWARD and not math.isnan(lower) and short_m > 0.0:
            rest[joint.name] = round(min(max(bodies.at[joint.name] + short_m, lower), upper), 2)
            short_m -= rest[joint.name] - bodies.at[joint.name]
    return rest


class _Waiting:
    """Where an arm may wait: the hand low before the shoulder, free to go anywhere, far from every limit.

    Args:
        robot: Its home is of no matter.
        side: "right", "left" or "".
    """

    def __init__(self, robot: RobotModel, side: str) -> None:
        self._robot, self._chain = robot, chain_of(robot)
        self._outward = {"right": -1.0, "left": 1.0}.get(side, 0.0)
        self._shoulder_m, self._reach_m = shoulder_and_reach_m(robot)
        self._bench = stands_on_bench(robot)
        low_m, reach_m = _ground_m(robot), self._reach_m
        height_m = max(float(self._shoulder_m[2]) - 0.3 * reach_m, low_m + 0.35 * reach_m)
        self._hand_m = np.array([float(self._shoulder_m[0]) + 0.42 * reach_m, float(self._shoulder_m[1]), height_m])
        self._low_m = low_m + 0.1 * reach_m
        self._zero = np.clip(np.zeros(len(robot.joint_names)), robot.lower_rad, robot.upper_rad)
        self._collision = Collision(robot)
        self.best = self._search()

    def _search(self) -> list[FloatArray]:
        """Postures (J,), the best first, rounded to 0.01 rad."""
        robot, random = self._robot, np.random.default_rng(SEED)
        tried = random.uniform(robot.lower_rad, robot.upper_rad, (TRIED_POSES, len(robot.joint_names)))
        ranked = sorted([(self._cost(pose), tuple(pose.tolist())) for pose in (self._zero, *tried)])[:KEPT]
        found = []
        for cost, start in ranked:
            at, spread = np.array(start), 0.3
            for _ in range(REFINED):
                other = np.clip(at + random.normal(0.0, spread, len(at)), robot.lower_rad, robot.upper_rad)
                if (better := self._cost(other)) < cost:
                    at, cost = other, better
                else:
                    spread = max(0.97 * spread, 0.02)
            rounded = np.clip(at.round(2), np.ceil(robot.lower_rad * 100) / 100, np.floor(robot.upper_rad * 100) / 100)
            clear = self._collision.clearance_m(rounded) > CLEAR_M
            found.append((not clear, cost, tuple(rounded.tolist())))
        return [np.array(pose) for _, _, pose in sorted(found)]

    def _cost(self, pose: FloatArray) -> float:
        """What speaks against waiting in a posture; 0 for nothing."""
        robot, chain = self._robot, self._chain
        frames = frames_of(pose, chain.columns, chain.offsets, chain.axes)
        joints_m = frames[1:, :3, 3]
        tool = frames[-1, :3, :3] @ chain.tool_m + frames[-1, :3, 3]
        reach = self._reach_m
        cost = 3.0 * math.dist(tool, self._hand_m) / reach
        room = np.minimum(pose - robot.lower_rad, robot.upper_rad - pose) / (robot.upper_rad - robot.lower_rad)
        cost += 3.0 * max(0.0, 0.12 - float(room.min())) + 0.02 * float(((pose - self._zero) ** 2).sum())
        jacobian = chain.jacobian(pose) / reach
        cost += 3.0 * max(0.0, 0.2 - math.sqrt(max(0.0, float(np.linalg.eigvalsh(jacobian @ jacobian.T)[0]))))
        cost += 2.0 * max(0.0, float(joints_m[:, 0].max() - tool[0])) / reach  # an elbow that pokes ahead
        way = tool - joints_m[-1] if len(joints_m) else tool
        if (length := float(np.linalg.norm(way))) > 1e-3:
            cost += 0.5 * (1.0 - float(way[0]) / length)
        cost += 5.0 * max(0.0, self._low_m - float(joints_m[1:, 2].min(initial=math.inf))) / reach
        cost += 2.0 * max(0.0, float(tool[2] - joints_m[1:, 2].min(initial=math.inf)) - 0.1 * reach) / reach
        if not self._bench:
            cost += max(0.0, float(joints_m[:, 2].max() - self._shoulder_m[2]) - 0.05) / reach
        aside = joints_m[:, 1] - self._shoulder_m[1]
        cost += 0.5 * float(np.abs(aside).mean()) / reach
        inward = -self._outward * aside
        return cost + 1.5 * max(0.0, float(inward.max()) - 0.02) / reach


def _ground_m(robot: RobotModel) -> float:
    """Height in the base frame of the floor or, where that is not known, of the lowest link that stands."""
    if robot.floor_m is not None:
        return robot.floor_m
    tree = read_tree(robot.urdf_path)
    standing = [link for link in tree.links if mount_of(robot, tree, link).frame == 0]
    return min(float(mount_of(robot, tree, link).pose[2, 3]) for link in standing)


def stands_on_bench(robot: RobotModel) -> bool:
    """Whether the shoulder is so low above what the robot stands on that the arm has to rise from there."""
    shoulder_m, reach_m = shoulder_and_reach_m(robot)
    return float(shoulder_m[2]) - _ground_m(robot) < BENCH * reach_m


class Collision:
    """Distance between parts of one robot in any posture.

    Args:
        robot: Which.
        home_counts: Whether parts that touch at home belong together; else home is one posture among others.
    """

    def __init__(self, robot: RobotModel, *, home_counts: bool = False) -> None:
        self._chain, shapes = chain_of(robot), capsules_of(robot)
        primitive = shapes.sizes_m[:, 0] > 0.0
        self._body = (shapes.mounted, shapes.ends_m, shapes.sizes_m)
        apart = np.abs(shapes.mounted[:, None] - shapes.mounted[None, :]) > NEIGHBOURS
        pairs = np.argwhere(np.triu(apart & primitive[:, None] & primitive[None, :], 1)).astype(np.float64)
        tried = np.random.default_rng(SEED).uniform(robot.lower_rad, robot.upper_rad, (100, len(robot.joint_names)))
        inside = np.mean([self._each(pose, pairs) <= 0.0 for pose in tried], axis=0) if len(pairs) else np.zeros(0)
        self._pairs = pairs[inside < ALWAYS]
        if home_counts and len(self._pairs):
            self._pairs = self._pairs[self._each(robot.home_rad, self._pairs) > 0.0]

    def _each(self, pose: FloatArray, pairs: FloatArray) -> FloatArray:
        chain = self._chain
        found: FloatArray = pair_clearances(pose[None], chain.columns, chain.offsets, chain.axes, *self._body, pairs)
        return found

    def clearance_m(self, pose: FloatArray) -> float:
        """The least of all pairs that do not always overlap."""
        return float(self._each(pose, self._pairs).min(initial=1.0))


class Hands:
    """How many hands ahead an arm meets from home, and how many it could.

    Args:
        robot: Whose arm.
        starts: From so many random postures a hand is tried as well, before it counts as out of reach.
    """

    def __init__(self, robot: RobotModel, starts: int = 8) -> None:
        solver = InverseKinematics(robot, (robot.tool_link,), MARGIN_RAD, RELENT)
        chain, collision = chain_of(robot), Collision(robot)
        random = np.random.default_rng(SEED)
        others = random.uniform(robot.lower_rad, robot.upper_rad, (starts, len(robot.joint_names)))
        self.met, self.reachable = 0, 0
        for hand_m in hands_ahead(robot):
            target = [Reach(robot.tool_link, hand_m)]
            for start in (robot.home_rad, *others):
                found = solver.step(start, target, robot.home_rad, STEPS)
                near = math.dist(chain.tool(found), hand_m) < MET_M and collision.clearance_m(found) > 0.0
                if near:
                    self.reachable += 1
                    self.met += start is robot.home_rad
                    break


def hands_ahead(robot: RobotModel, count: int = HANDS) -> FloatArray:
    """(H, 3) where people may hold out a hand before a robot, within 35 to 85 % of the reach of its arm [m].

    They are up to 40 degrees to either side of its shoulder, and as high as hands are held out.
    """
    shoulder_m, reach_m = shoulder_and_reach_m(robot)
    random = np.random.default_rng(SEED)
    found: list[FloatArray] = []
    bench = stands_on_bench(robot)
    for _ in range(100 * count):
        far, aside = random.uniform(0.35, 0.85) * reach_m, math.radians(random.uniform(-40.0, 40.0))
        rise = math.radians(random.uniform(0.0, 50.0) if bench else random.uniform(-45.0, 25.0))
        way = np.array([math.cos(rise) * math.cos(aside), math.cos(rise) * math.sin(aside), math.sin(rise)])
        hand_m = shoulder_m + far * way
        if robot.floor_m is None or 0.4 <= hand_m[2] - robot.floor_m <= 2.0:
            found.append(hand_m)
        if len(found) == count:
            break
    return np.array(found).reshape(-1, 3)


def _arm_links(robot: RobotModel) -> tuple[str, str]:
    """Shoulder and elbow: the last link that stays where it is, and the one that halves the way from there best.

    The distance from the shoulder to an elbow, and from there to the hand, should not change when the arm moves.
    """
    chain = [joint.child for joint in read_tree(robot.urdf_path).chain(robot.tool_link)]
    tried = np.random.default_rng(SEED).uniform(robot.lower_rad, robot.upper_rad, (60, len(robot.joint_names)))
    places = {link: forward_kinematics(robot, tried, link)[..., :3, 3] * np.ones((60, 1)) for link in chain}
    stays = [link for link in chain if float(np.ptp(places[link], axis=0).max()) < 1e-4]
    shoulder = stays[-1] if stays else robot.base_link
    start = places[stays[-1]] if stays else np.broadcast_to(np.zeros(3), (60, 3))
    tool = places[robot.tool_link]
    reach_m = shoulder_and_reach_m(robot)[1]
    best, elbow = -math.inf, robot.tool_link
    for link in chain[:-1]:
        if link in stays:
            continue
        upper, lower = (np.linalg.norm(places[link] - end, axis=1) for end in (start, tool))
        fit = min(float(upper.mean()), float(lower.mean())) - 2.0 * float(upper.std()) - float(lower.std())
        if fit > best + 0.01 * reach_m:
            best, elbow = fit, link
    return shoulder, elbow


def _checks(robot: RobotModel, limb: Limb, reach: Hands) -> list[str]:
    """What a person has to look at."""
    joints = limb.joints
    shoulder, elbow = robot.arm_links or ("", "")
    found = [
        f"x of base_link '{robot.base_link}' points ahead of the robot, y to its left, z up",
        f"tool_link '{robot.tool_link}' is what meets a hand; nothing of a gripper lies before it",
        f"shoulder '{shoulder}' and elbow '{elbow}' are where a person would have them",
        f"home_rad is a posture in which the arm may wait: see the picture; from it {reach.met} of {reach.reachable} "
        "hands ahead that it reaches are met",
        f"{len(joints)} joints from '{joints[0].name}' to '{joints[-1].name}' are commanded; all others stand at rest",
        "acceleration_rad_s2 and jerk_rad_s3 are cautious guesses: take the maker's",
    ]
    if unknown := [joint.name for joint in joints if math.isnan(joint.limits[0]) and joint.kind != "continuous"]:
        found.append(f"limits of {', '.join(unknown)} are guesses: the description has none")
    if unknown := [joint.name for joint in joints if math.isnan(joint.limits[2])]:
        found.append(f"velocity_rad_s of {', '.join(unknown)} is a guess: the description has none")
    if robot.on_table:
        found.append("the arm stands on a table, of 0.6 by 0.7 m, and keeps out of it: else take on_table away")
    if robot.floor_m is None:
        found.append("floor_m is not known: add the height of the floor in the base frame")
    else:
        found.append(f"the floor is {-robot.floor_m:g} m below the base frame")
    return found + [note.removeprefix(f"robot {robot.name}: ") for note in arm_notes(robot, limb.side or "right")]


def _values(robot: RobotModel, limb: Limb) -> dict[str, object]:
    """What the robot file says."""
    values: dict[str, object] = {
        "name": robot.name,
        "description": "",
        "base_link": robot.base_link,
        "tool_link": robot.tool_link,
    }
    if robot.arm_links is not None:
        values["shoulder_link"], values["elbow_link"] = robot.arm_links
    values |= {"joint_names": robot.joint_names, "home_rad": tuple(robot.home_rad.tolist())}
    if any(math.isnan(limit) for joint in limb.joints for limit in joint.limits[:2]):
        values["lower_rad"] = tuple(round(value, 3) for value in robot.lower_rad.tolist())
        values["upper_rad"] = tuple(round(value, 3) for value in robot.upper_rad.tolist())
    if any(math.isnan(joint.limits[2]) for joint in limb.joints):
        values["velocity_rad_s"] = tuple(robot.velocity_rad_s.tolist())
    values |= {"acceleration_rad_s2": ACCELERATION_RAD_S2, "jerk_rad_s3": JERK_RAD_S3}
    if robot.floor_m is not None:
        values["floor_m"] = robot.floor_m
    if robot.on_table:
        values["on_table"] = True
    values["rest"] = dict(robot.rest)
    return values
