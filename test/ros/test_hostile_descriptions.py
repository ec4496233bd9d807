# SPDX-License-Identifier: Apache-2.0
"""Untrusted robot descriptions: budgets are checked first, and a crash of the loader is a child process's."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.kinematics import read_tree
from mild_core.retargeting.robot_model.urdf import CHAIN_LIMIT, LINKS_LIMIT, NAME_LIMIT, SHAPES_LIMIT, SIZE_LIMIT
from mild_core.retargeting.robots import ROBOTS
from mild_ros.assembly.robot import make_robot
from mild_ros.simulation import trial_load
from mild_ros.simulation.bullet import BulletRobot
from mild_ros.simulation.trial_load import survivable, try_load
from test.ros.processes import NodeProcess, Probe

YUMI = ROBOTS["yumi"].urdf_path.read_text()
SECONDS = 10.0
"""Each is refused in a tenth of a second; the machine may be busy."""


def with_link(inside: str) -> str:
    """Our own description with something in one more link."""
    link = f'<link name="more">{inside}</link>'
    joint = '<joint name="to_more" type="fixed"><parent link="yumi_base_link"/><child link="more"/></joint>'
    return YUMI.replace("</robot>", f"{link}{joint}</robot>")


def with_shape(shape: str, part: str = "collision") -> str:
    return with_link(f"<{part}><geometry>{shape}</geometry></{part}>")


def with_inertia(mass: str, ixx: str = "1") -> str:
    others = 'ixy="0" ixz="0" iyy="1" iyz="0" izz="1"'
    return with_link(f'<inertial><mass value="{mass}"/><inertia ixx="{ixx}" {others}/></inertial>')


def chained(count: int, start: str = "yumi_base_link") -> str:
    text, parent = "", start
    for number in range(count):
        text += f'<link name="c{number}"/><joint name="jc{number}" type="fixed"><parent link="{parent}"/>'
        text += f'<child link="c{number}"/></joint>'
        parent = f"c{number}"
    return YUMI.replace("</robot>", text + "</robot>")


def with_joint(inside: str) -> str:
    joint = '<joint name="to_more" type="revolute"><parent link="yumi_base_link"/><child link="more"/>{}</joint>'
    return YUMI.replace("</robot>", f'<link name="more"/>{joint.format(inside)}</robot>')


BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
SPHERE = '<sphere radius="{}"/>'
HOSTILE = {
    "a link on no joint": (YUMI.replace("</robot>", '<link name="stray"/></robot>'), "'stray' hangs on no joint"),
    "a chain of 30,000 links": (chained(30_000), "it has more than 100000 elements"),
    "a thousand links": (chained(1000), "at most 300"),
    "a long chain": (chained(CHAIN_LIMIT + 1), "chain of more than"),
    "a loop": (YUMI.replace("</robot>", '<link name="a"/><link name="b"/>' + "".join(
        f'<joint name="l{one}" type="fixed"><parent link="{one}"/><child link="{other}"/></joint>'
        for one, other in ("ab", "ba")) + "</robot>"), "loop"),
    "a link that is not there": (YUMI.replace("</robot>", '<joint name="j" type="fixed"><parent link="yumi_base_link"/>'
        '<child link="nowhere"/></joint></robot>'), "'nowhere' that it does not have"),
    "two links of one name": (YUMI.replace("</robot>", '<link name="yumi_base_link"/></robot>'), "one name"),
    "too many shapes": (with_link(BOX * (SHAPES_LIMIT + 1)), "shapes"),
    "a radius of NaN": (with_shape(SPHERE.format("nan")), "finite"),
    "a radius beyond all numbers": (with_shape(SPHERE.format("1e999")), "finite"),
    "a radius of the earth": (with_shape(SPHERE.format("6.4e6"), "visual"), "range"),
    "a radius of nothing": (with_shape(SPHERE.format("0")), "not above 0"),
    "a negative box": (with_shape('<box size="1 -1 1"/>'), "not above 0"),
    "a cylinder without a length": (with_shape('<cylinder radius="1"/>'), "no length"),
    "a scale of infinity": (with_shape('<mesh filename="a.stl" scale="inf 1 1"/>', "visual"), "finite"),
    "a mass of NaN": (with_inertia("nan"), "finite"),
    "a negative mass": (with_inertia("-1"), "range"),
    "an inertia of infinity": (with_inertia("1", "inf"), "finite"),
    "a comma for a point": (with_joint('<limit upper="1,5"/>'), "joint 'to_more': upper='1,5' is not 1 finite"),
    "an effort of nothing": (with_joint('<limit effort=""/>'), "joint 'to_more': effort='' is not 1 finite"),
    "a soft limit of NaN": (with_joint('<safety_controller soft_upper_limit="nan"/>'), "joint 'to_more': soft_upper"),
    "an axis of two": (with_joint('<axis xyz="0 1"/>'), "joint 'to_more': xyz='0 1' is not 3 finite"),
    "a multiplier of text": (with_joint('<mimic joint="a" multiplier="x"/>'), "joint 'to_more': multiplier='x' is not"),
    "a far origin": (with_link('<visual><origin xyz="1e300 0 0"/></visual>'), "range"),
    "a name of a megabyte": (YUMI.replace("yumi_base_link", "x" * 1_000_000), "is called"),
    "a name with an escape": (YUMI.replace("yumi_base_link", "a\u202eb"), "is called"),
    "deep elements": (YUMI.replace("</robot>", "<a>" * 200_000 + "</a>" * 200_000 + "</robot>"), "in each other"),
    "many elements": (YUMI.replace("</robot>", "<a/>" * 200_000 + "</robot>"), "elements"),
    "entities": ('<!DOCTYPE r [<!ENTITY a "b">]>' + YUMI[YUMI.index("<robot"):], "document type"),
    "nine megabytes": (YUMI + " " * SIZE_LIMIT, "larger than"),
    "not XML": ("\0" * 1000, "no robot description"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "problem"), HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_description_is_one_line_before_anything_loads_it(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    started_s = time.monotonic()
    with pytest.raises(SetupError, match=problem) as caught:
        make_robot("yumi", str(path))
    assert time.monotonic() - started_s < SECONDS
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1000
    robot_file = tmp_path / "robot.toml"
    robot_file.write_text(
        'name = "x"\ndescription = "robot.urdf"\nbase_link = "yumi_base_link"\ntool_link = "tool_r"\n'
        'joint_names = ["yumi_joint_1_r"]\nhome_rad = [0.0]\nacceleration_rad_s2 = 1.0\njerk_rad_s3 = 1.0\n'
    )
    with pytest.raises(SetupError, match=problem):
        make_robot(str(robot_file))


def test_what_is_no_file_is_not_read(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.urdf"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero"), tmp_path):
        with pytest.raises(SetupError, match="file"):
            read_tree(path)
        with pytest.raises(SetupError, match="file"):
            make_robot("yumi", str(path))


def test_a_robot_of_many_links_is_within_the_budgets(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(chained(CHAIN_LIMIT - 20).replace('name="c0"', f'name="{"y" * NAME_LIMIT}"').replace(
        'link="c0"', f'link="{"y" * NAME_LIMIT}"'))  # fmt: skip
    assert len(read_tree(path).by_child) < LINKS_LIMIT
    make_robot("yumi", str(path))


def deadly(folder: Path) -> Path:
    """A description within all budgets that PyBullet dies of: a mesh whose faces name corners that are not there."""
    (folder / "bad.obj").write_text("v 1 2 3\nf 1 99999999 -88888888\n" * 10)
    path = folder / "robot.urdf"
    path.write_text(with_shape('<mesh filename="bad.obj"/>', "visual"))
    return path


def test_a_library_that_dies_does_so_in_a_child(tmp_path: Path) -> None:
    robot = make_robot("yumi", str(deadly(tmp_path)))
    for _ in range(2):  # what was survived is remembered, what was not is tried again
        with pytest.raises(SetupError, match="PyBullet dies of it"):
            BulletRobot(robot)


def test_a_child_has_bounded_memory_and_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(with_link(""))
    monkeypatch.setattr(trial_load, "PATIENCE_S", 0.01)
    with pytest.raises(SetupError, match="does not finish"):
        try_load(path, str(path))


def test_what_was_survived_is_not_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(
        with_link(BOX.replace("</geometry>", f"</geometry><origin xyz='0 0 {time.time_ns() % 10**9 / 1e9}'/>"))
    )
    calls = []
    run = trial_load.subprocess.run
    monkeypatch.setattr(trial_load.subprocess, "run", lambda *a, **k: (calls.append(a), run(*a, **k))[1])
    for _ in range(2):
        survivable(make_robot("yumi", str(path)))
    survivable(make_robot("yumi"))  # our own is known
    assert len(calls) == 1
    path.write_text(path.read_text().replace("1 1 1", "1 1 2"))
    read_tree.cache_clear()
    survivable(make_robot("yumi", str(path)))
    assert len(calls) == 2


@pytest.mark.slow
def test_a_hostile_latched_description_ends_a_node_in_one_line(
    start: Callable[..., NodeProcess], probe: Probe, tmp_path: Path
) -> None:
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node: Node = probe.node
    publisher = node.create_publisher(String, "robot_description", latched)
    for text, problem in (
        (deadly(tmp_path).read_text().replace("bad.obj", str(tmp_path / "bad.obj")), "PyBullet dies of it (SIGSEGV)"),
        (HOSTILE["a thousand links"][0], "at most 300"),
    ):
        publisher.publish(String(data=text))
        started = start("simulation", robot_description="topic:robot_description")
        assert started.wait() == 2
        assert problem in started.output()
        assert len(started.output().strip().splitlines()) == 1
