# SPDX-License-Identifier: Apache-2.0
"""The record node writes what is published, byte for byte, and survives a kill and a full disk."""

from __future__ import annotations

import resource
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from mild_core.errors import BagError
from mild_ros.bag.reader import open_bag
from mild_ros.node_kit.quality_of_service import HANDLED
from mild_ros.nodes.record_node import OVERLAP_S, OnceEach
from test.replay.processes import node, wait_until
from test.ros.processes import Probe

BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture(scope="module")
def sender(ros_domain: int) -> Iterator[Node]:
    rclpy.init()
    sender = Node("sender")
    yield sender
    sender.destroy_node()
    rclpy.try_shutdown()


WARM_UP = "warm-up"


def heard(publisher: Publisher, message: Any, folder: Path) -> None:
    """Send `message` until some arrives in the bag: a publisher may see a subscriber that does not see it yet."""

    def arrived() -> bool:
        publisher.publish(message)
        return size(folder) > 3000

    wait_until(arrived, f"message on {publisher.topic_name} in {folder.name}")


def joint_state(index: int) -> JointState:
    message = JointState(name=["a", "b"], position=[0.1 * index, -1.0])
    message.header.stamp.sec = index
    return message


def test_publishers_of_every_qos_are_recorded_whenever_they_come(sender: Node, tmp_path: Path) -> None:
    """The recorder listens as the first publisher sends; later ones send in other ways, and one sends another type."""
    ways = [
        QoSProfile(depth=500),
        QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT),
        QoSProfile(depth=500, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    ]
    with (
        closing(Probe()) as stranger,
        node("record", {"bag": tmp_path / "bag", "topics": "[joint_command]"}) as process,
    ):
        publishers = [sender.create_publisher(JointState, "joint_command", ways[0])]
        heard(publishers[0], joint_state(-1), tmp_path / "bag")
        publishers += [sender.create_publisher(JointState, "joint_command", way) for way in ways[1:]]
        publishers[2].publish(joint_state(99))  # kept by its publisher until the recorder has come
        stranger.node.create_publisher(String, "joint_command", 10)
        # As many subscriptions as ways, and the publisher that every one of them matches sees all three.
        wait_until(lambda: publishers[2].get_subscription_count() == 3, "a subscription for each way")
        wait_until(lambda: publishers[1].get_subscription_count() == 1, "the one for best effort")
        for index in range(100, 200):
            publishers[index % 3].publish(joint_state(index))
            publishers[index % 3].publish(joint_state(index))  # the same bytes twice are two messages
        wait_until(lambda: newest(tmp_path / "bag") >= 199, "last message on the disk")
        output = stop(process)
    with open_bag(tmp_path / "bag") as bag:
        numbers = [bag.decode(raw).header.stamp.sec for raw in bag.messages(["/joint_command"])]
    numbers = sorted(number for number in numbers if number >= 0)
    assert numbers == [99, *(index for index in range(100, 200) for _ in range(2))]
    assert "not recorded: /joint_command of probe" in output
    for publisher in publishers:
        sender.destroy_publisher(publisher)


def test_what_several_subscriptions_bring_is_kept_once() -> None:
    came = OnceEach()
    assert [came.is_new("a", b"x", 0.0), came.is_new("b", b"x", 0.1), came.is_new("b", b"y", 0.1)] == [
        True,
        False,
        True,
    ]
    assert [came.is_new("a", b"x", 0.2), came.is_new("a", b"x", 0.3)] == [True, True], "a repetition is a message"
    assert came.is_new("b", b"x", 0.4) is False
    assert came.is_new("b", b"x", 0.4 + 2 * OVERLAP_S) is True, "later it is another one"
    assert len(came._newest) == 1, "what is over is forgotten"


def stop(process: subprocess.Popen[str]) -> str:
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    return output


def test_what_is_published_is_recorded(sender: Node, tmp_path: Path) -> None:
    fast = sender.create_publisher(JointState, "joint_command", BEST_EFFORT)
    latched = sender.create_publisher(String, "interaction", LATCHED)
    latched.publish(String(data="before any subscriber"))
    with node("record", {"bag": tmp_path / "bag", "topics": "[joint_command, interaction]"}) as process:
        heard(fast, joint_state(-1), tmp_path / "bag")
        for index in range(500):
            fast.publish(joint_state(index))
        wait_until(lambda: newest(tmp_path / "bag") == 499, "last message on the disk")
        output = stop(process)
    with open_bag(tmp_path / "bag") as bag:
        states = [bag.decode(raw) for raw in bag.messages(["/joint_command"])]
        warm_ups = sum(state.header.stamp.sec < 0 for state in states)
        states = states[warm_ups:]
        assert [bag.decode(raw).data for raw in bag.messages(["/interaction"])] == ["before any subscriber"]
        assert set(bag.topics) == {"/joint_command", "/interaction"}
    np.testing.assert_array_equal([state.position[0] for state in states], [0.1 * index for index in range(500)])
    assert f"{501 + warm_ups} messages" in output
    sender.destroy_publisher(fast)
    sender.destroy_publisher(latched)


