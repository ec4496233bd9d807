# SPDX-License-Identifier: Apache-2.0
"""One bag cut into trials: who did what when, which of it is a trial, and what it shows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mild_core.errors import BagError, SetupError
from mild_core.perception.calibration import Calibration
from mild_core.retargeting.robot_file import find_robot
from mild_core.shapes import FloatArray
from mild_ros.bag.reader import BagReader, open_bag
from mild_ros.bag.tracker_clock import Clock, judge_clock
from mild_ros.commands.joint_naming import joint_naming
from mild_ros.demonstrations.labels import TOPIC, BagLabels, cleaned, for_all, label_each, spans_said
from mild_ros.demonstrations.settings import SAME, CutParameters, DemonstrationSettings
from mild_ros.demonstrations.streams import Streams, read_streams
from mild_ros.demonstrations.tracks import ArmTrack, Sightings, follow, joints_on_grid, on_grid, perception_of

if TYPE_CHECKING:
    from mild_core.learning.data.segmentation import Cut, RestToRest, Segment

PERSON, PARTNER, ROBOT = "the person", "the partner", "the robot"


@dataclass(frozen=True)
class Movement:
    """A movement of a bag: a trial, or what is left out.

    Attributes:
        segment: Its frames in the bag's tracks.
        interaction: What it shows; "" when unlabelled.
        fault: Why it is left out; "" for a trial.
        number: Counts, from 1, the movements that a label can make a trial; 0 for others.
    """

    segment: Segment
    interaction: str
    fault: str
    number: int


@dataclass(frozen=True, eq=False)
class CutBag:
    """A bag and what was cut out of it.

    Attributes:
        name: Of the bag.
        times_s: (T,) of the frames, since the bag's first message.
        arm_m: (T, 3, 3) the watched arm.
        others: (T, J) the robot's joints [rad], or (T, 3, 3) the partner's arm [m]; NaN where they are unknown.
        cut: Speeds and distances.
        movements: In order of time.
        calibrations: Of the person, and of the partner if there is one.
        notes: What is odd about the bag, for people.
    """

    name: str
    times_s: FloatArray
    arm_m: FloatArray
    others: FloatArray
    cut: Cut
    movements: tuple[Movement, ...]
    calibrations: tuple[Calibration, ...]
    notes: tuple[str, ...]


def rest_to_rest(parameters: CutParameters) -> RestToRest:
    """The parameters as cutting takes them."""
    from mild_core.learning.data.segmentation import RestToRest

    return RestToRest(**{name: getattr(parameters, name) for name in RestToRest.__dataclass_fields__})


def bag_names(paths: Sequence[Path]) -> list[str]:
    """What to call each of these bags: its own name, with those of folders above it where others share it.

    Raises:
        SetupError: One bag is there twice.
    """
    places = [path.resolve() if path.name in ("", "..") else path.absolute() for path in paths]
    twice = [str(path) for path, count in Counter(path.resolve() for path in paths).items() if count > 1]
    if twice:
        raise SetupError(f"bag {twice[0]}", "is given twice", "give each bag once: its trials would count twice")
    parts = [(*place.parts[1:-1], place.stem if place.is_file() else place.name) for place in places]
    names = [""] * len(parts)
    for depth in range(1, max(map(len, parts), default=0) + 1):
        shared = Counter(part[-depth:] for part in parts)
        for index, part in enumerate(parts):
            if not names[index] and shared[part[-depth:]] == 1:
                names[index] = "_".join(part[-depth:])
    if len(set(names)) < len(names) or not all(names):
        return [f"{name}_{index + 1}" for index, name in enumerate(names)]
    return names


def cut_bag(
    path: Path, name: str, settings: DemonstrationSettings, salvage: bool, on_message: Callable[[], None]
) -> CutBag:
    """Read a bag and cut it.

    Args:
        path: The bag.
        name: What pictures, trials and labels call it.
        settings: How.
        salvage: Read what is readable of a broken one.
        on_message: Called for each message, for progress.

    Raises:
        BagError: The bag cannot be read, lacks a topic, or shows no person who stands still.
        SetupError: A setting does not fit the bag.
    """
    from mild_core.learning.data.segmentation import cut_at_rest

    with open_bag(path, salvage=salvage) as bag:
        streams = read_streams(bag, name, settings, on_message)
        notes = [f"{count} messages: {reason}" for reason, count in sorted(streams.unreadable.items()) if count]
        if bag.lost:
            notes.append(bag.lost)
        tracks = _tracks(bag, settings, streams, notes)
        watched = tracks[0]
        times_s: FloatArray = (watched.stamps_ns - bag.start_ns).astype(np.float64) * 1e-9
        others = _others(settings, streams, tracks, notes)
        cut = cut_at_rest(watched.arm_m, others, times_s, rest_to_rest(settings.cut))
        if not cut.found_rest:
            raise BagError(str(path), "the person's hand never rests in it", "raise slow_m_s or near_m in [cut]")
        movements = _labelled(bag, name, settings, streams, cut, times_s)
    calibrations = tuple(track.calibration for track in tracks if track.calibration is not None)
    return CutBag(name, times_s, watched.arm_m, others, cut, movements, calibrations, tuple(notes))


def _tracks(bag: BagReader, settings: DemonstrationSettings, streams: Streams, notes: list[str]) -> list[ArmTrack]:
    """The watched arm, and the partner's if there is one."""
    person, rest = _followed(bag, settings, PERSON, streams.person, notes)
    tracks = [person]
    if settings.partner is not None:
        seen = rest if settings.partner.topic == SAME else streams.partner
        partner, _ = _followed(bag, settings, PARTNER, seen, notes)
        tracks.append(partner)
    return tracks[::-1] if settings.swap else tracks


