# SPDX-License-Identifier: Apache-2.0
"""How fast the robot is near people who stand still: `python -m test.bench.speed_near_people [--ticks N] [--moving]`.

Random episodes: people stand around YuMi, motions are wild, hands are offered, interactions change. The judge shares
nothing with the guard: the robot's joints are Pinocchio's; the links' own shapes (boxes, cylinders, balls) are sampled
at their surface, and the commands between two ticks along the cubic through their positions and velocities. Every
sampled point of the arm counts, with its own distance to the people's capsules, and inside of them too.

With `--moving` people walk and wave arms about: then the robot's speed towards them, less what is left of the bound by
their own approach, and whether the arm is braking at its limits when that is above zero (`braking.py`).

A million ticks are a thousand episodes of about a second each, of two or three where people move; with `--json FILE`
every episode is kept there, and a second call goes on from it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio  # type: ignore[import-untyped]

from mild_core.compiled import compiled
from mild_core.errors import SetupError
from mild_core.retargeting.human_track import AssumedPlacement
from mild_core.retargeting.robot_model.urdf import read_solids
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Retargeting, RetargetingSettings
from mild_core.shapes import FloatArray
from mild_core.signals import JointCommand, PersonPose
from test.bench.braking import SHARE, braking_joints
from test.core.retargeting import people
from test.core.retargeting.perfect import TICK_NS, measurement, window

ROOT = Path(__file__).resolve().parents[2]

BANDS_M = (0.1, 0.15, 0.2, 0.25, 0.3)
"""Upper ends of the bands of distance."""

BETWEEN = 4
"""Times at which the way from one tick to the next is judged."""

EPISODE_S = 10.0

TOWARDS_M_S = 0.05
"""A slower motion of a link's nearest point towards a person beyond the allowed speed is ignored: an arm that gives way
turns so slowly."""

CLEAR_M = 0.07
"""A person who is closer at first may stay so."""

TOUCHES = AssumedPlacement((0.9, 0.1, 0.7), np.pi, {"handshake": (0.9, 0.1, 0.7), "rocket": (0.9, 0.0, 0.8)})
UP = np.array([0.0, 0.0, 1.0])
TO_ROBOT = np.array([-1.0, 0.0, 0.0])


class Judge:
    """Where points of YuMi's right arm are and how fast they move, by Pinocchio's model of its joints.

    Attributes:
        placements: (J, 4, 4) of each joint in the one before, the first in the base frame; all turn about their z.
        columns: (J,) place of each joint among the commanded ones.
        points_m: (N, 3) points on the surface, in the frame of ...
        joints: (N,) ... this joint, ascending.
        balls_m: (J, 4) middle and radius of a ball around the points of each joint, in its frame.
    """

    def __init__(self) -> None:
        whole = pinocchio.buildModelFromUrdf(str(YUMI.urdf_path))
        rest, at = dict(YUMI.rest), pinocchio.neutral(whole)
        held = []
        for number, name in enumerate(whole.names):
            if number and name not in YUMI.joint_names:
                held.append(number)
                at[whole.joints[number].idx_q] = rest.get(name, 0.0)
        model = pinocchio.buildReducedModel(whole, held, at)
        self._model, self._data = model, model.createData()
        assert all(joint.shortname() == "JointModelRZ" for joint in list(model.joints)[1:])
        assert list(model.parents)[1:] == list(range(model.njoints - 1))
        base = model.frames[model.getFrameId(YUMI.base_link)]
        self._base = base.placement.homogeneous
        self.placements = np.array([each.homogeneous for each in list(model.jointPlacements)[1:]])
        self.placements[0] = np.linalg.inv(self._base) @ self.placements[0]
        self.columns = np.array([YUMI.joint_names.index(name) for name in list(model.names)[1:]])
        points, joints = [], []
        for solid in (*read_solids(YUMI.urdf_path), *read_solids(YUMI.urdf_path, "visual")):
            frame = model.frames[model.getFrameId(solid.link)]
            if frame.parentJoint > 1:  # the first link turns on the spot
                pose = frame.placement.homogeneous @ solid.origin
                points.append(_surface(solid.kind, solid.size_m) @ pose[:3, :3].T + pose[:3, 3])
                joints.append(np.full(len(points[-1]), frame.parentJoint - 1))
        tool = model.frames[model.getFrameId(YUMI.tool_link)]
        points.append(tool.placement.translation[None])
        joints.append(np.array([tool.parentJoint - 1]))
        order = np.argsort(np.concatenate(joints), kind="stable")
        self.points_m, self.joints = np.concatenate(points)[order], np.concatenate(joints)[order]
        self.balls_m = np.zeros((len(self.columns), 4))
        for joint in np.unique(self.joints):
            own = self.points_m[self.joints == joint]
            middle = (own.min(axis=0) + own.max(axis=0)) / 2.0
            self.balls_m[joint] = *middle, np.linalg.norm(own - middle, axis=1).max()

    def points(self, position_rad: FloatArray, velocity_rad_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N, 3) points in the base frame [m] and (N, 3) their velocities [m/s], as Pinocchio moves them.

        The oracle of `_placed`, which is quicker.
        """
        q, v = np.empty(len(self.columns)), np.empty(len(self.columns))
        q[:], v[:] = position_rad[self.columns], velocity_rad_s[self.columns]
        pinocchio.forwardKinematics(self._model, self._data, q, v)
        places, rates = np.empty_like(self.points_m), np.empty_like(self.points_m)
        for joint in range(1, self._model.njoints):
            pose, own = self._data.oMi[joint], self.joints == joint - 1
            speed = pinocchio.getVelocity(self._model, self._data, joint, pinocchio.LOCAL_WORLD_ALIGNED)
            turned = self.points_m[own] @ pose.rotation.T
            places[own] = turned + pose.translation
            rates[own] = speed.linear + np.cross(speed.angular, turned)
        rotation, origin = self._base[:3, :3], self._base[:3, 3]
        return (places - origin) @ rotation, rates @ rotation

    def look(self, commands: Commands, shown: Shown, bound_m_s: float) -> Looks:
        """What there is to see on the way to each command but the first."""
        return Looks(
            *_look(
                *(self.placements, self.columns, self.points_m, self.joints, self.balls_m),
                *(commands.times_s, commands.positions_rad, commands.velocities_rad_s),
                *(shown.of, shown.times_s, shown.ends_m, shown.velocities_m_s, shown.radii_m),
                *(np.array(BANDS_M), bound_m_s, BETWEEN),
            )
        )


