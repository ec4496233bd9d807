# SPDX-License-Identifier: Apache-2.0
"""The judge: the robot's shapes and the people's in PyBullet, distances and speeds between them, limits of commands.

The robot is where it is commanded to be. Its shapes are those of its description, collision and visual alike, of the
links that the commanded joints move from their place: a shoulder that the first of them turns on the spot can give way
to no one, like the trunk that it is part of. Kinematics, distances and speeds are PyBullet's, nothing is the package's
own.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled
from mild_core.retargeting.robots import ROBOTS
from mild_ros.benchmark.bodies import Array, Capsule, Person, capsules_of
from mild_ros.simulation.bullet import load_pybullet
from mild_ros.simulation.quiet import quiet_terminal
from test.bench.around_people.run import Run, Setting
from test.bench.braking import SHARE, braking_joints

NEAR_M, SPEED_M_S = 0.3, 0.8
BANDS_M = (0.1, 0.15, 0.25, 0.3)
"""Upper ends of the bands of distance in which speeds are reported."""

TOWARDS_M_S = 0.03
"""A slower motion towards a person beyond the allowed speed is ignored."""

STILL_M_S, STILL_FOR_S = 0.05, 0.3
"""A body that has moved no faster than this for so long is still."""

FINE_M, FINE_S = 0.12, 0.002
"""Nearer than this distances are taken at every 2 ms, between commands too."""

GRID_M, BETWEEN_M, DEEP_M = 0.03, 0.02, 0.06
"""Points on the robot's surface are so far apart; nothing of it is nearer by more than the second, nor deeper inside of
a body by more than the third."""

STARTED_M, FALSE_START_M = 0.01, 0.02
"""A hand of the robot that has moved so far has started; unwanted, it is a false start."""

RAISED_M = 0.08
"""A person's hand this far from its rest has left it."""

KINDS = ("watched head", "watched trunk", "watched limbs", "bystander head", "bystander trunk", "bystander limbs")


@dataclass
class Judgement:
    """What one run was like.

    Attributes:
        clearance_m: Least distance by kind of body, of `KINDS`; negative where they overlap; absent where none was.
        clearance_at: What and when that was.
        offered_m: Least distance to what is offered.
        still_m_s: Largest speed of a point of the robot near a body that stands still, by band.
        moving_m_s: The same near any other.
        over_s: Time with a speed above the bound near a body that stands still, in commands.
        towards_over: Commands in which a link's nearest point moves towards a moving body faster than it may, without
            braking.
        towards_m_s: Largest excess of such a speed.
        towards_braking: Commands in which it does so while it brakes at its limits.
        commands: How many there were.
        limits: Limits that were broken.
        moved_m: How far the hand went from where it started.
        start_s: From when the person's hand left its rest to when the robot's had started; None when it did not.
        contact_m: Median distance of the hands while the offered one is held out; None where none is offered.
        counts: What the pipeline counted.
    """

    clearance_m: dict[str, float] = field(default_factory=dict)
    clearance_at: dict[str, str] = field(default_factory=dict)
    offered_m: float | None = None
    still_m_s: list[float] = field(default_factory=lambda: [0.0] * len(BANDS_M))
    moving_m_s: list[float] = field(default_factory=lambda: [0.0] * len(BANDS_M))
    still_over: int = 0
    still_at: str = ""
    towards_over: int = 0
    towards_m_s: float = 0.0
    towards_at: str = ""
    towards_braking: int = 0
    near: int = 0
    commands: int = 0
    limits: list[str] = field(default_factory=list)
    moved_m: float = 0.0
    start_s: float | None = None
    contact_m: float | None = None
    counts: dict[str, int] = field(default_factory=dict)

    def as_mapping(self) -> dict[str, Any]:
        """For a file."""
        return asdict(self)


