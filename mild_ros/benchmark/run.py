# SPDX-License-Identifier: Apache-2.0
"""One encounter: people, tracker, the real pipeline and a robot in physics, in simulated time.

The hand waits where it is held out; when hands have met the person shakes, rises or sinks, and goes. Hands have met
within 2 cm beyond the error of the camera's pose, of which the robot cannot know.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from mild_core.pipeline import Pipeline
from mild_core.retargeting.limit_check import exceeded_limits
from mild_core.signals import NAMED, JointCommand, SkeletonFrame
from mild_ros.benchmark.bodies import KINECT_JOINTS, Array, Person, capsules_of
from mild_ros.benchmark.encounters import CONTACT_S, RETURN_S, Encounter, Timeline
from mild_ros.benchmark.reachable import Judge
from mild_ros.simulation.bullet import BulletRobot
from mild_ros.simulation.person import looking_at

START_NS, TICK_NS = 1_700_000_000_000_000_000, 10_000_000
TICK_S, MEASURED_TICKS, JUDGED_TICKS = 0.01, 2, 2

MET_M, MET_S = 0.02, 0.5
"""Hands have met when they are within the first for the second."""

STILL_M_S = 0.05
"""A slower part of a person stands still."""

HOME_M = 0.02


@dataclass(eq=False)
class Trace:
    """What happened, every `TICK_S`.

    Attributes:
        timeline: As it came to be.
        hand_m: (T, 3) the offered hand.
        tool_m: (T, 3) the robot's.
        modes: T modes of the robot.
        named: T names of what the robot recognised, "" for none.
        states: T recognition states.
        met_s: When hands had met for the first time; None if never.
        kept_m: Least distance from head and trunk of everyone.
        speed_m_s: Largest speed near a part of a person that stands still.
        collided: Whether the robot met itself.
        limits: What its commands broke.
        no_contact: What the robot said of why hands do not meet.
        counts: What the pipeline counted.
    """

    timeline: Timeline
    hand_m: Array
    tool_m: Array
    modes: list[str] = field(default_factory=list)
    named: list[str] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    met_s: float | None = None
    kept_m: float = math.inf
    speed_m_s: float = 0.0
    collided: bool = False
    limits: tuple[str, ...] = ()
    no_contact: str = ""
    counts: dict[str, int] = field(default_factory=dict)


def camera_for(encounter: Encounter, shoulder_m: tuple[float, float, float]) -> Array:
    """(4, 4) true pose of a camera behind and above the robot's shoulder that looks at the person."""
    eye = np.add(shoulder_m, (-0.5, 0.35, 0.6))
    at = np.array([*encounter.person.root.at(np.zeros(1))[0, :2], shoulder_m[2] - 0.1])
    if encounter.kind == "passer_by":
        at = np.add(shoulder_m, (1.5, 0.0, 0.0))
    return looking_at(tuple(eye), tuple(at))


@dataclass
class _Bodies:
    """Points of everyone by tick."""

    people: list[Person]
    times_s: Array
    points: list[dict[str, Array]]

    @classmethod
    def of(cls, people: list[Person], times_s: Array) -> _Bodies:
        return cls(people, times_s, [person.points(times_s) for person in people])


