# SPDX-License-Identifier: Apache-2.0
"""A vendor's description that robot_state_publisher has put on a topic long before."""

from __future__ import annotations

import pytest
from std_msgs.msg import String

import mild_ros.assembly.robot
from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.kinematics import read_tree
from mild_core.retargeting.robots.pepper import PEPPER
from mild_ros.assembly.robot import make_robot
from mild_ros.node_kit.quality_of_service import LATCHED
from test.ros.processes import Probe


def test_a_description_is_taken_from_a_topic(probe: Probe, monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = PEPPER.urdf_path.read_text().replace('xyz="0.15 0 0"', 'xyz="0.2 0 0"')
    publisher = probe.node.create_publisher(String, "robot_description", LATCHED)
    publisher.publish(String(data=theirs))
    robot = make_robot("pepper", "topic:robot_description")
    assert robot.urdf_path.read_text() == theirs
    assert read_tree(robot.urdf_path).by_child["r_wrist"].origin[0, 3] == 0.2
    monkeypatch.setattr(mild_ros.assembly.robot, "PATIENCE_S", 0.2)
    with pytest.raises(SetupError, match="nothing came on topic 'elsewhere'"):
        make_robot("pepper", "topic:elsewhere")