@dataclass(frozen=True, eq=False)
class Commands:
    """N commands of an episode.

    Attributes:
        times_s: (N,).
        positions_rad: (N, J).
        velocities_rad_s: (N, J).
        following: How many of them follow a motion.
    """

    times_s: FloatArray
    positions_rad: FloatArray
    velocities_rad_s: FloatArray
    following: int


@dataclass(frozen=True, eq=False)
class Shown:
    """M messages of S segments each.

    Attributes:
        of: (N,) the newest message at each command.
        times_s: (M,) of the messages.
        ends_m: (M, S, 2, 3) ...
        velocities_m_s: (M, S, 2, 3) ... which move on like this.
        radii_m: (S,).
        kept: (S,) whether a segment must not be touched.
    """

    of: FloatArray
    times_s: FloatArray
    ends_m: FloatArray
    velocities_m_s: FloatArray
    radii_m: FloatArray
    kept: FloatArray


@dataclass(frozen=True, eq=False)
class Looks:
    """What was seen on the way to each of N commands.

    Attributes:
        peaks_m_s: (N, B) largest speed of a point by band of its distance.
        clear_m: (N, S) least distance to each segment.
        beyond_m_s: (N,) by how much, at the command, the point of a link that is nearest to a segment, and within the
            last band of it, is too fast towards it.
        inside_m_s: (N,) the same of points inside of a body that has run into the arm, towards its axis.
        by_joint: (N, J) what each joint adds to the speed of the point of `beyond_m_s`.
    """

    peaks_m_s: FloatArray
    clear_m: FloatArray
    beyond_m_s: FloatArray
    inside_m_s: FloatArray
    by_joint: FloatArray


@compiled
def _placed(
    placements: FloatArray,
    columns: FloatArray,
    points_m: FloatArray,
    joints: FloatArray,
    position_rad: FloatArray,
    frames: FloatArray,
    points: FloatArray,
) -> None:
    """Fill in (J, 4, 4) frames of joints and (N, 3) points in the base frame."""
    for joint in range(len(columns)):
        s, c = np.sin(position_rad[columns[joint]]), np.cos(position_rad[columns[joint]])
        for i in range(3):
            if joint == 0:
                x, y, z = placements[0, i, 0], placements[0, i, 1], placements[0, i, 2]
                at = placements[0, i, 3]
            else:
                x, y, z, at = 0.0, 0.0, 0.0, frames[joint - 1, i, 3]
                for k in range(3):
                    before = frames[joint - 1, i, k]
                    x += before * placements[joint, k, 0]
                    y += before * placements[joint, k, 1]
                    z += before * placements[joint, k, 2]
                    at += before * placements[joint, k, 3]
            frames[joint, i, 0], frames[joint, i, 1] = c * x + s * y, c * y - s * x
            frames[joint, i, 2], frames[joint, i, 3] = z, at
    for point in range(len(points_m)):
        frame = frames[joints[point]]
        for i in range(3):
            points[point, i] = frame[i, 3]
            for k in range(3):
                points[point, i] += frame[i, k] * points_m[point, k]


