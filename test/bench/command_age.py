# SPDX-License-Identifier: Apache-2.0
"""Latency of commands: from the stamp of a skeleton to the arrival of the `JointState` that answers it, over DDS.

    ./mild measure command_age [--rate 100] [--seconds 10] [--model NAME] [--source azure_kinect] [--json]

Three processes: a tracker that publishes ready-made bytes of a kinematic human (as a compiled driver would), the
`pipeline` node, and this one, which listens as a robot's driver would. An answer is a command that a skeleton caused;
commands of the control clock between skeletons are counted beside them.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from mild_core.perception.skeletons import SOURCES
from mild_core.resources import model_folder
from mild_core.retargeting.robots import ROBOTS
from mild_core.signals import JointMeasurement
from mild_ros.messages.handled import handled_from_msg
from mild_ros.messages.joint_state import joint_measurement_to_msg
from mild_ros.messages.marker_array import people_to_marker_array
from mild_ros.messages.pose_array import person_to_pose_array
from mild_ros.messages.skeletons import ADAPTERS
from mild_ros.messages.stamps import NANOSECONDS_PER_SECOND, ns_from_msg
from mild_ros.node_kit.quality_of_service import COMMAND, HANDLED, SENSOR
from mild_ros.simulation.person import BODY_JOINTS, bodies, skeleton_frames, with_neutral_second
from test.core.inference.random_model import manifest, paper_member, random_arrays

ROOT = Path(__file__).parents[2]
MARK_NS = 0x1122_3344 * NANOSECONDS_PER_SECOND + 0x0A0B_0C0D
"""A stamp that stands for the time of sending, to be found again in serialised bytes."""

MADE = ("azure_kinect", "pose_array")
"""Trackers whose messages the kinematic human can send."""

PATIENCE_S = 300.0
"""The first start after a change of the compiled functions compiles them."""


def main() -> None:
    """Measure and print."""
    words = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    words.add_argument("--rate", type=float, default=100.0, help="skeletons per second")
    words.add_argument("--seconds", type=float, default=10.0)
    words.add_argument("--model", default="yumi_buetepage_ahead", help="name, path, or 'random' for random weights")
    words.add_argument("--source", choices=MADE, help="only this one")
    words.add_argument("--json", action="store_true")
    words.add_argument("--track", nargs=2, metavar=("SOURCE", "GOLDEN"), help=argparse.SUPPRESS)
    given = words.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if given.track:
        track(given.track[0], Path(given.track[1]), given.rate, given.seconds)
        return
    results = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = random_model(Path(scratch, "random")) if given.model == "random" else model_folder(given.model)
        for source in [given.source] if given.source else MADE:
            results.append(measure(source, folder, given.rate, given.seconds))
    if given.json:
        print(json.dumps(results, indent=1))
        return
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, ", end=""
    )
    print(f"Python {platform.python_version()}; skeletons at {given.rate:g} Hz for {given.seconds:g} s, {given.model}")
    print(f"{'source':14s}{'age of an answer [ms]':26s}{'way in':26s}{'work and way out':26s}skeletons answers ticks")
    for result in results:
        spreads = "".join(
            f"{'  '.join(f'{value:6.2f}' for value in result[key].values()):26s}"
            for key in ("age", "way_in", "work_and_way_out")
        )
        print(f"{result['source']:14s}{spreads}{result['skeletons']:9d} {result['answers']:7d} {result['ticks']:5d}")
    print(
        "p50, p99, max. Age: from the skeleton's stamp to the command's arrival here. Way in: until the node takes it."
    )


def random_model(folder: Path) -> Path:
    """A folder with a model of the usual size that knows everything and means nothing."""
    from mild_core.inference.model import save_model

    of = manifest((paper_member(),))
    arrays = random_arrays(of)
    arrays["member_0.latent_radius"] = np.full(len(of.interactions), 1e6)
    save_model(folder, of, arrays, "Random weights, for timing.\n")
    return folder


@contextmanager
def process(*words: str) -> Iterator[subprocess.Popen[bytes]]:
    """A Python process that ends with the block."""
    running = subprocess.Popen([sys.executable, "-m", *words], cwd=ROOT)
    try:
        yield running
    finally:
        if running.poll() is None:
            running.send_signal(signal.SIGINT)
        running.wait(PATIENCE_S)


def measure(source: str, folder: Path, rate_hz: float, seconds: float) -> dict[str, Any]:
    """Run the three processes and evaluate what arrived here."""
    parameters = {"model": folder, "source": source, "report_handled": "true", "enabled": "true"}
    if source == "pose_array":
        parameters |= {"joint_names": json.dumps(list(BODY_JOINTS)), "source_axes": "optical"}
    # Given, as what a golden sample shows is no interaction that could be recognised.
    parameters["interaction"] = json.loads((folder / "manifest.json").read_text())["interactions"][0]
    words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    rclpy.init()
    listener = Listener()
    tracking = ("--track", source, str(folder / "golden.npz"), "--rate", str(rate_hz), "--seconds", str(seconds))
    try:
        with process("mild_ros.nodes.pipeline_node", "--ros-args", *words):
            listener.start_robot()
            with process("test.bench.command_age", *tracking) as tracker:
                listener.listen_while(lambda: tracker.poll() is None)
        return {"source": source, "rate_hz": rate_hz, **listener.result()}
    finally:
        listener.node.destroy_node()
        rclpy.try_shutdown()


class Listener:
    """A robot's driver: takes commands, and says once where the robot is."""

    def __init__(self) -> None:
        self.node = Node("command_age")
        self.commands: list[tuple[int, int]] = []
        self.ticks: set[int] = set()
        self.skeletons: list[int] = []
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)
        self._states = self.node.create_publisher(JointState, "joint_states", 1)
        self.node.create_subscription(JointState, "joint_command", self._on_command, COMMAND)
        self.node.create_subscription(Header, "handled", self._on_handled, HANDLED)

    def start_robot(self) -> None:
        """Say where the robot is until it is commanded."""
        robot, deadline = ROBOTS["yumi"], time.monotonic() + PATIENCE_S
        while not self.commands:
            if time.monotonic() > deadline:
                raise SystemExit(f"no command within {PATIENCE_S:g} s: the pipeline node does not run")
            stamp_ns = self.node.get_clock().now().nanoseconds
            self._states.publish(
                joint_measurement_to_msg(JointMeasurement(stamp_ns, robot.joint_names, robot.home_rad))
            )
            self._executor.spin_once(timeout_sec=0.1)

    def listen_while(self, going_on: Any) -> None:
        """Take what comes until the tracker is done."""
        while going_on():
            self._executor.spin_once(timeout_sec=0.1)

    def result(self) -> dict[str, Any]:
        """Ages of the answers: from the newest skeleton before a command that no tick caused."""
        stamps = np.array(sorted(self.skeletons))
        between = [
            (sent, came)
            for sent, came in self.commands
            if stamps.size and stamps[0] < sent < stamps[-1] and sent not in self.ticks
        ]
        if not between:
            raise SystemExit(f"{len(stamps)} skeletons, {len(self.commands)} commands, but no answer among them")
        answers = np.array(between)
        seen = stamps[np.searchsorted(stamps, answers[:, 0], side="right") - 1]
        return {
            "age": _spread(answers[:, 1] - seen),
            "way_in": _spread(answers[:, 0] - seen),
            "work_and_way_out": _spread(answers[:, 1] - answers[:, 0]),
            "skeletons": len(stamps),
            "answers": len(answers),
            "ticks": len(self.ticks),
        }

    def _on_command(self, message: Any) -> None:
        self.commands.append((ns_from_msg(message.header.stamp), time.time_ns()))

    def _on_handled(self, message: Any) -> None:
        handled = handled_from_msg(message)
        if handled.outcome == "tick":
            self.ticks.add(handled.stamp_ns)
        elif handled.stage == "pipeline":
            self.skeletons.append(handled.stamp_ns)


