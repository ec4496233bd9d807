# SPDX-License-Identifier: Apache-2.0
"""The reader of the YuMi recording: what it makes of good trials, and one line for each kind of bad one."""

import numpy as np
import pytest

from mild_core.errors import DatasetError
from mild_core.learning.datasets import DATASETS
from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR


def object_array(values):
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array


def one_hot(interaction, frames, resting=3):
    labels = np.zeros((frames, 5))
    labels[: frames - resting, interaction] = 1
    labels[frames - resting :, 4] = 1
    return labels


def track(seed, frames):
    return np.random.default_rng(seed).uniform(-1, 1, size=(frames, 16))


def write(path, tracks, labels, test_tracks=(), test_labels=()):
    np.savez_compressed(
        path,
        train_data=object_array(tracks),
        train_labels=object_array(labels),
        test_data=object_array(test_tracks),
        test_labels=object_array(test_labels),
    )
    return path


def test_the_table_names_its_members():
    assert {recording.name: recording for recording in DATASETS.values()} == DATASETS


def test_columns_labels_and_splits_arrive_where_they_belong(tmp_path):
    tracks = [track(i, 20 + i) for i in range(3)]
    labels = [one_hot(1, 20), one_hot(3, 21), one_hot(2, 22)]
    read = BUETEPAGE_HR.read(write(tmp_path / "a.npz", tracks[:2], labels[:2], tracks[2:], labels[2:]))
    assert [trial.interaction for trial in read.train] == ["handshake", "parachute"]
    assert [trial.interaction for trial in read.test] == ["rocket"]
    assert [trial.trial for trial in read.train] == [0, 1]
    assert read.split("test") == read.test
    for trial, recorded in zip((*read.train, *read.test), tracks, strict=True):
        np.testing.assert_array_equal(trial.observed_m.reshape(len(recorded), 9), recorded[:, :9])
        np.testing.assert_array_equal(trial.controlled, recorded[:, 9:])
        assert trial.active.sum() == len(recorded) - 3
        assert not trial.observed_m.flags.writeable


def test_a_fifth_joint_recorded_a_turn_low_is_unwrapped_and_nothing_else_changes(tmp_path):
    low, plain = track(0, 30), track(1, 30)
    low[:, 13] = np.linspace(-5.06, -4.8, 30)
    read = BUETEPAGE_HR.read(write(tmp_path / "a.npz", [low, plain], [one_hot(0, 30), one_hot(0, 30)]))
    np.testing.assert_array_equal(read.train[0].controlled[:, 4], low[:, 13] + 2 * np.pi)
    np.testing.assert_array_equal(np.delete(read.train[0].controlled, 4, 1), np.delete(low[:, 9:], 4, 1))
    np.testing.assert_array_equal(read.train[1].controlled, plain[:, 9:])


def test_an_empty_test_split_is_an_empty_tuple(tmp_path):
    assert BUETEPAGE_HR.read(write(tmp_path / "a.npz", [track(0, 9)], [one_hot(0, 9)])).test == ()


def with_value(array, where, value):
    array = array.copy()
    array[where] = value
    return array


BAD_TRIALS = {
    "nan": (with_value(track(0, 20), (7, 3), np.nan), one_hot(0, 20), "motion is not finite in frame 7"),
    "infinite": (with_value(track(0, 20), (7, 12), np.inf), one_hot(0, 20), "motion is not finite in frame 7"),
    "too few columns": (track(0, 20)[:, :15], one_hot(0, 20), r"shape \(20, 15\)"),
    "too many columns": (np.zeros((20, 17)), one_hot(0, 20), r"shape \(20, 17\)"),
    "flat": (np.zeros(320), one_hot(0, 20), r"shape \(320,\)"),
    "empty": (np.zeros((0, 16)), np.zeros((0, 5)), "0 frames"),
    "one frame": (np.zeros((1, 16)), one_hot(0, 1, 0), "1 frames"),
    "words": (np.full((20, 16), "x"), one_hot(0, 20), "no array of numbers"),
    "no array": (1.0, one_hot(0, 20), "no array of numbers"),
    "ragged": (object_array([np.zeros(16), np.zeros(15)]), one_hot(0, 2, 0), "no array of numbers"),
    "labels short": (track(0, 20), one_hot(0, 19), "20 frames but 19 labels"),
    "labels of four": (track(0, 20), one_hot(0, 20)[:, :4], r"labels has shape \(20, 4\)"),
    "two interactions": (track(0, 20), with_value(one_hot(0, 20), 3, [0, 1, 0, 0, 0]), "name one interaction"),
    "never active": (track(0, 20), one_hot(0, 20, resting=20), "name one interaction"),
    "not one-hot": (track(0, 20), one_hot(0, 20) * 0.5, "name one interaction"),
    "labels nan": (track(0, 20), with_value(one_hot(0, 20), 2, np.nan), "labels is not finite"),
}


@pytest.mark.parametrize("kind", BAD_TRIALS)
def test_a_bad_trial_is_named_in_one_line(tmp_path, kind):
    bad_track, bad_labels, said = BAD_TRIALS[kind]
    path = write(tmp_path / "a.npz", [track(1, 12), bad_track], [one_hot(0, 12), bad_labels])
    with pytest.raises(DatasetError, match=said) as refused:
        BUETEPAGE_HR.read(path)
    assert "trial 1 of split 'train'" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_more_trials_than_labels_is_said(tmp_path):
    with pytest.raises(DatasetError, match="2 trials but 1 labels"):
        BUETEPAGE_HR.read(write(tmp_path / "a.npz", [track(0, 9), track(1, 9)], [one_hot(0, 9)]))


def test_the_published_recording(mild_data):
    read = BUETEPAGE_HR.read(mild_data / BUETEPAGE_HR.file)
    interactions = [trial.interaction for trial in read.train]
    assert interactions == [name for name in BUETEPAGE_HR.interactions for _ in range(8)]
    assert {trial.frames for trial in read.train} <= set(range(417, 641))
    for trial in read.train:
        # The recorded arm is one rigid model for everybody: 0.1797 m and 0.2342 m; one frame is 0.25 mm off.
        lengths = np.linalg.norm(np.diff(trial.observed_m, axis=1), axis=2)
        np.testing.assert_allclose(lengths, np.broadcast_to([0.1797, 0.2342], lengths.shape), atol=3e-4)
        # No joint jumps by a turn inside a trial, and all trials live on one branch after unwrapping.
        assert np.abs(np.diff(trial.controlled, axis=0)).max() < np.pi / 4
        assert np.degrees(trial.controlled[:, 4]).min() > -30