class RobotShapes:
    """One robot in PyBullet: only what the commanded joints move can be touched."""

    def __init__(self, name: str) -> None:
        self.robot = ROBOTS[name]
        self.bullet: Any = load_pybullet()
        self.client = self.bullet.connect(self.bullet.DIRECT)
        root = ElementTree.parse(self.robot.urdf_path).getroot()
        moved = self._moved_links(root)
        samples = self._furnish(root, moved)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "judged.urdf")
            path.write_text(ElementTree.tostring(root, encoding="unicode"))
            flags = 128  # cylinders as such: URDF_USE_IMPLICIT_CYLINDER
            with quiet_terminal():
                self.body = self.bullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=self.client)
        self.joints, self.links = {}, {}
        for number in range(self.bullet.getNumJoints(self.body, physicsClientId=self.client)):
            info = self.bullet.getJointInfo(self.body, number, physicsClientId=self.client)
            self.joints[info[1].decode()] = number
            self.links[info[12].decode()] = number
        for joint, place in self.robot.rest:
            if joint in self.joints:
                self.bullet.resetJointState(self.body, self.joints[joint], place, 0.0, physicsClientId=self.client)
        self.numbers = [self.joints[joint] for joint in self.robot.joint_names]
        self.sampled = [(self.links[link], np.array(points)) for link, points in samples.items() if points]
        self.link_of = np.repeat(np.arange(len(self.sampled)), [len(points) for _, points in self.sampled])
        self.tool = self.links[self.robot.tool_link]

    def _moved_links(self, root: ElementTree.Element) -> set[str]:
        """Links that a commanded joint moves from their place: all below one but those below the first alone."""
        below: dict[str, list[tuple[str, str]]] = {}
        for joint in root.findall("joint"):
            parent, child = joint.find("parent"), joint.find("child")
            assert parent is not None
            assert child is not None
            below.setdefault(parent.get("link", ""), []).append((joint.get("name", ""), child.get("link", "")))
        moved: set[str] = set()

        def visit(link: str, below_first: bool, is_moved: bool) -> None:
            if is_moved:
                moved.add(link)
            for joint, child in below.get(link, []):
                turned = joint in self.robot.joint_names
                visit(child, below_first or turned, is_moved or (below_first and turned))

        children = {child for pairs in below.values() for _, child in pairs}
        for link in below:
            if link not in children:
                visit(link, False, False)
        return moved

    def _furnish(self, root: ElementTree.Element, moved: set[str]) -> dict[str, list[Array]]:
        """Make every shape of the moved links one to touch, and of others none; points on their surfaces, by link."""
        samples: dict[str, list[Array]] = {}
        for link in root.findall("link"):
            for part in list(link.findall("collision")):
                if link.get("name") not in moved:
                    link.remove(part)
            if link.get("name") not in moved:
                continue
            for part in link.findall("visual"):
                copy = ElementTree.SubElement(link, "collision")
                copy.extend(child for child in part if child.tag in ("origin", "geometry"))
            points = [point for part in link.findall("collision") for point in _surface(part)]
            samples[link.get("name", "")] = list({tuple(np.round(each / GRID_M)): each for each in points}.values())
        return samples

    def pose(self, positions: Array, velocities: Array | None = None) -> None:
        """Put the joints there."""
        rates = np.zeros(len(positions)) if velocities is None else velocities
        for number, place, rate in zip(self.numbers, positions.tolist(), rates.tolist(), strict=True):
            self.bullet.resetJointState(self.body, number, place, rate, physicsClientId=self.client)

    def tool_m(self) -> Array:
        """(3,) the hand; after `pose`."""
        state = self.bullet.getLinkState(self.body, self.tool, computeForwardKinematics=1, physicsClientId=self.client)
        return np.array(state[4])

    def points(self) -> tuple[Array, Array]:
        """(P, 3) points on the surface and their velocities; after `pose`."""
        numbers = [number for number, _ in self.sampled]
        states = self.bullet.getLinkStates(
            self.body, numbers, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=self.client
        )
        places, speeds = [], []
        for (_, local), state in zip(self.sampled, states, strict=True):
            turn = np.array(self.bullet.getMatrixFromQuaternion(state[5])).reshape(3, 3)
            world = local @ turn.T + state[4]
            places.append(world)
            (wx, wy, wz), (x, y, z) = state[7], (world - state[0]).T
            speeds.append(np.stack([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x], axis=1) + state[6])
        return np.concatenate(places), np.concatenate(speeds)

    def bodies(self, capsules: Sequence[Capsule], starts: Array, ends: Array) -> list[int]:
        """PyBullet's numbers of new capsules with these ends (N, 3)."""
        made = []
        for capsule, start, end in zip(capsules, starts, ends, strict=True):
            shape = self.bullet.createCollisionShape(
                self.bullet.GEOM_CAPSULE,
                radius=capsule.radius_m,
                height=float(np.linalg.norm(end - start)),
                physicsClientId=self.client,
            )
            made.append(self.bullet.createMultiBody(0.0, shape, physicsClientId=self.client))
        return made

    def distance_m(self, body: int, start: Array, end: Array) -> float:
        """Between the robot and a capsule that is put there; after `pose`."""
        along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        half = np.array([-along[1], along[0], 0.0, 1.0 + along[2]])
        turn = half / np.linalg.norm(half) if along[2] > -0.999999 else np.array([1.0, 0.0, 0.0, 0.0])
        where = {"physicsClientId": self.client}
        self.bullet.resetBasePositionAndOrientation(body, ((start + end) / 2.0).tolist(), turn.tolist(), **where)
        found = self.bullet.getClosestPoints(self.body, body, 2.0 * NEAR_M, **where)
        return min((contact[8] for contact in found), default=np.inf)

    def remove(self, bodies: Sequence[int]) -> None:
        """Take capsules away."""
        for body in bodies:
            self.bullet.removeBody(body, physicsClientId=self.client)