def _spread(times_ns: Any) -> dict[str, float]:
    """[ms]."""
    return dict(zip(("p50", "p99", "max"), (np.percentile(times_ns, [50, 99, 100]) * 1e-6).tolist(), strict=True))


def track(source: str, golden: Path, rate_hz: float, seconds: float) -> None:
    """Be a tracker: a neutral second, then what the golden sample shows, there and back."""
    with np.load(golden) as arrays:
        windows = arrays["windows"]
    frames = np.concatenate([windows[0], windows[1:, -1]]).reshape(-1, windows.shape[-1])[:, :9].reshape(-1, 3, 3)
    there_and_back = np.concatenate([frames, frames[-2:0:-1]])
    count = round(seconds * rate_hz)
    repeated = np.resize(np.arange(len(there_and_back)), count)
    arm = with_neutral_second(there_and_back[repeated], rate_hz, 1.5)
    people = skeleton_frames(bodies(arm), rate_hz, MARK_NS)
    convention = SOURCES[source]
    if not convention.joint_ids:
        convention = convention.with_joints(BODY_JOINTS, "optical")
    rclpy.init()
    node = Node("tracker")
    publisher = node.create_publisher(ADAPTERS[convention.message].message_type, "skeleton", SENSOR)
    sent = [Stamped(_message(person, convention)) for person in people]
    deadline = time.monotonic() + PATIENCE_S
    while not publisher.get_subscription_count() and time.monotonic() < deadline:
        time.sleep(0.05)
    start = time.monotonic() + 0.5
    for index, message in enumerate(sent):
        time.sleep(max(0.0, start + index / rate_hz - time.monotonic()))
        if not rclpy.ok():
            break
        publisher.publish(message.at(time.time_ns()))
    node.destroy_node()
    rclpy.try_shutdown()


def _message(person: Any, convention: Any) -> Any:
    person = replace(person, stamp_ns=MARK_NS)
    many = convention.message == "marker_array"
    return people_to_marker_array([person], convention) if many else person_to_pose_array(person, convention)


class Stamped:
    """Serialised bytes whose stamps can be set."""

    def __init__(self, message: Any) -> None:
        self._bytes = bytearray(serialize_message(message))
        mark = _stamp_bytes(MARK_NS)
        self._places = [place for place in range(0, len(self._bytes), 4) if self._bytes[place : place + 8] == mark]

    def at(self, stamp_ns: int) -> bytes:
        """The bytes with this time in place of every mark."""
        stamp = _stamp_bytes(stamp_ns)
        for place in self._places:
            self._bytes[place : place + 8] = stamp
        return bytes(self._bytes)


def _stamp_bytes(stamp_ns: int) -> bytes:
    return np.array(divmod(stamp_ns, NANOSECONDS_PER_SECOND), dtype="<u4").tobytes()


if __name__ == "__main__":
    main()
