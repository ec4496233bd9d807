# SPDX-License-Identifier: Apache-2.0
"""Discovery between two machines, set up as docs/deployment.md says."""

from __future__ import annotations

import json
import sys

import pytest

from test.ros.two_machines import cannot_be_made, on_both

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("multicast", "environment", "heard"),
    [
        (True, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, True),
        (False, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_STATIC_PEERS": "{peer}"}, True),
        (True, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, False),
    ],
    ids=["multicast", "static peers", "localhost keeps to itself"],
)
def test_two_machines_hear_each_other_as_set_up(
    multicast: bool, environment: dict[str, str], heard: bool, ros_domain: int
) -> None:
    reason = cannot_be_made()
    if reason:
        pytest.skip(f"no two machines: {reason}")
    hello = [sys.executable, "-m", "mild_ros.environment.discovery_probe", "hello"]
    patience = "60" if heard else "5"  # silence has to be waited for
    names = ("first", "second")
    said = on_both(tuple([*hello, name, patience] for name in names), multicast, **environment)
    assert [json.loads(line) for line in said] == ([["second"], ["first"]] if heard else [[], []])
