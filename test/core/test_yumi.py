# SPDX-License-Identifier: Apache-2.0
"""The robot that ships: its drawing has the real one's kinematics and limits."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.retargeting.robot_model.kinematics import forward_kinematics, read_tree
from mild_core.retargeting.robots.yumi import AXES, LEFT_REST_RAD, YUMI, joint_name
from tools.yumi_description import yumi


@pytest.mark.parametrize(("side", "word"), [("r", "right"), ("l", "left")])
def test_forward_kinematics_reproduces_what_the_real_robot_logged(mild_data: Path, side: str, word: str) -> None:
    log = np.load(mild_data / "yumi_fk_oracle.npz", allow_pickle=False)
    columns = log[f"{word}_joints_rad"].T
    positions = dict(zip((joint_name(axis, side) for axis in AXES), columns, strict=True))
    poses = read_tree(YUMI.urdf_path).pose(f"yumi_link_7_{side}", positions, YUMI.base_link)
    error_m = np.linalg.norm(poses[:, :3, 3] - log[f"{word}_position_m"], axis=1)
    # The bounds of the task. A wrong order of the axes gives 6.6 mm at best; 1.2 % of the log's own rows are off.
    assert np.median(error_m) < 0.2e-3
    assert np.mean(error_m < 2e-3) >= 0.98


def test_the_description_is_what_its_program_writes() -> None:
    assert YUMI.urdf_path.read_text() == yumi()


def test_limits_of_model_and_description_agree() -> None:
    joints = {joint.get("name"): joint for joint in ElementTree.parse(YUMI.urdf_path).getroot().findall("joint")}
    for side in "rl":
        for place, axis in enumerate(AXES):
            limit = joints[joint_name(axis, side)].find("limit")
            assert limit is not None
            model = (YUMI.lower_rad, YUMI.upper_rad, YUMI.velocity_rad_s)
            written = [float(limit.get(name, "nan")) for name in ("lower", "upper", "velocity")]
            # Nine digits are written.
            np.testing.assert_allclose(written, [values[place] for values in model], rtol=1e-8)


def test_masses_are_those_of_the_robot_and_inertias_are_possible() -> None:
    links = ElementTree.parse(YUMI.urdf_path).getroot().findall("link")
    total = 0.0
    for inertial in (found for link in links if (found := link.find("inertial")) is not None):
        mass, entries = inertial.find("mass"), inertial.find("inertia")
        assert mass is not None
        assert entries is not None
        total += float(mass.get("value", "nan"))
        xx, xy, xz, yy, yz, zz = (
            float(entries.get(f"i{name}", "nan")) for name in ("xx", "xy", "xz", "yy", "yz", "zz")
        )
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert moments[0] > 0
        # No body is harder to turn about one axis than about the two others together; a part in a million of rounding.
        assert moments[2] <= (moments[0] + moments[1]) * (1 + 1e-6)
    assert total == pytest.approx(38, abs=1)  # kg, ABB product specification IRB 14000


def test_home_is_where_recorded_interactions_begin(mild_data: Path) -> None:
    trials = BUETEPAGE_HR.read(mild_data / BUETEPAGE_HR.file).train
    mean = np.mean([trial.controlled[0] for trial in trials], axis=0)
    # Home is that mean to 0.01 rad, so that it is a number of ours.
    np.testing.assert_allclose(YUMI.home_rad, mean, atol=0.006)


def test_the_left_arm_rests_as_the_mirror_image_of_home() -> None:
    positions = dict(zip((joint_name(axis, "l") for axis in AXES), LEFT_REST_RAD, strict=True))
    left = read_tree(YUMI.urdf_path).pose("tool_l", positions)[:3, 3]
    right = forward_kinematics(YUMI, YUMI.home_rad, "tool_r")[:3, 3]
    # The two shoulders of the real robot mirror each other to 0.3 degrees, 2 mm at an arm's length.
    np.testing.assert_allclose(left * [1, -1, 1], right, atol=3e-3)


def test_names_are_those_of_the_recordings() -> None:
    assert YUMI.joint_names == BUETEPAGE_HR.controlled_names
