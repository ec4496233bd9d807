# SPDX-License-Identifier: Apache-2.0
"""Trials as other people would have done them: the person's hand goes elsewhere, and the robot's follows it there.

The few people of a recording hold their hands out at nearly one place, and what is learned of them aims there for
every person. So each trial is repeated by people of other reach, height and stance. Where hands meet, the robot's tool
is moved by inverse kinematics as the person's hand was, so that both still meet and the pair stays true.

Source: METHOD, section 5, "paired augmentation"; the idea of moving goals with their demonstrations is that of movement
primitives (A. Ijspeert et al., Neural Computation 2013).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]  # scipy brings no types

from mild_core.inference.gesture_recogniser import SAME
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.training.place_fit import FACE_TO_FACE_RAD, turned_about_z
from mild_core.learning.training.settings import Paired
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robots import ROBOTS
from mild_core.shapes import FloatArray

MEETING = ("handshake", "rocket", "parachute")
"""Gestures in which hands meet (`gesture_recogniser.GESTURES`); in others the robot stays as it was recorded."""

HELD_OUT = 0.8
"""Share of a hand's farthest way from rest at which it is moved by the whole vector."""

REACHED = 0.995
"""Longest reach of an arm, as a share of its bones: a straight elbow has no plane."""

LEAST_AWAY_M = 0.05
IK_STEPS = 2
"""Of inverse kinematics for each frame: each begins where the one before it ended, a few millimetres away."""

WANDER_S = 0.8
MISSED_M, HASTY_RAD_S, DRAWS = 0.05, 3.0, 20
"""Pairs are redrawn, so many times at most, while the tool misses its place by so much, or a joint leaps: is so much
faster than in the recording."""


def repeated_by_others(
    demonstrations: Sequence[Demonstration], settings: Paired, seed: int
) -> tuple[list[Demonstration], ...]:
    """`settings.copies` times all trials, in order, each time by others.

    Args:
        demonstrations: As recorded; of a robot among `ROBOTS`, described by its joints.
        settings: How far people differ.
        seed: Of all draws.

    Returns:
        Nothing for a robot that is not among them and for a partner's arm.
    """
    robot = next((one for one in ROBOTS.values() if one.joint_names == demonstrations[0].controlled_names), None)
    if robot is None:
        return ()
    solver, rng = InverseKinematics(robot, [robot.tool_link]), np.random.default_rng((seed, len(demonstrations)))
    return tuple(
        [_by_another(one, robot, solver, settings, rng) for one in demonstrations] for _ in range(settings.copies)
    )


def _by_another(
    trial: Demonstration, robot: RobotModel, solver: InverseKinematics, settings: Paired, rng: np.random.Generator
) -> Demonstration:
    """The trial by a person whom the robot can meet; as recorded after `DRAWS` of whom it cannot."""
    trial = _faster(trial, float(np.exp(rng.uniform(*np.log(settings.speed)))))
    for _ in range(DRAWS):
        moved, out = moved_arm(trial.observed_m, trial.rate_hz, settings, rng)
        if SAME.get(trial.interaction, trial.interaction) not in MEETING:
            return replace(trial, observed_m=moved)
        aside = out[:, None] * (moved[:, -1] - trial.observed_m[:, -1]) @ turned_about_z(FACE_TO_FACE_RAD).T
        angles, missed_m = followed(robot, solver, trial.controlled, aside)
        hasty = np.abs(np.diff(angles, axis=0)).max() - np.abs(np.diff(trial.controlled, axis=0)).max()
        if missed_m < MISSED_M and hasty * trial.rate_hz < HASTY_RAD_S:
            return replace(trial, observed_m=moved, controlled=angles)
    return trial


def _faster(trial: Demonstration, speed: float) -> Demonstration:
    """The trial at another speed of both agents."""
    times = np.arange(0.0, trial.frames - 1 + 1e-9, speed)

    def at(track: FloatArray) -> FloatArray:
        columns = track.reshape(trial.frames, -1).T
        moved = np.stack([np.interp(times, np.arange(trial.frames), column) for column in columns], axis=1)
        return moved.reshape(len(times), *track.shape[1:])

    return replace(trial, observed_m=at(trial.observed_m), controlled=at(trial.controlled), active=at(trial.active))


