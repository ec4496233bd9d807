# SPDX-License-Identifier: Apache-2.0
"""The reader of two people in motion capture suits, on files of the published layout."""

import shutil

import numpy as np
import pytest

from mild_core.errors import DatasetError
from mild_core.learning.datasets import recording_named
from mild_core.learning.datasets.buetepage_hh import BUETEPAGE_HH, FILES, JOINTS

NAMES = ["TIME"]
for joint in JOINTS:
    NAMES += [f"{joint}.P.{axis}" for axis in "xyz"] + [f"{joint}.Q.{axis}" for axis in "wxyz"]
FRAMES, SEGMENTS = 60, [[3, 20], [25, 40], [41, 60]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Six trials of each interaction; the columns of all joints differ, rotations lie between the positions."""
    path, rng = tmp_path_factory.mktemp("hh"), np.random.default_rng(0)
    for part in ("p1", "p2", "segmentation"):
        (path / part).mkdir()
    for begin in FILES.values():
        for take in (1, 2):
            np.save(path / "segmentation" / f"{begin}_{take}.npy", np.array(SEGMENTS))
            for person in (1, 2):
                rows = np.column_stack([np.arange(FRAMES) / 40, rng.normal(size=(FRAMES, 7 * len(JOINTS)))])
                rows[50:] = rows[50]  # no one moves in the end
                file = path / f"p{person}" / f"{begin}_s{person}_{take}.csv"
                np.savetxt(file, rows, delimiter=",", header=",".join(NAMES), comments="", fmt="%.9g")
    return path


def columns(path, joint):
    """(T, 3) of a joint, found by the names of its columns; x forward, y left, z up."""
    names = path.read_text().split("\n")[0].split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    x, y, z = (rows[:, names.index(f"{joint}.P.{axis}")] for axis in "xyz")
    return np.column_stack([z, -x, y])


def test_arms_are_cut_from_their_columns_and_four_fifths_are_learned(folder):
    read = recording_named("buetepage_hh", folder).read(folder)
    assert [trial.interaction for trial in read.train] == [name for name in FILES for _ in range(4)]
    assert [trial.interaction for trial in read.test] == [name for name in FILES for _ in range(2)]
    assert [trial.trial for trial in read.train] == list(range(16))
    second, fourth = read.train[5], read.train[7]  # of the handshakes
    for trial, take, (first, after) in ((second, 1, SEGMENTS[1]), (fourth, 2, SEGMENTS[0])):
        assert (trial.rate_hz, trial.frames, trial.partner) == (40.0, after - first, True)
        for person, arm in ((1, trial.observed_m), (2, trial.controlled)):
            file = folder / f"p{person}" / f"hand_shake_s{person}_{take}.csv"
            recorded = [columns(file, joint)[first:after] for joint in ("RightArm", "RightForeArm", "RightHand")]
            np.testing.assert_allclose(arm, np.stack(recorded, axis=1) - recorded[0][0], atol=1e-12)
    assert second.active.tolist() == [1.0] * 13 + [0.0] * 2
    resting = next(trial for trial in read.train if trial.frames == 19)
    assert resting.active.sum() == 8  # of frames 41 to 59 the last that moves is 49


CSV, SEGMENTATION = "p2/rocket_s2_1.csv", "segmentation/rocket_1.npy"


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        (CSV, lambda whole: b"", "names 0 columns of positions, expected 78"),
        (CSV, lambda whole: whole.replace(b".P.", b".R."), "names 0 columns of positions"),
        (CSV, lambda whole: b"\xff\xfe" + whole, "cannot be read"),
        (CSV, lambda whole: whole + b"1,2,x\n", "cannot be read"),
        (CSV, lambda whole: b"\n".join(whole.split(b"\n")[:31]), "trial 1 .* is from frame 25 to 40, of 60 and 30"),
        (CSV, lambda whole: whole.replace(b"\n0.1,", b"\n0.1," + b"nan," * 180 + b"0,"), "not finite in frame 1"),
        (SEGMENTATION, lambda whole: b"\x80\x04cos\nsystem\n(S'true'\ntR.", "cannot be read"),
        (SEGMENTATION, lambda whole: whole[:-1], "cannot be read"),
    ],
)
def test_files_of_another_kind_are_refused_in_one_line(folder, tmp_path, name, change, said):
    path = shutil.copytree(folder, tmp_path / "hh")
    whole = (path / name).read_bytes()
    assert change(whole) != whole
    (path / name).write_bytes(change(whole))
    with pytest.raises(DatasetError, match=said) as caught:
        BUETEPAGE_HH.read(path)
    assert "\n" not in str(caught.value)


def test_a_folder_without_the_files_says_which_one_is_meant(tmp_path):
    with pytest.raises(DatasetError, match="give the publishers' folder 'hh'"):
        BUETEPAGE_HH.read(tmp_path)


def test_the_published_file_gives_the_trials_that_its_folder_gives(folder, tmp_path):
    made = BUETEPAGE_HH.read(folder)
    arrays = {}
    for split in ("train", "test"):
        trials = made.split(split)
        tracks, labels = np.empty(len(trials), object), np.empty(len(trials), object)
        for i, trial in enumerate(trials):
            tracks[i] = np.column_stack([arm.reshape(trial.frames, -1) for arm in (trial.observed_m, trial.controlled)])
            labels[i] = np.eye(5)[np.where(trial.active > 0, list(FILES).index(trial.interaction), 4)]
        arrays |= {f"{split}_data": tracks, f"{split}_labels": labels}
    np.savez(tmp_path / "traj_data.npz", **arrays)
    read = BUETEPAGE_HH.read(tmp_path / "traj_data.npz")
    for split in ("train", "test"):
        for one, other in zip(read.split(split), made.split(split), strict=True):
            assert (one.trial, one.interaction, one.partner) == (other.trial, other.interaction, True)
            for name in ("observed_m", "controlled", "active"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize(
    ("columns", "label", "said"),
    [(17, 0, "trial 0 of split 'train' .*shape"), (18, 4, "trial 0 of split 'train' .*do not name one interaction")],
)
def test_a_published_file_of_another_layout_is_refused_in_one_line(tmp_path, columns, label, said):
    tracks, labels = np.empty(1, object), np.empty(1, object)
    tracks[0], labels[0] = np.zeros((30, columns)), np.eye(5)[[label] * 30]
    none = np.empty(0, object)
    file = tmp_path / "traj_data.npz"
    np.savez(file, train_data=tracks, train_labels=labels, test_data=none, test_labels=none)
    with pytest.raises(DatasetError, match=said):
        BUETEPAGE_HH.read(file)