@lru_cache(maxsize=2)
def shapes_of(robot: str) -> RobotShapes:
    """The robot of a name, loaded once."""
    return RobotShapes(robot)


def _surface(part: ElementTree.Element) -> list[Array]:
    """Points on the surface of a primitive shape, in its link's frame."""
    origin, geometry = part.find("origin"), part.find("geometry")
    xyz = np.zeros(3) if origin is None else np.array([float(w) for w in origin.get("xyz", "0 0 0").split()])
    rpy = (0.0, 0.0, 0.0) if origin is None else tuple(float(w) for w in origin.get("rpy", "0 0 0").split())
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        return []
    if shape.tag == "box":
        size = np.array([float(word) for word in shape.get("size", "").split()])
        sides = [np.linspace(-0.5, 0.5, 1 + int(np.ceil(side / GRID_M))) for side in size]
        grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
        local = grid[(np.abs(grid) > 0.4999).any(axis=1)] * size
    elif shape.tag == "cylinder":
        radius, length = float(shape.get("radius", "0")), float(shape.get("length", "0"))
        around = np.arange(0.0, 2.0 * np.pi, min(GRID_M / radius, np.pi / 3.0))
        along = np.linspace(-0.5, 0.5, 1 + int(np.ceil(length / GRID_M))) * length
        rings = [(radius, z) for z in along] + [(radius / 2.0, z) for z in (along[0], along[-1])]
        local = np.array([[r * np.cos(angle), r * np.sin(angle), z] for r, z in rings for angle in around])
    elif shape.tag == "sphere":
        number = max(int(4.0 * np.pi * (float(shape.get("radius", "0")) / GRID_M) ** 2), 12)
        # Source: the spiral of Saff and Kuijlaars, "Distributing many points on a sphere", 1997.
        z, angle = np.linspace(-1.0, 1.0, number), np.arange(number) * np.pi * (3.0 - np.sqrt(5.0))
        flat = np.sqrt(1.0 - z * z)
        local = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1) * float(shape.get("radius", "0"))
    else:
        return []
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(angle), np.sin(angle)) for angle in rpy)
    turn = np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip
    return list(local @ turn.T + xyz)


@dataclass(frozen=True, eq=False)
class _Crowd:
    """All capsules of all people at N times.

    Attributes:
        capsules: C capsules.
        people: Whose each is; 0 for the watched person.
        radii: (C,).
        offered: (C,) whether it may be touched.
        starts: (N, C, 3) one end ...
        ends: ... and the other ...
        start_speeds: (N, C, 3) ... with their velocities ...
        end_speeds: ...
        known_start_speeds: ... and those that a tracker can have reported by then.
        known_end_speeds: ...
        still: (N, C) whether it stands still.
    """

    capsules: tuple[Capsule, ...]
    people: tuple[int, ...]
    radii: Array
    offered: Array
    starts: Array
    ends: Array
    start_speeds: Array
    end_speeds: Array
    known_start_speeds: Array
    known_end_speeds: Array
    still: Array


