# SPDX-License-Identifier: Apache-2.0
"""Two people and two robots in one domain: each robot responds to its own person only."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from test.ros.processes import NodeProcess, Probe
from test.ros.surroundings import YUMI, Person, Surroundings

pytestmark = pytest.mark.slow


def test_two_robots_keep_apart(start: Callable[..., NodeProcess], ros_domain: int, random_model: Path) -> None:
    probes = [Probe("/left"), Probe("/right")]
    try:
        around = [
            Surroundings(probe, f"{name}/pipeline") for name, probe in zip(("left", "right"), probes, strict=True)
        ]
        people = [Person(probe) for probe in probes]
        for name in ("left", "right"):
            start("pipeline", "-r", f"__ns:=/{name}", model=random_model, interaction="hand_shake")
        for one, person in zip(around, people, strict=True):
            one.connect(one.states, person.publisher)

        def act() -> None:
            people[0].act()  # no person stands before the right one
            for one in around:
                one.obey()
                one.probe.spin(0.01)

        def left_follows() -> bool:
            act()
            return one_moved(around[0]) and len(around[1].commands) > 100

        probes[0].until(left_follows, "the left robot following its person")
        assert not one_moved(around[1]), "the right one stays at home"
        for one in around:
            assert "other publisher" not in one.status()[1], "neither takes the other for a rival"
            assert one.probe.node.count_publishers("joint_command") == 1
        assert probes[0].node.count_publishers("/joint_command") == 0
    finally:
        for probe in probes:
            probe.close()


def one_moved(around: Surroundings) -> bool:
    positions = np.array([list(message.position) for message in around.commands])
    return bool(len(positions)) and bool(np.abs(positions - YUMI.home_rad).max() > 0.05)
