# SPDX-License-Identifier: Apache-2.0
"""One file and one URDF per robot; the table of those that `robot` may name."""

from mild_core.retargeting.robots.pepper import PEPPER
from mild_core.retargeting.robots.yumi import YUMI

ROBOTS = {"pepper": PEPPER, "yumi": YUMI}