@compiled
def _lever(frames: FloatArray, joint: int, point: FloatArray) -> tuple[float, float, float]:
    """Velocity of a point when a joint turns at 1 rad/s."""
    x, y, z = point[0] - frames[joint, 0, 3], point[1] - frames[joint, 1, 3], point[2] - frames[joint, 2, 3]
    ax, ay, az = frames[joint, 0, 2], frames[joint, 1, 2], frames[joint, 2, 2]
    return ay * z - az * y, az * x - ax * z, ax * y - ay * x


@compiled
def _move(
    frames: FloatArray,
    joint: int,
    columns: FloatArray,
    velocity_rad_s: FloatArray,
    firsts: FloatArray,
    points: FloatArray,
    rates: FloatArray,
) -> None:
    """Fill in (N, 3) the velocities of the points of a joint."""
    for p in range(firsts[joint], firsts[joint + 1]):
        rates[p] = 0.0
        for other in range(joint + 1):
            x, y, z = _lever(frames, other, points[p])
            rate = velocity_rad_s[columns[other]]
            rates[p, 0] += rate * x
            rates[p, 1] += rate * y
            rates[p, 2] += rate * z


@compiled
def _apart(point: FloatArray, start: FloatArray, along: FloatArray, square: float) -> tuple[float, float]:
    """Distance from a point to a straight line with an end, and the share of the way along it where it is least."""
    share, far = 0.0, 0.0
    for i in range(3):
        share += (point[i] - start[i]) * along[i]
    share = min(max(share / square, 0.0), 1.0)
    for i in range(3):
        far += (start[i] + share * along[i] - point[i]) ** 2
    return max(np.sqrt(far), 1e-9), share


