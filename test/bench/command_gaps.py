# SPDX-License-Identifier: Apache-2.0
"""Does control wait for reception? Gaps in the stream of commands while every topic is flooded, over DDS.

    python -m test.bench.command_gaps [--nodes pipeline|three] [--topics skeleton ...] [--rate 5000] [--seconds 10]
                                      [--runs 1] [--json]

A person shakes hands without end before a tracker at 30 Hz, a robot says at 100 Hz that it is where it was sent.
A process for each topic repeats valid messages with fresh stamps and invalid ones between them. Another process
listens: it takes the steady time at which each command comes (gaps at the subscriber) and the stamp that each command
got when it was made (gaps at the publisher).
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState, PointCloud2
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from mild_core.signals import JointMeasurement
from mild_ros.environment.processes import Nodes, private_domain
from mild_ros.messages.joint_state import joint_measurement_to_msg
from mild_ros.node_kit.priorities import in_real_time
from mild_ros.node_kit.quality_of_service import STATE
from test.faults.encoded_people import EncodedPeople
from test.faults.fault_bench import ROBOT, FaultBench
from test.faults.people import SimulatedPerson

ROOT = Path(__file__).parents[2]
NODES = {"pipeline": ("pipeline",), "three": ("perception", "inference", "retargeting")}
TOPICS = {
    "pipeline": ("skeleton", "joint_states"),
    "three": ("skeleton", "joint_states", "feature_window", "person", "motion"),
}
KINDS: dict[str, Any] = {
    "skeleton": MarkerArray,
    "joint_states": JointState,
    "feature_window": PointCloud2,
    "person": PointCloud2,
    "motion": JointTrajectory,
    "motion_state": PointCloud2,
}
FLOODS = {"quiet": (), "both": ("skeleton", "joint_states")}
"""Names of floods of no topic and of the two that come from outside; `all` is each that the nodes take."""

BURST_S = 0.002
"""A flood comes in bursts this far apart: a Python process cannot sleep for less with any precision."""

ALLOWED_MS, LONGEST_MS, SHARE = 20.0, 50.0, 0.999
"""What issue 12 asks for: this share of the gaps is at most `ALLOWED_MS`, none is above `LONGEST_MS`."""


class GapRoom(FaultBench):
    """A person and a robot that obeys at once."""

    def __init__(self, nodes: Nodes, domain: int, names: Sequence[str]) -> None:
        super().__init__(nodes, domain, names)
        for name in names:
            nodes.start(name, {})
        self._robot_ns = 0

    def now_ns(self) -> int:
        return time.time_ns()

    def report(self, name: str) -> dict[str, str]:
        """The newest diagnostics of a node."""
        return self._reports[name][1]

    @property
    def start_ns(self) -> int:
        """When the person came."""
        assert self.human._start_ns is not None
        return self.human._start_ns

    def _live(self) -> None:
        now_ns = self.now_ns()
        if now_ns >= self._due_ns:
            for message in self._see(now_ns):
                self._skeletons.publish(message)
            self._due_ns = max(self._due_ns + self._period_ns, now_ns)
        if now_ns >= self._robot_ns:
            self._robot_ns = max(self._robot_ns + 10_000_000, now_ns)
            place = np.array(self.commands[-1].positions_rad) if self.commands else ROBOT.home_rad
            self._publish_joints(JointMeasurement(now_ns, ROBOT.joint_names, place))
        self._executor.spin_once(timeout_sec=0.002)


def main() -> None:
    """Measure and print."""
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("--nodes", choices=NODES, default="pipeline")
    words.add_argument("--topics", nargs="*", help="one run for each; 'quiet', 'both', 'all' flood none, two, each")
    words.add_argument("--rate", type=float, default=5000.0, help="messages per second on a flooded topic")
    words.add_argument("--seconds", type=float, default=10.0)
    words.add_argument("--runs", type=int, default=1)
    words.add_argument("--json", action="store_true")
    words.add_argument("--flood", nargs=2, metavar=("TOPIC", "START_NS"), help=argparse.SUPPRESS)
    words.add_argument("--listen", help=argparse.SUPPRESS)
    given = words.parse_args()
    if given.flood:
        flood(given.flood[0], int(given.flood[1]), given.rate)
        return
    if given.listen:
        listen(Path(given.listen))
        return
    topics = given.topics or ["quiet", *TOPICS[given.nodes], "both"]
    results = []
    with (
        tempfile.TemporaryDirectory() as scratch,
        private_domain() as domain,
        Nodes(domain, Path(scratch)) as nodes,
        GapRoom(nodes, domain, NODES[given.nodes]) as room,
    ):
        os.environ |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        room.begin()
        for topic in topics:
            flooded = FLOODS.get(topic, TOPICS[given.nodes] if topic == "all" else (topic,))
            for _ in range(given.runs):
                results.append(measure(room, NODES[given.nodes][-1], topic, flooded, given.rate, given.seconds))
                if not given.json:
                    print(line(results[-1]), flush=True)
    if given.json:
        print(json.dumps(results, indent=1))


def line(result: dict[str, Any]) -> str:
    """A result for people."""
    parts = [f"{result['flooded']:16s}{result['commands']:6d} commands, fastest joint {result['rad_s']:.2f} rad/s"]
    for where in ("subscriber", "publisher"):
        found = result[where]
        parts.append(
            f"{where}: p50 {found['p50']:.1f} p99.9 {found['p99.9']:.1f} max {found['max']:.1f} ms, "
            f"{100 * found['within']:.2f} % within {ALLOWED_MS:g} ms"
        )
    return "; ".join([*parts, f"memory {result['memory_mb']:+.1f} MB", f"cpu {result['cpu']:.0f} %", result["said"]])


def measure(
    room: GapRoom, name: str, label: str, flooded: Sequence[str], rate_hz: float, seconds: float
) -> dict[str, Any]:
    """Flood these topics for a while."""
    room.until(lambda: room.follows, 30.0)
    process = room._nodes._running[name]
    with tempfile.TemporaryDirectory() as scratch, ExitStack() as stack:
        heard = Path(scratch, "heard.npz")
        listener = stack.enter_context(started("--listen", str(heard)))
        for topic in flooded:
            stack.enter_context(started("--flood", topic, str(room.start_ns), "--rate", str(rate_hz)))
        wanted = {"command_gaps", *(f"flood_{topic}" for topic in flooded)}
        if not room.until(lambda: wanted <= set(room._node.get_node_names()), 60.0):
            raise SystemExit(f"of {', '.join(sorted(wanted))} some did not start")
        room.until(lambda: False, 1.0)  # for discovery
        before, cpu = memory_mb(process.pid), cpu_s(process.pid)
        started_ns = time.monotonic_ns()
        room.until(lambda: False, seconds)
        ended_ns = time.monotonic_ns()
        cpu, after = cpu_s(process.pid) - cpu, memory_mb(process.pid)
        listener.send_signal(signal.SIGTERM)
        listener.wait(20.0)
        with np.load(heard) as arrays:
            came_ns, stamps_ns, fastest = arrays["came_ns"], arrays["stamp_ns"], arrays["rad_s"]
    during = (came_ns >= started_ns) & (came_ns <= ended_ns)
    return {
        "flooded": label,
        "commands": int(during.sum()),
        "rad_s": float(fastest[during].max(initial=0.0)),
        "subscriber": gaps(came_ns[during]),
        "publisher": gaps(stamps_ns[during]),
        "memory_mb": after - before,
        "cpu": 100 * cpu / seconds,
        "said": ", ".join(f"{key} {value}" for key, value in room.report(name).items() if "superseded" in key),
    }


def gaps(times_ns: Any) -> dict[str, float]:
    """Between neighbours [ms]."""
    found = np.diff(np.sort(times_ns)) * 1e-6
    values = np.percentile(found, [50.0, 99.9, 100.0]).tolist()
    within = float(np.mean(found <= ALLOWED_MS))
    return {**dict(zip(("p50", "p99.9", "max"), values, strict=True)), "within": within}


@contextmanager
def started(*words: str) -> Iterator[subprocess.Popen[bytes]]:
    """This bench in another role, ended with the block."""
    running = subprocess.Popen([sys.executable, "-m", "test.bench.command_gaps", *words], cwd=ROOT)
    try:
        yield running
    finally:
        running.terminate()
        running.wait(20.0)


def memory_mb(pid: int) -> float:
    """What a process holds in memory [MB]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") * 1e-6


