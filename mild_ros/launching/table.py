# SPDX-License-Identifier: Apache-2.0
"""What `ros2 launch mild_ros NAME.launch.py` and `./mild launch NAME` start: one table for both.

`launch_description.py` makes of it what `ros2 launch` runs. Where that command is not installed, `run_launch` starts
the same nodes itself.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import yaml

from mild_core.errors import SetupError, unknown_name
from mild_ros.bag.camera import camera_for
from mild_ros.environment.processes import PYTHON, as_yaml, end_with_parent
from mild_ros.node_kit.parameter_files import configuration

NAMESPACE = {"namespace": ("", "Before every name: one for each robot and its person.")}
CONFIG = {"config": ("yumi", "Parameters: a name in share/mild_ros/config, or a path.")}
TIME = {
    "use_sim_time": ("false", "Take the time from `/clock`."),
    "respawn": ("true", "Start a node again that has ended by itself, after two seconds."),
}
CAMERA = "robot_from_camera"
TRACKER = {
    "skeleton": ("skeleton", "Topic of the tracker."),
    CAMERA: ("", "Pose of the tracker's frame in the robot's base; empty takes the configuration's."),
}
WINDOW = {"gui": ("false", "Open a window with the robot.")}

RESPAWN_DELAY_S = 2.0
"""DDS needs up to this long to miss the commands of a node that died, and the new one looks for others first."""

FAILED_S = 5.0
"""After a node failed the others get so long to say why they do: replay would wait for the one that is not there."""

SETUP_ERROR = 2
"""Exit code of a node that was set up wrongly: it would be again."""

LOOK_S, POLITE_S, FIRM_S = 0.1, 10.0, 5.0
"""How often nodes are looked after; how long one may take to end after SIGINT, and after SIGTERM."""


@dataclass(frozen=True)
class Started:
    """A node that a launch starts.

    Attributes:
        executable: Of ours, which is also the node's name.
        parameters: Name of the argument that gives each parameter its value.
        topics: Name of the argument that gives each topic its name.
        fixed: Parameters that no argument changes.
        configured: Whether the parameter file is for this node too.
        only_with: Argument without which (empty) the node is not started; "" for none.
        respawned: Whether the argument `respawn` is for this node.
        ends_all: Whether the end of this node is the end of the launch.
        sees_by_camera: Whether it takes the camera's pose, see `camera_of`.
    """

    executable: str
    parameters: Mapping[str, str] = field(default_factory=dict)
    topics: Mapping[str, str] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    configured: bool = True
    only_with: str = ""
    respawned: bool = False
    ends_all: bool = False
    sees_by_camera: bool = False


@dataclass(frozen=True)
class Launch:
    """A launch file.

    Attributes:
        text: What it is for.
        arguments: Default and meaning of each by name; without a default (None) it has to be given.
        nodes: What is started, in order.
        ends_with_failure: Whether a node that fails ends the launch.
    """

    text: str
    arguments: Mapping[str, tuple[str | None, str]]
    nodes: tuple[Started, ...]
    ends_with_failure: bool = False


def _same(*names: str) -> dict[str, str]:
    return {name: name for name in names}


_LIVE_PIPELINE = Started(
    "pipeline",
    _same("use_sim_time"),
    {**_same("skeleton", "joint_states", "joint_command"), "joint_trajectory": "trajectory"},
    respawned=True,
    sees_by_camera=True,
)

LAUNCHES: Mapping[str, Launch] = {
    "live": Launch(
        "A tracker and a robot that are there: all three stages, in one process.",
        {
            **NAMESPACE,
            **CONFIG,
            **TRACKER,
            "joint_states": ("joint_states", "Topic where the robot says where it is."),
            "joint_command": ("joint_command", "Topic of the commands."),
            "trajectory": (
                "joint_trajectory",
                "Topic of the JointTrajectoryController, if the configuration has that output.",
            ),
            **TIME,
        },
        (_LIVE_PIPELINE,),
    ),
    "simulation": Launch(
        "A tracker that is there and a simulated robot.",
        {**NAMESPACE, **CONFIG, **TRACKER, **WINDOW, **TIME},
        (
            Started("pipeline", _same("use_sim_time"), _same("skeleton"), respawned=True, sees_by_camera=True),
            Started("simulation", _same("gui", "use_sim_time"), respawned=True),
        ),
    ),
    "replay": Launch(
        "A bag in place of a tracker, and a simulated robot; ends when the bag does.",
        {
            "bag": (None, "Folder or file of the bag."),
            **NAMESPACE,
            "config": (
                "yumi",
                f"{CONFIG['config'][1][:-1]}; with a section for `replay` the bag's `source`.",
            ),
            "skeleton_topic": ("", "Topic of the skeletons in the bag; empty finds it by its type."),
            "rate": ("1.0", "2.0 is twice as fast."),
            "start_s": ("0.0", "How much of the beginning to skip."),
            "loop": ("false", "Begin again after the end."),
            "paused": ("false", "Wait until `replay/pause` is called with false: `./mild pause --off`."),
            **WINDOW,
            "record": ("", "Folder of a new bag with what happens; empty for none."),
        },
        (
            Started("pipeline", sees_by_camera=True),
            Started("simulation", _same("gui")),
            Started("record", {"bag": "record"}, configured=False, only_with="record"),
            Started(
                "replay",
                _same("bag", "skeleton_topic", "rate", "start_s", "loop", "paused"),
                fixed={"patience_s": 300.0},
                ends_all=True,
            ),
        ),
        # One that starts in the midst of a replay would make another of it.
        ends_with_failure=True,
    ),
}


def camera_of(given: Mapping[str, str]) -> str:
    """The camera pose for a node that sees people by a camera: as given, else where the bag says it stood; else "".

    Raises:
        BagError: The bag says it badly.
        SetupError: There is no such configuration.
    """
    stated = given.get(CAMERA, "")
    return stated or (camera_for(given["config"], Path(given["bag"])) if "bag" in given else "")


LISTENERS = "subscribers"
"""Parameter of `replay`: a recorder listens before the pipeline does, and both shall hear the first message."""


def listeners(recorded: str) -> int:
    """How many subscribers a replay waits for."""
    return 2 if recorded else 1


def read_arguments(launch: Launch, words: Sequence[str]) -> dict[str, str]:
    """The arguments of a launch, each `NAME:=VALUE`; the others are defaults.

    Raises:
        SetupError: A word is no argument, a value cannot be one, or one is missing.
    """
    given = {name: value for name, (value, _) in launch.arguments.items() if value is not None}
    for word in words:
        name, sign, value = word.partition(":=")
        if not sign:
            raise SetupError(word, "is no argument of a launch", "write NAME:=VALUE")
        if name not in launch.arguments:
            raise unknown_name("argument", name, launch.arguments)
        default = launch.arguments[name][0]
        if default in ("true", "false") and value.lower() not in ("true", "false"):
            raise SetupError(word, f"{name} is '{value}'", "give true or false")
        given[name] = value.lower() if default in ("true", "false") else value
    for name, (_, text) in launch.arguments.items():
        if name not in given:
            raise SetupError(f"{name}:=", "is missing", f"give it: {text}")
    return given


def commands(launch: Launch, given: Mapping[str, str]) -> list[tuple[Started, list[str]]]:
    """The nodes to start with the command line of each.

    Raises:
        SetupError: There is no such configuration.
    """
    file = configuration(given["config"])
    found = []
    for node in launch.nodes:
        if node.only_with and not given[node.only_with]:
            continue
        values: dict[str, object] = {
            name: _value(launch, argument, given) for name, argument in node.parameters.items()
        }
        values |= node.fixed
        if node.sees_by_camera and (camera := camera_of(given)):
            values[CAMERA] = camera
        if node.executable == "replay":
            values[LISTENERS] = listeners(given["record"])
        words = [*PYTHON, "-m", f"mild_ros.nodes.{node.executable}_node", "--ros-args"]
        words += ["-r", f"__ns:=/{given['namespace'].strip('/')}"] * bool(given["namespace"].strip("/"))
        words += ["--params-file", str(file)] * node.configured
        words += [word for name, value in values.items() for word in ("-p", f"{name}:={as_yaml(value)}")]
        words += [
            word
            for topic, argument in node.topics.items()
            if given[argument] != topic
            for word in ("-r", f"{topic}:={given[argument]}")
        ]
        found.append((node, words))
    return found


def _value(launch: Launch, argument: str, given: Mapping[str, str]) -> object:
    """An argument's value in the type of its default.

    Raises:
        SetupError: It has another.
    """
    default, text = launch.arguments[argument][0] or "", given[argument]
    kind: type[Any] = type(yaml.safe_load(default)) if default else str
    if kind is bool:
        return text == "true"
    if kind is float:
        try:
            return float(text)
        except ValueError:
            raise SetupError(f"{argument}:={text}", "is no number", "give one, e.g. 1.0") from None
    return text


class _Started:
    """A node that runs, what it says on standard error passed on, its refusal of the set-up kept.

    Attributes:
        process: The node.
        refusal: The line with which it refused its set-up; empty for none.
    """

    last = b""
    """The newest line of all nodes."""

    def __init__(self, node: str, words: Sequence[str]) -> None:
        self.refusal, self._begin = b"", f"mild_ros {node}: ".encode()
        # Through a pipe its log would lose the colours of a terminal.
        coloured = {"RCUTILS_COLORIZED_OUTPUT": "1"} if sys.stderr.isatty() else {}
        self.process = subprocess.Popen(
            words, stderr=subprocess.PIPE, env=coloured | os.environ, preexec_fn=end_with_parent
        )
        self._passing = threading.Thread(target=self._pass_on, daemon=True)
        self._passing.start()

    def ended(self) -> int | None:
        """The exit code, once it has ended and all that it said was passed on."""
        code = self.process.poll()
        if code is not None:
            self._passing.join(LOOK_S)  # a child of its own may hold the pipe open
        return code

    def _pass_on(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as lines:
            for line in lines:
                _Started.last = line
                if line.startswith(self._begin):
                    self.refusal = line
                with suppress(OSError):  # a terminal that was closed
                    os.write(sys.stderr.fileno(), line)


def run_launch(launch: Launch, given: Mapping[str, str]) -> int:
    """Start the nodes and look after them until one that ends all has ended, or a signal comes; 0 if all went well.

    A node that refuses its set-up ends them all, and its line is said last: it would refuse it again.
    """
    wanted = commands(launch, given)
    respawned = given.get("respawn") == "true"
    running: dict[str, _Started] = {}
    again_s: dict[str, float] = {}
    failed_s, code = None, 0
    with _ended(running), _signalled() as signals:
        for node, words in wanted:
            running[node.executable] = _Started(node.executable, words)
        while not signals:
            time.sleep(LOOK_S)
            now_s = time.monotonic()
            for node, words in wanted:
                ended = running[node.executable].ended() if node.executable not in again_s else None
                if ended is not None and node.ends_all and ended == 0:
                    return code
                if ended not in (None, SETUP_ERROR) and node.respawned and respawned:
                    again_s[node.executable] = now_s + RESPAWN_DELAY_S
                elif ended:
                    code = code or ended
                    failed_s = failed_s or (now_s if launch.ends_with_failure or ended == SETUP_ERROR else None)
                if again_s.get(node.executable, now_s + 1.0) <= now_s:
                    del again_s[node.executable]
                    running[node.executable] = _Started(node.executable, words)
            is_over = all(each.ended() is not None for each in running.values()) and not again_s
            if is_over or (failed_s and now_s - failed_s > FAILED_S):
                break
    for one in running.values():
        if one.ended() == SETUP_ERROR and one.refusal != _Started.last:
            os.write(sys.stderr.fileno(), one.refusal)
    return code


@contextmanager
def _ended(running: Mapping[str, _Started]) -> Iterator[None]:
    """At its end all processes get SIGINT, then SIGTERM, then SIGKILL."""
    try:
        yield
    finally:
        for number, patience_s in ((signal.SIGINT, POLITE_S), (signal.SIGTERM, FIRM_S), (signal.SIGKILL, FIRM_S)):
            left = [one.process for one in running.values() if one.process.poll() is None]
            for process in left:
                process.send_signal(number)
            deadline_s = time.monotonic() + patience_s
            while any(process.poll() is None for process in left) and time.monotonic() < deadline_s:
                time.sleep(LOOK_S / 10)


@contextmanager
def _signalled() -> Iterator[list[int]]:
    """Signals that have come, SIGINT of a terminal among them, which its children get as well."""
    came: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        came.append(number)

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
