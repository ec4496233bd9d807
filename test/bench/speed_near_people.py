# SPDX-License-Identifier: Apache-2.0
"""How fast the robot is near people who stand still: `python -m test.bench.speed_near_people [--ticks N] [--moving]`.

Random episodes: people stand around YuMi, motions are wild, hands are offered, interactions change. The judge shares
nothing with the guard: Pinocchio says where links are and how they move; the links' own shapes (boxes, cylinders,
balls) are sampled at their surface, and the commands between two ticks along the cubic through their positions and
velocities. Every sampled point of the arm counts, with its own distance to the people's capsules.

With `--moving` people walk and wave arms about: then the robot's speed towards them, less what is left of the bound by
their own approach, and whether the arm is braking when that is above zero.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise, product

import numpy as np
import pinocchio  # type: ignore[import-untyped]

from mild_core.retargeting.person import Standing
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Retargeting, RetargetingSettings
from mild_core.retargeting.urdf import read_solids
from mild_core.shapes import FloatArray
from mild_core.signals import JointCommand, PersonPose
from test.core.retargeting import people
from test.core.retargeting.perfect import TICK_NS, measurement, window

BANDS_M = (0.1, 0.15, 0.2, 0.25, 0.3)
"""Upper ends of the bands of distance."""

BETWEEN = 4
"""Times at which the way from one tick to the next is judged."""

NEVER_NEAR_M = 0.9
"""Ticks at which the arm is further away than this are not sampled."""

TOWARDS_M_S = 0.05
"""A slower motion of a link's nearest point towards somebody is none: an arm that gives way turns so slowly."""

CLEAR_M = 0.07
"""Whoever is nearer at first may stay so."""

TOUCHES = Standing((0.9, 0.1, 0.7), np.pi, {"handshake": (0.9, 0.1, 0.7), "rocket": (0.9, 0.0, 0.8)})
UP = np.array([0.0, 0.0, 1.0])
TO_ROBOT = np.array([-1.0, 0.0, 0.0])


class Judge:
    """Where points of YuMi's right arm are and how fast they move, by Pinocchio."""

    def __init__(self) -> None:
        whole = pinocchio.buildModelFromUrdf(str(YUMI.urdf_path))
        rest, at = dict(YUMI.rest), pinocchio.neutral(whole)
        held = []
        for number, name in enumerate(whole.names):
            if number and name not in YUMI.joint_names:
                held.append(number)
                at[whole.joints[number].idx_q] = rest.get(name, 0.0)
        self._model = pinocchio.buildReducedModel(whole, held, at)
        self._data = self._model.createData()
        self._order = [self._model.joints[self._model.getJointId(name)].idx_q for name in YUMI.joint_names]
        base = self._model.getFrameId(YUMI.base_link)
        pinocchio.framesForwardKinematics(self._model, self._data, pinocchio.neutral(self._model))
        self._base = self._data.oMf[base].homogeneous.copy()
        found: dict[int, list[FloatArray]] = {}
        for solid in (*read_solids(YUMI.urdf_path), *read_solids(YUMI.urdf_path, "visual")):
            frame = self._model.getFrameId(solid.link)
            if self._model.frames[frame].parentJoint > 1:  # the first link turns on the spot
                points = _surface(solid.kind, solid.size_m) @ solid.origin[:3, :3].T + solid.origin[:3, 3]
                found.setdefault(frame, []).append(points)
        tool = self._model.getFrameId(YUMI.tool_link)
        found.setdefault(tool, []).append(np.zeros((1, 3)))
        self._points = {frame: np.concatenate(points) for frame, points in found.items()}

    @property
    def links(self) -> list[slice]:
        """Places of the points of each link."""
        ends = np.cumsum([0, *(len(local) for local in self._points.values())]).tolist()
        return [slice(start, end) for start, end in pairwise(ends)]

    def points(self, position_rad: FloatArray, velocity_rad_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N, 3) points in the base frame [m] and (N, 3) their velocities [m/s]."""
        q, v = np.empty(len(self._order)), np.empty(len(self._order))
        q[self._order], v[self._order] = position_rad, velocity_rad_s
        pinocchio.forwardKinematics(self._model, self._data, q, v)
        pinocchio.updateFramePlacements(self._model, self._data)
        places, rates = [], []
        for frame, local in self._points.items():
            pose = self._data.oMf[frame]
            speed = pinocchio.getFrameVelocity(self._model, self._data, frame, pinocchio.LOCAL_WORLD_ALIGNED)
            turned = local @ pose.rotation.T
            places.append(turned + pose.translation)
            rates.append(speed.linear + np.cross(speed.angular, turned))
        rotation, origin = self._base[:3, :3], self._base[:3, 3]
        return (np.concatenate(places) - origin) @ rotation, np.concatenate(rates) @ rotation


def _surface(kind: str, size_m: tuple[float, ...]) -> FloatArray:
    """(N, 3) points on the surface of a solid: those that are farthest out, and some between."""
    if kind == "box":
        return np.array(list(product(*[(-0.5 * edge, 0.0, 0.5 * edge) for edge in size_m])))
    angles = np.linspace(0.0, 2.0 * np.pi, 9)[:-1]
    if kind == "sphere":
        tilts = np.linspace(0.0, np.pi, 5)
        turned = [(np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)) for t in tilts for a in angles]
        return size_m[0] * np.array(turned)
    radius, length = size_m
    rows = [(radius * np.cos(a), radius * np.sin(a), z) for a in angles for z in np.array([-0.5, 0.0, 0.5]) * length]
    return np.array(rows)


def distances(points_m: FloatArray, pose: PersonPose, ahead_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(N, S) from points to surfaces of segments, (N, S, 3) directions there, (N, S) how fast segments approach."""
    known = pose.segments
    ends = known.ends_m + ahead_s * known.velocities_m_s
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    shares = np.einsum("nsk,sk->ns", points_m[:, None] - start, along) / np.maximum((along**2).sum(axis=1), 1e-12)
    shares = np.clip(shares, 0.0, 1.0)[..., None]
    way = start + shares * along - points_m[:, None]
    far = np.linalg.norm(way, axis=2)
    toward = way / np.maximum(far, 1e-9)[..., None]
    rates = known.velocities_m_s[:, 0] + shares * (known.velocities_m_s[:, 1] - known.velocities_m_s[:, 0])
    return far - known.radii_m, toward, -(toward * rates).sum(axis=2)


