# SPDX-License-Identifier: Apache-2.0
"""A whole run of real nodes over DDS: a bag in, a simulated robot that moves, and everything recorded."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from mild_core.errors import SetupError
from mild_ros.assembly.bag_settings import FIRST_HEARD
from mild_ros.assembly.perception import skeleton_source
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.bag.people import skeleton_feeds
from mild_ros.bag.reader import open_bag
from mild_ros.commands.command_topics import JOINT_COMMAND
from mild_ros.environment.processes import Nodes, private_domain
from mild_ros.node_kit.parameter_files import changed

RECORDED = "recorded"
"""Folder of the bag that a run leaves."""

PATIENCE_S = 600.0
"""For nodes to start: the first start compiles, and a busy machine takes its time."""

DISCOVERY_S = 60.0
"""For nodes that are at work to hear each other: DDS takes a second or two, a busy machine ten times that."""

READY = "through {}"
"""What the pipeline says last of its model when it is at work."""

OVERDUE_S = 60.0
"""Longest wait after the end of a bag [s]."""

TOPICS = (
    *("joint_states", JOINT_COMMAND, "motion", "motion_state", "interaction", "true_motion", "handled"),
    "/diagnostics",
)
"""Recorded beside the skeletons: enough for every picture. Windows and beliefs would be published for that alone."""

DRIVERS_NAMES = ("robot_joint_names", "position_order")
"""Parameters of the pipeline that hold a driver's names of the joints."""

REPLAYING = {False: "replaying", True: "replaying over and over; control-C ends it"}

AFTERWARDS_S = 0.7
"""The last commands get this long to be carried out and written down."""

LOOK_S = 0.05

Progress = Callable[[str, float], None]
"""Called with what is going on and how much of it is done, 0 to 1."""


@dataclass(frozen=True)
class RunOptions:
    """What a run may differ in.

    Attributes:
        pipeline: Parameters of the pipeline: tracker, model, robot and all else.
        skeleton_topic: In the bag; "" finds it by its type.
        lock_step: As fast as every message is handled, on simulated time, rather than in real time.
        salvage: Read what is readable of a broken bag.
        start_s: How much of the bag's beginning to skip.
        rate: Speed in real time.
        loop: Begin the bag again after its end, until KeyboardInterrupt.
    """

    pipeline: PipelineParameters = field(default_factory=PipelineParameters)
    skeleton_topic: str = ""
    lock_step: bool = False
    salvage: bool = False
    start_s: float = 0.0
    rate: float = 1.0
    loop: bool = False


def run_nodes(
    bag: Path, out: Path, options: RunOptions, progress: Progress, when_ready: Callable[[], None] = lambda: None
) -> Path:
    """Send a bag to the pipeline and a simulated robot, all of them processes of their own, and record it.

    Args:
        bag: The bag.
        out: Folder for the recorded bag and the nodes' logs; an earlier run there is replaced.
        options: How.
        progress: Called with what goes on.
        when_ready: Called before the first message, when everybody is at work.

    Returns:
        The recorded bag.

    Raises:
        SetupError: The bag is broken, or a node failed.
    """
    import_module("rclpy")  # where it is missing, report it here and not in the first node
    with open_bag(bag, salvage=options.salvage) as opened:
        duration_s = max(opened.duration_s - options.start_s, LOOK_S) / options.rate
        feeds = skeleton_feeds(opened, skeleton_source(options.pipeline), options.skeleton_topic)
    recorded = out / RECORDED
    shutil.rmtree(recorded, ignore_errors=True)
    with private_domain() as domain, Nodes(domain, out / "log") as nodes:
        _start_listeners(nodes, recorded, [feed.topic for feed in feeds.values()], options)
        ready, starting = READY.format(options.pipeline.model), lambda: progress("starting nodes", 0.0)
        _until(lambda: nodes.has_said("pipeline", ready), nodes, starting, PATIENCE_S, "are not ready")
        # Only then does the bag start: whatever a recorder writes down has been discovered, loaded and is at work.
        flowing = FIRST_HEARD.format("/joint_states" if options.lock_step else "/joint_command")
        _until(lambda: nodes.has_said("record", flowing), nodes, lambda: progress("looking for each other", 0.0))
        when_ready()
        nodes.start("replay", _replay_parameters(bag, options))
        _until(lambda: nodes.has_said("replay", "replaying"), nodes, lambda: progress("looking for each other", 0.0))
        longest_s = math.inf if options.loop or options.lock_step else duration_s + OVERDUE_S
        _follow(nodes, duration_s, progress, longest_s, forever=options.loop)
        nodes.stop("record")
    return recorded


