# SPDX-License-Identifier: Apache-2.0
"""A recording is cut where the person's hand rests, and each movement that is no trial says why."""

import numpy as np
import pytest

from mild_core.inference.priors.hsmm import HSMM
from mild_core.learning.data.segmentation import (
    CUT_OFF,
    GAP,
    OTHER_STILL,
    OTHER_UNSEEN,
    TOO_SHORT,
    TWITCH,
    RestToRest,
    cut_at_rest,
    speeds,
)
from test.bench import segmentation
from test.core.learning.made_trials import made_trials

RATE_HZ = 30.0
SETTINGS = RestToRest()
TREMBLE_M = 0.003
"""Of a good depth camera."""


def recording(movements, seconds=30.0, reach_m=0.5, tremble_m=TREMBLE_M):
    """An arm (T, 3, 3) that reaches forward and comes back in each of `movements` (from, to) [s], and its stamps.

    The hand goes out in the first third, stays where it is in the second, and comes back in the last.
    """
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    share = np.zeros(len(times))
    for begin, end in movements:
        share += np.interp((times - begin) / (end - begin), [0.0, 1 / 3, 2 / 3, 1.0], [0.0, 1.0, 1.0, 0.0])
    arm = np.zeros((len(times), 3, 3))
    arm[:, 1:, 2] = (-0.3, -0.6)
    arm[:, 2, 0] = reach_m * share
    noise = np.random.default_rng(0).normal(0.0, tremble_m, arm.shape)
    return arm + noise, times, share


def cut(movements, settings=SETTINGS, others=None, **options):
    arm, times, share = recording(movements, **options)
    return cut_at_rest(arm, np.stack([share, 0 * share], axis=1) if others is None else others, times, settings)


def test_each_movement_is_a_trial_with_the_rest_around_it():
    found = cut([(5.0, 9.0), (13.0, 18.0), (22.0, 25.0)])
    assert [segment.fault for segment in found.segments] == ["", "", ""]
    for segment, (begin, end) in zip(found.segments, [(5.0, 9.0), (13.0, 18.0), (22.0, 25.0)], strict=True):
        # Smoothing and the limits of speed and distance find a movement a few frames early or late.
        assert segment.onset / RATE_HZ == pytest.approx(begin, abs=0.25)
        assert segment.back / RATE_HZ == pytest.approx(end, abs=0.25)
        assert (segment.onset - segment.begin, segment.end - segment.back) == (30, 30)


def test_a_hand_that_is_held_out_does_not_rest():
    held = cut([(5.0, 20.0)])
    assert len(held.segments) == 1
    middle = slice(round(11.0 * RATE_HZ), round(14.0 * RATE_HZ))
    assert np.median(held.speed_m_s[middle]) < SETTINGS.slow_m_s
    assert (held.away_m[middle] > SETTINGS.near_m).all()


def test_neighbours_share_a_short_rest_and_a_shorter_one_divides_nothing():
    first, second = cut([(5.0, 9.0), (10.0, 14.0)]).segments
    assert first.back < first.end == second.begin < second.onset
    assert len(cut([(5.0, 9.0), (9.3, 13.0)]).segments) == 1


def test_what_is_no_trial_says_why():
    def faults(movements, **options):
        return [segment.fault for segment in cut(movements, **options).segments]

    assert faults([(5.0, 5.8)]) == [TOO_SHORT]
    assert faults([(5.0, 6.2)], reach_m=0.12) == [TWITCH]
    assert faults([(-1.0, 3.0), (10.0, 14.0), (28.0, 32.0)]) == [CUT_OFF, "", CUT_OFF]
    assert faults([]) == []


def test_the_other_agent_has_to_be_recorded_and_to_move():
    _, times, share = recording([(5.0, 9.0), (15.0, 19.0)])
    robot = np.stack([share, share], axis=1)
    robot[times > 12.0] = 0.0
    assert [segment.fault for segment in cut([(5.0, 9.0), (15.0, 19.0)], others=robot).segments] == ["", OTHER_STILL]
    robot[(times > 6.0) & (times < 6.3)] = np.nan
    first, _ = cut([(5.0, 9.0), (15.0, 19.0)], others=robot).segments
    assert first.fault == OTHER_UNSEEN


def test_rest_in_which_the_other_agent_was_not_recorded_is_left_out():
    _, times, share = recording([(5.0, 9.0)])
    robot = np.stack([share, share], axis=1)
    robot[(times < 4.5) | (times > 9.6)] = np.nan
    (segment,) = cut([(5.0, 9.0)], others=robot).segments
    assert segment.fault == ""
    assert np.isfinite(robot[segment.begin : segment.end]).all()
    assert times[segment.begin] == pytest.approx(4.5)