def _crowd(people: Sequence[Person], times_s: Array, latency_s: float) -> _Crowd:
    capsules: list[Capsule] = []
    whose: list[int] = []
    offered: list[bool] = []
    parts: list[tuple[Array, ...]] = []
    for number, person in enumerate(people):
        own = capsules_of(person.sizes)
        now, before, after = (person.points(times_s + shift) for shift in (0.0, -0.005, 0.005))
        old, older = (person.points(times_s - latency_s + shift) for shift in (0.005, -0.005))
        back = [person.points(times_s - STILL_FOR_S * share) for share in (1.0, 0.66, 0.33)]
        for capsule in own:
            ends = [now[name] for name in (capsule.start, capsule.end)]
            speeds = [(after[name] - before[name]) / 0.01 for name in (capsule.start, capsule.end)]
            still = np.ones(len(times_s), dtype=bool)
            for name, speed in zip((capsule.start, capsule.end), speeds, strict=True):
                still &= np.linalg.norm(speed, axis=1) < STILL_M_S
                for earlier in back:
                    still &= np.linalg.norm(earlier[name] - now[name], axis=1) < STILL_M_S * STILL_FOR_S
            capsules.append(capsule)
            whose.append(number)
            offered.append(number == 0 and capsule.outer and capsule.group == f"{person.offers}_arm")
            known = [(old[name] - older[name]) / 0.01 for name in (capsule.start, capsule.end)]
            parts.append((*ends, *speeds, *known, still))
    stacked = [np.stack(each, axis=1) for each in zip(*parts, strict=True)]
    radii = np.array([capsule.radius_m for capsule in capsules])
    return _Crowd(tuple(capsules), tuple(whose), radii, np.array(offered), *stacked)


def latency_s(setting: Setting) -> float:
    """How long what people do may be unknown to the robot: a picture, its message and two ticks."""
    return 1.0 / setting.tracker.rate_hz + setting.tracker.delay_s[1] + 0.02


@compiled
def _look(
    points: Array,
    speeds: Array,
    links: Array,
    starts: Array,
    ends: Array,
    start_speeds: Array,
    end_speeds: Array,
    known_start_speeds: Array,
    known_end_speeds: Array,
    radii: Array,
    still: Array,
    bands: Array,
    allowed: float,
) -> tuple[Array, Array, Array, Array]:
    """What P points on the robot, those of each of its links in a row, do near C capsules.

    Returns:
        (C,) least distance of a point to each capsule;
        (2, B) largest speed of a point by band, near those that stand still and near others;
        (3,) largest speed near those that stand still, the number of that capsule and its distance;
        (3,) largest excess of the speed of a link's nearest point towards one that moves, the number of that capsule
            and the place of the point.
    """
    middle, reach = np.zeros(3), 0.0
    for p in range(len(points)):
        middle += points[p] / len(points)
    for p in range(len(points)):
        reach = max(reach, ((points[p] - middle) ** 2).sum() ** 0.5)
    nearest = np.full(len(radii), np.inf)
    fastest = np.zeros((2, len(bands)))
    worst_still, worst_towards = np.array([0.0, -1.0, 0.0]), np.array([0.0, -1.0, -1.0])
    for c in range(len(radii)):
        ax, ay, az = ends[c] - starts[c]
        square = max(ax * ax + ay * ay + az * az, 1e-12)
        x, y, z = middle - starts[c]
        share = min(max((x * ax + y * ay + z * az) / square, 0.0), 1.0)
        x, y, z = share * ax - x, share * ay - y, share * az - z
        if (x * x + y * y + z * z) ** 0.5 - radii[c] - reach >= bands[-1]:
            continue  # too far from all of the arm
        least, closest = bands[-1], -1
        for p in range(len(points)):
            if p > 0 and links[p] != links[p - 1]:
                least, closest = bands[-1], -1
            x, y, z = points[p] - starts[c]
            share = min(max((x * ax + y * ay + z * az) / square, 0.0), 1.0)
            x, y, z = share * ax - x, share * ay - y, share * az - z
            far = (x * x + y * y + z * z) ** 0.5 - radii[c]
            nearest[c] = min(nearest[c], far)
            if far < least:
                least, closest = far, p
            if far < bands[-1]:
                vx, vy, vz = speeds[p]
                speed = (vx * vx + vy * vy + vz * vz) ** 0.5
                band = 0
                while far >= bands[band]:
                    band += 1
                row = 0 if still[c] else 1
                fastest[row, band] = max(fastest[row, band], speed)
                if still[c] and speed > worst_still[0]:
                    worst_still[0], worst_still[1], worst_still[2] = speed, c, far
            if still[c] or closest < 0 or (p + 1 < len(points) and links[p + 1] == links[p]):
                continue
            x, y, z = points[closest] - starts[c]
            share = min(max((x * ax + y * ay + z * az) / square, 0.0), 1.0)
            x, y, z = share * ax - x, share * ay - y, share * az - z
            length = max((x * x + y * y + z * z) ** 0.5, 1e-9)
            bx, by, bz = start_speeds[c] + share * (end_speeds[c] - start_speeds[c])
            kx, ky, kz = known_start_speeds[c] + share * (known_end_speeds[c] - known_start_speeds[c])
            approach = min(-(bx * x + by * y + bz * z), -(kx * x + ky * y + kz * z)) / length
            vx, vy, vz = speeds[closest]
            excess = (vx * x + vy * y + vz * z) / length - max(allowed - max(approach, 0.0), 0.0)
            if excess > worst_towards[0]:
                worst_towards[0], worst_towards[1], worst_towards[2] = excess, c, closest
    return nearest, fastest, worst_still, worst_towards


