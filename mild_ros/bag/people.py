# SPDX-License-Identifier: Apache-2.0
"""The people in a bag: which of its topics show them to a source, and what they show.

A tracker that shows a person joint by joint has a topic for each, or tf frames; the others have one topic.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import islice

from mild_core.errors import BagError, DataError, SetupError
from mild_core.perception.skeletons import SkeletonSource
from mild_ros.bag.reader import BagReader, topic_of_type
from mild_ros.messages.feeds import SKELETON_TOPIC, Feed
from mild_ros.messages.joint_by_joint import People
from mild_ros.messages.misfits import fitting_sources, misfit
from mild_ros.messages.skeletons import ADAPTERS

LOOKED_AT = 300
"""Messages by which the source is judged."""

OWN = ("person", "features", "belief", "motion", "motion_state", "markers")
"""Topics of ours that have the type of a tracker's."""


def skeleton_feeds(bag: BagReader, source: SkeletonSource, wanted: str = "") -> Mapping[str, Feed]:
    """How to read the bag's topics that show people, by their names in the bag; what is read shares one new memory.

    Args:
        bag: The bag.
        source: Tracker convention.
        wanted: Topic of a source with a single one; "" finds it by its type.

    Raises:
        BagError: The bag lacks one of them.
        SetupError: The source has a topic for each joint, and none is named.
    """
    feeds = ADAPTERS[source.message].feeds(source)
    if not feeds:
        raise SetupError("joint_names", f"is empty, and {source.name} has a topic for each joint", "name the joints")
    if feeds[0].topic == SKELETON_TOPIC:
        _of_another_source(bag, feeds[0].type_name)
        usual = bag.topics.get(f"/{SKELETON_TOPIC}")  # as our own recordings name it, among other clouds perhaps
        named = usual is not None and usual.type_name == feeds[0].type_name
        topic = topic_of_type(bag, feeds[0].type_name, wanted or SKELETON_TOPIC * named)
        _check_defined(bag, feeds[0].type_name)
        return {topic: feeds[0]}
    found = {f"/{feed.topic.lstrip('/')}": feed for feed in feeds}
    there = {topic: summary.type_name for topic, summary in bag.topics.items()}
    for topic, feed in found.items():
        if there.get(topic, feed.type_name if feed.latched else "") != feed.type_name:
            listing = ", ".join(sorted(there)) or "no topic at all"
            remedy = "name the topics in joint_places, or choose another bag or source"
            raise BagError(str(bag.path), f"has no {topic} of {feed.type_name}, but {listing}", remedy)
        if topic in there:
            _check_defined(bag, feed.type_name)
    return {topic: feed for topic, feed in found.items() if topic in there}


def source_fault(
    bag: BagReader, source: SkeletonSource, wanted: str = "", looked_at: int | None = LOOKED_AT
) -> tuple[str, str]:
    """Why no person can be seen in a bag's messages with a source, and what to do; empty when one may be.

    It says what the live check of the source says, and only looks at what messages are made of.

    Args:
        bag: The bag.
        source: Tracker convention.
        wanted: As of `skeleton_feeds`.
        looked_at: How many messages count; None for all, so that a joint that is missing is missing for good.

    Raises:
        BagError: As `skeleton_feeds`, or the bag breaks off.
        SetupError: As `skeleton_feeds`.
    """
    feeds, wrong, unread = skeleton_feeds(bag, source, wanted), Counter[str](), Counter[str]()
    seen = 0
    for raw in islice(bag.messages(feeds), looked_at):
        seen += 1
        try:
            message = bag.decode(raw)
            found, people = misfit(message, source), feeds[raw.topic].read(message, raw.time_ns)
        except DataError as error:
            unread[f"{error.reason} ({error.detail})"] += 1
            continue
        if people and not found:
            return "", ""
        if found:
            wrong[found] += 1
    if wrong:
        fault, _, remedy = wrong.most_common(1)[0][0].rpartition(": ")
        return f"it brings {fault}", remedy
    for feed in feeds.values() if seen and looked_at is None else ():
        if feed.lacks is not None and (lacking := feed.lacks()):
            fault, _, remedy = lacking.rpartition(": ")
            return fault, remedy
    if unread and (looked_at is None or unread.total() == seen):
        reason, count = unread.most_common(1)[0]
        defined = reason.startswith("undecodable")
        remedy = "in mcap, which keeps definitions of types" if defined else "once what publishes them is mended"
        return f"{count} of {seen} messages are {reason}", f"record it again, {remedy}"
    return "", ""


def _of_another_source(bag: BagReader, type_name: str) -> None:
    """Refuse a bag without messages of a type, if it has some that another source reads: as the live check does."""
    if any(summary.type_name == type_name for summary in bag.topics.values()):
        return
    listing = ", ".join(sorted(bag.topics)) or "no topic at all"
    for topic, summary in sorted(bag.topics.items()):
        fitting = fitting_sources(summary.type_name)
        if fitting and topic.rsplit("/", 1)[-1] not in OWN:
            problem = f"has no topic of {type_name}, but {listing}"
            raise BagError(str(bag.path), problem, f"is it {topic}? Then set source to {' or '.join(fitting)}")


def _check_defined(bag: BagReader, type_name: str) -> None:
    """Refuse a bag that lacks the definition of a type that ROS 2 Jazzy does not have."""
    if type_name not in bag.types.fielddefs:
        problem = f"does not define {type_name}, which is no type of ROS 2 Jazzy"
        remedy = "record it with `-s mcap`, or where that package is installed convert it: ros2 bag convert"
        raise BagError(str(bag.path), problem, remedy)


def people_in_bag(
    bag: BagReader, source: SkeletonSource, wanted: str = "", looked_at: int | None = None
) -> Iterator[tuple[int, People]]:
    """Everyone in every message that shows people, and when it was recorded [ns]; what is unreadable is passed over.

    Args:
        bag: The bag.
        source: Tracker convention.
        wanted: As of `skeleton_feeds`.
        looked_at: How many messages are looked at; None for all.

    Raises:
        BagError: As `skeleton_feeds`, or the bag breaks off.
    """
    feeds = skeleton_feeds(bag, source, wanted)
    for raw in islice(bag.messages(feeds), looked_at):
        try:
            people = feeds[raw.topic].read(bag.decode(raw), raw.time_ns)
        except DataError:
            continue
        if people is not None:
            yield raw.time_ns, people
