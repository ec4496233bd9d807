# SPDX-License-Identifier: Apache-2.0
"""What `mild demonstrations` leaves: pictures of the cuts, and a folder of trials that a model can be trained on."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mild_core.inference.manifest import ControlledAgent, HumanPlacement, ObservedAgent
from mild_core.perception.arm import with_bone_lengths
from mild_core.retargeting.robot_file import find_robot
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray
from mild_core.signals import ARM_JOINTS
from mild_ros.assembly.perception import robot_from_camera
from mild_ros.command_line.cutting import CutBag, Movement, mean_bones_m
from mild_ros.demonstrations.settings import DemonstrationSettings
from mild_ros.viewing.figures.segments import Curve, ShownMovement, colours_of, draw_segments

if TYPE_CHECKING:
    from mild_core.learning.data.demonstration import Demonstration
    from mild_core.learning.data.trials import TrialEntry

FACING_RAD = math.pi
"""Of the person's forward axis in the robot's base frame, where hands meeting is all that is known."""


def interactions_of(cut: Sequence[CutBag], settings: DemonstrationSettings) -> tuple[str, ...]:
    """What the trials show: in the order that was asked for, otherwise by name."""
    found = {one.interaction for bag in cut for one in bag.movements if not one.fault}
    return tuple(name for name in settings.interactions if name in found) or tuple(sorted(found))


def draw(cut: Sequence[CutBag], settings: DemonstrationSettings, out: Path) -> list[Path]:
    """Write a picture for each bag; returns where."""
    colours, paths = colours_of(interactions_of(cut, settings)), []
    for bag in cut:
        away = Curve("hand from rest [m]", bag.cut.away_m, settings.cut.near_m)
        speed = Curve("hand's speed [m/s]", bag.cut.speed_m_s, settings.cut.slow_m_s)
        if bag.others.ndim == 2:
            other = Curve("robot's joints [°]", np.degrees(bag.others))
        else:
            hand = bag.others[:, -1] - bag.others[:, 0]
            other = Curve("partner's hand [m]", hand)
        paths.append(out / f"{bag.name}.png")
        shown = [_shown(bag, movement) for movement in bag.movements]
        draw_segments(bag.times_s, (away, speed, other), shown, colours, paths[-1], bag.name)
    return paths


def _shown(bag: CutBag, one: Movement) -> ShownMovement:
    frames = (one.segment.begin, one.segment.onset, one.segment.back - 1, one.segment.end - 1)
    begin_s, onset_s, back_s, end_s = (float(bag.times_s[frame]) for frame in frames)
    return ShownMovement(begin_s, onset_s, back_s, end_s, one.interaction, one.fault, one.number)


def write(cut: Sequence[CutBag], settings: DemonstrationSettings, out: Path, test_every: int) -> None:
    """Write the folder of trials.

    Args:
        cut: The bags.
        settings: How they were cut.
        out: The folder.
        test_every: Every so many trials of an interaction is put aside as test; 0 for none.

    Raises:
        SetupError: Hands are said to meet in an interaction of which there is no trial.
    """
    from mild_core.learning.data.trials import TrialEntry, Trials, write_trials

    robot = find_robot(settings.robot.robot) if settings.robot else None
    bones = [mean_bones_m(cut, place) for place in range(1 if robot else 2)]
    entries: list[TrialEntry] = []
    trials: list[Demonstration] = []
    seen: Counter[str] = Counter()
    for bag in cut:
        for one in (movement for movement in bag.movements if not movement.fault):
            seen[one.interaction] += 1
            aside = test_every > 0 and seen[one.interaction] % test_every == 0
            times = [round(value, 4) for value in vars(_shown(bag, one)).values() if isinstance(value, float)]
            entries.append(TrialEntry(len(entries), one.interaction, "test" if aside else "train", bag.name, *times))
            trials.append(_demonstration(bag, one, entries[-1], settings.cut.rate_hz, bones, robot))
    described = Trials(
        name=out.resolve().name,
        source=settings.source,
        licence=settings.licence,
        rate_hz=settings.cut.rate_hz,
        interactions=interactions_of(cut, settings),
        observed=ObservedAgent("human_arm", ARM_JOINTS, "m", bones[0], "right"),
        controlled=ControlledAgent("robot_joints", robot.name, robot.joint_names, "rad")
        if robot
        else ControlledAgent("human_arm", "human", ARM_JOINTS, "m"),
        robot_from_human=_placement(cut, settings, trials, robot, bones[0]) if robot else None,
        trial=tuple(entries),
    )
    write_trials(out, described, trials)


def _demonstration(
    bag: CutBag,
    one: Movement,
    entry: TrialEntry,
    rate_hz: float,
    bones: Sequence[tuple[float, float]],
    robot: RobotModel | None,
) -> Demonstration:
    """A trial as it will be read: every arm from its own shoulder, with the bones of them all."""
    from mild_core.learning.data.demonstration import Demonstration

    frames = slice(one.segment.begin, one.segment.end)
    others = bag.others[frames]
    active = np.zeros(len(others))
    active[one.segment.onset - one.segment.begin : one.segment.back - one.segment.begin] = 1.0
    return Demonstration(
        trial=entry.number,
        interaction=entry.interaction,
        rate_hz=rate_hz,
        observed_names=ARM_JOINTS,
        observed_m=_arm(bag.arm_m[frames], bones[0]),
        controlled_names=robot.joint_names if robot else ARM_JOINTS,
        controlled=others if robot else _arm(others, bones[1]),
        active=active,
    )


def _arm(arm_m: FloatArray, bones: tuple[float, float]) -> FloatArray:
    from mild_core.learning.datasets.traj_data import from_the_shoulder

    return from_the_shoulder(with_bone_lengths(arm_m, bones))


def _placement(
    cut: Sequence[CutBag],
    settings: DemonstrationSettings,
    trials: Sequence[Demonstration],
    robot: RobotModel,
    bones: tuple[float, float],
) -> HumanPlacement | None:
    """Where the person stood: seen by a calibrated camera, or where hands meet; None when neither is known.

    Raises:
        SetupError: There is no trial in which hands meet, or `robot_from_camera` is no pose.
    """
    from mild_core.learning.training.place_fit import fit_contact

    pose = robot_from_camera(settings.person.robot_from_camera)
    if pose is not None:
        places = [pose[:3, :3] @ bag.calibrations[0].shoulder_m + pose[:3, 3] for bag in cut]
        forward = np.mean([pose[:3, :3] @ bag.calibrations[0].arm_from_source[0] for bag in cut], axis=0)
        x, y, z = (round(float(value), 4) for value in np.mean(places, axis=0))
        return HumanPlacement((x, y, z), round(math.atan2(forward[1], forward[0]), 4))
    if not settings.touching:
        return None
    return fit_contact(trials, robot, settings.touching, bones, FACING_RAD).placement()
