# SPDX-License-Identifier: Apache-2.0
"""The camera's pose without a ruler: the arm shows its hand at some places, and a person holds theirs at it.

    people in the tracker's frame, the arm's measured joints or a tick -> requests to the arm, and what is to be said

At each place the arm stands still, measured, and the hand has to be raised, to have left the place before and to stay
for a second. From all places together follows the one rigid pose that lays hands on tools; a hand that was elsewhere is
found by what it leaves over, and asked for once more. The tool is where the measured joints put it, so an arm that is
moved by hand works as well as one that goes by itself.

Sources: S. Umeyama, "Least-Squares Estimation of Transformation Parameters Between Two Point Patterns", PAMI 1991,
without scale; outliers by the smallest set without which the rest agrees (least trimmed squares, exhaustive).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Literal

import numpy as np

from mild_core.errors import SetupError
from mild_core.retargeting.limiter import Joints
from mild_core.retargeting.robot_model.chain import Chain, chain_of
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_proposal import Collision, hands_ahead
from mild_core.retargeting.state import Request
from mild_core.shapes import FloatArray, read_only
from mild_core.signals import JointMeasurement, SkeletonFrame

FEWEST, DEFAULT_PLACES, MOST = 4, 6, 12
"""Places: three points determine a pose, and a fourth shows whether it is right."""

ARRIVED_RAD, STILL_RAD, STILL_S = 0.06, 0.01, 0.3
"""The arm is at its place when it is so near, and has moved no further than the second for the third."""

NEAR_M, CLEAR_M = 0.1, 0.02
"""The tool comes so near to a place of a hand ahead, wherever it is then; parts of the arm keep so far apart."""

TRIED = 100
"""So many places of hands are tried."""

REPEATED_S, WARNED_S = 15.0, 2.0
"""What is waited for is said again after the first time; what is in its way after the second."""

NOISY = 1.5
"""Noise alone drifts so many times its own error of a mean over half the time in one case of ten: it is tried again."""

MIRROR = np.array([-1.0, 1.0, 1.0])
DISTINCT = 2.0
"""Hands fit so much better than their mirror image, or the places do not tell left from right."""

HANGING_DEG = 30.0
"""An arm that points no further away from where the trunk does hangs."""

APART_M, LEAST_APART_M = 0.12, 0.08
"""Places are so far from each other or, of an arm that is short, so far at least."""

HARDLY_MOVED = 0.5
"""A hand that spread over less than this share of the tool's spread did not go where the tool went."""

Phase = Literal["begin", "going", "waiting", "done", "failed"]


@dataclass(frozen=True)
class CameraSettings:
    """How the camera's pose is found.

    Attributes:
        side: Of the person's hand: "right" or "left".
        places: So many are shown, or waited for.
        by_hand: Whether people move the arm: then nothing is commanded.
        hold_s: The hand has to stay at a place for so long ...
        still_m: ... and its mean no further than this from one half of that time to the other, beside what noise
            does to means, ...
        noise_m: ... which may be so large (rms from frame to frame).
        left_m: It has to have left the place before by so much.
        residual_m: Largest distance between a hand and the tool, by the fitted pose.
        error_m: Places are shown twice where hands would be placed worse than this (standard deviation).
        reach_s: The arm comes to a place within this time, or the place is left out.
        wait_s: The hand comes to a place within this time, or the place is left out.

    Raises:
        SetupError: A value is outside its range.
    """

    side: str = "right"
    places: int = DEFAULT_PLACES
    by_hand: bool = False
    hold_s: float = 1.0
    still_m: float = 0.006
    noise_m: float = 0.06
    left_m: float = 0.05
    residual_m: float = 0.035
    error_m: float = 0.004
    reach_s: float = 30.0
    wait_s: float = 60.0

    def __post_init__(self) -> None:
        if self.side not in ("right", "left"):
            raise SetupError("side", f"is '{self.side}'", "give right or left")
        if not FEWEST <= self.places <= MOST:
            raise SetupError("places", f"{self.places} is outside its range", f"give {FEWEST} to {MOST}")