def moved_arm(
    arm_m: FloatArray, rate_hz: float, settings: Paired, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """An arm's motion by another person.

    Args:
        arm_m: (T, 3, 3) shoulder, elbow, hand [m], x forward, y left, z up.
        rate_hz: Frames per second.
        settings: How far people differ.
        rng: Draws.

    Returns:
        The same bones moved otherwise (T, 3, 3), and (T,) how far out the hand is: 0 at rest, 1 where hands meet.
    """
    lengths = np.linalg.norm(np.diff(arm_m, axis=1), axis=2)
    reach = float(np.median(lengths.sum(axis=1)))
    shoulder, elbow, hand = (arm_m[:, joint] for joint in range(3))
    rest = hand[0] - shoulder[0]
    away = np.linalg.norm(hand - shoulder - rest, axis=1)
    out = np.clip(away / (HELD_OUT * max(float(away.max()), LEAST_AWAY_M)), 0.0, 1.0)
    turn = turned_about_z(rng.uniform(-1.0, 1.0) * settings.yaw_rad)
    scale = float(rng.uniform(settings.scale[0], settings.scale[1]))
    low, high = np.array(settings.least), np.array(settings.most)
    vector = reach * (low + rng.uniform(size=3) * (high - low))
    wander = [_wander(len(arm_m), rate_hz, settings.style * reach, rng) for _ in range(2)]
    way = scale * (hand - shoulder - rest) @ turn.T
    new_hand = rest + way + out[:, None] * vector + np.clip(0.2 + out, 0.0, 1.0)[:, None] * wander[0]
    new_elbow = (elbow - shoulder) @ turn.T + wander[1]
    bent = bent_arm(new_elbow, new_hand, lengths)
    return np.concatenate([arm_m[:, :1], shoulder[:, None] + bent], axis=1), out


def _wander(frames: int, rate_hz: float, deviation: float, rng: np.random.Generator) -> FloatArray:
    """(T, 3) a slow random walk without drift."""
    knots = max(2, int(frames / rate_hz / WANDER_S) + 2)
    curve = CubicSpline(np.arange(knots), rng.normal(size=(knots, 3)) * deviation)
    wander: FloatArray = curve(np.linspace(0, knots - 1, frames))
    return wander


def bent_arm(elbow: FloatArray, hand: FloatArray, lengths: FloatArray) -> FloatArray:
    """(T, 2, 3) elbow and hand from the shoulder, the hand pulled within reach, the elbow nearest to where it was.

    Args:
        elbow: (T, 3) wanted, from the shoulder [m].
        hand: (T, 3) wanted, from the shoulder [m].
        lengths: (T, 2) of the bones [m].
    """
    upper, fore = lengths.T
    away = np.linalg.norm(hand, axis=1)
    along = hand / np.maximum(away, 1e-9)[:, None]
    reach = np.clip(away, np.abs(upper - fore) + 0.05 * (upper + fore), REACHED * (upper + fore))
    foot = (upper**2 - fore**2 + reach**2) / (2.0 * reach)
    height = np.sqrt(np.maximum(upper**2 - foot**2, 1e-8))
    aside = elbow - (elbow * along).sum(axis=1, keepdims=True) * along
    length = np.linalg.norm(aside, axis=1, keepdims=True)
    # A straight arm has no side to which its elbow would bend: downwards, or backwards where it hangs.
    down = np.array([0.1, 0.0, 1.0]) - (along @ np.array([0.1, 0.0, 1.0]))[:, None] * along
    down = -down / np.linalg.norm(down, axis=1, keepdims=True)
    aside = np.where(length > 1e-3, aside / np.maximum(length, 1e-9), down)
    return np.stack([foot[:, None] * along + height[:, None] * aside, reach[:, None] * along], axis=1)


def followed(
    robot: RobotModel, solver: InverseKinematics, angles_rad: FloatArray, aside_m: FloatArray
) -> tuple[FloatArray, float]:
    """(T, J) joints with which the tool is where it was, moved; and by how much it misses that at most [m].

    Args:
        robot: Whose.
        solver: Of its tool link.
        angles_rad: (T, J) recorded.
        aside_m: (T, 3) how far the tool is moved, in the robot's base frame [m].
    """
    tool = forward_kinematics(robot, angles_rad, robot.tool_link)[:, :3, 3] + aside_m
    found = angles_rad.copy()
    correction = np.zeros(angles_rad.shape[1])
    for t in np.flatnonzero((aside_m**2).sum(axis=1) > 1e-8):
        near = [Reach(robot.tool_link, tool[t])]
        found[t] = solver.step(angles_rad[t] + correction, near, angles_rad[t], IK_STEPS)
        correction = found[t] - angles_rad[t]
    reached = forward_kinematics(robot, found, robot.tool_link)[:, :3, 3]
    return found, float(np.linalg.norm(reached - tool, axis=1).max())