def _kind(crowd: _Crowd, index: int) -> str:
    who = "watched" if crowd.people[index] == 0 else "bystander"
    group = crowd.capsules[index].group
    return f"{who} {group if group in ('head', 'trunk') else 'limbs'}"


def judge(setting: Setting, run: Run) -> Judgement:
    """All that is judged of one run."""
    shapes = shapes_of(setting.robot)
    result = Judgement(commands=len(run.times_s), counts=run.counts)
    result.limits = exceeded_limits(setting.robot, run)
    crowd = _crowd(setting.people, run.times_s, latency_s(setting))
    bodies = shapes.bodies(crowd.capsules, crowd.starts[0], crowd.ends[0])
    model = ROBOTS[setting.robot]
    braking = braking_joints(run.times_s, run.velocities_rad_s, model.acceleration_rad_s2, model.jerk_rad_s3)
    tools = np.empty((len(run.times_s), 3))
    least = np.full((len(run.times_s), len(bodies)), np.inf)
    try:
        for k in range(len(run.times_s)):
            shapes.pose(run.positions_rad[k], run.velocities_rad_s[k])
            points, speeds = shapes.points()
            tools[k] = shapes.tool_m()
            least[k], fastest, still, towards = _seen(shapes, points, speeds, crowd, k)
            time_s = float(run.times_s[k])
            if least[k].min() < NEAR_M:
                _distances(result, shapes, crowd, bodies, k, least[k], time_s)
            is_braking = towards[0] > TOWARDS_M_S and _is_braking(shapes, run, crowd, k, towards, braking[k])
            _speeds(result, crowd, fastest, still, towards, time_s, is_braking)
        _between(result, shapes, setting, run, crowd, bodies, least)
    finally:
        shapes.remove(bodies)
    _starts(result, setting, run, tools)
    return result


def _seen(
    shapes: RobotShapes, points: Array, speeds: Array, crowd: _Crowd, k: int
) -> tuple[Array, Array, Array, Array]:
    """`_look` at one moment."""
    return _look(
        points,
        speeds,
        shapes.link_of,
        crowd.starts[k],
        crowd.ends[k],
        crowd.start_speeds[k],
        crowd.end_speeds[k],
        crowd.known_start_speeds[k],
        crowd.known_end_speeds[k],
        crowd.radii,
        crowd.still[k],
        np.array(BANDS_M),
        SPEED_M_S,
    )


