# SPDX-License-Identifier: Apache-2.0
"""How near the hands come: recorded trials and generated bags through the pipeline into the simulated robot.

`./mild measure contact [--data FOLDER] [--every N] [--ik blend off only]` prints, for each interaction in which
hands touch, the distance of the person's true hand and the simulated robot's while they are to touch and the person's
is within reach, and how far the motion before the approach is from the learned one. The trials were trained on.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.learning.training.place_fit import hand_of, touching
from mild_core.perception.stage import Perception
from mild_core.pipeline import Pipeline
from mild_core.retargeting.human_track import AssumedPlacement, Point
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robots import ROBOTS
from mild_core.retargeting.stage import Retargeting
from mild_core.shapes import FloatArray
from mild_core.signals import ARM_FRAME, JointCommand, JointMeasurement, MotionWindow, PersonPose
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.simulation.bullet import BulletRobot
from mild_ros.simulation.person import Camera, bodies, skeleton_frames, with_neutral_second
from tools.scenes import RATE_HZ, SCENES, arm_track

TICK_NS = 10_000_000
START_NS = 1_700_000_000_000_000_000
REACHED_M = 0.005
"""A hand within this of where the robot's can be is within reach."""

APPROACH_M = 0.35
"""Before the learned hand has come so near the person's, the motion is the learned one."""

ROBOT = ROBOTS["yumi"]


@dataclass(frozen=True, eq=False)
class Episode:
    """One interaction, 100 times a second.

    Attributes:
        commands: T commands.
        simulated_m: (T, 3) the simulated robot's hand.
        hand_m: (T, 3) the person's true hand in the robot's base frame.
        step_ms: (T,) CPU time of the ticks.
        refused: Ticks at which a motion was refused.
    """

    commands: tuple[JointCommand, ...]
    simulated_m: FloatArray
    hand_m: FloatArray
    step_ms: FloatArray
    refused: int

    def apart_m(self) -> FloatArray:
        """(N,) between the hands while they are to touch and the person's is within reach."""
        places = np.flatnonzero(touching(self.hand_m))
        within = places[reachable(self.hand_m[places])]
        apart: FloatArray = np.linalg.norm(self.simulated_m - self.hand_m, axis=1)[within]
        return apart

    def before_deg(self, learned: Episode) -> float:
        """How far a joint is from the learned motion alone, at most, until that one approaches the person."""
        nearing = np.linalg.norm(learned.simulated_m - learned.hand_m, axis=1) < APPROACH_M
        first = int(np.argmax(nearing)) if nearing.any() else len(nearing)
        here, there = (np.array([each.positions_rad for each in who.commands]) for who in (self, learned))
        return float(np.rad2deg(np.abs(here - there)[:first].max()))


def _robot_from_camera(standing: AssumedPlacement, place_m: Point) -> FloatArray:
    """(4, 4) the camera's pose in the robot's base frame, for a person who stands there."""
    axes = standing.placed(np.vstack([np.eye(3), np.zeros(3)]), ARM_FRAME, place_m)
    robot_from_arm = np.eye(4)
    robot_from_arm[:3, :3], robot_from_arm[:3, 3] = (axes[:3] - axes[3]).T, axes[3]
    return robot_from_arm @ Camera().arm_from_camera


@dataclass(frozen=True, eq=False)
class Story:
    """Inputs of retargeting in one interaction, by real perception and inference.

    Attributes:
        inputs: Each input and when it comes [ns].
        hand_m: (T, 3) the person's true hand in the robot's base frame ...
        rate_hz: ... so often.
        end_ns: When it is over.
    """

    inputs: tuple[tuple[int, MotionWindow | PersonPose], ...]
    hand_m: FloatArray
    rate_hz: float
    end_ns: int

    def hand_at(self, now_ns: int) -> list[float]:
        """The true hand then."""
        where = (now_ns - START_NS) * 1e-9 * self.rate_hz
        return [float(np.interp(where, np.arange(len(self.hand_m)), column)) for column in self.hand_m.T]


def story(pipeline: Pipeline, arm_m: FloatArray, rate_hz: float, interaction: str, calibrated: bool = True) -> Story:
    """Let a person move this arm (T, 3, 3), seen by a calibrated camera or not."""
    standing = pipeline.retargeting.standing
    assert standing is not None
    place_m = standing.by_interaction[interaction]
    track = with_neutral_second(arm_m, rate_hz, 1.2)
    hand_m = standing.placed(hand_of(track, (0.29, 0.335)) - track[0, 0], ARM_FRAME, place_m)
    perception = pipeline.perception
    if calibrated:
        settings = replace(perception.settings, robot_from_source=_robot_from_camera(standing, place_m))
        perception = Perception(settings)
    seeing, inferring = perception.init(), pipeline.inference.init()
    inputs: list[tuple[int, MotionWindow | PersonPose]] = []
    for frame in skeleton_frames(bodies(track), rate_hz, START_NS):
        seeing, windows = perception.step(seeing, (frame,), frame.stamp_ns)
        if seeing.person is not None:
            inputs.append((frame.stamp_ns, seeing.person))
        for window in windows:
            inferring, motions = pipeline.inference.step(inferring, window, frame.stamp_ns)
            inputs += [(frame.stamp_ns, motion) for motion in motions]
    return Story(tuple(inputs), hand_m, rate_hz, START_NS + round(len(track) / rate_hz * 1e9))