def meet(encounter: Encounter, pipeline: Pipeline, robot: BulletRobot, judge: Judge) -> Trace:
    """Let an encounter happen. The pipeline's camera must be `camera_for`, off by what the encounter says."""
    rng = np.random.default_rng(encounter.seed + 1)
    times = np.arange(0.0, encounter.duration_s, TICK_S)
    timeline = encounter.timeline
    bodies = _Bodies.of([encounter.performed(timeline), *encounter.others], times)
    trace = Trace(timeline, np.zeros((len(times), 3)), np.zeros((len(times), 3)))
    messages = _messages(encounter, times, rng)
    measured = pipeline.perception.settings.robot_from_source
    assert measured is not None
    true = np.array(measured)
    true[:3, 3] -= encounter.tracking.camera_off_m
    state = pipeline.init()
    commands: list[JointCommand] = []
    command: JointCommand | None = None
    name, recognition = "", ""
    within_since, next_message = math.inf, 0
    met_m = MET_M + float(np.linalg.norm(encounter.tracking.camera_off_m))
    home_m = judge.tool_m(robot.robot.home_rad)
    for tick, time_s in enumerate(times.tolist()):
        now_ns = START_NS + tick * TICK_NS
        position = robot.measure(now_ns)
        where = np.array([position.positions_rad[position.joint_names.index(n)] for n in robot.robot.joint_names])
        tool, hand = judge.tool_m(where), bodies.points[0][f"{encounter.side}_hand"][tick]
        trace.tool_m[tick], trace.hand_m[tick] = tool, hand
        if tick % JUDGED_TICKS == 0:
            _judge(trace, judge, bodies, tick, where, command)
        if encounter.offers and timeline.offered_s <= time_s < timeline.withdrawn_s:
            apart = float(np.linalg.norm(tool - hand))
            within_since = min(within_since, time_s) if apart < met_m else math.inf
            if trace.met_s is None and time_s - within_since >= MET_S:
                trace.met_s = within_since
                ends = within_since + CONTACT_S
                timeline = replace(timeline, moves_s=time_s, withdrawn_s=ends, back_s=ends + RETURN_S)
                bodies = _Bodies.of([encounter.performed(timeline), *encounter.others], times)
        inputs: list[object] = []
        while next_message < len(messages) and messages[next_message][0] <= time_s:
            _, seen = messages[next_message]
            inputs.append(_frames(encounter, bodies, seen, true, rng))
            next_message += 1
        if tick % MEASURED_TICKS == 0:
            inputs.append(position)
        for given in (*inputs, None):
            state, output = pipeline.step(state, given, now_ns)  # type: ignore[arg-type]
            for motion in output.motions:
                name, recognition = motion.interaction, motion.state
            commands += output.commands
            command = output.commands[-1] if output.commands else command
        robot.step(command, TICK_S)
        mode = state.retargeting.mode.value
        trace.modes.append(mode)
        trace.named.append(name if recognition == NAMED else "")
        trace.states.append(recognition)
        if state.retargeting.unmet or state.retargeting.no_contact:
            trace.no_contact = state.retargeting.unmet or state.retargeting.no_contact
        over = time_s > (timeline.back_s if math.isfinite(timeline.back_s) else 5.9) + 0.5
        if over and mode not in ("following", "holding", "returning") and np.linalg.norm(tool - home_m) < HOME_M:
            break
    last = len(trace.modes)
    trace.hand_m, trace.tool_m, trace.timeline = trace.hand_m[:last], trace.tool_m[:last], timeline
    counts = state.retargeting.counts
    trace.counts = {key: value for key, value in counts.items() if value and key != "tick"}
    if commands:
        trace.limits = exceeded_limits(
            robot.robot,
            np.array([one.stamp_ns for one in commands]),
            np.array([one.positions_rad for one in commands]),
            np.array([one.velocities_rad_s for one in commands]),
        )
    return trace


def _messages(encounter: Encounter, times: Array, rng: np.random.Generator) -> list[tuple[float, float]]:
    """(when it comes, when it was seen) of each tracker message [s]."""
    tracking, made, last = encounter.tracking, [], 0.0
    for seen_s in np.arange(0.0, times[-1], 1.0 / tracking.rate_hz).tolist():
        if rng.random() < tracking.loss:
            continue
        last = max(seen_s + float(rng.uniform(*tracking.delay_s)), last + 1e-4)
        made.append((last, seen_s))
    return made


def _frames(
    encounter: Encounter, bodies: _Bodies, seen_s: float, camera: Array, rng: np.random.Generator
) -> tuple[SkeletonFrame, ...]:
    """Everyone as the tracker sees them."""
    frames = []
    tick = min(round(seen_s / TICK_S), len(bodies.times_s) - 1)
    for number, points in enumerate(bodies.points, start=1):
        shown = np.stack([points[name][tick] for name in KINECT_JOINTS])
        shown = shown + rng.normal(0.0, encounter.tracking.noise_m, shown.shape)
        optical = (shown - camera[:3, 3]) @ camera[:3, :3]
        stamp_ns = START_NS + round(seen_s * 1e9)
        frames.append(SkeletonFrame(stamp_ns, "camera", number, KINECT_JOINTS, optical, np.ones(len(KINECT_JOINTS))))
    return tuple(frames)


def _judge(trace: Trace, judge: Judge, bodies: _Bodies, tick: int, where: Array, command: JointCommand | None) -> None:
    """Distances and speeds at one moment."""
    velocities = np.zeros(len(where)) if command is None else np.asarray(command.velocities_rad_s)
    judge.put(where, velocities)
    before = max(tick - 3, 0)
    for person, points in zip(bodies.people, bodies.points, strict=True):
        capsules = capsules_of(person.sizes)
        shoulder = np.array(judge.shoulder_m)
        if np.linalg.norm(points["chest"][tick] - shoulder) > judge.reach_m + 1.6:
            continue
        for capsule, found in zip(capsules, judge.nearest(capsules, points, tick), strict=True):
            if not math.isfinite(found.apart_m):
                continue
            if capsule.group in ("head", "trunk"):
                trace.kept_m = min(trace.kept_m, found.apart_m)
            still = all(
                np.linalg.norm(points[end][tick] - points[end][before]) <= STILL_M_S * (tick - before) * TICK_S + 1e-6
                for end in (capsule.start, capsule.end)
            )
            if still:
                trace.speed_m_s = max(trace.speed_m_s, found.speed_m_s)
    if tick % (5 * JUDGED_TICKS) == 0 and judge.collides(where):
        trace.collided = True
