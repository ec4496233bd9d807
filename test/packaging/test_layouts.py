# SPDX-License-Identifier: Apache-2.0
"""The layouts for RViz and Foxglove: panels that there are, and topics that are published as they ask for them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import yaml

from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.robots import ROBOTS
from mild_ros.messages.skeletons import ADAPTERS
from test.habits.tree import ROOT
from tools.documentation import TOPICS

CONFIG = ROOT / "mild_ros/config"
TYPES = {topic.name.lstrip("/"): topic.message for topic in TOPICS}
LATCHED = {topic.name for topic in TOPICS if "latched" in topic.meaning}
SKELETONS = {adapter.type_name.replace("/msg/", "/") for adapter in ADAPTERS.values()}

RVIZ_DISPLAYS = {
    "rviz_default_plugins/Grid": "",
    "rviz_default_plugins/RobotModel": "std_msgs/String",
    "rviz_default_plugins/MarkerArray": "visualization_msgs/MarkerArray",
    "rviz_default_plugins/PointCloud2": "sensor_msgs/PointCloud2",
}
"""Of RViz 2 of Jazzy: what each display shows. Source: rviz_default_plugins, plugins_description.xml."""

FOXGLOVE_PANELS = {"3D", "Plot", "DiagnosticSummary", "RawMessages"}
"""Source: Foxglove's documentation of panels; the part of a panel's name before `!`."""


def shows(topic: str, message: str) -> bool:
    """Whether messages of this type come on a topic."""
    known = SKELETONS if topic == "skeleton" else {TYPES.get(topic, "")}
    return message in known


def test_rviz_shows_what_is_published() -> None:
    layout = yaml.safe_load((CONFIG / "mild.rviz").read_text())
    manager = layout["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] in {robot.base_link for robot in ROBOTS.values()}
    topics = []
    for display in manager["Displays"]:
        message = RVIZ_DISPLAYS[display["Class"]]
        asked = display.get("Topic") or display.get("Description Topic")
        assert bool(asked) == bool(message)
        if asked:
            topics.append(asked["Value"])
            assert shows(asked["Value"], message), f"{display['Name']}: {asked['Value']} is no {message}"
            assert (asked["Durability Policy"] == "Transient Local") == (asked["Value"] in LATCHED)
    assert {"skeleton", "markers", "robot_description"} <= set(topics)


def leaves(tree: Any) -> Iterator[str]:
    """Panels of a layout, which is a tree of two halves each."""
    if isinstance(tree, str):
        yield tree
        return
    assert tree["direction"] in ("row", "column")
    assert tree.keys() <= {"first", "second", "direction", "splitPercentage"}
    yield from leaves(tree["first"])
    yield from leaves(tree["second"])


def test_foxglove_shows_what_is_published() -> None:
    layout = json.loads((CONFIG / "foxglove.json").read_text())
    assert layout.keys() >= {"configById", "globalVariables", "userNodes", "layout"}, "what Foxglove imports"
    panels = layout["configById"]
    assert sorted(leaves(layout["layout"])) == sorted(panels), "every panel has its place"
    assert {name.split("!")[0] for name in panels} <= FOXGLOVE_PANELS
    text = json.dumps(panels)
    paths = re.findall(r'"/([a-z_/]+)(?:\.([a-z]+)(?:\[\d+\])?)?"', text)
    assert {topic for topic, _ in paths} >= {"skeleton", "markers", "joint_command", "belief", "diagnostics"}
    fields = {"sensor_msgs/JointState": "position", "std_msgs/Float64MultiArray": "data", "std_msgs/String": "data"}
    for topic, field in paths:
        assert topic in TYPES, f"no publisher of /{topic}"
        assert not field or field == fields[TYPES[topic]]
    assert SOURCES["azure_kinect"].message == "marker_array", "of all skeletons only markers can be shown as they are"