def test_what_a_replay_waits_for_is_recorded_though_it_overtakes_the_first_clock(sender: Node, tmp_path: Path) -> None:
    handled, clock = sender.create_publisher(Header, "handled", HANDLED), sender.create_publisher(Clock, "clock", 10)
    repeated: list[str] = []
    listener = sender.create_subscription(Header, "recorded", lambda header: repeated.append(header.frame_id), HANDLED)
    given = {"bag": tmp_path / "bag", "topics": "[handled]", "report_recorded": True, "use_sim_time": True}
    with node("record", given) as process:
        wait_until(lambda: handled.get_subscription_count() == 1, "the recorder")
        wait_until(lambda: sender.count_publishers("recorded") == 1, "its answers")
        handled.publish(Header(frame_id="pipeline 0 from before the replay"))
        handled.publish(Header(frame_id="pipeline 0 tick", stamp=Time(sec=1700)))
        assert process.stderr is not None
        assert any("first message on /handled" in line for line in process.stderr), "it came before the clock"

        def answered() -> bool:
            clock.publish(Clock(clock=Time(sec=1700)))
            rclpy.spin_once(sender, timeout_sec=0.05)
            return bool(repeated)

        wait_until(answered, "the answer to the tick")
        output = stop(process)
    assert repeated == ["pipeline 0 tick"]
    with open_bag(tmp_path / "bag") as bag:
        assert [raw.time_ns for raw in bag.messages(["/handled"])] == [1700 * 10**9]
    assert "1 from before the first /clock" in output
    for publisher in (handled, clock):
        sender.destroy_publisher(publisher)
    sender.destroy_subscription(listener)


def newest(path: Path) -> int:
    """Number of the newest message that a recording under way has brought to the disk."""
    with open_bag(path, salvage=True) as bag:
        return max((bag.decode(raw).header.stamp.sec for raw in bag.messages(["/joint_command"])), default=-1)


def size(path: Path) -> int:
    return sum(file.stat().st_size for file in path.glob("*.mcap"))


def kept_numbers(path: Path, *, salvage: bool) -> int:
    with open_bag(path, salvage=salvage) as bag:
        texts = [bag.decode(raw).data for raw in bag.messages(["/text", "/more_text"])]
    numbers = [int(text.split()[0]) for text in texts if text != WARM_UP]
    assert numbers == list(range(len(numbers)))
    return len(numbers)


def noise(generator: np.random.Generator, index: int) -> String:
    return String(data=f"{index} {generator.bytes(10_000).hex()}")


def test_a_killed_recorder_loses_a_second_at_most(sender: Node, tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    publisher = sender.create_publisher(String, "text", 100)
    with node("record", {"bag": tmp_path / "bag"}) as process:
        heard(publisher, String(data=WARM_UP), tmp_path / "bag")
        for index in range(20):
            publisher.publish(noise(generator, index))
        # All twenty are more than 100 kB even when packed: once the file is that long they are on the disk.
        wait_until(lambda: size(tmp_path / "bag") > 200_000, "flush")
        process.kill()
        process.wait(timeout=60)
    with pytest.raises(BagError, match="--salvage"):
        kept_numbers(tmp_path / "bag", salvage=False)
    assert kept_numbers(tmp_path / "bag", salvage=True) == 20
    sender.destroy_publisher(publisher)


def test_a_disk_that_takes_no_more_is_one_line(sender: Node, tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    # Another topic than in the test above: DDS takes 20 s to miss the listener that was killed there.
    publisher = sender.create_publisher(String, "more_text", 1000)
    with node("record", {"bag": tmp_path / "bag"}) as process:
        heard(publisher, String(data=WARM_UP), tmp_path / "bag")
        # Only now: DDS itself needs larger files, in shared memory, when it starts.
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (4 * 2**20, 4 * 2**20))
        for index in range(600):
            publisher.publish(noise(generator, index))
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    lines = [line for line in errors.splitlines() if not line.startswith("[INFO]")]
    assert len(lines) == 1, errors
    assert "while writing" in lines[0]
    assert kept_numbers(tmp_path / "bag", salvage=True) > 100
    sender.destroy_publisher(publisher)


@pytest.mark.parametrize("replaced_by", ["nothing", "a link", "a folder", "another name"])
@pytest.mark.parametrize("at_the_end", [False, True], ids=["while it records", "at its end"])
def test_a_folder_that_goes_away_is_one_line(replaced_by: str, at_the_end: bool, sender: Node, tmp_path: Path) -> None:
    bag, elsewhere = tmp_path / "bag", tmp_path / "elsewhere"
    publisher = sender.create_publisher(String, f"text_{replaced_by.replace(' ', '_')}_{int(at_the_end)}", 1000)
    elsewhere.mkdir()
    (elsewhere / ".reserve").write_text("of another process")
    with node("record", {"bag": bag}) as process:
        generator = np.random.default_rng(0)
        heard(publisher, noise(generator, 0), bag)
        if at_the_end:
            process.send_signal(signal.SIGSTOP)  # it notices once a second; here its end comes first
        bag.rename(tmp_path / "moved")
        if replaced_by == "a link":
            bag.symlink_to(elsewhere)
        elif replaced_by == "a folder":
            bag.mkdir()
        if replaced_by != "another name":
            shutil.rmtree(tmp_path / "moved")
        if at_the_end:
            process.send_signal(signal.SIGINT)
            process.send_signal(signal.SIGCONT)
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 2, errors
    lines = [line for line in errors.splitlines() if not line.startswith("[INFO]")]
    assert len(lines) == 1, errors
    assert "was removed or replaced while it was written" in lines[0]
    assert "messages in" not in output
    assert [path.name for path in elsewhere.iterdir()] == [".reserve"]
    if replaced_by == "another name":
        with open_bag(tmp_path / "moved", salvage=True) as moved:
            assert sum(topic.count for topic in moved.topics.values()) > 0
    sender.destroy_publisher(publisher)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [({}, "parameter bag: is empty"), ({"bag": "."}, "exists already"), ({"bga": "x"}, "did you mean 'bag'")],
)
def test_wrong_parameters_are_one_line(parameters: dict[str, str], words: str) -> None:
    with node("record", parameters) as process:
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert len(errors.strip().splitlines()) == 1
    assert words in errors