def _followed(
    bag: BagReader, settings: DemonstrationSettings, who: str, sightings: Sightings, notes: list[str]
) -> tuple[ArmTrack, Sightings]:
    """The arm of one of the two, and who else was seen.

    Raises:
        BagError: They do not stand still for the calibration.
    """
    parameters = settings.partner if who == PARTNER and settings.partner is not None else settings.person
    seen = [(received_ns, people[0].stamp_ns) for received_ns, people in sightings if people]
    received, stamps = [received_ns for received_ns, _ in seen], [stamp_ns for _, stamp_ns in seen]
    clock = judge_clock(who, received, stamps, settings.cut.clock)
    if clock.note:
        notes.append(clock.note)
    track, rest = follow(sightings, clock, perception_of(parameters, settings.cut.rate_hz))
    counts = {reason: count for reason, count in track.counts.items() if reason not in ("windows", "calibrated")}
    outcomes = ", ".join(f"{count} {reason}" for reason, count in sorted(counts.items(), key=lambda pair: -pair[1]))
    if not len(track.stamps_ns):
        problem = (
            f"{who} never stands still for {parameters.calibration_s:g} s in it ({outcomes or 'no person is seen'})"
        )
        raise BagError(str(bag.path), problem, "leave the bag out, or set source, side or calibration_s")
    notes.append(f"{who}: {outcomes}")
    return track, rest


def _others(
    settings: DemonstrationSettings, streams: Streams, tracks: Sequence[ArmTrack], notes: list[str]
) -> FloatArray:
    """What the other agent did, at the times of the watched arm."""
    grid_ns, gap_s = tracks[0].stamps_ns, settings.person.max_gap_s
    if settings.robot is None:
        return on_grid(grid_ns, tracks[1].stamps_ns, tracks[1].arm_m, gap_s)
    names = joint_naming(find_robot(settings.robot.robot).joint_names, settings.robot.robot_joint_names).theirs
    received, stamps = [time_ns for time_ns, _ in streams.joints], [one.stamp_ns for _, one in streams.joints]
    clock: Clock = judge_clock(ROBOT, received, stamps, settings.cut.clock)
    if clock.note:
        notes.append(clock.note)
    return joints_on_grid(grid_ns, streams.joints, names, clock, gap_s)


def _labelled(
    bag: BagReader, name: str, settings: DemonstrationSettings, streams: Streams, cut: Cut, times_s: FloatArray
) -> tuple[Movement, ...]:
    """Every movement with what it shows."""
    possible = [segment for segment in cut.segments if not segment.fault]
    spans = [(float(times_s[one.onset]), float(times_s[one.back - 1])) for one in possible]
    labels = settings.labels.get(name) or _said(settings, streams, bag.start_ns)
    said = iter(label_each(f"labels of {name}", labels, spans))
    movements, number = [], 0
    for segment in cut.segments:
        if segment.fault:
            movements.append(Movement(segment, "", segment.fault, 0))
            continue
        number += 1
        interaction, fault = cleaned(next(said), settings.interactions)
        movements.append(Movement(segment, interaction, fault, number))
    return tuple(movements)


def _said(settings: DemonstrationSettings, streams: Streams, start_ns: int) -> BagLabels:
    if settings.label.startswith(TOPIC):
        return spans_said([((time_ns - start_ns) * 1e-9, word) for time_ns, word in streams.labels])
    return for_all(settings.label)


def left_out(bags: Sequence[CutBag]) -> Counter[str]:
    """Movements that are no trials, by reason."""
    return Counter(
        f"{one.fault} '{one.interaction}'" if one.interaction else one.fault
        for bag in bags
        for one in bag.movements
        if one.fault
    )


def mean_bones_m(bags: Sequence[CutBag], place: int) -> tuple[float, float]:
    """Upper arm and forearm [m], the mean over bags, of the agent at a place of `CutBag.calibrations`."""
    upper, fore = np.mean([bag.calibrations[place].bone_lengths_m for bag in bags], axis=0).tolist()
    return upper, fore
