# SPDX-License-Identifier: Apache-2.0
"""Hands that met in the recording meet again from the fitted place."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import DatasetError
from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.learning.training.place_fit import fit_contact, hand_of, touching
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robots import ROBOTS
from test.core.learning.made_trials import made_trial

YUMI = ROBOTS["yumi"]


def robot_trial(trial, interaction):
    made = made_trial(trial, interaction, gain=0.3)
    joints = np.concatenate([made.controlled, made.controlled, made.controlled[:, :1]], axis=1) + YUMI.home_rad
    return replace(made, controlled_names=YUMI.joint_names, controlled=joints)


def test_from_the_fitted_place_the_hand_is_at_the_tool():
    trials = [robot_trial(0, "shake"), robot_trial(1, "bump")]
    contact = fit_contact(trials, YUMI, ("shake", "bump"), (0.3, 0.3), math.radians(170))
    assert contact.distance_m == pytest.approx({"shake": 0.0, "bump": 0.0}, abs=1e-12)
    for trial in trials:
        hand = hand_of(trial.observed_m, (0.3, 0.3))
        when = touching(hand)
        cosine, sine = math.cos(math.radians(170)), math.sin(math.radians(170))
        turned = hand @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
        tool = forward_kinematics(YUMI, trial.controlled, YUMI.tool_link)[:, :3, 3]
        meant = (turned + contact.by_interaction[trial.interaction])[when].mean(axis=0)
        np.testing.assert_allclose(meant, tool[when].mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(contact.translation_m, np.mean(list(contact.by_interaction.values()), axis=0))
    placement = contact.placement()
    assert set(placement.by_interaction) == {"shake", "bump"}
    np.testing.assert_allclose(placement.translation_m, contact.translation_m, atol=5e-5)
    assert placement.arm_lengths_m == (0.3, 0.3)


def test_other_bones_keep_directions_and_the_way_of_the_shoulder():
    trial = made_trial(0)
    np.testing.assert_array_equal(hand_of(trial.observed_m, None), trial.observed_m[:, 2])
    np.testing.assert_allclose(hand_of(trial.observed_m, (0.18, 0.23)), trial.observed_m[:, 2], atol=1e-12)
    np.testing.assert_allclose(hand_of(trial.observed_m, (0.36, 0.46)), 2 * trial.observed_m[:, 2], atol=1e-12)


def test_an_interaction_without_trials_is_named():
    with pytest.raises(DatasetError, match="bump"):
        fit_contact([robot_trial(0, "shake")], YUMI, ("shake", "bump"))


def test_recorded_hands_meet_within_a_hands_breadth(mild_data):
    trials = BUETEPAGE_HR.read(mild_data / BUETEPAGE_HR.file).train
    contact = fit_contact(trials, YUMI, BUETEPAGE_HR.touching)
    # Measured 3.9, 4.5 and 10.6 cm (in two parachute trials the robot comes late); the bounds leave a fifth.
    assert contact.distance_m["handshake"] < 0.047
    assert contact.distance_m["rocket"] < 0.054
    assert contact.distance_m["parachute"] < 0.13
    # The person stands before the robot, an arm's length away, and looks at it.
    assert 0.6 < contact.translation_m[0] < 1.3
    assert abs(contact.translation_m[1]) < 0.3
