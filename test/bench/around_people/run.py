# SPDX-License-Identifier: Apache-2.0
"""One scene through the real pipeline, in simulated time: people as a tracker shows them, a robot that lags.

The commands and where the people truly were is all that the judge gets.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from mild_core.pipeline import Pipeline
from mild_core.retargeting.robots import ROBOTS
from mild_core.signals import FeatureWindow, JointMeasurement, MotionWindow, SkeletonFrame
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.benchmark.bodies import KINECT_JOINTS, Array, Person

START_NS, TICK_NS = 1_700_000_000_000_000_000, 10_000_000
MEASURED_NS, LAG_NS = 20_000_000, 50_000_000
"""`joint_states` come at 50 Hz; the robot is where it was commanded to be 50 ms ago."""

CAMERA_M, LOOKS_AT_M = (-0.45, 0.3, 1.15), (0.9, -0.05, 0.2)
"""The tracker's camera stands behind the robot's shoulder and looks down at the people before it [m]."""


@dataclass(frozen=True)
class Tracker:
    """How people are seen.

    Attributes:
        rate_hz: Messages per second.
        noise_m: Standard deviation of each coordinate of each joint.
        loss: Share of messages that never come.
        delay_s: Least and largest time from the picture to the message.
        pauses: (start, end) [s] in which no message comes.
        jumps: (start, end, x, y, z): the whole of the first person is seen elsewhere by so much.
    """

    rate_hz: float = 30.0
    noise_m: float = 0.004
    loss: float = 0.0
    delay_s: tuple[float, float] = (0.02, 0.04)
    pauses: tuple[tuple[float, float], ...] = ()
    jumps: tuple[tuple[float, float, float, float, float], ...] = ()


@dataclass(frozen=True)
class Expectation:
    """What is promised of a scene, beside speeds and limits, which always hold.

    Attributes:
        keep_m: Distance from head and trunk and all that is not offered, less the tracker's noise; None where people
            move into the arm faster than it can make way: then it is only reported.
        starts: `wanted`, `unwanted` or `any`.
        touches: Whether hands meet.
    """

    keep_m: float | None = 0.05
    starts: str = "any"
    touches: bool = False


@dataclass(frozen=True, eq=False)
class Setting:
    """A scene with all its numbers drawn.

    Attributes:
        people: The watched person first.
        duration_s: How long it is.
        expectation: What is promised of it.
        tracker: How people are seen.
        parameters: Of the pipeline.
        measured: Whether the camera's place is known.
        motions: In place of inference: targets of the joints by time, `(time_s) -> (J,)`.
        greets_s: When the watched person starts to raise the hand; None for never.
    """

    people: tuple[Person, ...]
    duration_s: float
    expectation: Expectation = Expectation()
    tracker: Tracker = Tracker()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    measured: bool = True
    motions: Callable[[float], Array] | None = None
    greets_s: float | None = None

    @property
    def robot(self) -> str:
        """Its name."""
        return str(self.parameters.get("robot", "yumi"))


@dataclass(frozen=True, eq=False)
class Run:
    """What came of a setting.

    Attributes:
        times_s: (N,) of the commands.
        positions_rad: (N, J).
        velocities_rad_s: (N, J).
        modes: N modes.
        counts: What perception and retargeting counted.
    """

    times_s: Array
    positions_rad: Array
    velocities_rad_s: Array
    modes: tuple[str, ...]
    counts: dict[str, int]


def robot_from_camera() -> Array:
    """(4, 4) pose of the camera's optical frame (x right, y down, z away) in the robot's base frame."""
    away = np.subtract(LOOKS_AT_M, CAMERA_M) / np.linalg.norm(np.subtract(LOOKS_AT_M, CAMERA_M))
    right = np.cross(away, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(away, right), away], axis=1)
    pose[:3, 3] = CAMERA_M
    return pose


def camera_text() -> str:
    """The same as the parameter `robot_from_camera`: x y z roll pitch yaw."""
    pose = robot_from_camera()
    roll = math.atan2(pose[2, 1], pose[2, 2])
    pitch, yaw = -math.asin(pose[2, 0]), math.atan2(pose[1, 0], pose[0, 0])
    return " ".join(f"{value:.9f}" for value in (*CAMERA_M, roll, pitch, yaw))


def messages(setting: Setting, rng: np.random.Generator) -> list[tuple[int, tuple[SkeletonFrame, ...]]]:
    """Every tracker message and when it comes [ns], in order."""
    tracker, camera = setting.tracker, robot_from_camera()
    times = np.arange(0.0, setting.duration_s, 1.0 / tracker.rate_hz)
    places = [person.points(times) for person in setting.people]
    joints = [np.stack([points[name] for name in KINECT_JOINTS], axis=1) for points in places]
    made: list[tuple[int, tuple[SkeletonFrame, ...]]] = []
    last_ns = 0
    for index, time_s in enumerate(times.tolist()):
        if rng.random() < tracker.loss or any(start <= time_s < end for start, end in tracker.pauses):
            continue
        stamp_ns = START_NS + round(time_s * 1e9)
        seen = []
        for place, person in enumerate(setting.people):
            if not person.seen(time_s):
                continue
            confidence = np.ones(len(KINECT_JOINTS))
            if person.confidence is not None:
                confidence = np.array([person.confidence(time_s, name) for name in KINECT_JOINTS])
            spread = np.where(confidence < 0.5, person.hidden_m, tracker.noise_m)[:, None]
            shown = joints[place][index] + rng.normal(0.0, 1.0, (len(KINECT_JOINTS), 3)) * spread
            for start, end, *jump in tracker.jumps if place == 0 else ():
                if start <= time_s < end:
                    shown = shown + jump
            optical = (shown - camera[:3, 3]) @ camera[:3, :3]
            number = person.number(time_s)
            seen.append(SkeletonFrame(stamp_ns, "depth_camera_link", number, KINECT_JOINTS, optical, confidence))
        came_ns = max(stamp_ns + round(rng.uniform(*tracker.delay_s) * 1e9), last_ns + 1)
        last_ns = came_ns
        made.append((came_ns, tuple(seen)))
    return made


@dataclass(frozen=True, eq=False)
class ScriptedMotions:
    """Arbitrary motions in place of the learned ones: what a wrong model may ask for."""

    inner: Any
    joint_names: tuple[str, ...]
    target: Callable[[float], Array]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def step(self, state: Any, given: Any, now_ns: int) -> tuple[Any, tuple[MotionWindow, ...]]:
        """A motion for every window."""
        state, _ = self.inner.step(state, given, now_ns)
        if not isinstance(given, FeatureWindow):
            return state, ()
        period_ns, rows = 25_000_000, 40
        times = [(given.stamp_ns - START_NS + row * period_ns) * 1e-9 for row in range(1, rows + 1)]
        positions, count = np.stack([self.target(time_s) for time_s in times]), len(self.joint_names)
        belief = np.array([1.0])
        return state, (
            MotionWindow(
                given.stamp_ns, period_ns, period_ns, self.joint_names, positions, 1e-4 * np.eye(count), "handshake",
                1.0, belief, 0.5, 0.1,
            ),
        )  # fmt: skip


@lru_cache(maxsize=2)
def _model(name: str) -> Any:
    return load(name)


@lru_cache(maxsize=6)
def _pipeline(given: tuple[tuple[str, Any], ...]) -> Pipeline:
    parameters = PipelineParameters(**dict(given))
    return make_pipeline(parameters, _model(parameters.model))


def pipeline_of(setting: Setting) -> Pipeline:
    """The real pipeline by the parameters of a setting."""
    given = dict(setting.parameters)
    if setting.measured:
        given["robot_from_camera"] = camera_text()
    made = _pipeline(tuple(sorted(given.items())))
    if setting.motions is not None:
        scripted = ScriptedMotions(made.inference, ROBOTS[setting.robot].joint_names, setting.motions)
        return replace(made, inference=scripted)  # type: ignore[arg-type] # it has the same steps
    return made


def play(setting: Setting, seed: int) -> Run:
    """Let a scene happen; the same seed gives the same run."""
    pipeline, robot = pipeline_of(setting), ROBOTS[setting.robot]
    queue: list[tuple[int, int, int, Any]] = []
    for order, (came_ns, people) in enumerate(messages(setting, np.random.default_rng(seed))):
        heapq.heappush(queue, (came_ns, 0, order, people))
    end_ns = START_NS + round(setting.duration_s * 1e9)
    for order, tick_ns in enumerate(range(START_NS, end_ns, TICK_NS)):
        heapq.heappush(queue, (tick_ns, 2, order, None))
        if tick_ns % MEASURED_NS == 0:
            heapq.heappush(queue, (tick_ns, 1, order, "joint_states"))
    state = pipeline.init()
    commands: list[Any] = []
    lagging = 0
    while queue:
        now_ns, _, _, given = heapq.heappop(queue)
        if given == "joint_states":
            while lagging + 1 < len(commands) and commands[lagging + 1].stamp_ns <= now_ns - LAG_NS:
                lagging += 1
            where = commands[lagging].positions_rad if commands else robot.home_rad
            given = JointMeasurement(now_ns, robot.joint_names, np.array(where))
        state, output = pipeline.step(state, given, now_ns)
        commands += output.commands
    counts = {f"perception {key}": value for key, value in state.perception.counts.items()}
    counts |= {f"retargeting {key}": value for key, value in state.retargeting.counts.items()}
    return Run(
        np.array([(command.stamp_ns - START_NS) * 1e-9 for command in commands]),
        np.array([command.positions_rad for command in commands]),
        np.array([command.velocities_rad_s for command in commands]),
        tuple(command.mode for command in commands),
        counts,
    )