def between(before: JointCommand, after: JointCommand, share: float) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities on the way from one command to the next. Source: cubic Hermite interpolation."""
    during_s = (after.stamp_ns - before.stamp_ns) * 1e-9
    start, end = before.positions_rad, after.positions_rad
    leaving, coming = before.velocities_rad_s * during_s, after.velocities_rad_s * during_s
    third, second = 2.0 * (start - end) + leaving + coming, 3.0 * (end - start) - 2.0 * leaving - coming
    position = start + share * (leaving + share * (second + share * third))
    return position, (leaving + share * (2.0 * second + 3.0 * share * third)) / during_s


@dataclass
class Found:
    """What the judge saw.

    Attributes:
        ticks: So many.
        peaks_m_s: Largest speed in each band of distance, of people who stand still.
        above: Ticks above the bound.
        clear_m: Least distance to a segment that must not be touched and that was further away at first.
        towards_m_s: Largest speed towards somebody above what their approach leaves of the bound, ...
        towards: ... ticks at which it is above ...
        not_braking: ... and those of them at which the arm does not brake.
        followed: Ticks of following, so that a robot that stands still proves nothing.
    """

    ticks: int = 0
    peaks_m_s: FloatArray = field(default_factory=lambda: np.zeros(len(BANDS_M)))
    above: int = 0
    clear_m: float = np.inf
    towards_m_s: float = 0.0
    towards: int = 0
    not_braking: int = 0
    followed: int = 0


def somebody(rng: np.random.Generator, number: int) -> tuple[int, people.Ends]:
    """Somebody around the robot, the watched one before it."""
    angle = rng.uniform(-0.5, 0.5) if number == 0 else rng.uniform(-np.pi, np.pi)
    far = rng.uniform(0.55, 1.2)
    at = np.array([far * np.cos(angle), far * np.sin(angle), 0.0])
    shoulders, hips = at + rng.uniform(0.3, 0.8) * UP, at + rng.uniform(-0.3, 0.0) * UP
    hand = at * rng.uniform(0.25, 0.8) + np.array([0.0, rng.normal(0.0, 0.15), rng.uniform(-0.1, 0.5)])
    return number, people.body_ends(hand, shoulders + 0.25 * UP, shoulders, hips)


def pose_of(stamp_ns: int, bodies: list[tuple[int, people.Ends]], rest: bool, drift_m_s: FloatArray) -> PersonPose:
    """The message of these people; at first the watched hand rests elsewhere."""
    known, ends = people.segments(bodies, drift_m_s), bodies[0][1]
    hand = ends["right_forearm"][1] - people.HAND_M * _along(ends["right_forearm"])
    if rest:
        hand = hand + np.array([0.2, 0.0, -0.3])
    return PersonPose(stamp_ns, "robot", hand, ends["head"][0], np.array(ends["trunk"]), known, TO_ROBOT)


def _along(ends: tuple[FloatArray, FloatArray]) -> FloatArray:
    way: FloatArray = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
    return way


def episode(seed: int, seconds: float, moving: bool) -> Iterator[tuple[JointCommand, JointCommand, PersonPose]]:
    """Commands in pairs and the people then."""
    rng = np.random.default_rng(seed)
    settings = RetargetingSettings(
        ik=rng.choice(["off", "blend", "only"]),
        ramp_velocity_rad_s=float(rng.choice([1.0, 4.0, 10.0])),
        start_watch_s=0.0,
        start_evidence=0.0,
        start_reach_m=0.0,
    )
    stage = Retargeting(YUMI, settings, TOUCHES)
    now_ns = 1_700_000_000_000_000_000
    state, _ = stage.step(stage.init(), measurement(YUMI.home_rad), now_ns)
    bodies = [somebody(rng, number) for number in range(rng.integers(1, 4))]
    drift = rng.normal(0.0, 0.4, 3) * np.array([1.0, 1.0, 0.2]) if moving else np.zeros(3)
    goal, before = np.array(YUMI.home_rad), None
    newest = pose_of(now_ns, bodies, True, drift)
    for tick in range(round(seconds * 100)):
        made: list[JointCommand] = []
        now_ns += TICK_NS + int(rng.integers(-3_000_000, 3_000_000))
        if moving and tick % 40 == 0:
            drift = rng.normal(0.0, 0.5, 3) * np.array([1.0, 1.0, 0.2])
        if tick % 3 == 0:
            if moving:
                bodies = [(number, people.shifted(ends, 0.03 * drift)) for number, ends in bodies]
            newest = pose_of(now_ns, bodies, tick < 30, drift)
            state, _ = stage.step(state, newest, now_ns)
            if rng.random() < 0.02:
                goal = rng.uniform(YUMI.lower_rad, YUMI.upper_rad)
            elif rng.random() < 0.05:
                goal = YUMI.home_rad + rng.normal(0.0, 0.6, 7)
            name = "handshake" if (tick // 300) % 2 == 0 else rng.choice(["hand_wave", "handshake"])
            state, new = stage.step(state, window(np.tile(goal, (40, 1)), now_ns, interaction=str(name)), now_ns)
            made += new
        state, new = stage.step(state, None, now_ns)
        for command in (*made, *new):
            if before is not None:
                yield before, command, newest
            before = command


def judged(seeds: range, seconds: float, moving: bool, every: int = 1) -> Found:
    """What the judge sees of some episodes, looking at each `every`-th way from tick to tick."""
    judge, found = Judge(), Found()
    bound = RetargetingSettings().near_speed_m_s
    for seed in seeds:
        kept = None
        for number, (before, after, pose) in enumerate(episode(seed, seconds, moving)):
            found.ticks += 1
            found.followed += after.mode == "following"
            if number % every:
                continue
            points, _ = judge.points(after.positions_rad, after.velocities_rad_s)
            clear = distances(points, pose, 0.0)[0].min(axis=0)
            if kept is None:
                kept = (clear > CLEAR_M) & (np.array(pose.segments.parts) != "right_forearm")
            if clear.min() > NEVER_NEAR_M:
                continue
            fastest = beyond = 0.0
            for share in np.linspace(0.0, 1.0, BETWEEN + 1)[1:]:
                at_ns = before.stamp_ns + share * (after.stamp_ns - before.stamp_ns)
                points, rates = judge.points(*between(before, after, share))
                far, toward, coming = distances(points, pose, (at_ns - pose.stamp_ns) * 1e-9)
                speeds, nearest = np.linalg.norm(rates, axis=1), far.min(axis=1)
                for band, (least, most) in enumerate(pairwise((-np.inf, *BANDS_M))):
                    there = speeds[(nearest >= least) & (nearest < most)]
                    found.peaks_m_s[band] = max(found.peaks_m_s[band], there.max(initial=0.0))
                fastest = max(fastest, speeds[nearest < BANDS_M[-1]].max(initial=0.0))
                closing = np.einsum("nk,nsk->ns", rates, toward) - np.maximum(bound - np.maximum(coming, 0.0), 0.0)
                for link in judge.links:
                    nearest_of = far[link].argmin(axis=0), np.arange(far.shape[1])
                    # Inside somebody who ran into the arm there is no way towards them.
                    apart = far[link][nearest_of]
                    over = np.where((apart > 0.0) & (apart < BANDS_M[-1]), closing[link][nearest_of], 0.0)
                    beyond = max(beyond, over.max(initial=0.0))
                found.clear_m = min(found.clear_m, float(far[:, kept].min(initial=np.inf)))
            found.above += fastest > bound
            found.towards_m_s = max(found.towards_m_s, beyond)
            found.towards += beyond > TOWARDS_M_S
            slower = np.abs(after.velocities_rad_s).sum() <= np.abs(before.velocities_rad_s).sum() + 1e-9
            found.not_braking += beyond > TOWARDS_M_S and not slower
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--moving", action="store_true")
    given = parser.parse_args()
    seeds = range(given.first, given.first + max(1, given.ticks // 1000))
    found = judged(seeds, 10.0, given.moving)
    print(f"{found.ticks} ticks, {found.followed} of them following; least distance kept {found.clear_m:.3f} m")
    for most, peak in zip(BANDS_M, found.peaks_m_s, strict=True):
        print(f"nearer than {most:4.2f} m: at most {peak:.3f} m/s")
    print(f"above the bound: {found.above} ticks")
    print(
        f"towards people above what their approach leaves: {found.towards} ticks, at most {found.towards_m_s:.3f} m/s, "
        f"{found.not_braking} of them not braking"
    )


if __name__ == "__main__":
    main()
