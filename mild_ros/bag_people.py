# SPDX-License-Identifier: Apache-2.0
"""The people in a bag: which of its topics show them to a source, and what they show.

A tracker that shows a person joint by joint has a topic for each, or tf frames; the others have one topic.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from mild_core.errors import BagError, DataError, SetupError
from mild_core.perception.skeletons import SkeletonSource
from mild_ros.bags import BagReader, topic_of_type
from mild_ros.messages.feeds import SKELETON_TOPIC, Feed
from mild_ros.messages.joint_by_joint import People
from mild_ros.messages.misfits import misfit
from mild_ros.messages.skeletons import ADAPTERS


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
        usual = bag.topics.get(f"/{SKELETON_TOPIC}")  # as our own recordings name it, among other clouds perhaps
        named = usual is not None and usual.type_name == feeds[0].type_name
        return {topic_of_type(bag, feeds[0].type_name, wanted or SKELETON_TOPIC * named): feeds[0]}
    found = {f"/{feed.topic.lstrip('/')}": feed for feed in feeds}
    there = {topic: summary.type_name for topic, summary in bag.topics.items()}
    for topic, feed in found.items():
        if there.get(topic, feed.type_name if feed.latched else "") != feed.type_name:
            listing = ", ".join(sorted(there)) or "no topic at all"
            remedy = "name the topics in joint_places, or choose another bag or source"
            raise BagError(str(bag.path), f"has no {topic} of {feed.type_name}, but {listing}", remedy)
    return {topic: feed for topic, feed in found.items() if topic in there}


def people_in_bag(bag: BagReader, source: SkeletonSource, wanted: str = "") -> Iterator[tuple[int, People]]:
    """Everyone in every message that shows people, and when it was recorded [ns]; what is unreadable is passed over.

    Raises:
        BagError: As `skeleton_feeds`, or the bag breaks off.
    """
    feeds = skeleton_feeds(bag, source, wanted)
    for raw in bag.messages(feeds):
        try:
            people = feeds[raw.topic].read(bag.decode(raw), raw.time_ns)
        except DataError:
            continue
        if people is not None:
            yield raw.time_ns, people


def look_for_people(bag: BagReader, source: SkeletonSource, wanted: str = "") -> None:
    """Look whether a source sees anybody in a bag at all, which its first messages tell as a rule.

    Raises:
        BagError: As `people_in_bag`, or nobody is seen: then with the source that its messages are of.
    """
    feeds, wrong = skeleton_feeds(bag, source, wanted), ""
    for raw in bag.messages(feeds):
        try:
            message = bag.decode(raw)
            wrong = wrong or misfit(message, source)
            if feeds[raw.topic].read(message, raw.time_ns):
                return
        except DataError:
            continue
    problem = f"shows nobody to {source.name}{wrong and f': {wrong}'}"
    raise BagError(str(bag.path), problem, "or choose another bag" if wrong else "choose another bag or source")
