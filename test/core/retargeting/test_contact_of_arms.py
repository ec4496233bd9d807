# SPDX-License-Identifier: Apache-2.0
"""Arms that were not trained for, Pepper's of four joints and Panda's of seven, bring their hand to the person's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mild_core.retargeting.robot_file import find_robot
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robots.pepper import PEPPER
from mild_core.shapes import FloatArray
from mild_core.signals import JointCommand
from test.core.retargeting.limits import check_limits
from test.core.retargeting.offering import HIGH, LOW, RAISING_S, Offer, answered, learned_hand
from test.core.retargeting.panda import panda_file

BESIDE_M = np.array([0.04, -0.05, 0.04])
"""From where the learned motion would have the hands meet to where the person's hand is: 7.5 cm."""


@pytest.fixture(scope="module", params=["pepper", "panda"])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    if request.param == "pepper":
        return PEPPER
    return find_robot(str(panda_file(tmp_path_factory.mktemp("robot"))))


def _apart_m(offer: Offer, commands: list[JointCommand]) -> FloatArray:
    """(T,) between the hands in the last half of a second in which the person's is held out."""
    check_limits(offer.robot, commands)
    last = round((0.6 + RAISING_S + offer.held_s) * 100)
    tools = [chain_of(offer.robot).tool(command.positions_rad) for command in commands[last - 50 : last]]
    apart: FloatArray = np.linalg.norm(np.array(tools) - offer.hand_m, axis=1)
    return apart


def test_the_hands_meet_and_part(robot: RobotModel) -> None:
    arms = LOW if robot is PEPPER else HIGH
    offer = Offer(robot, learned_hand(robot, arms) + BESIDE_M, arms)
    learned, _ = answered(replace(offer, parts=()), "off")
    commands, counts = answered(offer, "blend")
    assert np.median(_apart_m(offer, learned)) == pytest.approx(0.075, abs=0.02), "the learned motion alone passes by"
    assert np.median(_apart_m(offer, commands)) < 0.02, counts
    assert commands[-1].mode in ("returning", "ready"), counts
    tools = [chain_of(robot).tool(command.positions_rad) for command in commands]
    assert np.linalg.norm(tools[-1] - tools[0]) < 0.5 * np.linalg.norm(offer.hand_m - tools[0]), "it goes home"


def test_a_hand_beyond_peppers_reach_is_pointed_at_without_a_tremble() -> None:
    shoulder_m = chain_of(PEPPER).offsets[0][:3, 3]
    away = learned_hand(PEPPER) - shoulder_m
    far = Offer(PEPPER, shoulder_m + away * (0.55 / np.linalg.norm(away)))  # Pepper's hand comes 0.37 m far
    commands, _ = answered(far)
    check_limits(PEPPER, commands)
    last = round((0.6 + RAISING_S + far.held_s) * 100)
    held = np.array([command.positions_rad for command in commands[last - 50 : last]])
    assert np.rad2deg(np.ptp(held, axis=0)).max() < 1.0
    tool = chain_of(PEPPER).tool(held[-1])
    assert np.linalg.norm(tool - shoulder_m) == pytest.approx(0.37, abs=0.03)