def cpu_s(pid: int) -> float:
    """Processor time that a process has taken [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def ending() -> list[int]:
    """Grows when SIGTERM comes."""
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ended.append(number))
    return ended


def listen(path: Path) -> None:
    """Write down when commands come, until SIGTERM."""
    ended = ending()
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node, rows = Node("command_gaps"), []

    def on_command(message: Any) -> None:
        stamp = message.header.stamp
        rad_s = max(map(abs, message.velocity), default=0.0)
        rows.append((time.monotonic_ns(), stamp.sec * 10**9 + stamp.nanosec, rad_s))

    node.create_subscription(JointState, "joint_command", on_command, 1000)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    in_real_time()  # as a robot's driver
    while not ended:
        executor.spin_once(timeout_sec=0.1)
    came_ns, stamp_ns, rad_s = zip(*rows, strict=True) if rows else ((), (), ())
    np.savez(path, came_ns=np.array(came_ns), stamp_ns=np.array(stamp_ns), rad_s=np.array(rad_s))
    rclpy.try_shutdown()


def flood(topic: str, start_ns: int, rate_hz: float) -> None:
    """Publish valid and invalid messages in turn, until SIGTERM."""
    ended = ending()
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = Node(f"flood_{topic}")
    names = ("motion", "motion_state") if topic == "motion" else (topic,)
    quality = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    # Stages listen to each other reliably; a reliable publisher would wait for them.
    publishers = [
        node.create_publisher(KINDS[name], name, quality if name in TOPICS["pipeline"] else STATE) for name in names
    ]
    newest: dict[str, bytes] = {}
    source = {"joint_states": "joint_command"}.get(topic, topic)
    for name in () if topic == "skeleton" else names if topic == "motion" else (source,):
        kind = KINDS[topic if name == source else name]
        node.create_subscription(kind, name, lambda data, name=name: newest.__setitem__(name, data), quality, raw=True)
    human, encoded = SimulatedPerson(), EncodedPeople()
    human.seen(start_ns)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    nan = JointMeasurement(0, ROBOT.joint_names, np.full(len(ROBOT.joint_names), np.nan))
    bad = {"joint_states": serialize_message(joint_measurement_to_msg(nan)), "skeleton": encoded.message(())}
    sent, started_s = 0, time.monotonic()
    while not ended:
        executor.spin_once(timeout_sec=0.0)
        due = int((time.monotonic() - started_s) * rate_hz)
        due, sent = (due, sent) if due - sent < rate_hz * 0.1 else (due, due - int(rate_hz * 0.1))
        for number in range(sent, due):
            now_ns = time.time_ns()
            if number % 2:
                for publisher, name in zip(publishers, names, strict=True):
                    data = bad.get(name) or serialize_message(KINDS[name]())
                    publisher.publish(data)
            elif topic == "skeleton":
                publishers[0].publish(encoded.message((human.seen(now_ns),)))
            else:
                stamp = struct.pack("<iI", *divmod(now_ns, 10**9))
                for publisher, name in zip(publishers, names, strict=True):
                    data = newest.get(source if topic != "motion" else name)
                    if data is not None:
                        publisher.publish(data[:4] + stamp + data[12:])
        sent = max(due, sent)
        time.sleep(BURST_S)
    print(f"flood of {topic}: {sent / (time.monotonic() - started_s):.0f} messages a second", file=sys.stderr)
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