def _distances(
    result: Judgement,
    shapes: RobotShapes,
    crowd: _Crowd,
    bodies: Sequence[int],
    k: int,
    least: Array,
    time_s: float,
) -> None:
    """Ask PyBullet for the distances that may be smaller than the least so far of their kind; after `pose`."""
    for index in np.argsort(least):
        if not least[index] < NEAR_M:
            break
        kind = _kind(crowd, int(index))
        known = result.clearance_m.get(kind, NEAR_M) if not crowd.offered[index] else result.offered_m or 0.1
        if least[index] < known + (BETWEEN_M if known > 0.0 else DEEP_M):
            apart = shapes.distance_m(bodies[index], crowd.starts[k, index], crowd.ends[k, index])
            _note(result, crowd, int(index), min(apart, float(least[index])), time_s)


def _note(result: Judgement, crowd: _Crowd, index: int, apart: float, time_s: float) -> None:
    if crowd.offered[index]:
        result.offered_m = apart if result.offered_m is None else min(result.offered_m, apart)
        return
    kind = _kind(crowd, index)
    if apart < result.clearance_m.get(kind, np.inf):
        result.clearance_m[kind] = float(apart)
        result.clearance_at[kind] = f"{_name(crowd, index)} at {time_s:.2f} s"


def _speeds(
    result: Judgement,
    crowd: _Crowd,
    fastest: Array,
    still: Array,
    towards: Array,
    time_s: float,
    braking: bool,
) -> None:
    """Note the speeds near people at one command."""
    result.near += bool(fastest.any())
    result.still_m_s = np.maximum(result.still_m_s, fastest[0]).tolist()
    result.moving_m_s = np.maximum(result.moving_m_s, fastest[1]).tolist()
    if still[0] > SPEED_M_S + 1e-3:
        result.still_over += 1
        if still[0] >= max(result.still_m_s):
            result.still_at = f"{still[0]:.2f} m/s, {_name(crowd, still[1])}, {still[2]:.2f} m at {time_s:.2f} s"
    excess = float(towards[0])
    if excess > TOWARDS_M_S and braking:
        result.towards_braking += 1
    elif excess > TOWARDS_M_S:
        result.towards_over += 1
        if excess > result.towards_m_s:
            result.towards_m_s, result.towards_at = excess, f"{_name(crowd, towards[1])} at {time_s:.2f} s"


def _name(crowd: _Crowd, number: float) -> str:
    """A capsule in words."""
    who = "watched" if crowd.people[int(number)] == 0 else "bystander"
    capsule = crowd.capsules[int(number)]
    return f"{who} {capsule.group}{' outer' if capsule.outer else ''}"


