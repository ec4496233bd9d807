# SPDX-License-Identifier: Apache-2.0
"""The three protocols cut exactly the frames that they say."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.learning.data.windows import PROTOCOLS, cut, feature_windows, features_of, protocol_named, thin
from test.core.learning.made_trials import made_trial


def counting_trial(frames):
    """Values encode their frame: the hand's x is the frame's number and so is each joint."""
    trial = made_trial(0, frames=frames)
    observed = np.zeros((frames, 3, 3))
    observed[:, 2, 0] = np.arange(frames)
    return replace(trial, observed_m=observed, controlled=np.tile(np.arange(frames, dtype=float)[:, None], 3))


@pytest.mark.parametrize(
    ("name", "frames", "windows", "first_seen", "first_target", "step"),
    [
        ("same", 100, 100 - 40 + 1, 0, 0, 1),
        ("ahead", 100, 100 - 80 + 1, 0, 40, 1),
        ("next", 103, 20 - 10 + 1, 0, 25, 5),
    ],
)
def test_each_window_holds_the_frames_of_its_protocol(name, frames, windows, first_seen, first_target, step):
    protocol = PROTOCOLS[name]
    made = cut(counting_trial(frames), protocol)
    assert len(made.observed) == len(made.controlled) == windows == protocol.windows_of(frames // step)
    for index in (0, 1, windows - 1):
        seen = np.arange(protocol.window) * step + first_seen + index * step
        targets = np.arange(protocol.window) * step + first_target + index * step
        np.testing.assert_array_equal(made.observed[index, :, 6], seen)
        np.testing.assert_array_equal(made.controlled[index, :, 0], targets)
        # The contract of a model folder: row 0 of the answer lies `lead_frames` after the newest frame seen.
        assert targets[0] == seen[-1] + protocol.lead_frames * step


@pytest.mark.parametrize("name", PROTOCOLS)
def test_a_trial_one_frame_too_short_has_no_window_and_one_more_has_one(name):
    protocol = PROTOCOLS[name]
    shortest = protocol.keep_every * (protocol.window + max(0, protocol.lead_frames + protocol.window - 1))
    assert len(cut(counting_trial(shortest - 1), protocol).observed) == 0
    assert cut(counting_trial(shortest - 1), protocol).controlled.shape[1:] == (protocol.window, 3)
    assert len(cut(counting_trial(shortest), protocol).observed) == 1


def test_velocities_are_differences_per_second_after_the_positions():
    trial = counting_trial(20)
    features = features_of(thin(trial, PROTOCOLS["next"]), "positions_velocities")
    assert features.shape == (4, 18)
    np.testing.assert_array_equal(features[:, 6], [0, 5, 10, 15])
    # 5 m from one kept frame to the next, at 8 Hz.
    np.testing.assert_allclose(features[:, 9 + 6], [0, 40, 40, 40], rtol=1e-12)
    np.testing.assert_array_equal(features_of(trial, "positions"), trial.observed_m.reshape(20, 9))


def test_thinning_keeps_every_fifth_frame_and_reports_the_rate():
    trial = thin(counting_trial(103), PROTOCOLS["next"])
    assert trial.rate_hz == 8.0
    np.testing.assert_array_equal(trial.controlled[:, 0], np.arange(20) * 5)
    assert thin(trial, PROTOCOLS["same"]) is trial


def test_feature_windows_are_the_cut_windows_stamped_by_their_newest_frame():
    trial = made_trial(0)
    windows = list(feature_windows(trial, PROTOCOLS["ahead"]))
    made = cut(trial, PROTOCOLS["ahead"])
    assert len(windows) == len(made.observed)
    assert windows[0].stamp_ns == 975_000_000
    assert windows[1].stamp_ns - windows[0].stamp_ns == 25_000_000
    np.testing.assert_array_equal(windows[3].features, made.observed[3])


def test_a_misspelt_protocol_lists_the_right_ones():
    with pytest.raises(SetupError, match="did you mean 'ahead'"):
        protocol_named("ahed")
