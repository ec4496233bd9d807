# SPDX-License-Identifier: Apache-2.0
"""A whole run of real nodes over DDS: a bag in, a simulated robot that moves, and everything recorded."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mild_core.errors import SetupError
from mild_ros.bag_settings import FIRST_HEARD
from mild_ros.bags import open_bag
from mild_ros.processes import Nodes, private_domain

RECORDED = "recorded"
"""Folder of the bag that a run leaves."""

PATIENCE_S = 600.0
"""For nodes to start: the first start compiles, and a busy machine takes its time."""

TOPICS = (
    *("skeleton", "joint_states", "joint_command", "motion", "motion_state", "interaction", "true_motion", "handled"),
    "/diagnostics",
)
"""What is recorded: enough for every picture. Windows and beliefs would be published for the recorder alone."""

AFTERWARDS_S = 0.7
"""The last commands get this long to be carried out and written down."""

LOOK_S = 0.05

Progress = Callable[[str, float], None]
"""Called with what is going on and how much of it is done, 0 to 1."""


@dataclass(frozen=True)
class RunOptions:
    """What a run may differ in.

    Attributes:
        model: Name or folder.
        interaction: An interaction of the model, or `auto`.
        source: Tracker convention of the bag.
        robot: Whom to command.
        skeleton_topic: In the bag; "" finds it by its type.
        lock_step: As fast as every message is handled, on simulated time, rather than in real time.
        salvage: Read what is readable of a broken bag.
    """

    model: str = "yumi_buetepage_ahead"
    interaction: str = "auto"
    source: str = "azure_kinect"
    robot: str = "yumi"
    skeleton_topic: str = ""
    lock_step: bool = False
    salvage: bool = False


def run_nodes(bag: Path, out: Path, options: RunOptions, progress: Progress) -> Path:
    """Send a bag to the pipeline and a simulated robot, all of them processes of their own, and record it.

    Args:
        bag: The bag.
        out: Folder for the recorded bag and the nodes' logs; an earlier run there is replaced.
        options: How.
        progress: Told what goes on.

    Returns:
        The recorded bag.

    Raises:
        SetupError: The bag is broken, or a node failed.
    """
    with open_bag(bag, salvage=options.salvage) as opened:
        duration_s = opened.duration_s
    recorded = out / RECORDED
    shutil.rmtree(recorded, ignore_errors=True)
    sim_time = {"use_sim_time": True} if options.lock_step else {}
    with private_domain() as domain, Nodes(domain, out / "log") as nodes:
        nodes.start("simulation", {"robot": options.robot} | sim_time)
        nodes.start("record", {"bag": recorded.resolve(), "topics": TOPICS} | sim_time)
        told = {"model": options.model, "interaction": options.interaction, "robot": options.robot}
        nodes.start("pipeline", told | {"source": options.source, "report_handled": True} | sim_time)
        # Only then does the bag start: whatever a recorder writes down has been discovered, loaded and is at work.
        flowing = FIRST_HEARD.format("/joint_states" if options.lock_step else "/joint_command")
        _until(lambda: nodes.has_said("record", flowing), nodes, lambda: progress("starting nodes", 0.0), PATIENCE_S)
        nodes.start("replay", _replay_parameters(bag, options))
        _until(lambda: nodes.has_said("replay", "replaying"), nodes, lambda: progress("starting nodes", 0.0))
        begin_s = time.monotonic()

        def tell() -> None:
            progress("replaying", min((time.monotonic() - begin_s) / max(duration_s, 1e-3), 1.0))

        _until(lambda: nodes.has_ended("replay"), nodes, tell)
        progress("replaying", 1.0)
        end_s = time.monotonic() + AFTERWARDS_S
        _until(lambda: time.monotonic() > end_s, nodes, lambda: None)
        nodes.stop("record")
    return recorded


def _replay_parameters(bag: Path, options: RunOptions) -> dict[str, object]:
    """The pipeline and the recorder listen; the simulated robot says where it is."""
    return {
        "bag": bag.resolve(),
        "mode": "lock_step" if options.lock_step else "real_time",
        "joint_states": "none",
        "source": options.source,
        "skeleton_topic": options.skeleton_topic,
        "subscribers": 2,
        "patience_s": PATIENCE_S,
        "salvage": options.salvage,
    }


def _until(
    happened: Callable[[], bool], nodes: Nodes, meanwhile: Callable[[], None], patience_s: float = math.inf
) -> None:
    """Wait until `happened`, looking after the nodes.

    Raises:
        SetupError: One has failed, or it took longer than `patience_s`.
    """
    deadline_s = time.monotonic() + patience_s
    while not happened():
        nodes.check("replay")
        if time.monotonic() > deadline_s:
            raise SetupError("nodes", f"not at work after {patience_s:.0f} s", f"see {nodes.log_folder}; ./mild doctor")
        meanwhile()
        time.sleep(LOOK_S)
