# SPDX-License-Identifier: Apache-2.0
"""A description as vendors write them: meshes by package, some of them not here, and none of our own frames."""

from __future__ import annotations

import logging
import re
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.inference.manifest import ControlledAgent
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import read_solids
from mild_core.retargeting.robots.pepper import PEPPER
from mild_core.retargeting.robots.yumi import YUMI
from mild_ros.assembly.robot import check_fit, make_robot
from mild_ros.simulation.bullet import BulletRobot

PACKAGE = "package://yumi_description/meshes"
HERE, MISSING = "yumi_link_1_r", "yumi_body"


def write_stl(path: Path) -> None:
    """One triangle, binary."""
    triangle = np.array([0, 0, 1, 0, 0, 0, 0.1, 0, 0, 0, 0.1, 0], dtype="<f4")
    path.write_bytes(bytes(80) + np.uint32(1).tobytes() + triangle.tobytes() + bytes(2))


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    """YuMi's joints by the vendor's names; every link is a mesh, of which that of one link is here."""
    tree = ElementTree.parse(YUMI.urdf_path)
    root = tree.getroot()
    for link in root.findall("link"):
        if link.get("name", "").startswith("tool_"):
            root.remove(link)
        for part in (*link.findall("visual"), *link.findall("collision")):
            link.remove(part)
        for tag in ("visual", "collision"):
            geometry = ElementTree.SubElement(ElementTree.SubElement(link, tag), "geometry")
            ElementTree.SubElement(geometry, "mesh", filename=f"{PACKAGE}/{link.get('name')}.stl")
    for joint in root.findall("joint"):
        if joint.get("name", "").startswith("tool_"):
            root.remove(joint)
    for material in root.findall("material"):
        root.remove(material)
    package = tmp_path / "yumi_description"
    (package / "meshes").mkdir(parents=True)
    write_stl(package / "meshes" / f"{HERE}.stl")
    (package / "urdf").mkdir()
    tree.write(package / "urdf/yumi.urdf")
    return package / "urdf/yumi.urdf"


def parts(robot: RobotModel, link: str, tag: str) -> list[str]:
    """What a link is made of."""
    found = ElementTree.parse(robot.urdf_path).getroot().findall(f"link[@name='{link}']/{tag}/geometry/*")
    return [part.get("filename", part.tag) for part in found]


def test_meshes_that_are_missing_by_their_files_names_are_named(theirs: Path, caplog: pytest.LogCaptureFixture) -> None:
    theirs.write_text(theirs.read_text().replace(PACKAGE, "file:///opt/vendor/meshes"))
    with caplog.at_level(logging.WARNING):
        make_robot("yumi", str(theirs))
    assert re.search(r" meshes of files such as file:///opt/vendor/meshes/\S+\.stl are not here: ", caplog.text)
    assert "; put them there, or name them by package://" in caplog.text


def test_what_is_missing_is_ours_and_said_in_one_line(theirs: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        robot = make_robot("yumi", str(theirs))
    (line,) = caplog.messages
    links = len(ElementTree.parse(theirs).getroot().findall("link"))
    assert f"{links - 1} meshes of yumi_description are not here: those parts are drawn as our own yumi is" in line
    assert parts(robot, HERE, "visual") == [str(theirs.parents[1] / "meshes" / f"{HERE}.stl")]
    assert parts(robot, MISSING, "visual") == parts(YUMI, MISSING, "visual")
    joints_rad = np.linspace(robot.lower_rad, robot.upper_rad, 5)
    np.testing.assert_array_equal(
        forward_kinematics(robot, joints_rad, robot.tool_link), forward_kinematics(YUMI, joints_rad, YUMI.tool_link)
    )
    ours = [(solid.link, solid.kind, solid.size_m) for solid in read_solids(YUMI.urdf_path)]
    assert sorted((solid.link, solid.kind, solid.size_m) for solid in read_solids(robot.urdf_path)) == sorted(ours)
    with BulletRobot(robot) as simulated:
        assert simulated.measure(0).joint_names[:7] == YUMI.joint_names


def test_a_robot_file_may_name_meshes_by_package(theirs: Path, caplog: pytest.LogCaptureFixture) -> None:
    joints = ", ".join(f'"{name}"' for name in YUMI.joint_names)
    file = theirs.parent / "mine.toml"
    file.write_text(
        f'name = "mine"\ndescription = "yumi.urdf"\nbase_link = "yumi_base_link"\ntool_link = "gripper_r_base"\n'
        f"joint_names = [{joints}]\nhome_rad = {list(map(float, YUMI.home_rad))}\n"
        "acceleration_rad_s2 = 10.0\njerk_rad_s3 = 300.0\n"
    )
    with caplog.at_level(logging.WARNING), BulletRobot(make_robot(str(file))) as simulated:
        assert simulated.measure(0).joint_names[:7] == YUMI.joint_names
    assert "those parts are drawn not at all; source the workspace that has them" in caplog.messages[0]


def test_another_robot_s_description_is_refused(theirs: Path) -> None:
    with pytest.raises(SetupError, match="it has no joint RElbowRoll"):
        make_robot("pepper", str(theirs))


def test_copies_lie_where_no_other_user_can_write(
    theirs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    first, second = make_robot("yumi", str(theirs)).urdf_path, make_robot("yumi", str(theirs)).urdf_path
    assert first == second
    assert list(first.parent.glob("*.urdf*")) == [first]
    first.parent.chmod(0o777)
    with pytest.raises(SetupError, match="can be written by other users; remove it, or set TMPDIR"):
        make_robot("yumi", str(theirs))


def test_a_mesh_outside_its_package_is_none(theirs: Path) -> None:
    write_stl(theirs.parents[2] / "outside.stl")
    text = theirs.read_text()
    theirs.write_text(text.replace(f"{PACKAGE}/{HERE}.stl", "package://yumi_description/../outside.stl"))
    assert parts(make_robot("yumi", str(theirs)), HERE, "visual") == parts(YUMI, HERE, "visual")


def test_a_model_of_another_robot_is_refused_with_the_robot_that_fits() -> None:
    theirs = ControlledAgent("robot_joints", "pepper", PEPPER.joint_names, "rad")
    with pytest.raises(SetupError, match=r"; set robot to pepper, or choose a model of yumi$"):
        check_fit("of_pepper", theirs, YUMI)
    check_fit("of_pepper", theirs, PEPPER)
