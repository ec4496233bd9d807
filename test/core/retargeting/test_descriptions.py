# SPDX-License-Identifier: Apache-2.0
"""Descriptions as others write them: read as they are meant, or rejected in one line that says why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.guard import Guard
from mild_core.retargeting.robot_file import find_robot, read_robot
from mild_core.retargeting.robot_model.capsules import capsules_of
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.inverse_kinematics import InverseKinematics, Reach
from mild_core.retargeting.robot_model.kinematics import forward_kinematics, read_tree
from mild_core.retargeting.robot_model.rigid_bodies import rigid_bodies
from mild_core.retargeting.settings import RetargetingSettings
from test.core.retargeting.small_arm import ARM, COPYING, LIMIT, joint, link, small_arm, with_more, written

SOFT = '<safety_controller k_velocity="20" soft_lower_limit="-1.0" soft_upper_limit="1.0"/>'
TOML = "lower_rad = [-1, -1, -1]\nupper_rad = [1, 1, 1]\nvelocity_rad_s = 1\n"


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_what_has_no_single_position_stands_still_unless_it_is_in_the_arm(tmp_path: Path, kind: str) -> None:
    cart = link("cart") + joint("loose", "base", "cart", "0 0 1", "", kind)
    robot = small_arm(tmp_path, with_more(cart))
    assert any("'loose'" in note and kind in note for note in robot.notes)
    np.testing.assert_array_equal(read_tree(robot.urdf_path).pose("cart", {"loose": 9.0})[:3, 3], [0.3, 0, 0])
    with pytest.raises(SetupError, match=f"joint 'j2' is {kind} and lies between 'base' and the tool"):
        small_arm(tmp_path, ARM.replace('name="j2" type="revolute"', f'name="j2" type="{kind}"'), ("j1", "j3"))


def test_soft_limits_count_where_they_are_narrower(tmp_path: Path) -> None:
    robot = small_arm(tmp_path, ARM.replace(LIMIT, LIMIT + SOFT, 1))
    assert (robot.lower_rad.tolist(), robot.upper_rad.tolist()) == ([-1, -1.5, -1.5], [1, 1.5, 1.5])
    assert "soft limits of its safety controller hold for j1" in " ".join(robot.notes)
    for useless in ('soft_lower_limit="0" soft_upper_limit="0"', 'soft_lower_limit="2" soft_upper_limit="3"'):
        robot = small_arm(tmp_path, ARM.replace(LIMIT, f"{LIMIT}<safety_controller {useless}/>", 1))
        assert robot.upper_rad[0] == 1.5
        assert "leave no room, and do not count, for j1" in " ".join(robot.notes)
    silent = small_arm(tmp_path, ARM.replace(LIMIT, f'{LIMIT}<safety_controller k_velocity="20"/>', 1))
    assert silent.notes == (), "no limits are stated there"
    narrow = SOFT.replace("-1.0", "-0.1").replace("1.0", "0.1")
    with pytest.raises(SetupError, match=r"outside the limits of 'j1': 0.2, not within -0.1 to 0.1; the soft limits"):
        small_arm(tmp_path, ARM.replace(LIMIT, LIMIT + narrow, 1))


@pytest.mark.parametrize("limit", ["", '<limit lower="0" upper="0" velocity="0" effort="0"/>'])
def test_limits_that_leave_no_room_are_asked_for(tmp_path: Path, limit: str) -> None:
    text = ARM.replace(LIMIT, limit, 1)
    with pytest.raises(SetupError, match=r"'lower_rad' is missing, and arm.urdf has none that 'j1' could move in"):
        small_arm(tmp_path, text)
    assert small_arm(tmp_path, text, more=TOML).upper_rad.tolist() == [1, 1, 1]
    with pytest.raises(SetupError, match=r"the limits of 'j1' are 1.5 to -1.5, not in order"):
        small_arm(tmp_path, ARM.replace('lower="-1.5" upper="1.5"', 'lower="1.5" upper="-1.5"', 1))


def test_a_joint_without_end_is_kept_within_half_a_turn(tmp_path: Path) -> None:
    text = ARM.replace(
        joint("j2", "upper", "fore", "0 0 1"),
        joint("j2", "upper", "fore", "0 0 1", '<limit velocity="2" effort="9"/>', "continuous"),
    )
    robot = small_arm(tmp_path, text)
    assert robot.upper_rad[1] == pytest.approx(np.pi)
    assert "turn without end" in " ".join(robot.notes)
    InverseKinematics(robot, ("hand",))


def test_a_joint_that_copies_a_commanded_one_moves_in_every_model(tmp_path: Path) -> None:
    robot = small_arm(tmp_path, COPYING, ("j1", "j3"))
    chain, at = chain_of(robot), np.array([0.5, -0.3])
    place = forward_kinematics(robot, at, "hand")[:3, 3]
    np.testing.assert_allclose(chain.tool(at), place, atol=1e-12)
    moved = forward_kinematics(robot, at + np.eye(2) * 1e-6, "hand")[:, :3, 3]
    np.testing.assert_allclose(chain.jacobian(at), (moved - place).T / 1e-6, atol=1e-5)
    solver = InverseKinematics(robot, ("hand",))
    found = solver.step(np.array([0.3, 0.0]), [Reach("hand", place)], at, 40)
    np.testing.assert_allclose(forward_kinematics(robot, found, "hand")[:3, 3], place, atol=1e-3)
    with pytest.raises(SetupError, match="holds 'j2', which copies 'j1'"):
        small_arm(tmp_path, COPYING)


def test_a_joint_that_copies_nothing_stands_at_rest(tmp_path: Path) -> None:
    robot = small_arm(tmp_path, COPYING.replace('mimic joint="j1"', 'mimic joint="j9"'), ("j1", "j3"))
    assert "'j2'" in " ".join(robot.notes)
    text = COPYING.replace(
        joint("j1", "base", "upper"), joint("j1", "base", "upper", more='<mimic joint="j2"/>' + LIMIT)
    )
    assert "'j1', 'j2'" in " ".join(small_arm(tmp_path, text, ("j3",)).notes)


@pytest.mark.parametrize(
    "text",
    [
        ARM.replace('name="arm"', 'name="Müller"').encode("latin-1"),
        b'<?xml version="1.0" encoding="UTF-8"?>' + ARM.replace('name="arm"', 'name="Müller"').encode("latin-1"),
        b'<?xml version="1.0" encoding="ISO-8859-1"?>' + ARM.replace('name="arm"', 'name="Müller"').encode("latin-1"),
        b"\xef\xbb\xbf" + ARM.encode(),
        with_more('<drake:joint name="j1"><drake:a b:c="1"/></drake:joint><mujoco/><gazebo/><transmission name="t"/>'),
        ARM.replace("<robot", '<robot xmlns="http://drake.mit.edu" xmlns:xacro="http://wiki.ros.org/xacro"'),
        ARM.replace('ixx="0.01"', 'ixx="-5.4e-20"'),
    ],
    ids=["latin-1", "latin-1 as utf-8", "declared", "mark", "prefixes", "namespace", "rounded inertia"],
)
def test_what_others_read_is_read(tmp_path: Path, text: str | bytes) -> None:
    assert small_arm(tmp_path, text).joint_names == ("j1", "j2", "j3")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (with_more('<xacro:include filename="a.xacro"/>'), "is xacro, not URDF yet: <xacro:include>"),
        (ARM.replace("0.3 0 0", "${length} 0 0"), "is xacro, not URDF yet: <origin>; give what 'xacro arm.urdf >"),
        (with_more(link("upper")), "two links are called 'upper'"),
        (with_more(link("a") + joint("j1", "base", "a")), "two joints are called 'j1'"),
        (with_more(joint("j9", "base", "hand")), "'hand' hangs on two joints"),
        (with_more(link("a") + link("b") + joint("j9", "a", "b")), "its links form no tree: a, base hang on nothing"),
        (ARM.replace('value="2"', 'value="nan"', 1), "link 'upper': value='nan'"),
        (ARM.replace('value="2"', 'value="-2"', 1), "link 'upper': mass value"),
        (ARM.replace('xyz="0 1 0"', 'xyz="0 0 0"', 1), "joint 'j1' has no axis"),
        (ARM.replace('"revolute"', '"ball"', 1), "joint 'j1' of type 'ball'"),
    ],
)
def test_what_cannot_be_read_is_one_line_that_names_it(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(SetupError) as refused:
        small_arm(tmp_path, text)
    assert problem in str(refused.value)
    assert str(tmp_path / "arm.urdf") in str(refused.value)
    assert "\n" not in str(refused.value)


MOVEIT = """joint_limits:
  j1: {has_velocity_limits: true, max_velocity: 0.5, has_acceleration_limits: true, max_acceleration: 3.0}
