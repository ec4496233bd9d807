# SPDX-License-Identifier: Apache-2.0
"""Trials repeated by other people: the robot's hand goes where theirs goes, and who is bent stays a person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import PROTOCOLS
from mild_core.learning.training.corpus import corpus_of
from mild_core.learning.training.paired import MISSED_M, bent_arm, repeated_by_others
from mild_core.learning.training.settings import Paired
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robots.yumi import YUMI
from test.core.learning.made_trials import made_trial, made_trials

SAME_SPEED = Paired(copies=3, speed=(1.0, 1.0))


def with_yumi(interaction: str) -> Demonstration:
    """A made trial in which YuMi leaves home and comes back as the person's hand does."""
    trial = made_trial(0, interaction, frames=200)
    bump = trial.controlled[:, :1]
    out = np.array([0.3, 0.2, -0.2, 0.3, 0.2, 0.1, 0.1])
    return replace(trial, controlled_names=YUMI.joint_names, controlled=YUMI.home_rad + bump * out)


def tool(trial: Demonstration) -> np.ndarray:
    return forward_kinematics(YUMI, trial.controlled, YUMI.tool_link)[:, :3, 3]


def test_the_tool_follows_the_hand_to_another_place_and_both_begin_at_rest() -> None:
    trial = with_yumi("handshake")
    again = [trials[0] for trials in repeated_by_others([trial], SAME_SPEED, 0)]
    farthest = int(np.linalg.norm(trial.observed_m[:, 2] - trial.observed_m[0, 2], axis=1).argmax())
    moved = []
    for other in again:
        hand = (other.observed_m - trial.observed_m)[farthest, 2]
        np.testing.assert_allclose((tool(other) - tool(trial))[farthest], hand * [-1.0, -1.0, 1.0], atol=MISSED_M)
        np.testing.assert_allclose(tool(other)[0], tool(trial)[0], atol=5e-3)
        moved.append(np.linalg.norm(hand))
    assert max(moved) > 0.05
    assert len({round(float(one), 6) for one in moved}) == len(moved)


def test_where_no_hands_meet_the_robot_stays_as_it_was_recorded() -> None:
    trial = with_yumi("hand_wave")
    ((other,), *_) = repeated_by_others([trial], SAME_SPEED, 0)
    np.testing.assert_allclose(other.controlled, trial.controlled)
    assert np.abs(other.observed_m - trial.observed_m).max() > 0.01


def test_bones_keep_their_lengths() -> None:
    trial = with_yumi("handshake")
    for (other,) in repeated_by_others([trial], SAME_SPEED, 0):
        lengths = np.linalg.norm(np.diff(other.observed_m, axis=1), axis=2)
        np.testing.assert_allclose(lengths, np.linalg.norm(np.diff(trial.observed_m, axis=1), axis=2), atol=1e-6)


def test_people_are_faster_and_slower_and_the_robot_with_them() -> None:
    trial = with_yumi("hand_wave")
    ((other,),) = repeated_by_others([trial], Paired(copies=1, speed=(2.0, 2.0)), 0)
    assert other.frames == trial.frames // 2
    np.testing.assert_allclose(other.controlled, trial.controlled[::2])


def test_a_robot_that_is_not_known_and_a_partner_are_left_as_they_are() -> None:
    assert repeated_by_others(made_trials(2), Paired(), 0) == ()


@pytest.mark.parametrize("hand", [(0.0, 0.0, -0.5), (0.0, 0.0, -2.0), (1e-9, 0.0, 0.0), (0.3, -0.2, 0.1)])
def test_an_arm_is_bent_whatever_is_wanted_of_it(hand) -> None:
    elbow = np.tile([0.0, 0.0, -0.3], (4, 1))
    bent = bent_arm(elbow, np.tile(hand, (4, 1)), np.tile([0.3, 0.25], (4, 1)))
    assert np.isfinite(bent).all()
    np.testing.assert_allclose(np.linalg.norm(bent[:, 0], axis=1), 0.3, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(bent[:, 1] - bent[:, 0], axis=1), 0.25, atol=1e-3)


def test_a_share_of_what_is_drawn_is_repeated() -> None:
    trials = [with_yumi("handshake"), with_yumi("hand_wave")]
    corpus = corpus_of(trials, PROTOCOLS["same"], ("handshake", "hand_wave"), replace(SAME_SPEED, share=0.5), 0)
    assert len(corpus.again) == 3
    torch.manual_seed(0)
    drawn = corpus.drawn(200)
    assert drawn.label.tolist() == [0, 1] * 200
    recorded = [
        (torch.equal(one, corpus.tracks.observed[label]))
        for one, label in zip(drawn.observed, drawn.label, strict=True)
    ]
    assert 0.4 < np.mean(recorded) < 0.6
    plain = corpus_of(trials, PROTOCOLS["same"], ("handshake", "hand_wave"))
    assert torch.equal(plain.drawn(1).observed, plain.tracks.observed)