def _is_braking(
    shapes: RobotShapes, run: Run, crowd: _Crowd, k: int, towards: Array, braking: NDArray[np.bool_]
) -> bool:
    """Whether all joints that bring the point nearer that is too fast brake at their limits."""
    capsule, place = int(towards[1]), int(towards[2])
    shapes.pose(run.positions_rad[k])
    point = shapes.points()[0][place]
    along = crowd.ends[k, capsule] - crowd.starts[k, capsule]
    share = np.clip((point - crowd.starts[k, capsule]) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    way = crowd.starts[k, capsule] + share * along - point
    by_joint = np.empty(len(braking))
    for joint, rate in enumerate(run.velocities_rad_s[k]):
        shapes.pose(run.positions_rad[k], np.where(np.arange(len(braking)) == joint, rate, 0.0))
        by_joint[joint] = shapes.points()[1][place] @ way
    shapes.pose(run.positions_rad[k], run.velocities_rad_s[k])
    return not (by_joint > SHARE * np.maximum(by_joint, 0.0).sum())[~braking].any()


def _between(
    result: Judgement,
    shapes: RobotShapes,
    setting: Setting,
    run: Run,
    crowd: _Crowd,
    bodies: Sequence[int],
    least: Array,
) -> None:
    """Distances between commands too, wherever it is near: cubic motion from each to the next."""
    times: list[float] = []
    poses: list[Array] = []
    best = np.array([result.clearance_m.get(_kind(crowd, index), NEAR_M) for index in range(len(bodies))])
    judged = np.where(crowd.offered, np.inf, least) < np.minimum(best + BETWEEN_M, FINE_M)
    near = judged.any(axis=1)
    for k in np.flatnonzero(near[:-1] | near[1:]):
        step_s = float(run.times_s[k + 1] - run.times_s[k])
        for at in np.arange(1, max(round(step_s / FINE_S), 1)) * FINE_S / max(step_s, 1e-9):
            if at >= 1.0:
                continue
            a, b = run.positions_rad[k], run.positions_rad[k + 1]
            va, vb = run.velocities_rad_s[k] * step_s, run.velocities_rad_s[k + 1] * step_s
            cubic = (2 * at**3 - 3 * at**2 + 1) * a + (at**3 - 2 * at**2 + at) * va
            poses.append(cubic + (3 * at**2 - 2 * at**3) * b + (at**3 - at**2) * vb)
            times.append(float(run.times_s[k]) + at * step_s)
    if not times:
        return
    fine = _crowd(setting.people, np.array(times), latency_s(setting))
    for k, (time_s, pose) in enumerate(zip(times, poses, strict=True)):
        shapes.pose(pose)
        points, speeds = shapes.points()
        here = _seen(shapes, points, speeds, fine, k)[0]
        here[fine.offered] = np.inf
        # Between commands only what is nearer than at every command matters.
        known = np.array([result.clearance_m.get(_kind(fine, index), NEAR_M) for index in range(len(bodies))])
        here[here > known + GRID_M] = np.inf
        _distances(result, shapes, fine, bodies, k, here, time_s)


def _starts(result: Judgement, setting: Setting, run: Run, tools: Array) -> None:
    """When the hand started, how far it went, and how near hands came."""
    away = np.linalg.norm(tools - tools[0], axis=1)
    result.moved_m = float(away.max())
    person = setting.people[0]
    side = person.offers or ("left" if setting.parameters.get("side") == "left" else "right")
    hands = person.points(run.times_s)[f"{side}_hand"]
    from_rest = np.linalg.norm(hands - hands[0], axis=1)
    if setting.greets_s is not None:
        raised = (from_rest > RAISED_M) & (run.times_s >= setting.greets_s)
        started = away > STARTED_M
        if raised.any() and started.any():
            result.start_s = float(run.times_s[np.argmax(started)] - run.times_s[np.argmax(raised)])
    if person.offers and setting.expectation.touches:
        out = from_rest > 0.95 * from_rest.max()
        if out.any():
            result.contact_m = float(np.median(np.linalg.norm(hands - tools, axis=1)[out]))


def exceeded_limits(robot: str, run: Run) -> list[str]:
    """Limits of position, velocity, acceleration and jerk that commands break.

    Averages of speed over each step and of acceleration from one step's middle to the next can be no larger than the
    limits of the motion that they are of.
    """
    model, found = ROBOTS[robot], []
    steps = np.diff(run.times_s)
    if not (np.isfinite(run.positions_rad).all() and np.isfinite(run.velocities_rad_s).all()):
        return ["not finite"]
    paused = steps > 0.3
    slack = 1.0 + 1e-6
    if (run.positions_rad < model.lower_rad - 1e-9).any() or (run.positions_rad > model.upper_rad + 1e-9).any():
        found.append("position")
    mean = np.diff(run.positions_rad, axis=0) / np.maximum(steps, 1e-9)[:, None]
    acceleration = np.diff(run.velocities_rad_s, axis=0) / np.maximum(steps, 1e-9)[:, None]
    jerk = np.diff(acceleration, axis=0) / np.maximum(0.5 * (steps[1:] + steps[:-1]), 1e-9)[:, None]
    usable = ~paused
    # Rounding of 1e-16 rad in a step of microseconds is no motion: steps shorter than 0.1 ms are ignored.
    usable &= steps > 1e-4
    pairs = usable[1:] & usable[:-1]
    for name, values, limit, judged in (
        ("velocity", mean, model.velocity_rad_s, usable),
        ("velocity sent", run.velocities_rad_s[1:], model.velocity_rad_s, usable),
        ("acceleration", acceleration, model.acceleration_rad_s2, usable),
        ("jerk", jerk, model.jerk_rad_s3, pairs),
    ):
        excess = np.abs(values[judged]) / (limit * slack)
        if excess.size and excess.max() > 1.0 + 1e-6:
            found.append(f"{name} {excess.max():.4f} times its limit")
    return found