@compiled
def _look(
    placements: FloatArray,
    columns: FloatArray,
    points_m: FloatArray,
    joints: FloatArray,
    balls_m: FloatArray,
    times_s: FloatArray,
    positions_rad: FloatArray,
    velocities_rad_s: FloatArray,
    of: FloatArray,
    shown_s: FloatArray,
    ends_m: FloatArray,
    ends_m_s: FloatArray,
    radii_m: FloatArray,
    bands_m: FloatArray,
    bound_m_s: float,
    between: int,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """The five of `Looks`, for commands that come by the cubic from each to the next."""
    count, turning, others = len(times_s), len(columns), len(radii_m)
    peaks, clear = np.zeros((count, len(bands_m))), np.full((count, others), np.inf)
    beyond, inside, by_joint = np.zeros(count), np.zeros(count), np.zeros((count, turning))
    frames, points, rates = np.zeros((turning, 4, 4)), np.empty_like(points_m), np.empty_like(points_m)
    position, velocity, nearest = np.empty(turning), np.empty(turning), np.empty(len(points_m))
    a, along, middle, way = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    moved = np.empty(turning, dtype=np.bool_)
    firsts = np.zeros(turning + 1, dtype=np.int64)  # of the points of each joint
    for p in range(len(joints)):
        firsts[joints[p] + 1 :] += 1
    for k in range(1, count):
        during = times_s[k] - times_s[k - 1]
        for part in range(1, between + 1):
            s = part / between
            for j in range(turning):
                start, end = positions_rad[k - 1, j], positions_rad[k, j]
                leaving, coming = velocities_rad_s[k - 1, j] * during, velocities_rad_s[k, j] * during
                third, second = 2.0 * (start - end) + leaving + coming, 3.0 * (end - start) - 2.0 * leaving - coming
                position[j] = start + s * (leaving + s * (second + s * third))
                velocity[j] = (leaving + s * (2.0 * second + 3.0 * s * third)) / during
            _placed(placements, columns, points_m, joints, position, frames, points)
            nearest[:] = np.inf
            moved[:] = False
            now = of[k - 1]  # what is shown at a command's own time is known from then on
            ahead = times_s[k - 1] + s * during - shown_s[now]
            for c in range(others):
                square = 0.0
                for i in range(3):
                    a[i] = ends_m[now, c, 0, i] + ahead * ends_m_s[now, c, 0, i]
                    along[i] = ends_m[now, c, 1, i] + ahead * ends_m_s[now, c, 1, i] - a[i]
                    square += along[i] ** 2
                square = max(square, 1e-12)
                for j in range(turning):
                    if firsts[j] == firsts[j + 1]:
                        continue
                    for i in range(3):
                        middle[i] = frames[j, i, 3]
                        for n in range(3):
                            middle[i] += frames[j, i, n] * balls_m[j, n]
                    far, _ = _apart(middle, a, along, square)
                    if far - radii_m[c] - balls_m[j, 3] >= bands_m[-1]:
                        continue
                    if not moved[j]:
                        moved[j] = True
                        _move(frames, j, columns, velocity, firsts, points, rates)
                    least, closest, at = bands_m[-1], -1, 0.0
                    for p in range(firsts[j], firsts[j + 1]):
                        far, share = _apart(points[p], a, along, square)
                        nearest[p] = min(nearest[p], far - radii_m[c])
                        clear[k, c] = min(clear[k, c], far - radii_m[c])
                        if far - radii_m[c] < least:
                            least, closest, at = far - radii_m[c], p, share
                    if closest < 0 or part < between:
                        continue
                    to, coming = 0.0, 0.0
                    for i in range(3):
                        way[i] = (a[i] + at * along[i] - points[closest, i]) / max(least + radii_m[c], 1e-9)
                        to += way[i] * rates[closest, i]
                        first, last = ends_m_s[now, c, 0, i], ends_m_s[now, c, 1, i]
                        coming -= way[i] * (first + at * (last - first))
                    excess = to - max(bound_m_s - max(coming, 0.0), 0.0)
                    if least <= 0.0:
                        inside[k] = max(inside[k], excess)
                    elif excess > beyond[k]:
                        beyond[k] = excess
                        for other in range(turning):
                            by_joint[k, columns[other]] = 0.0
                            if other > j:
                                continue
                            for i, lever in enumerate(_lever(frames, other, points[closest])):
                                by_joint[k, columns[other]] += way[i] * lever * velocity[columns[other]]
            for p in range(len(points)):
                if nearest[p] < bands_m[-1]:
                    band = 0
                    while nearest[p] >= bands_m[band]:
                        band += 1
                    speed = np.sqrt(rates[p, 0] ** 2 + rates[p, 1] ** 2 + rates[p, 2] ** 2)
                    peaks[k, band] = max(peaks[k, band], speed)
    return peaks, clear, beyond, inside, by_joint


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


@dataclass
class Found:
    """What the judge saw.

    Attributes:
        ticks: So many commands.
        near: Those of them with a point of the arm within the last band of a person.
        peaks_m_s: Largest speed in each band of distance, of people who stand still.
        above: Commands above the bound.
        clear_m: Least distance to a segment that must not be touched and that was further away at first.
        towards_m_s: Largest speed towards a person above what their approach leaves of the bound, ...
        towards: ... commands at which it is above ...
        not_braking: ... those of them at which the arm does not brake at its limits ...
        not_braking_m_s: ... and the largest such speed there.
        inside: Commands at which a point inside of a body that has run into the arm is above, ...
        inside_m_s: ... and the largest such speed there.
        worst: Seed and time [s] of the last.
        followed: Commands of following, so that a robot that stands still proves nothing.
    """

    ticks: int = 0
    near: int = 0
    peaks_m_s: list[float] = field(default_factory=lambda: [0.0] * len(BANDS_M))
    above: int = 0
    clear_m: float = np.inf
    towards_m_s: float = 0.0
    towards: int = 0
    not_braking: int = 0
    not_braking_m_s: float = 0.0
    inside: int = 0
    inside_m_s: float = 0.0
    worst: tuple[int, float] = (-1, 0.0)
    followed: int = 0

    def add(self, other: Found) -> None:
        """Both together."""
        if other.not_braking_m_s > self.not_braking_m_s:
            self.not_braking_m_s, self.worst = other.not_braking_m_s, other.worst
        for name in ("ticks", "near", "above", "towards", "not_braking", "inside", "followed"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.peaks_m_s = np.maximum(self.peaks_m_s, other.peaks_m_s).tolist()
        self.clear_m = min(self.clear_m, other.clear_m)
        self.towards_m_s = max(self.towards_m_s, other.towards_m_s)
        self.inside_m_s = max(self.inside_m_s, other.inside_m_s)


def some_person(rng: np.random.Generator, number: int) -> tuple[int, people.Ends]:
    """A person around the robot, the watched one before it."""
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


def episode(seed: int, seconds: float, moving: bool) -> tuple[Commands, Shown]:
    """What the robot is commanded, and the people."""
    rng = np.random.default_rng(seed)
    settings = RetargetingSettings(
        ik=str(rng.choice(["off", "blend", "only"])),
        ramp_velocity_rad_s=float(rng.choice([1.0, 4.0, 10.0])),
        start_watch_s=0.0,
        start_evidence=0.0,
        start_reach_m=0.0,
    )
    stage = Retargeting(YUMI, settings, TOUCHES)
    start_ns = now_ns = 1_700_000_000_000_000_000
    state, _ = stage.step(stage.init(), measurement(YUMI.home_rad), now_ns)
    bodies = [some_person(rng, number) for number in range(rng.integers(1, 4))]
    drift = rng.normal(0.0, 0.4, 3) * np.array([1.0, 1.0, 0.2]) if moving else np.zeros(3)
    goal = np.array(YUMI.home_rad)
    poses = [pose_of(now_ns, bodies, True, drift)]
    commands: list[JointCommand] = []
    of: list[int] = []
    for tick in range(round(seconds * 100)):
        now_ns += TICK_NS + int(rng.integers(-3_000_000, 3_000_000))
        if moving and tick % 40 == 0:
            drift = rng.normal(0.0, 0.5, 3) * np.array([1.0, 1.0, 0.2])
        if tick % 3 == 0:
            if moving:
                bodies = [(number, people.shifted(ends, 0.03 * drift)) for number, ends in bodies]
            poses.append(pose_of(now_ns, bodies, tick < 30, drift))
            state, _ = stage.step(state, poses[-1], now_ns)
            if rng.random() < 0.02:
                goal = rng.uniform(YUMI.lower_rad, YUMI.upper_rad)
            elif rng.random() < 0.05:
                goal = YUMI.home_rad + rng.normal(0.0, 0.6, 7)
            name = "handshake" if (tick // 300) % 2 == 0 else rng.choice(["hand_wave", "handshake"])
            state, new = stage.step(state, window(np.tile(goal, (40, 1)), now_ns, interaction=str(name)), now_ns)
            commands += new
        state, new = stage.step(state, None, now_ns)
        commands += new
        of += [len(poses) - 1] * (len(commands) - len(of))
    parts = np.array(poses[0].segments.parts)
    return Commands(
        np.array([(command.stamp_ns - start_ns) * 1e-9 for command in commands]),
        np.array([command.positions_rad for command in commands]),
        np.array([command.velocities_rad_s for command in commands]),
        sum(command.mode == "following" for command in commands),
    ), Shown(
        np.array(of),
        np.array([(pose.stamp_ns - start_ns) * 1e-9 for pose in poses]),
        np.array([pose.segments.ends_m for pose in poses]),
        np.array([pose.segments.velocities_m_s for pose in poses]),
        np.array(poses[0].segments.radii_m),
        parts != "right_forearm",
    )


def judged_one(seed: int, seconds: float, moving: bool, judge: Judge | None = None) -> Found:
    """What the judge sees of an episode."""
    commands, shown = episode(seed, seconds, moving)
    bound = RetargetingSettings().near_speed_m_s
    looks = (judge or Judge()).look(commands, shown, bound)
    kept = (looks.clear_m[1] > CLEAR_M) & shown.kept
    fastest, over = looks.peaks_m_s.max(axis=1), looks.beyond_m_s > TOWARDS_M_S
    hard = braking_joints(commands.times_s, commands.velocities_rad_s, YUMI.acceleration_rad_s2, YUMI.jerk_rad_s3)
    matters = looks.by_joint > SHARE * np.maximum(looks.by_joint, 0.0).sum(axis=1, keepdims=True)
    free = np.where(over & (matters & ~hard).any(axis=1), looks.beyond_m_s, 0.0)
    return Found(
        ticks=len(fastest) - 1,
        near=int((fastest > 0.0).sum()),
        peaks_m_s=looks.peaks_m_s.max(axis=0).tolist(),
        above=int((fastest > bound).sum()),
        clear_m=float(looks.clear_m[1:, kept].min(initial=np.inf)),
        towards_m_s=float(looks.beyond_m_s.max()),
        towards=int(over.sum()),
        not_braking=int((free > 0.0).sum()),
        not_braking_m_s=float(free.max()),
        inside=int((looks.inside_m_s > TOWARDS_M_S).sum()),
        inside_m_s=float(looks.inside_m_s.max()),
        worst=(seed, round(float(commands.times_s[free.argmax()]), 3)),
        followed=commands.following,
    )


def judged(seeds: Iterable[int], seconds: float, moving: bool) -> Found:
    """What the judge sees of some episodes."""
    judge, found = Judge(), Found()
    for seed in seeds:
        found.add(judged_one(seed, seconds, moving, judge))
    return found


def _work(job: tuple[int, bool]) -> tuple[int, Found]:
    return job[0], judged_one(job[0], EPISODE_S, job[1])


def _digest() -> str:
    """Changes with all code that a result depends on."""
    digest = hashlib.sha256()
    folder = ROOT / "mild_core" / "retargeting"
    own = [Path(__file__), Path(__file__).with_name("braking.py")]
    for path in [*sorted(folder.rglob("*.py")), *sorted((ROOT / "test/core/retargeting").glob("pe*.py")), *own]:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _known(path: Path | None, key: str) -> dict[int, Found]:
    """Episodes that an earlier call with the same code has left in a file."""
    if path is None or not path.exists():
        return {}
    try:
        kept: dict[str, Any] = json.loads(path.read_text())
        if kept["code"] != key:
            return {}
        return {int(seed): Found(**{**each, "worst": tuple(each["worst"])}) for seed, each in kept["episodes"].items()}
    except (ValueError, KeyError, TypeError) as error:
        raise SetupError(str(path), f"holds no episodes ({error!r})", "give another file") from error


def measured(seeds: Sequence[int], moving: bool, processes: int, path: Path | None) -> Found:
    """What the judge sees of all episodes, with progress on standard error."""
    key = f"{_digest()} {'moving' if moving else 'still'}"
    known = _known(path, key)
    waiting = [(seed, moving) for seed in seeds if seed not in known]
    started_s = kept_s = time.monotonic()
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for number, (seed, found) in enumerate(pool.imap_unordered(_work, waiting, 4), 1):
            known[seed] = found
            if time.monotonic() - kept_s < 10.0 and number < len(waiting):
                continue
            kept_s = time.monotonic()
            if path is not None:
                written = path.with_suffix(f".{os.getpid()}")
                episodes = {seed: asdict(each) for seed, each in known.items()}
                written.write_text(json.dumps({"code": key, "episodes": episodes}) + "\n")
                written.replace(path)
            left_s = (kept_s - started_s) / number * (len(waiting) - number)
            above = sum(each.above for each in known.values())
            line = f"{len(known)} of {len(seeds)} episodes, {above} ticks above the bound"
            print(f"{line}; {left_s / 60:.1f} min left", file=sys.stderr, flush=True)
    total = Found()
    for seed in seeds:
        total.add(known[seed])
    return total


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; 1 when a bound is broken, 2 for a wrong call."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=1_000_000, help="about so many (1000000)")
    parser.add_argument("--first", type=int, default=0, help="first seed (0)")
    parser.add_argument("--moving", action="store_true", help="people move")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at once (all cores)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep every episode here, and resume from it")
    given = parser.parse_args(argv)
    try:
        if given.ticks < 1 or given.jobs < 1:
            raise SetupError("speed_near_people", "--ticks and --jobs must be 1 or more", "give a number above 0")
        count = -(-given.ticks // round(100 * EPISODE_S))
        found = measured(range(given.first, given.first + count), given.moving, given.jobs, given.json)
    except SetupError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{found.ticks} ticks of {count} episodes, {found.followed} of them following, {found.near} near people")
    print(f"least distance kept {found.clear_m:.3f} m")
    for most, peak in zip(BANDS_M, found.peaks_m_s, strict=True):
        print(f"nearer than {most:4.2f} m: at most {peak:.3f} m/s")
    if not given.moving:
        print(f"above the bound: {found.above} ticks")
        return int(found.above > 0)
    print(
        f"towards people above what their approach leaves: {found.towards} ticks, at most {found.towards_m_s:.3f} m/s; "
        f"not braking at its limits: {found.not_braking} ticks, at most {found.not_braking_m_s:.3f} m/s "
        f"(seed {found.worst[0]}, {found.worst[1]} s)"
    )
    print(f"inside of bodies that ran into the arm: {found.inside} ticks, at most {found.inside_m_s:.3f} m/s")
    return int(found.not_braking > 0)


if __name__ == "__main__":
    sys.exit(main())
