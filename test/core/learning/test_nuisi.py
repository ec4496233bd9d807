# SPDX-License-Identifier: Apache-2.0
"""The readers of two people: whose arm is whose, from its own shoulder, and one line for each kind of bad trial."""

import numpy as np
import pytest

from mild_core.errors import DatasetError
from mild_core.learning.datasets import DATASETS
from mild_core.learning.datasets.nuisi_v1 import JOINTS
from mild_core.learning.datasets.pepper_nuisi import PEPPER_NUISI, published_angles
from test.core.learning.test_buetepage_hr import object_array

COLUMNS = {"nuisi": 18, "nuisi_v1": 60}


def track(name, seed, frames=20):
    return np.random.default_rng(seed).uniform(-1, 1, size=(frames, COLUMNS[name]))


def write(path, tracks, labels, test_tracks=(), test_labels=()):
    arrays = {"train_data": object_array(tracks), "test_data": object_array(test_tracks)}
    np.savez_compressed(path, **arrays, train_labels=np.array(labels, float), test_labels=np.array(test_labels, float))
    return path


def right_arms(name, recorded):
    """(T, 2, 3, 3) of both people, found another way than the reader does."""
    if name == "nuisi":
        return recorded.reshape(len(recorded), 2, 3, 3)
    columns = [
        person * 30 + 3 * JOINTS.index(joint) + axis
        for person in (0, 1)
        for joint in ("right_shoulder", "right_elbow", "right_hand")
        for axis in range(3)
    ]
    return recorded[:, columns].reshape(len(recorded), 2, 3, 3)


@pytest.mark.parametrize("name", COLUMNS)
def test_each_arm_starts_at_its_own_shoulder_and_splits_stay_apart(tmp_path, name):
    tracks = [track(name, seed, 20 + seed) for seed in range(3)]
    read = DATASETS[name].read(write(tmp_path / "a.npz", tracks[:2], [1, 3], tracks[2:], [2]))
    interactions = DATASETS[name].interactions
    assert [trial.interaction for trial in (*read.train, *read.test)] == [interactions[i] for i in (1, 3, 2)]
    for trial, recorded in zip((*read.train, *read.test), tracks, strict=True):
        arms = right_arms(name, recorded)
        np.testing.assert_array_equal(trial.observed_m, arms[:, 0] - arms[0, 0, 0])
        np.testing.assert_array_equal(trial.controlled, arms[:, 1] - arms[0, 1, 0])
        assert trial.partner
        assert trial.controlled.shape == (len(recorded), 3, 3)


BAD = {
    "nan": (lambda t: np.where(np.arange(len(t))[:, None] == 7, np.nan, t), 0, "not finite in frame 7"),
    "a column less": (lambda t: t[:, 1:], 0, "expected .frames, "),
    "empty": (lambda t: t[:0], 0, "0 frames"),
    "one frame": (lambda t: t[:1], 0, "1 frames"),
    "ragged": (lambda t: object_array([t[0], t[0][1:]]), 0, "no array of numbers"),
    "no such label": (lambda t: t, 6, "its label is 6.0"),
    "half a label": (lambda t: t, 0.5, "its label is 0.5"),
    "no label": (lambda t: t, np.nan, "its label is nan"),
}


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("name", COLUMNS)
def test_a_bad_trial_is_named_in_one_line(tmp_path, name, kind):
    spoil, label, said = BAD[kind]
    path = write(tmp_path / "a.npz", [track(name, 0), spoil(track(name, 1))], [0, label])
    with pytest.raises(DatasetError, match=said) as refused:
        DATASETS[name].read(path)
    assert "trial 1 of split 'train'" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_more_labels_than_trials_and_no_list_at_all_are_said(tmp_path):
    with pytest.raises(DatasetError, match="1 trials but 2 labels"):
        DATASETS["nuisi"].read(write(tmp_path / "a.npz", [track("nuisi", 0)], [0, 1]))
    np.savez(tmp_path / "b.npz", train_data=0.0, train_labels=0.0, test_data=np.empty(0), test_labels=np.empty(0))
    with pytest.raises(DatasetError, match="1 trials but 1 labels in split 'train'"):
        DATASETS["nuisi"].read(tmp_path / "b.npz")


@pytest.mark.parametrize(("name", "trials"), [("nuisi", (9, 8, 9, 7)), ("nuisi_v1", (15,) * 6)])
def test_the_published_recording(mild_data, name, trials):
    recording = DATASETS[name]
    read = recording.read(mild_data / recording.file)
    wanted = [
        interaction for interaction, count in zip(recording.interactions, trials, strict=True) for _ in range(count)
    ]
    assert [trial.interaction for trial in read.train] == wanted
    for arm in ("observed_m", "controlled"):
        frames = np.concatenate([getattr(trial, arm) for trial in read.train])
        lengths = np.linalg.norm(np.diff(frames, axis=1), axis=2)
        # An adult's upper arm and forearm; a tracker's bones breathe.
        np.testing.assert_allclose(np.median(lengths, axis=0), [0.28, 0.28], atol=0.03)
        # At rest the hand hangs below the shoulder: z is up.
        rest = np.median([getattr(trial, arm)[0] for trial in read.train], axis=0)
        assert rest[2, 2] < -0.3


def arm(upper, fore):
    return np.array([[np.zeros(3), upper, np.add(upper, fore)]], dtype=float)


@pytest.mark.parametrize(
    ("upper", "fore", "angles"),
    [
        # Hanging; straight ahead; bent to the left in the level plane; bent upwards; straight to the right.
        ((0, 0, -1), (0, 0, -1), (np.pi / 2, -0.0087, 0.0, 0.0087)),
        ((1, 0, 0), (1, 0, 0), (0.0, -0.0087, 0.0, 0.0087)),
        ((1, 0, 0), (1, 1, 0), (0.0, -0.0087, 0.0087, np.pi / 4)),
        ((1, 0, 0), (1, 0, 1), (0.0, -0.0087, np.pi / 3, np.pi / 4)),
        ((0, -1, -0.001), (0, -1, 0), (np.pi / 2, -1.562, 0.0, 0.0087)),
    ],
)
def test_the_published_mapping_at_poses_worked_out_by_hand(upper, fore, angles):
    # Where the shoulder's roll is clipped to half a degree, the other angles move by as much at most.
    np.testing.assert_allclose(published_angles(arm(upper, fore))[0], angles, atol=0.02)


def test_pepper_is_the_second_person_mapped(tmp_path):
    path = write(tmp_path / "a.npz", [track("nuisi", 0)], [2])
    people, pepper = DATASETS["nuisi"].read(path).train[0], PEPPER_NUISI.read(path).train[0]
    np.testing.assert_array_equal(pepper.observed_m, people.observed_m)
    np.testing.assert_array_equal(pepper.controlled, published_angles(people.controlled))
    assert (pepper.interaction, pepper.controlled.shape, pepper.partner) == ("rocket", (20, 4), False)