@dataclass(frozen=True, eq=False)
class Taken:
    """One place at which the hand was held.

    Attributes:
        number: Of the place, from 0.
        tool_m: (3,) the tool in the robot's base frame, by the measured joints.
        hand_m: (3,) the hand's mean in the tracker's frame.
    """

    number: int
    tool_m: FloatArray
    hand_m: FloatArray


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A pose, and how well hands lie on tools by it.

    Attributes:
        pose: (4, 4) of the tracker's frame in the robot's base frame.
        residuals_m: (N,) distance of each hand from the tool.
        used: (N,) whether it counted.
        error_m: Standard deviation of where a hand is placed, over the arm's reach, by what is left over.
    """

    pose: FloatArray
    residuals_m: FloatArray
    used: tuple[bool, ...]
    error_m: float

    def text(self) -> str:
        """As the parameter `robot_from_camera` takes it: x y z roll pitch yaw [m, rad]."""
        r = self.pose[:3, :3]
        rpy = (
            math.atan2(r[2, 1], r[2, 2]),
            math.asin(max(-1.0, min(1.0, -float(r[2, 0])))),
            math.atan2(r[1, 0], r[0, 0]),
        )
        return " ".join(f"{value:.4f}" for value in (*self.pose[:3, 3].tolist(), *rpy))


@dataclass(frozen=True, eq=False)
class CameraState:
    """How far it is.

    Attributes:
        phase: What is waited for.
        left: Places that are still to be shown.
        again: Places that have been asked for once more.
        taken: Those at which the hand was held.
        since_ns: When the phase began ...
        said_ns: ... and when something was last said about it.
        joints_rad: Where the arm was measured last, ...
        still_rad: ... where it has been, nearly, ...
        still_ns: ... since when.
        hands: Stamps and places (3,) of the hand lately.
        rest_m: (3,) where it was when all began.
        frame_id: The tracker's frame.
        twice: Whether places are shown once more, as hands were not known well enough by the first time.
        fit: The pose; None before the end.
        problem: Why it failed; "" when it did not.
    """

    phase: Phase = "begin"
    left: tuple[int, ...] = ()
    again: frozenset[int] = frozenset()
    taken: tuple[Taken, ...] = ()
    since_ns: int = 0
    said_ns: int = 0
    joints_rad: Joints = ()
    still_rad: Joints = ()
    still_ns: int = 0
    hands: tuple[tuple[int, FloatArray], ...] = ()
    rest_m: FloatArray | None = None
    frame_id: str = ""
    twice: bool = False
    fit: CameraFit | None = None
    problem: str = ""


CameraOutput = Request | str
"""What the arm is to do, or what people are to hear."""

_Stepped = tuple[CameraState, tuple[CameraOutput, ...]]


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """Finds where the camera is, for one robot.

    Attributes:
        robot: Whose arm shows its hand.
        settings: How.

    Raises:
        SetupError: The arm comes to too few places.
    """

    robot: RobotModel
    settings: CameraSettings = field(default_factory=CameraSettings)
    _chain: Chain = field(init=False, repr=False)
    _places: tuple[Joints, ...] = field(init=False, repr=False)
    _reach: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_chain", chain_of(self.robot))
        places = () if self.settings.by_hand else showing_postures(self.robot, self.settings.places)
        object.__setattr__(self, "_places", places)
        object.__setattr__(self, "_reach", hands_ahead(self.robot))

    def init(self) -> CameraState:
        """The state before the first input."""
        return CameraState(left=tuple(range(len(self._places) or self.settings.places)))

    def step(
        self, state: CameraState, given: tuple[SkeletonFrame, ...] | JointMeasurement | None, now_ns: int
    ) -> _Stepped:
        """Take everyone in a tracker's message, the measured joints of the robot (all of them), or a tick."""
        if state.phase in ("done", "failed"):
            return state, ()
        if isinstance(given, JointMeasurement):
            return self._measured(state, given, now_ns), ()
        if given is not None:
            return self._seen(state, given, now_ns)
        return self._ticked(state, now_ns)

    def _measured(self, state: CameraState, given: JointMeasurement, now_ns: int) -> CameraState:
        order = [given.joint_names.index(name) for name in self.robot.joint_names]
        joints = tuple(given.positions_rad[order].tolist())
        moved = max(map(abs, np.subtract(joints, state.still_rad)), default=0.0) if state.still_rad else math.inf
        if moved > STILL_RAD:
            return replace(state, joints_rad=joints, still_rad=joints, still_ns=now_ns)
        return replace(state, joints_rad=joints)

    def _seen(self, state: CameraState, people: Sequence[SkeletonFrame], now_ns: int) -> _Stepped:
        if len(people) != 1:
            state = replace(state, hands=())
            several = f"{len(people)} people are in view: only the one whose hand is held should be" if people else ""
            return self._say(state, several, now_ns, WARNED_S) if several else (state, ())
        (person,) = people
        hand_m, lifted = _hand(person, self.settings.side)
        if hand_m is None:
            return replace(state, hands=()), ()
        if state.frame_id not in ("", person.frame_id):
            return self._failed(state, f"the tracker's frame changed from '{state.frame_id}' to '{person.frame_id}'")
        rest_m = hand_m if state.rest_m is None else state.rest_m
        state = replace(state, frame_id=person.frame_id, rest_m=rest_m)
        if not lifted:
            state = replace(state, hands=())
            other = "left" if self.settings.side == "right" else "right"
            if state.phase == "waiting" and _hand(person, other)[1] and _hand(person, other)[0] is not None:
                text = f"the {other} hand is up: hold the {self.settings.side} one at the tool, or set side to {other}"
                return self._say(state, text, now_ns, WARNED_S)
            return state, ()
        oldest_ns = now_ns - round(1.2 * self.settings.hold_s * 1e9)
        kept = tuple(entry for entry in state.hands if entry[0] >= oldest_ns)
        return replace(state, hands=(*kept, (now_ns, hand_m))), ()

    def _ticked(self, state: CameraState, now_ns: int) -> _Stepped:
        settings = self.settings
        if not state.joints_rad:
            return self._say(state, "waiting for the robot to say where it is, on joint_states", now_ns)
        waited_s = (now_ns - state.since_ns) * 1e-9
        if state.phase == "begin":
            return self._next(state, now_ns)
        number = state.left[0]
        if state.phase == "going":
            if self._stands(state, number, now_ns):
                which = f"place {number + 1}: hold the {settings.side} hand at the tool, for a second"
                return replace(state, phase="waiting", since_ns=now_ns, said_ns=now_ns, hands=()), (which,)
            if settings.by_hand:
                return self._say(state, "move the arm to another place ahead of it, and leave it there", now_ns)
            if waited_s > settings.reach_s:
                return self._skipped(state, f"the arm did not come to place {number + 1}: left out", now_ns)
            return state, ()
        if not self._stands(state, number, now_ns):
            return replace(state, phase="going", since_ns=now_ns), ()
        hand_m = self._held(state, now_ns)
        if hand_m is not None:
            tool_m = read_only(self._chain.tool(np.array(state.joints_rad)))
            state = replace(state, taken=(*state.taken, Taken(number, tool_m, hand_m)), left=state.left[1:], hands=())
            return self._next(state, now_ns, "good; ")
        if waited_s > settings.wait_s:
            text = f"no {settings.side} hand was held at place {number + 1}: left out"
            return self._skipped(state, text, now_ns)
        again = f"hold the {settings.side} hand at the tool, raised and still, for {settings.hold_s:g} s"
        return self._say(state, again, now_ns, REPEATED_S)

    def _stands(self, state: CameraState, number: int, now_ns: int) -> bool:
        """Whether the arm stands still, where it was sent or, moved by hand, where it has not been."""
        if (now_ns - state.still_ns) * 1e-9 < STILL_S:
            return False
        if self.settings.by_hand:
            tool_m = self._chain.tool(np.array(state.joints_rad))
            this_time = max(0, self.settings.places - len(state.left))  # places may be shown twice
            shown = state.taken[max(0, len(state.taken) - this_time) :] if this_time else state.taken[-1:]
            return all(math.dist(tool_m, one.tool_m) > APART_M for one in shown)
        away = np.abs(np.subtract(state.joints_rad, self._places[number]))
        return float(away.max()) < ARRIVED_RAD

    def _held(self, state: CameraState, now_ns: int) -> FloatArray | None:
        """(3,) where the hand has been held for long enough; None while it has not."""
        settings = self.settings
        recent = [entry for entry in state.hands if (now_ns - entry[0]) * 1e-9 <= settings.hold_s]
        if len(recent) < 4 or len(recent) == len(state.hands):  # not seen for all that time
            return None
        points = np.array([point for _, point in recent])
        mean, half = points.mean(axis=0), len(points) // 2
        # What changes from frame to frame is noise; a hand that moves changes little between two of them.
        noise_m = math.sqrt(float((np.diff(points, axis=0) ** 2).sum(axis=1).mean()) / 2.0)
        drift_m = math.dist(points[:half].mean(axis=0), points[half:].mean(axis=0))
        if noise_m > settings.noise_m or drift_m > settings.still_m + NOISY * noise_m / math.sqrt(half):
            return None
        before = [one.hand_m for one in state.taken[-1:]]
        if any(math.dist(mean, place) < settings.left_m for place in before):
            return None
        return read_only(mean)

    def _next(self, state: CameraState, now_ns: int, prefix: str = "") -> _Stepped:
        """Send the arm to the next place, or fit."""
        if not state.left:
            return self._finished(state, now_ns)
        state = replace(state, phase="going", since_ns=now_ns, said_ns=now_ns)
        if self.settings.by_hand:
            return state, (f"{prefix}move the arm to place {state.left[0] + 1}, ahead of it, and leave it there",)
        where = f"{prefix}the arm goes to place {state.left[0] + 1} of {len(self._places)}: keep clear of it"
        return state, (where, Request("show", self._places[state.left[0]]))

    def _skipped(self, state: CameraState, text: str, now_ns: int) -> _Stepped:
        state = replace(state, left=state.left[1:], hands=())
        if len(state.taken) + len(state.left) < FEWEST:
            return self._failed(state, f"{text}; fewer than {FEWEST} places are left")
        state, outputs = self._next(state, now_ns)
        return state, (text, *outputs)

    def _finished(self, state: CameraState, now_ns: int) -> _Stepped:
        tools, hands = (np.array([getattr(one, name) for one in state.taken]) for name in ("tool_m", "hand_m"))
        fit = fit_camera(tools, hands, self.settings.residual_m, self._reach)
        if fit is not None:
            wrong = [one for one, used in zip(state.taken, fit.used, strict=True) if not used]
            fresh = [one.number for one in wrong if one.number not in state.again]
            if fresh:
                text = f"at {_places(wrong)} the hand was elsewhere, by {_cm(fit, False)} cm: once more"
                kept = tuple(one for one, used in zip(state.taken, fit.used, strict=True) if used)
                state = replace(state, taken=kept, left=tuple(fresh), again=state.again | set(fresh))
                state, outputs = self._next(state, now_ns)
                return state, (text, *outputs)
            if fit.error_m > self.settings.error_m and not state.twice:
                text = f"over the arm's reach hands are known to {100 * fit.error_m:.1f} cm: all places once more"
                state = replace(state, left=self.init().left, twice=True)
                state, outputs = self._next(state, now_ns)
                return state, (text, *outputs)
            left_out = f"; {_places(wrong)} left out, where the hand was {_cm(fit, False)} cm away" if wrong else ""
            text = (
                f"robot_from_camera: '{fit.text()}': hands lie within {_cm(fit, True)} cm of the tool{left_out}; over "
                f"the arm's reach they are known to {100 * fit.error_m:.1f} cm"
            )
            return replace(state, phase="done", fit=fit), (text, Request("reset"))
        return self._failed(state, self._why(tools, hands))

    def _why(self, tools_m: FloatArray, hands_m: FloatArray) -> str:
        """What is wrong with hands that no pose lays on the tools."""
        side, other = self.settings.side, "left" if self.settings.side == "right" else "right"
        moved = float(np.sqrt(hands_m.var(axis=0).sum() / max(tools_m.var(axis=0).sum(), 1e-9)))
        if moved < HARDLY_MOVED:
            return (
                f"the {side} hand went {100 * moved:.0f} % as far as the tool: it was not the hand at the tool; hold "
                f"the {side} one there, or set side to {other}"
            )
        if moved > 1.0 / HARDLY_MOVED:
            return f"the {side} hand went {moved:.1f} times as far as the tool: are the tracker's units metres?"
        if float(_fit_residuals(hands_m * MIRROR, tools_m).max()) <= self.settings.residual_m:
            return "the places fit in a mirror only: an axis, or left and right, is swapped in the tracker's skeletons"
        left = _fit_residuals(hands_m, tools_m)
        return (
            f"hands are {100 * float(left.min()):.0f} to {100 * float(left.max()):.0f} cm from the tool by the best "
            f"pose: hold the {side} hand, always the same, at the tool until it moves on; the camera must not move"
        )

    def _failed(self, state: CameraState, problem: str) -> _Stepped:
        return replace(state, phase="failed", problem=problem), (f"not calibrated: {problem}", Request("reset"))

    def _say(self, state: CameraState, text: str, now_ns: int, after_s: float = REPEATED_S) -> _Stepped:
        """With something said, if it is time to say something again."""
        if state.said_ns and (now_ns - state.said_ns) * 1e-9 < after_s:
            return state, ()
        return replace(state, said_ns=now_ns), (text,)


