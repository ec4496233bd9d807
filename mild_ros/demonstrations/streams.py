# SPDX-License-Identifier: Apache-2.0
"""What a bag holds of a demonstration: people, joints and labels in order of receipt."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from mild_core.errors import DataError
from mild_core.signals import JointMeasurement
from mild_ros.assembly.perception import skeleton_source
from mild_ros.bag.budgets import OverBudgetError, TimeBudget
from mild_ros.bag.people import skeleton_feeds
from mild_ros.bag.reader import BagReader, topic_of_type
from mild_ros.demonstrations.labels import LABEL_TYPE, TOPIC
from mild_ros.demonstrations.settings import SAME, DemonstrationSettings, PersonParameters
from mild_ros.messages.joint_by_joint import People
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.replay.in_process import JOINT_STATE_TYPE


@dataclass(frozen=True, eq=False)
class Streams:
    """A bag's messages, each with the time of its receipt [ns].

    Attributes:
        person: Everyone whom the person's tracker saw.
        partner: The same of the partner's tracker; that of the person where both are in its messages.
        joints: Where the robot said it was.
        labels: What was said to go on.
        unreadable: Messages that cannot be read, by reason.
    """

    person: list[tuple[int, People]] = field(default_factory=list)
    partner: list[tuple[int, People]] = field(default_factory=list)
    joints: list[tuple[int, JointMeasurement]] = field(default_factory=list)
    labels: list[tuple[int, str]] = field(default_factory=list)
    unreadable: Counter[str] = field(default_factory=Counter)


Reader = Callable[[Any, int], None]
"""Takes a message and the time when it came [ns]."""


def readers(bag: BagReader, name: str, settings: DemonstrationSettings, streams: Streams) -> dict[str, list[Reader]]:
    """Who reads the messages of which topics of a bag, which labels call by `name`, into `streams`.

    Raises:
        BagError: The bag lacks a topic.
        SetupError: A tracker's joints are not named.
    """
    found: dict[str, list[Reader]] = {}

    def watch(parameters: PersonParameters, into: list[tuple[int, People]]) -> None:
        for topic, feed in skeleton_feeds(bag, skeleton_source(parameters), parameters.topic).items():
            found.setdefault(topic, []).append(partial(_people, feed.read, into))

    watch(settings.person, streams.person)
    if settings.partner is not None and settings.partner.topic != SAME:
        watch(settings.partner, streams.partner)
    if settings.robot is not None:
        topic = topic_of_type(bag, JOINT_STATE_TYPE, settings.robot.topic)
        found.setdefault(topic, []).append(partial(_joints, streams))
    if settings.label.startswith(TOPIC) and name not in settings.labels:
        topic = topic_of_type(bag, LABEL_TYPE, settings.label.removeprefix(TOPIC))
        found.setdefault(topic, []).append(partial(_label, streams.labels))
    return found


def read_streams(bag: BagReader, name: str, settings: DemonstrationSettings, on_message: Callable[[], None]) -> Streams:
    """Read a bag.

    Args:
        bag: The bag.
        name: What labels call it.
        settings: What is wanted of it.
        on_message: Called for each message, for progress.

    Raises:
        BagError: It lacks a topic, or breaks off.
        SetupError: A tracker's joints are not named.
    """
    streams = Streams()
    wanted = readers(bag, name, settings, streams)
    budget = TimeBudget()
    for raw in bag.messages(wanted):
        on_message()
        try:
            budget.reach(raw.time_ns)  # what comes of it is resampled
        except OverBudgetError as error:
            raise error.of(bag.path) from None
        try:
            message = bag.decode(raw)
            for read in wanted[raw.topic]:
                read(message, raw.time_ns)
        except DataError as error:
            streams.unreadable[f"{raw.topic} {error.reason}"] += 1
    return streams


def _people(read: Callable[[Any, int], People | None], into: list[tuple[int, People]], message: Any, now: int) -> None:
    people = read(message, now)
    if people is not None:
        into.append((now, people))


def _joints(streams: Streams, message: Any, now: int) -> None:
    """Keep the joints with finite positions: a gripper that reports NaN does not invalidate an arm."""
    names, positions = tuple(map(str, message.name)), np.asarray(message.position, dtype=np.float64)
    if len(names) != len(positions):
        raise DataError("wrong_layout", f"{len(names)} joint names with {len(positions)} positions")
    finite = np.isfinite(positions)
    streams.unreadable["joint positions not finite"] += int(np.count_nonzero(~finite))
    reported = tuple(name for name, is_finite in zip(names, finite, strict=True) if is_finite)
    streams.joints.append((now, JointMeasurement(ns_from_msg(message.header.stamp), reported, positions[finite])))


def _label(into: list[tuple[int, str]], message: Any, now: int) -> None:
    into.append((now, str(message.data)))
