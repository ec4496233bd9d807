# SPDX-License-Identifier: Apache-2.0
"""The parts of the documents that are written from the code; a test holds each document to them.

A document marks the place with `<!-- generated: NAME -->` and, on a later line, `<!-- end -->`. Bring them up to date
with `python -m tools.documentation docs/reference.md ...`.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rclpy.qos import DurabilityPolicy

from mild_core.errors import SetupError, unknown_name
from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_ros.assembly.bag_settings import RecordParameters, ReplayParameters
from mild_ros.assembly.camera import CameraParameters
from mild_ros.assembly.settings import NODES
from mild_ros.command_line.main import COMMANDS
from mild_ros.commands.command_topics import command_types
from mild_ros.controllers import OUTPUTS
from mild_ros.demonstrations.settings import CutParameters
from mild_ros.messages.skeletons import ADAPTERS
from mild_ros.node_kit.parameters import table_markdown
from mild_ros.node_kit.quality_of_service import (
    BETWEEN_STAGES,
    CLOCK,
    COMMAND,
    HANDLED,
    LATCHED,
    SENSOR,
    STATE,
    STATIC_TRANSFORMS,
)
from test.faults.broken_bags import bag_faults_markdown

PLACE = re.compile(r"(<!-- generated: ([a-z_]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


class Topic(NamedTuple):
    """One topic as people read of it.

    Attributes:
        name: Relative unless it starts with a slash; remap as usual.
        message: Its type, without `msg`; several joined by " or ".
        sender: Who publishes it.
        receiver: Who subscribes to it.
        meaning: What is in it.
    """

    name: str
    message: str
    sender: str
    receiver: str
    meaning: str


TOPICS = (
    Topic("skeleton", "by `source`", "tracker or replay", "perception", "people as the tracker sees them"),
    Topic(
        *("feature_window", "sensor_msgs/PointCloud2", "perception", "inference"),
        "the arm's last W frames: one row per frame, one point per joint, in the arm frame [m]",
    ),
    Topic(
        *("person", "sensor_msgs/PointCloud2", "perception", "retargeting"),
        "the watched person's hand, head, middle of shoulders and of hips [m], where the chest points, and two rows "
        "for each body segment of everyone in view: ends [m], velocities [m/s], radius [m], number of the person (the "
        "watched one is 0), part; in frame `robot` with `robot_from_camera`, else `arm`",
    ),
    Topic(
        *("motion", "`trajectory_msgs/JointTrajectory` or `sensor_msgs/PointCloud2`", "inference", "retargeting"),
        "the robot's next window as the model predicts it [rad], or the partner's arm of a model of two people [m]",
    ),
    Topic(
        *("motion_state", "sensor_msgs/PointCloud2", "inference", "retargeting"),
        "with `motion`, equal stamp: interaction, probability, phase, out_of_distribution, state, "
        "radii of its 50 and 90 % regions, belief, covariance",
    ),
    Topic(
        "belief", "std_msgs/Float64MultiArray", "inference", "tools", "over the components of the interaction's prior"
    ),
    Topic("interaction", "std_msgs/String", "inference", "tools", "the recognised interaction, latched"),
    Topic(
        *("joint_command", "sensor_msgs/JointState", "retargeting", "robot or simulation"),
        "positions [rad] and velocities [rad/s] inside every limit",
    ),
    *(
        Topic(
            *(output.topic, output.type_name.replace("/msg/", "/"), "retargeting", output.controller),
            f"{output.meaning}; with that in `outputs`",
        )
        for output in OUTPUTS.values()
    ),
    Topic(
        *("robot_description", "std_msgs/String", "simulation", "tools"),
        "the simulated robot's URDF, latched",
    ),
    Topic(
        *("joint_states", "sensor_msgs/JointState", "robot, simulation or replay", "inference, retargeting"),
        "where the robot is; no command before the first",
    ),
    Topic(
        *("camera/image_raw", "sensor_msgs/Image", "simulation", "people"),
        "the simulated robot; only with `camera_rate_hz`",
    ),
    Topic(
        *("mode", "std_msgs/String", "retargeting", "operators"),
        "waiting, idle, ready, following, holding, returning, showing, disabled or held; latched",
    ),
    Topic(
        *("stiffness", "std_msgs/Float64", "retargeting", "robot or simulation"),
        "a hint: 1 while the arm moves by itself, down to 0.3 while hands touch; latched",
    ),
    Topic(
        *("markers", "visualization_msgs/MarkerArray", "markers", "people"),
        "both hands, the predicted way of the robot's and what each component expects, for RViz and Foxglove",
    ),
    Topic(
        *("handled", "std_msgs/Header", "every stage", "replay"),
        "the outcome of each input, for a replay in lock-step; only with `report_handled`",
    ),
    Topic(
        *("recorded", "std_msgs/Header", "record", "replay"),
        "each message of `handled` that was written down, for a replay in lock-step; only with `report_recorded`",
    ),
    Topic("/mild_doctor", "std_msgs/String", "doctor", "doctor", "node names, while `mild doctor` runs"),
    Topic("/clock", "rosgraph_msgs/Clock", "replay", "every stage", "the time in the bag, for `use_sim_time`"),
    Topic(
        "/diagnostics", "diagnostic_msgs/DiagnosticArray", "every stage", "operators", "rates, ages, drops by reason"
    ),
)
"""Of all nodes; where the stages share one process, `pipeline` stands for the three."""


DELIVERY = {
    "SENSOR": ("skeletons, `joint_states` where they are taken", SENSOR),
    "STATE": ("`joint_states` and `camera/image_raw` of the simulation", STATE),
    "BETWEEN_STAGES": (
        "`feature_window`, `person`, `motion`, `motion_state`, `belief`, `markers`; all of a replay",
        BETWEEN_STAGES,
    ),
    "COMMAND": (", ".join(f"`{topic}`" for topic in command_types()), COMMAND),
    "LATCHED": ("`interaction`, `mode`, `stiffness`, `robot_description`", LATCHED),
    "STATIC_TRANSFORMS": ("`/tf_static`", STATIC_TRANSFORMS),
    "HANDLED": ("`handled`, `recorded`", HANDLED),
    "CLOCK": ("`/clock` where it is taken", CLOCK),
}
"""How each topic is delivered, by the name in `quality_of_service`."""


def qualities_markdown() -> str:
    """Quality of service by topic."""
    lines = ["| Topics | Reliability | Latched | Depth |", "|---|---|---|---:|"]
    for topics, quality in DELIVERY.values():
        reliability = quality.reliability.name.lower().replace("_", " ")
        kept = "yes" if quality.durability is DurabilityPolicy.TRANSIENT_LOCAL else "no"
        lines.append(f"| {topics} | {reliability} | {kept} | {quality.depth} |")
    return "\n".join(lines) + "\n"


def topics_markdown() -> str:
    """All topics as a Markdown table."""
    lines = ["| Topic | Type | From | To | What |", "|---|---|---|---|---|"]
    for topic in TOPICS:
        kind = topic.message if "`" in topic.message else f"`{topic.message}`"
        lines.append(f"| `{topic.name}` | {kind} | {topic.sender} | {topic.receiver} | {topic.meaning} |")
    return "\n".join(lines) + "\n"


OF_OTHERS = {"pipeline": "perception, inference and retargeting", "camera": "the pipeline"}
"""Nodes that take the parameters of others."""


def parameters_markdown() -> str:
    """The parameters of all nodes: one heading and one table each, of the pipeline only what is its own."""
    kinds = {**NODES, "camera": CameraParameters, "record": RecordParameters, "replay": ReplayParameters}
    parts = []
    for name, kind in kinds.items():
        table = table_markdown(kind)
        if name in OF_OTHERS:
            known = {line for other in kind.__mro__[1:-1] for line in table_markdown(other).splitlines()[2:]}
            own = [line for line in table.splitlines() if line not in known]
            table = f"All of {OF_OTHERS[name]}, and:\n\n" + "\n".join(own) + "\n"
        parts.append(f"**`{name}`**\n\n{table}")
    return "\n".join(parts)


def commands_markdown() -> str:
    """The commands of `./mild`."""
    own = {"check": "Lint, types and the quick tests, in a minute.", "test": "All tests."}
    lines = ["| Command | What it does |", "|---|---|"]
    return "\n".join([*lines, *(f"| `./mild {name}` | {text} |" for name, text in {**COMMANDS, **own}.items())]) + "\n"


def sources_markdown() -> str:
    """The trackers that are read, for who has one."""
    columns = ("`source`", "Message", "Right shoulder, elbow, wrist, hand", "Axes", "Confidence", "How to start it")
    lines = ["| " + " | ".join((*columns, "Tested on")) + " |", "|---" * 7 + "|"]
    for source in SOURCES.values():
        axes = "by `source_axes`" if source.axes == "unknown" else source.axes
        adapter = ADAPTERS[source.message]
        kinds = {feed.type_name: None for feed in adapter.feeds(source)} if source.places else [adapter.type_name]
        kind = " and ".join(f"`{name.replace('/msg/', '/')}`" for name in kinds)
        cells = (kind, _arm_numbers(source), axes, source.confidence, source.start, source.tested)
        lines.append(f"| `{source.name}`: {source.driver} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _arm_numbers(source: SkeletonSource) -> str:
    """How messages of a source number the right arm."""
    arm = [f"right_{part}" for part in ("shoulder", "elbow", "wrist", "hand")]
    if source.places:
        return ", ".join(f"`{place}`" for name in arm for place in source.places.get(name, ())[:1])
    if not source.joint_ids:
        return "by `joint_names`"
    numbers = [{name: number for number, name in ids.items()} for ids in source.formats or (source.joint_ids,)]
    return "; ".join(", ".join(str(of[name]) for name in arm if name in of) for of in numbers)


def benchmark_markdown() -> str:
    """What `mild benchmark` said of each robot, from the objects in docs/benchmark."""
    columns = ("Robot", "Model", "Interaction", "Encounters", "Success", "Offers reachable", "Of these met")
    columns += ("Met after, median / 90 %", "Hands apart, median", "Not safe", "False starts")
    lines = ["| " + " | ".join(columns) + " |", "|---" * len(columns) + "|"]
    for path in sorted((Path(__file__).parent.parent / "docs" / "benchmark").glob("*.json")):
        found = json.loads(path.read_text())
        shares = []
        for name in ("success", "reachable", "met_reachable", "violations", "false_starts"):
            one = found[name]
            between = f"{100 * one['low']:.0f} to {100 * one['high']:.0f}"
            shares.append(f"{100 * one['share']:.1f} % ({between})" if one["count"] else "")
        waits, apart = found["met_after_s"], found["median_distance_m"]
        waited = "" if waits["median"] is None else f"{waits['median']:.2f} / {waits['90 %']:.2f} s"
        cells = [Path(found["robot"]).stem, f"`{found['model']}`", found["interaction"], str(found["encounters"])]
        cells += [*shares[:3], waited, "" if apart is None else f"{100 * apart:.1f} cm", *shares[3:]]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


SECTIONS: dict[str, Callable[[], str]] = {
    "topics": topics_markdown,
    "parameters": parameters_markdown,
    "commands": commands_markdown,
    "sources": sources_markdown,
    "qualities": qualities_markdown,
    "cut": partial(table_markdown, CutParameters),
    "bag_faults": bag_faults_markdown,
    "benchmark": benchmark_markdown,
}
"""What may stand between the marks, by name."""


def filled(text: str, name: str) -> str:
    """A document with every marked place regenerated.

    Args:
        text: The document.
        name: What to call it when something is wrong.

    Raises:
        SetupError: A mark of an unknown name, or one without an end.
    """
    if text.count("<!-- generated:") != len(PLACE.findall(text)):
        raise SetupError(name, "a place for generated text has no end", "write <!-- end --> on a line below its mark")

    def write(place: re.Match[str]) -> str:
        if place.group(2) not in SECTIONS:
            raise unknown_name(f"{name}: generated text", place.group(2), SECTIONS)
        return f"{place.group(1)}{SECTIONS[place.group(2)]()}{place.group(4)}"

    return PLACE.sub(write, text)


def main(names: Sequence[str]) -> None:
    """Bring the named documents up to date."""
    for name in names:
        path = Path(name)
        path.write_text(filled(path.read_text(), name))


if __name__ == "__main__":
    main(sys.argv[1:])