def play(retargeting: Retargeting, inputs: Story) -> Episode:
    """Let the simulated robot answer."""
    chain, waiting = chain_of(ROBOT), list(inputs.inputs)
    state, _ = retargeting.step(
        retargeting.init(), JointMeasurement(START_NS, ROBOT.joint_names, ROBOT.home_rad), START_NS
    )
    commands, simulated, hands, times = [], [], [], []
    with BulletRobot(ROBOT) as robot:
        for now_ns in range(START_NS, inputs.end_ns, TICK_NS):
            started = time.thread_time()
            state, (command,) = retargeting.step(state, None, now_ns)
            times.append((time.thread_time() - started) * 1e3)
            while waiting and waiting[0][0] <= now_ns + TICK_NS // 2:
                stamp_ns, given = waiting.pop(0)
                state, _ = retargeting.step(state, given, max(now_ns, stamp_ns))
            hands.append(inputs.hand_at(now_ns))
            commands.append(command)
            simulated.append(chain.tool(robot.measure(now_ns).positions_rad[: len(ROBOT.joint_names)]))
            robot.stiffen(command.stiffness)
            robot.step(command, TICK_NS * 1e-9)
    refused = sum(count for reason, count in state.counts.items() if reason.startswith("refused"))
    return Episode(tuple(commands), np.array(simulated), np.array(hands), np.array(times), refused)


def reachable(hands_m: FloatArray) -> FloatArray:
    """(T,) whether the robot's hand can be there, as far as descent from home finds it."""
    solver, chain = InverseKinematics(ROBOT, (ROBOT.tool_link,), 0.01), chain_of(ROBOT)
    found, joints = [], np.array(ROBOT.home_rad)
    for hand in hands_m:
        joints = solver.step(joints, [Reach(ROBOT.tool_link, hand)], ROBOT.home_rad, steps=3)
        found.append(np.linalg.norm(chain.tool(joints) - hand) < REACHED_M)
    return np.array(found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("MILD_DATA", "../shared/data")))
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--uncalibrated", action="store_true", help="the person's place is taken from the manifest")
    parser.add_argument("--ik", nargs="+", default=["off", "blend", "only"])
    chosen = parser.parse_args()
    arms = [(scene.name, "bag", arm_track(scene), RATE_HZ) for scene in SCENES]
    if (chosen.data / BUETEPAGE_HR.file).exists():
        trials = BUETEPAGE_HR.read(chosen.data / BUETEPAGE_HR.file).train[:: chosen.every]
        arms += [(trial.interaction, "trial", trial.observed_m, trial.rate_hz) for trial in trials]
    model = load(PipelineParameters().model)
    pipelines = {mix: make_pipeline(PipelineParameters(ik=mix), model) for mix in {"off", *chosen.ik}}
    print("interaction source ik     frames  median cm  p90 cm  before deg  tick ms  refused")
    for name in model.manifest.robot_from_human.by_interaction:
        for source in ("bag", "trial"):
            chosen_arms = [(arm, rate) for other, of, arm, rate in arms if (other, of) == (name, source)]
            learned: list[Episode] = []
            stories = [story(pipelines["off"], arm, rate, name, not chosen.uncalibrated) for arm, rate in chosen_arms]
            for mix in chosen.ik:
                episodes = [play(pipelines[mix].retargeting, inputs) for inputs in stories]
                learned = learned or episodes
                if episodes:
                    print(f"{name:11} {source:6} {mix:6} " + _summary(episodes, learned), flush=True)


def _summary(episodes: list[Episode], learned: list[Episode]) -> str:
    apart = [episode.apart_m() for episode in episodes]
    before = [episode.before_deg(other) for episode, other in zip(episodes, learned, strict=True)]
    times = [episode.step_ms for episode in episodes]
    every = np.concatenate(apart) * 100
    middle, most = np.percentile(every, [50, 90]) if len(every) else (np.nan, np.nan)
    typical = np.median(np.concatenate(times))
    refused = sum(episode.refused for episode in episodes)
    return f"{len(every):6}  {middle:9.2f}  {most:6.2f}  {max(before):10.2f}  {typical:7.3f}  {refused:7}"


if __name__ == "__main__":
    main()
