# SPDX-License-Identifier: Apache-2.0
"""Two people made by formulas, who shake hands: what is measured of a model with them, through all its stages."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mild_core.learning.data.people import read_people
from mild_core.learning.evaluation.strangers import meeting
from mild_core.learning.training.paired import bent_arm
from mild_core.retargeting.contact import shoulder_and_reach_m
from mild_core.retargeting.robots.yumi import YUMI
from test.command_line.test_main import run

JOINTS = ("head", "neck", "right_shoulder", "right_elbow", "right_hand", "left_shoulder", "right_hip", "left_hip")
BODY_M = ((0.0, 0.2, 0.25), (0.0, 0.2, 0.06), None, None, None, (0.0, 0.4, 0.0), (0.0, 0.1, -0.5), (0.0, 0.3, -0.5))
"""From the right shoulder, forward, left and up; the arm moves."""

RATE_HZ, SHOULDER_M, APART_M = 30.0, 1.4, 0.9
BONES_M = (0.29, 0.31)
TIMES_S = np.arange(0.0, 7.0, 1.0 / RATE_HZ)


def shaken(hand_m: tuple[float, float, float]) -> np.ndarray:
    """(T, J, 3) a person who looks along x, stands, holds the hand out after a second and takes it back after five."""
    rest = np.array([0.02, -0.02, -0.58])
    out = np.interp(TIMES_S, [1.0, 2.0, 5.0, 6.0], [0.0, 1.0, 1.0, 0.0])
    out = (out * out * (3.0 - 2.0 * out))[:, None]
    hand = rest + out * (np.array(hand_m) - rest)
    arm = bent_arm(hand * 0.5 + [-0.1, 0.0, -0.1], hand, np.tile(BONES_M, (len(hand), 1)))
    parts = [np.zeros_like(hand), arm[:, 0], arm[:, 1]]
    fixed = [None if place is None else np.tile(place, (len(hand), 1)) for place in BODY_M]
    body = np.stack([parts.pop(0) if one is None else one for one in fixed], axis=1)
    body[..., 2] += SHOULDER_M
    return body


def people_file(path: Path, people: int) -> Path:
    """Two who meet in the middle, or one of them alone."""
    one = shaken((APART_M / 2.0, 0.2, -0.25))
    other = shaken((APART_M / 2.0, 0.2, -0.25)) * [-1.0, -1.0, 1.0] + [APART_M, 0.4, 0.0]
    both = np.stack([one, other], axis=1)[:, :people]
    noise = 0.002 * np.random.default_rng(0).normal(size=both.shape)  # a tracker that repeats itself is frozen
    positions = np.round((both + noise) * 1000.0).astype(np.int16)
    np.savez(
        path,
        joint_names=np.array(JOINTS),
        labels=np.array(["handshake"]),
        active_s=np.array([[1.0, 6.0]]),
        r0000_positions_mm=positions,
        r0000_times_ms=np.round(TIMES_S * 1000.0).astype(np.int64),
    )
    return path


@pytest.fixture(name="measured", scope="module")
def _measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return people_file(tmp_path_factory.mktemp("people") / "people.npz", 2)


def test_the_robot_takes_the_partner_s_place_and_meets_the_hand(measured, capsys) -> None:
    """No person of the model's recordings stood so; frames come between two ticks of the control clock."""
    (recording,) = read_people(measured)
    assert 2.5 < meeting(recording).sum() / RATE_HZ < 4.5
    command = ("evaluate", "--people", str(measured), "--model", "yumi_buetepage_ahead")
    assert run(*command, "--interaction", "given", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["contact"]["given"] < 0.02
    assert found["contact"]["auto"] < 0.05
    assert found["starts_per_minute"] > 0.0
    assert found["active"]["right"] == 1.0


def test_who_is_alone_meets_no_one(tmp_path, capsys) -> None:
    alone = people_file(tmp_path / "people.npz", 1)
    (recording,) = read_people(alone)
    assert not meeting(recording).any()
    assert run("evaluate", "--people", str(alone), "--model", "yumi_buetepage_ahead") == 0
    assert "contact" not in capsys.readouterr().out


def test_the_reach_is_that_of_the_arm() -> None:
    shoulder_m, reach_m = shoulder_and_reach_m(YUMI)
    np.testing.assert_allclose(shoulder_m, (0.05355, -0.0725, 0.41492), atol=1e-4)
    assert 0.7 < reach_m < 0.9
