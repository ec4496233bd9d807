# SPDX-License-Identifier: Apache-2.0
"""The replay node in real time: paused at first, from the middle, faster, over and over, under other names."""

from __future__ import annotations

import itertools
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool
from visualization_msgs.msg import Marker, MarkerArray

from mild_ros.bag.encoding import encode
from mild_ros.bag.reader import jazzy_types
from mild_ros.bag.writer import create_bag
from mild_ros.messages.stamps import ns_from_msg, time_to_msg
from mild_ros.node_kit.quality_of_service import HANDLED
from mild_ros.replay.sending import SETTLING_S
from test.ros.processes import NodeProcess, Probe

START_NS, STEP_NS, COUNT = 1_700_000_000 * 10**9, 50_000_000, 40

pytestmark = pytest.mark.slow


@pytest.fixture(name="bag")
def _bag(tmp_path: Path) -> Path:
    """Two seconds of numbered skeletons, with other topics beside them: one of a type that is not installed."""
    transforms = jazzy_types().types["tf2_msgs/msg/TFMessage"]([])
    with create_bag(tmp_path / "bag") as bag:
        for index in range(COUNT):
            time_ns = START_NS + index * STEP_NS
            marker = Marker(id=index)
            marker.header.stamp = time_to_msg(time_ns)
            bag.write("/bodies", "visualization_msgs/msg/MarkerArray", time_ns, encode(MarkerArray(markers=[marker])))
            bag.write("/note", "std_msgs/msg/String", time_ns, encode(String(data=str(index))))
            bag.write("/tf", "tf2_msgs/msg/TFMessage", time_ns, encode(transforms))
            bag.write("/joint_command", "sensor_msgs/msg/JointState", time_ns, encode(JointState()))
    return tmp_path / "bag"


def test_a_bag_is_played_as_asked(start: Callable[..., NodeProcess], probe: Probe, bag: Path) -> None:
    skeletons = probe.listen(MarkerArray, "/tracker", 1000)
    notes, clocks = probe.listen(String, "/note", 1000), probe.listen(Clock, "/clock", 1000)
    asked = {"paused": True, "loop": True, "start_s": 1.0, "rate": 4.0, "clock": True, "also": ["all"]}
    node = start("replay", "-r", "skeleton:=/tracker", bag=bag, **asked)
    assert probe.call(SetBool, "/replay/pause", SetBool.Request(data=False)).success
    probe.until(lambda: len(skeletons) > 50, "two laps and a half")
    assert "/joint_command" not in dict(probe.node.get_topic_names_and_types()), "commands were not asked for"
    lap = list(range(COUNT // 2, COUNT))
    numbers = [message.markers[0].id for message in skeletons]
    assert numbers == list(itertools.islice(itertools.cycle(lap), len(numbers))), "from the first on, none is lost"
    assert [int(note.data) for note in notes[:50]] == numbers[:50]
    assert [ns_from_msg(message.markers[0].header.stamp) for message in skeletons[:20]] == [
        START_NS + index * STEP_NS for index in lap
    ], "with a clock of the bag, stamps stay"
    ticks = np.array([ns_from_msg(clock.clock) for clock in clocks])
    assert ticks[0] == START_NS + COUNT // 2 * STEP_NS
    assert set(np.diff(ticks[:90])) == {10_000_000}
    assert np.any(np.diff(ticks) < 0), "time starts again with each lap"
    assert probe.call(SetBool, "/replay/pause", SetBool.Request(data=True)).success
    assert node.stop(signal.SIGINT) == 0, "a loop ends on SIGINT"
    assert "/tf is not sent: the type tf2_msgs/msg/TFMessage is not installed here" in node.output()
    assert f"{COUNT} messages of types that are not installed here left out (/tf)" in node.output()


def test_lock_step_begins_when_the_recorder_hears_of_outcomes(
    start: Callable[..., NodeProcess], probe: Probe, bag: Path
) -> None:
    """A recorder looks for topics now and then, so that it reports before it listens."""
    probe.listen(MarkerArray, "skeleton", 1000)
    clocks = probe.listen(Clock, "clock", 1000)
    publishers = [probe.node.create_publisher(Header, topic, HANDLED) for topic in ("handled", "recorded")]
    start("replay", bag=bag, mode="lock_step", recorders=1, joint_states="home")
    probe.until(lambda: all(one.get_subscription_count() for one in publishers), "a replay that listens")
    begin_s = time.monotonic()
    probe.until(lambda: time.monotonic() - begin_s > 3 * SETTLING_S, "what settles to have settled")
    assert not clocks
    probe.listen(Header, "handled", 1000)
    probe.until(lambda: bool(clocks), "the first tick")