def test_a_trial_waits_for_a_robot_that_comes_home_later():
    _, _, share = recording([(5.0, 9.0)])
    robot = np.stack([np.roll(share, round(RATE_HZ)), 0 * share], axis=1)
    (late,) = cut([(5.0, 9.0)], others=robot).segments
    (prompt,) = cut([(5.0, 9.0)]).segments
    assert late.onset == prompt.onset
    assert (late.back - prompt.back) / RATE_HZ == pytest.approx(1.0, abs=0.3)


def test_a_partner_is_looked_at_like_a_person():
    arm, times, _ = recording([(5.0, 9.0)])
    still, _, _ = recording([])
    assert [s.fault for s in cut_at_rest(arm, arm, times, SETTINGS).segments] == [""]
    assert [s.fault for s in cut_at_rest(arm, still, times, SETTINGS).segments] == [OTHER_STILL]


def test_nothing_is_cut_across_a_gap():
    arm, times, share = recording([(5.0, 9.0), (15.0, 19.0)])
    kept = (times < 6.0) | (times > 7.0)
    robot = np.stack([share, 0 * share], axis=1)
    found = cut_at_rest(arm[kept], robot[kept], times[kept], SETTINGS)
    assert [segment.fault for segment in found.segments] == [GAP, GAP, ""]


def test_a_hand_that_never_rests_is_said():
    arm, times, share = recording([], tremble_m=0.0)
    arm[:, 2, 0] = np.sin(3.0 * times)
    arm[:, 2, 1] = np.cos(3.0 * times)
    assert not cut_at_rest(arm, share[:, None], times, SETTINGS).found_rest


def test_speeds_are_those_of_the_motion_and_little_of_a_trackers_trembling():
    times = np.arange(300) / RATE_HZ
    places = np.stack([0.4 * times, 0 * times, 0.3 * times], axis=1)[:, None]
    # Away from the ends, where averages are one-sided.
    np.testing.assert_allclose(speeds(places, times)[10:-10], 0.5, rtol=1e-9)
    trembling = np.random.default_rng(0).normal(0.0, TREMBLE_M, (300, 1, 3))
    assert np.quantile(speeds(trembling, times), 0.99) < SETTINGS.slow_m_s / 2


def made_hsmm(seed):
    rng = np.random.default_rng(seed)
    track = rng.normal(size=(20, 2)) + np.repeat(rng.normal(size=(2, 2)), 10, axis=0)
    return HSMM.from_demonstrations([track], 2, 1)


def test_hsmms_side_by_side_weigh_interactions_by_their_likelihoods_alone():
    parts, latents = [made_hsmm(seed) for seed in (1, 2, 3)], np.random.default_rng(0).normal(size=(9, 2))
    separate = np.array([segmentation.likelihood(part, latents) for part in parts])
    assert segmentation.likelihood(segmentation.stacked(parts, 0.0), latents) == pytest.approx(
        np.logaddexp.reduce(separate) - np.log(3)
    )
    named = segmentation.Named(segmentation.stacked(parts, 0.0), np.repeat(np.arange(3), 2))
    weights = segmentation.responsibilities(named.prior, latents)
    wanted = np.exp(separate - np.logaddexp.reduce(separate))
    np.testing.assert_allclose(segmentation.by_interaction(named, weights, 3)[4], wanted, atol=1e-9)
    crossing = segmentation.stacked(parts, 0.01).chain.transitions
    assert (crossing[1] @ np.repeat(np.eye(3), 2, axis=0) > 0.2).all()  # the last leads to each of them


def test_trials_joined_know_where_they_rest():
    trials = made_trials(each=1)
    joined = segmentation.join(trials, ("push", "reach"))
    (after, before), labels = joined.rests[0], joined.interaction
    assert (labels[after:before] == -1).all()
    assert (labels[after - 1], labels[before]) == (1, 0)
    assert len(labels) == joined.recording.frames == sum(t.frames for t in trials) + 19
    steps = np.abs(np.diff(joined.recording.observed_m, axis=0)).max(axis=(1, 2))
    assert steps.max() < 0.05  # half a second from pose to pose


def test_boundaries_are_right_within_the_rest_or_near_it():
    figures = segmentation.Figures()
    segmentation.judge_boundaries(
        figures, "made", np.array([1.5, 9.0, 20.0]), np.array([[1.0, 2.0], [9.5, 10.0], [40.0, 41.0]])
    )
    assert figures.values["made"] == {
        "outside_s": [0.0, 0.5, 20.0],
        "found": [1.0, 1.0, 0.0],
        "wanted": [1.0, 1.0, 0.0],
    }
