# SPDX-License-Identifier: Apache-2.0
"""The Franka Panda that comes with PyBullet, as a user would describe it: in a robot file."""

from __future__ import annotations

from pathlib import Path

import pytest

JOINTS = [f"panda_joint{number}" for number in range(1, 8)]
PANDA = """
name = "panda"
description = "{description}"
base_link = "panda_link0"
tool_link = "panda_hand"
shoulder_link = "panda_link2"
elbow_link = "panda_link4"
joint_names = {joint_names}
home_rad = [0.0, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]
acceleration_rad_s2 = 10.0
jerk_rad_s3 = 300.0
[rest]
panda_finger_joint1 = 0.02
panda_finger_joint2 = 0.02
"""


def panda_file(folder: Path) -> Path:
    """The robot file in `folder`; skips the test where PyBullet's descriptions are missing."""
    data = pytest.importorskip("pybullet_data").getDataPath()
    path = folder / "panda.toml"
    path.write_text(PANDA.format(description=Path(data, "franka_panda", "panda.urdf"), joint_names=JOINTS))
    return path
