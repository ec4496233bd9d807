# SPDX-License-Identifier: Apache-2.0
"""People of our own making who do the four interactions with a robot: no recording, so no licence but ours.

A hand goes from place to place with the least jerk, and shakes, waves, rises or sinks there. The robot's hand goes to
meet it by inverse kinematics, a little later; while the person waves it waves back. What these people do is a guess at
what people do: a model of them errs more, and its card says by how much.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mild_core.inference.gesture_recogniser import FOREARM, GESTURES, RATE_HZ, UPPER_ARM
from mild_core.inference.manifest import ControlledAgent, HumanPlacement, ObservedAgent
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.trials import TrialEntry, Trials
from mild_core.learning.training.gestures import arm_to, hanging, leaning, through
from mild_core.learning.training.place_fit import ADULT_ARM_M, FACE_TO_FACE_RAD
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray

LICENCE = "Apache-2.0"
TOUCHING = ("handshake", "rocket", "parachute")
TRIALS_HZ = 40.0

MET = np.array([0.62, 0.12, -0.2])
"""Where hands meet on the whole, from the person's shoulder [arm lengths]."""

ARM_M = ADULT_ARM_M[0] + ADULT_ARM_M[1]
LEAST_LATE_S, MOST_LATE_S = 0.1, 0.4
"""What the robot is later by."""

SPEED_SHARE = 0.6
"""Of the joints' speeds, that the robot moves with at most."""

SETTLING_STEPS = 12
"""Steps of inverse kinematics until the arm stands at its first goal."""


def _met_at(rng: np.random.Generator) -> FloatArray:
    place: FloatArray = MET + 0.08 * rng.normal(size=3)
    return place


def _oscillation(frames: int, hz: float, deviation: float, way: FloatArray, rng: np.random.Generator) -> FloatArray:
    times = np.arange(frames) / RATE_HZ
    turns = 2.0 * np.pi * hz * times * (1.0 + 0.1 * np.sin(times)) + rng.uniform(0.0, 6.3)
    wave: FloatArray = deviation * np.sin(turns)[:, None] * way
    return wave


def _wave(rest: FloatArray, rng: np.random.Generator) -> FloatArray:
    place = np.array([rng.uniform(0.25, 0.6), rng.uniform(-0.45, 0.15), rng.uniform(-0.1, 0.6)])
    hand = through([rest, place, rest], [rng.uniform(0.3, 2.0), rng.uniform(1.5, 4.0), 1.0], rng)
    there = np.clip(1.2 - np.linalg.norm(hand - place, axis=1) / 0.25, 0.0, 1.0)[:, None]
    way = np.array([0.1 * rng.normal(), 1.0, 0.3 * rng.normal()])
    swing = _oscillation(len(hand), rng.uniform(0.8, 2.4), rng.uniform(0.1, 0.3), way, rng)
    waved: FloatArray = hand + there * swing
    return waved


def _handshake(rest: FloatArray, rng: np.random.Generator) -> FloatArray:
    place = _met_at(rng) + np.array([0.0, 0.0, -0.05])
    hand = through([rest, place, rest], [rng.uniform(0.3, 2.0), rng.uniform(1.0, 3.5), 1.0], rng)
    there = np.clip(1.0 - np.linalg.norm(hand - place, axis=1) / 0.1, 0.0, 1.0)[:, None]
    way = np.array([0.1 * rng.normal(), 0.1 * rng.normal(), 1.0])
    swing = _oscillation(len(hand), rng.uniform(1.2, 3.0), rng.uniform(0.02, 0.12), way, rng)
    shaken: FloatArray = hand + there * swing
    return shaken


def _rocket(rest: FloatArray, rng: np.random.Generator) -> FloatArray:
    place = _met_at(rng)
    up = place + np.array([rng.uniform(-0.3, 0.0), 0.05 * rng.normal(), rng.uniform(0.45, 0.85)])
    places, stays = [rest, place, up, rest], [rng.uniform(0.3, 2.0), rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.8), 1.0]
    hand = through(places, stays, rng)
    high = np.clip((hand[:, 2] - place[2]) / 0.3, 0.0, 1.0)[:, None]
    swing = _oscillation(len(hand), rng.uniform(1.5, 4.0), rng.uniform(0.0, 0.05), rng.normal(size=3), rng)
    risen: FloatArray = hand + high * swing
    return risen


def _parachute(rest: FloatArray, rng: np.random.Generator) -> FloatArray:
    place = _met_at(rng) + np.array([rng.uniform(-0.2, 0.0), 0.0, rng.uniform(0.35, 0.7)])
    down = place + np.array([rng.uniform(-0.1, 0.15), 0.1 * rng.normal(), -rng.uniform(0.5, 0.9)])
    fall = np.linspace(0.0, 1.0, int(rng.integers(3, 6)))[1:, None]
    sway = np.array([0.0, 1.0, 0.0]) * rng.uniform(0.02, 0.15) * np.where(np.arange(len(fall)) % 2, 1.0, -1.0)[:, None]
    falling = place + fall * (down - place) + sway
    stays = [rng.uniform(0.3, 2.0), rng.uniform(0.1, 0.9), *[0.05] * len(falling), 1.0]
    return through([rest, place, *falling, rest], stays, rng)


PERFORMED: dict[str, Callable[[FloatArray, np.random.Generator], FloatArray]] = dict(
    zip(GESTURES, (_wave, _handshake, _rocket, _parachute), strict=True)
)
"""The hand (T, 3) from the shoulder [arm lengths] at RATE_HZ, from its rest (3,) and back."""