def _places(taken: Sequence[Taken]) -> str:
    """Their numbers, for people."""
    return f"place{'s' * (len(taken) > 1)} {', '.join(str(one.number + 1) for one in taken)}"


def _cm(fit: CameraFit, used: bool) -> str:
    """The greatest residual of those that counted, or did not."""
    return f"{100 * max(float(r) for r, one in zip(fit.residuals_m, fit.used, strict=True) if one == used):.1f}"


def _hand(person: SkeletonFrame, side: str) -> tuple[FloatArray | None, bool]:
    """(3,) one hand of a person, None where it is not seen; and whether it is raised."""
    places = dict(zip(person.joint_names, person.positions_m, strict=True))

    def seen(*names: str) -> FloatArray | None:
        return next((places[name] for name in names if name in places and np.isfinite(places[name]).all()), None)

    hand_m, shoulder_m = seen(f"{side}_hand", f"{side}_wrist"), seen(f"{side}_shoulder")
    neck_m, hip_m = (
        seen("neck", "spine_chest", "head", f"{side}_shoulder"),
        seen("pelvis", f"{side}_hip", "spine_naval"),
    )
    if hand_m is None:
        return None, False
    if shoulder_m is None or neck_m is None or hip_m is None:
        return hand_m, True
    arm, down = hand_m - shoulder_m, hip_m - neck_m
    lengths = float(np.linalg.norm(arm) * np.linalg.norm(down))
    if lengths < 1e-6:
        return hand_m, True
    return hand_m, float(arm @ down) / lengths < math.cos(math.radians(HANGING_DEG))