def _start_listeners(nodes: Nodes, recorded: Path, skeleton_topics: list[str], options: RunOptions) -> None:
    """Start all nodes but the one that sends the bag."""
    sim_time: dict[str, Any] = {"use_sim_time": True} if options.lock_step else {}
    # The simulated robot has our names of its joints, whatever those of the real one's driver are.
    changes = {name: value for name, value in changed(options.pipeline).items() if name not in DRIVERS_NAMES}
    simulated = {name: changes[name] for name in ("robot", "robot_description") if name in changes}
    outputs = options.pipeline.outputs
    nodes.start("simulation", simulated | sim_time)
    recording = {"bag": recorded.resolve(), "topics": [*TOPICS, *outputs, *skeleton_topics]}
    nodes.start("record", recording | {"report_recorded": options.lock_step} | sim_time)
    nodes.start("pipeline", changes | {"report_handled": True} | sim_time)


def _follow(nodes: Nodes, duration_s: float, progress: Progress, longest_s: float, *, forever: bool) -> None:
    """Wait until the bag has ended, and until what it caused is over; KeyboardInterrupt ends one that never does."""
    begin_s, what = time.monotonic(), REPLAYING[forever]

    def report_progress() -> None:
        share = (time.monotonic() - begin_s) / duration_s
        progress(what, share % 1.0 if forever else min(share, 1.0))

    try:
        _until(lambda: nodes.has_ended("replay"), nodes, report_progress, longest_s, "did not end")
    except KeyboardInterrupt:
        if not forever:
            raise
    progress(what, 1.0)
    end_s = time.monotonic() + AFTERWARDS_S
    _until(lambda: time.monotonic() > end_s, nodes, lambda: None)


def _replay_parameters(bag: Path, options: RunOptions) -> dict[str, object]:
    """The pipeline and the recorder listen; the simulated robot says where it is."""
    asked = {name: getattr(options, name) for name in ("skeleton_topic", "salvage", "start_s", "rate", "loop")}
    same = ("source", "joint_names", "joint_places", "robot", "control_rate_hz")
    tracked = {name: getattr(options.pipeline, name) for name in same}
    return {
        **asked,
        **tracked,
        "bag": bag.resolve(),
        "mode": "lock_step" if options.lock_step else "real_time",
        "joint_states": "none",
        "recorders": int(options.lock_step),
        "subscribers": 2,
        "patience_s": DISCOVERY_S,
    }


def _until(
    happened: Callable[[], bool],
    nodes: Nodes,
    meanwhile: Callable[[], None],
    patience_s: float | None = None,
    problem: str = "do not hear each other",
) -> None:
    """Wait until `happened`, looking after the nodes.

    Raises:
        SetupError: One has failed, or it took longer than `patience_s` (or `DISCOVERY_S`), which is the `problem` then.
    """
    patience_s = DISCOVERY_S if patience_s is None else patience_s
    deadline_s = time.monotonic() + patience_s
    while not happened():
        nodes.check("replay")
        if time.monotonic() > deadline_s:
            raise SetupError("nodes", f"{problem} within {patience_s:.0f} s", f"see {nodes.log_folder}; ./mild doctor")
        meanwhile()
        time.sleep(LOOK_S)