def perform(interaction: str, rng: np.random.Generator) -> FloatArray:
    """(T, 3, 3) shoulder, elbow and hand of a person in an interaction [arm lengths], at RATE_HZ."""
    hand = PERFORMED[interaction](hanging(rng), rng)
    return arm_to(hand, leaning(hand, rng), rng)


def placement_for(robot: RobotModel) -> HumanPlacement:
    """Where a person stands whose hand meets the robot's where its arm is half stretched before it."""
    chain = chain_of(robot)
    shoulder, home = chain.offsets[0][:3, 3], chain.tool(robot.home_rad)
    poses = np.random.default_rng(0).uniform(robot.lower_rad, robot.upper_rad, (400, len(robot.joint_names)))
    reach_m = max(float(np.linalg.norm(chain.tool(pose) - shoulder)) for pose in poses)
    met_m = shoulder + np.array([0.65 * reach_m, 0.0, 0.0])
    met_m[1], met_m[2] = 0.5 * (shoulder[1] + home[1]), 0.5 * (shoulder[2] + home[2])
    x, y, z = (round(float(value), 3) for value in met_m - _turned(MET[None] * ARM_M)[0])
    return HumanPlacement((x, y, z), FACE_TO_FACE_RAD, dict.fromkeys(TOUCHING, (x, y, z)), ADULT_ARM_M)


def _turned(points: FloatArray) -> FloatArray:
    """Points of a person's axes in those of the robot that they face."""
    turned: FloatArray = points * np.array([-1.0, -1.0, 1.0])
    return turned


def answer(robot: RobotModel, solver: InverseKinematics, hand_m: FloatArray, interaction: str, late: int) -> FloatArray:
    """(T, J) joints of a robot that meets a hand (T, 3) in its base frame [m], so many frames late."""
    chain, home = chain_of(robot), robot.home_rad
    tool = chain.tool(home)
    hand_m = hand_m[np.maximum(np.arange(len(hand_m)) - late, 0)]
    away = np.linalg.norm(hand_m - hand_m[0], axis=1)
    raised = np.clip(away / max(0.8 * float(away.max()), 1e-6), 0.0, 1.0)
    raised = (raised * raised * (3.0 - 2.0 * raised))[:, None]
    goal = hand_m
    if interaction not in TOUCHING:  # it waves back, where its own hand is
        goal = tool + np.array([0.1, 0.0, 0.15]) + 0.7 * (hand_m - np.median(hand_m[away > 0.8 * away.max()], axis=0))
    goal = tool + raised * (goal - tool)
    rows, at, most_rad = [], home, SPEED_SHARE * robot.velocity_rad_s / TRIALS_HZ
    for index, point_m in enumerate(goal):
        steps = SETTLING_STEPS if index == 0 else 1
        wanted = solver.step(at, [Reach(robot.tool_link, point_m)], home, steps)
        at = wanted if index == 0 else at + np.clip(wanted - at, -most_rad, most_rad)
        rows.append(at)
    return np.array(rows)


def kinematic_trials(robot_name: str, robot: RobotModel, each: int, seed: int) -> tuple[Trials, list[Demonstration]]:
    """Made trials of all four interactions with a robot, for `trials.write_trials`.

    Args:
        robot_name: In `ROBOTS`.
        robot: That robot.
        each: Trials of each interaction.
        seed: Of all draws.

    Raises:
        SetupError: Inverse kinematics is not installed.
    """
    rng, placement = np.random.default_rng(seed), placement_for(robot)
    solver = InverseKinematics(robot, (robot.tool_link,), 0.05, relent=1.0)
    entries, made = [], []
    for number in range(each * len(GESTURES)):
        interaction = GESTURES[number % len(GESTURES)]
        slow = perform(interaction, rng)
        times = np.arange(0.0, (len(slow) - 1) / RATE_HZ, 1.0 / TRIALS_HZ)
        columns = (slow - slow[0, 0]).reshape(len(slow), -1).T
        arm = np.stack([np.interp(times * RATE_HZ, np.arange(len(slow)), one) for one in columns], axis=1)
        arm_m = _on_bones(arm.reshape(-1, 3, 3))
        hand_m = np.array(placement.translation_m) + _turned(arm_m[:, 2])
        late = round(rng.uniform(LEAST_LATE_S, MOST_LATE_S) * TRIALS_HZ)
        joints = answer(robot, solver, hand_m, interaction, late)
        end_s = len(times) / TRIALS_HZ
        entries.append(TrialEntry(number, interaction, "train", "made", 0.0, 0.0, end_s, end_s))
        names = ("shoulder", "elbow", "hand")
        active = np.ones(len(times))
        made.append(Demonstration(number, interaction, TRIALS_HZ, names, arm_m, robot.joint_names, joints, active))
    trials = Trials(
        name=f"kinematic_{robot_name}",
        source="kinematic people of mild_ros's own making (kinematic_people.py), no recording",
        licence=LICENCE,
        rate_hz=TRIALS_HZ,
        interactions=GESTURES,
        observed=ObservedAgent("human_arm", ("shoulder", "elbow", "hand"), "m", ADULT_ARM_M, "right"),
        controlled=ControlledAgent("robot_joints", robot_name, robot.joint_names, "rad"),
        robot_from_human=placement,
        trial=tuple(entries),
    )
    return trials, made


def _on_bones(arm: FloatArray) -> FloatArray:
    """(T, 3, 3) arms [arm lengths] in metres of an adult."""
    shoulder, bones = arm[:, :1] * ARM_M, np.diff(arm, axis=1)
    upper, fore = bones[:, :1] / UPPER_ARM * ADULT_ARM_M[0], bones[:, 1:] / FOREARM * ADULT_ARM_M[1]
    found: FloatArray = np.concatenate([shoulder, shoulder + upper, shoulder + upper + fore], axis=1)
    return found