def showing_postures(robot: RobotModel, count: int) -> tuple[Joints, ...]:
    """Postures in which an arm shows its hand at places ahead that lie as far from one plane as they can.

    The arm can go straight from home to each, and from each to the next, where there are enough of these.

    Raises:
        SetupError: It comes to too few such places.
    """
    solver, chain, collision = (
        InverseKinematics(robot, (robot.tool_link,), 0.05, 1.0),
        chain_of(robot),
        Collision(robot, home_counts=True),
    )
    postures, tools = [], []
    for place_m in hands_ahead(robot, TRIED):
        found = solver.step(robot.home_rad, [Reach(robot.tool_link, place_m)], robot.home_rad, 100)
        if math.dist(chain.tool(found), place_m) < NEAR_M and _way_is_clear(collision, robot.home_rad, found):
            postures.append(found)
            tools.append(chain.tool(found))
    chosen: list[int] = []
    for apart_m, direct in ((APART_M, True), (APART_M, False), (LEAST_APART_M, False)):
        # Where the way from one to the next is not clear, the guard of the stage leads the arm round, or stops it.
        more = chosen
        chosen = []
        while len(chosen) < count:
            clear = [
                one
                for one in range(len(tools))
                if all(math.dist(tools[one], tools[other]) > apart_m for other in chosen)
                and (not (direct and chosen) or _way_is_clear(collision, postures[chosen[-1]], postures[one]))
            ]
            if not clear:
                break
            chosen.append(max(clear, key=lambda one: _spread(np.array([tools[n] for n in (*chosen, one)]))))
        if len(chosen) == count:
            break
        chosen = max(more, chosen, key=len)
    if len(chosen) < min(count, FEWEST):
        problem = f"its arm can show its hand at {len(chosen)} places ahead, and {FEWEST} are needed"
        raise SetupError(f"robot {robot.name}", problem, "move the arm by hand: --by-hand")
    return tuple(tuple(postures[one].tolist()) for one in chosen)