"""
CONTROL = """/**:
  ros__parameters:
    robot_description_planning:
      joint_limits:
        j1: {has_position_limits: true, min_position: !degrees -30.0, max_position: 3.0, max_velocity: 9.0}
        j2: {has_position_limits: false, max_position: 0.1, has_soft_limits: true, soft_upper_limit: 0.7,
             has_jerk_limits: true, max_jerk: 50.0, max_deceleration: 2.0, has_deceleration_limits: true}
        other: {max_velocity: 1.0}
"""


def test_limits_are_also_read_from_files_of_limits_and_the_narrowest_counts(tmp_path: Path) -> None:
    (tmp_path / "moveit.yaml").write_text(MOVEIT)
    (tmp_path / "control.yaml").write_text(CONTROL)
    robot = small_arm(tmp_path, more='joint_limits = ["moveit.yaml", "control.yaml"]\n')
    np.testing.assert_allclose(robot.lower_rad, [np.deg2rad(-30), -1.5, -1.5])
    np.testing.assert_allclose(robot.upper_rad, [1.5, 0.7, 1.5])
    np.testing.assert_allclose(robot.velocity_rad_s, [0.5, 2, 2])
    np.testing.assert_allclose(robot.acceleration_rad_s2, [3, 2, 10])
    np.testing.assert_allclose(robot.jerk_rad_s3, [300, 50, 300])
    (tmp_path / "all.yaml").write_text(
        "joint_limits:\n" + "".join(f"  j{n}: {{max_acceleration: {n}}}\n" for n in (1, 2, 3))
    )
    (note,) = robot.notes
    assert note.endswith(
        "control.yaml: limits for joints that arm.urdf has not, which bind nothing: 'other' (there are j3)"
    )
    path = written(tmp_path, more='joint_limits = "all.yaml"\n')
    path.write_text(path.read_text().replace("acceleration_rad_s2 = 10\n", ""))
    assert read_robot(path).acceleration_rad_s2.tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("joint_limits: [", "is no YAML that can be used"),
        ("limits: 3", "has no key 'joint_limits'"),
        ("joint_limits: {j1: 3}", "key 'joint_limits.j1' is no object"),
        ("joint_limits: {j1: {max_velocity: quick}}", "key 'joint_limits.j1.max_velocity' is no finite number"),
        ("joint_limits: {j1: {max_velocity: .nan}}", "is no finite number"),
        ("joint_limits: {j1: {max_velocity: 0}}", "is 0: the joint could not move"),
        ("joint_limits: {j1: {has_velocity_limits: 3, max_velocity: 1}}", "is neither true nor false"),
        ("joint_limits: {j1: {min_position: 1, max_position: -1}}", "is -1, not above min_position 1"),
        ("joint_limits: {j1: {max_position: !degrees [1]}}", "stands before no number"),
        (
            "joint_limits: {joint_a: {max_velocity: 1}}",
            "names limits.yaml, which has none of the joints; it has joint_a",
        ),
        ("joint_limits: !!python/object/apply:os.abort []", "is no YAML that can be used"),
    ],
)
def test_a_file_of_limits_that_cannot_be_used_is_one_line(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "limits.yaml").write_text(text)
    with pytest.raises(SetupError) as refused:
        small_arm(tmp_path, more='joint_limits = "limits.yaml"\n')
    assert problem in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_table_is_kept_out_of_where_the_robot_has_one(tmp_path: Path) -> None:
    down = np.array([[1.2, 0.0, 0.0]])  # over the edge of the table, then into it: the base begins at its top
    near = ARM.replace('xyz="0.3 0 0"/><axis', 'xyz="0.05 0 0"/><axis')
    clear_m = [
        Guard(small_arm(tmp_path, near, more=f"on_table = {flag}\n"), RetargetingSettings()).own_clearance_m(down)[0]
        for flag in ("false", "true")
    ]
    assert clear_m[0] > 0.0 > clear_m[1]
    robot = small_arm(tmp_path, near, more="on_table = true\n")
    assert np.sum(capsules_of(robot).mounted == 0) == np.sum(capsules_of(small_arm(tmp_path, near)).mounted == 0) + 9


def test_what_others_get_has_bodies_that_there_can_be(tmp_path: Path) -> None:
    text = ARM.replace('ixx="0.01"', 'ixx="0"').replace('izz="0.02"', 'izz="5"')
    many = "".join(link(f"l{n}") + joint(f"k{n}", "hand", f"l{n}") for n in range(200))
    made = rigid_bodies(small_arm(tmp_path, with_more(many, text)))
    assert made.count("<link") == 4
    assert max(map(len, made.splitlines())) < 300  # PyBullet cuts those of more than 8192, and a robot has many
    (tmp_path / "made.urdf").write_text(made)
    assert [each.name for each in read_tree(tmp_path / "made.urdf").by_child.values()] == ["j1", "j2", "j3"]


def test_a_file_of_limits_may_be_for_more_than_the_arm_and_a_misspelt_joint_is_named(tmp_path: Path) -> None:
    gripper = link("finger") + joint("finger_joint", "hand", "finger", "0 0 1")
    text = "joint_limits:\n  j1: {max_velocity: 1}\n  finger_joint: {max_velocity: 1}\n"
    (tmp_path / "limits.yaml").write_text(text)
    assert small_arm(tmp_path, with_more(gripper), more='joint_limits = "limits.yaml"\n').notes == ()
    (tmp_path / "limits.yaml").write_text(text + "  finger_jont: {max_velocity: 1}\n  j22: {max_velocity: 1}\n")
    (note,) = small_arm(tmp_path, with_more(gripper), more='joint_limits = "limits.yaml"\n').notes
    assert "'finger_jont' (there are j2, j3)" in note
    assert "'j22' (did you mean 'j2'?)" in note


def test_home_outside_the_limits_of_a_file_of_limits_names_that_file(tmp_path: Path) -> None:
    (tmp_path / "limits.yaml").write_text("joint_limits: {j1: {has_position_limits: true, max_position: 0.1}}")
    with pytest.raises(SetupError, match=r"limits of 'j1': 0.2, not within -1.5 to 0.1; those of limits.yaml hold"):
        small_arm(tmp_path, more='joint_limits = "limits.yaml"\n')


def test_a_loop_is_named_by_the_joint_or_by_its_links(tmp_path: Path) -> None:
    """Whatever the order in which a set of links comes."""
    loops = link("a") + link("b") + joint("ab", "a", "b", "0 0 1") + joint("ba", "b", "a", "0 0 1")
    with pytest.raises(SetupError, match="links hang on each other in a loop: a, b"):
        small_arm(tmp_path, with_more(loops))
    with pytest.raises(SetupError, match="joint 'self' joins link 'a' to itself"):
        small_arm(tmp_path, with_more(link("a") + joint("self", "a", "a", "0 0 1")))


def test_a_folder_in_the_place_of_a_robot_file_and_a_rest_of_nothing_say_what_works(tmp_path: Path) -> None:
    path = written(tmp_path, more="[rest]\nj9 = 0.1\n")
    with pytest.raises(SetupError, match=r"key 'rest.j9' is unknown; leave it out"):
        read_robot(path)
    with pytest.raises(SetupError, match=f"is a folder, not a robot file; give {path}"):
        find_robot(str(tmp_path))
    (tmp_path / "empty").mkdir()
    with pytest.raises(SetupError, match="there is none in it"):
        find_robot(str(tmp_path / "empty"))