def _spread(points_m: FloatArray) -> float:
    """How far some points are from one plane: the more, the better they tell a rotation."""
    return float(np.linalg.slogdet(np.cov(points_m.T, bias=True) + 1e-4 * np.eye(3))[1]) if len(points_m) > 1 else 0.0


def _way_is_clear(collision: Collision, start: FloatArray, end: FloatArray) -> bool:
    """Whether the arm keeps clear of itself on its way, or as clear as it is where that begins."""
    least_m = min(CLEAR_M, 0.9 * collision.clearance_m(start))
    return all(collision.clearance_m(start + share * (end - start)) > least_m for share in np.linspace(0.0, 1.0, 7))


def fit_camera(tools_m: FloatArray, hands_m: FloatArray, residual_m: float, reach_m: FloatArray) -> CameraFit | None:
    """The rigid pose that lays hands on tools, without those that are elsewhere; None where too few agree.

    Args:
        tools_m: (N, 3) in the robot's base frame.
        hands_m: (N, 3) in the tracker's.
        residual_m: Largest distance of a hand that counts.
        reach_m: (P, 3) places over which the error is reported.
    """
    count = len(tools_m)
    for dropped in range(min(count - FEWEST, count // 3) + 1):
        best: tuple[float, tuple[int, ...]] | None = None
        for kept in combinations(range(count), count - dropped):
            chosen = list(kept)
            left = _fit_residuals(hands_m[chosen], tools_m[chosen])
            square = float((left**2).sum())
            mirrored = float((_fit_residuals(hands_m[chosen] * MIRROR, tools_m[chosen]) ** 2).sum())
            fits = float(left.max()) <= residual_m and DISTINCT**2 * square < mirrored
            if fits and (best is None or square < best[0]):
                best = square, kept
        if best is None and float(_fit_residuals(hands_m * MIRROR, tools_m).max()) <= residual_m:
            return None  # all of them fit in a mirror: some of them fit without it too
        if best is not None:
            return _fitted(tools_m, hands_m, best[1], reach_m)
    return None


def _fitted(tools_m: FloatArray, hands_m: FloatArray, kept: tuple[int, ...], reach_m: FloatArray) -> CameraFit:
    rotation, shift = _rigid(hands_m[list(kept)], tools_m[list(kept)])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, shift
    residuals = _residuals(hands_m, tools_m, rotation, shift)
    used = tuple(number in kept for number in range(len(tools_m)))
    own = tools_m[list(kept)] - tools_m[list(kept)].mean(axis=0)
    variance = float((residuals[list(kept)] ** 2).sum()) / max(3 * len(kept) - 6, 1)
    inertia = sum((float(d @ d) * np.eye(3) - np.outer(d, d) for d in own), 1e-9 * np.eye(3))
    turned = np.linalg.inv(inertia)
    away = reach_m - tools_m[list(kept)].mean(axis=0)
    # A small rotation w moves a point by w x p: its variance is tr([p] C [p]^T) = tr(C) p.p - p.C.p.
    swung = np.trace(turned) * (away**2).sum(axis=1) - np.einsum("pi,ij,pj->p", away, turned, away)
    error = math.sqrt(variance * (3.0 / len(kept) + float(swung.mean())))
    return CameraFit(read_only(pose), read_only(residuals), used, error)


def _rigid(source_m: FloatArray, target_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(3, 3) and (3,) that bring points nearest to others: a proper rotation and a shift. Source: Umeyama 1991."""
    middle, there = source_m.mean(axis=0), target_m.mean(axis=0)
    u, _, v = np.linalg.svd((target_m - there).T @ (source_m - middle))
    rotation: FloatArray = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v)) or 1.0]) @ v
    return rotation, there - rotation @ middle


def _fit_residuals(source_m: FloatArray, target_m: FloatArray) -> FloatArray:
    """(N,) what the best pose leaves between points and others."""
    return _residuals(source_m, target_m, *_rigid(source_m, target_m))


def _residuals(source_m: FloatArray, target_m: FloatArray, rotation: FloatArray, shift: FloatArray) -> FloatArray:
    """(N,) what is left between points and others."""
    left: FloatArray = np.linalg.norm(source_m @ rotation.T + shift - target_m, axis=1)
    return left
