# SPDX-License-Identifier: Apache-2.0
"""Two people in motion capture suits: the first table of the MILD paper (Bütepage et al. 2020)."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mild_core.budgets import SETTINGS_BYTES, read_file, read_numbers
from mild_core.errors import DatasetError
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import Demonstrations, Download, Recording
from mild_core.learning.data.safe_npz import REMEDY, numbers
from mild_core.learning.data.windows import protocols
from mild_core.learning.datasets.traj_data import from_the_shoulder, one_hot, read_splits
from mild_core.shapes import FloatArray

JOINTS = (
    *("Root", "Hips", "LeftThigh", "LeftShin", "LeftFoot", "LeftToe", "LeftToeTip"),
    *("RightThigh", "RightShin", "RightFoot", "RightToe", "RightToeTip", "Spine1", "Spine2", "Spine3", "Spine4"),
    *("LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "Neck", "Head"),
    *("RightShoulder", "RightArm", "RightForeArm", "RightHand"),
)
"""In the order of their columns; each is named after the bone that begins there."""

ARM = ("RightArm", "RightForeArm", "RightHand")

FILES = {"hand_wave": "hand_wave", "handshake": "hand_shake", "rocket": "rocket", "parachute": "parachute"}
"""What the publishers' files of an interaction begin with."""

TAKES = (1, 2)
LEARNED = 0.8
"""Share of an interaction's trials, the first, that are for training."""

ARM_COLUMNS = 9

STILL_M = 1e-3
"""A frame moves when its joints go farther than this on average."""

LARGEST_HEADER, LARGEST_TABLE = 100_000, 256 << 20


def read(path: Path) -> Demonstrations:
    """Read `traj_data.npz`, or the publishers' folder `hh` that it was made from.

    In the file a frame has 18 columns: shoulder, elbow and hand of the right arm, x y z [m], of the first person and
    then of the second, each from the own shoulder in the trial's first frame (x forward, y left, z up). Its labels are
    those of `buetepage_hr`.

    Args:
        path: The file or the folder (see `_read_folder`).

    Returns:
        The publisher's training trials (the first four fifths of each interaction) and test trials; a file may leave
        one of them empty.

    Raises:
        DatasetError: It is neither, a file is missing, or a trial is malformed; names it.

    Source: github.com/souljaboy764/phd_utils, data_preproc/buetepage and data_raw/buetepage_preproc.py.
    """
    return _read_folder(path) if path.is_dir() else read_splits(path, _published_trial)


def _published_trial(thing: str, index: int, track: Any, labels: Any) -> Demonstration:
    """One trial of the file, checked."""
    track = numbers(thing, "motion", track, 2 * ARM_COLUMNS)
    interaction, active = one_hot(thing, labels, len(track), BUETEPAGE_HH.interactions)
    return _trial(index, interaction, [track[:, :ARM_COLUMNS], track[:, ARM_COLUMNS:]], active)


def _read_folder(path: Path) -> Demonstrations:
    """Read the publishers' folder `hh`: `p1/hand_wave_s1_1.csv`, `p2/hand_wave_s2_1.csv` and so on, two takes each.

    The first line of a file names its columns. Positions [m] are those whose last but two letter is P, three for each
    of `JOINTS`; x points right, y up and z ahead, in a left-handed frame. A row is a frame, 40 a second.
    `segmentation/hand_wave_1.npy` holds the first frame of each trial and the one after its last. The right arms are
    taken, each from its own shoulder in the trial's first frame. Frames after the last that moves are marked as not
    active, as the publishers do.

    Source: github.com/jbutepage/human_robot_interaction_data, `read_hh_hr_data.py`; axes and splits as in
    github.com/souljaboy764/phd_utils, `data_raw/buetepage_preproc.py`.
    """
    train: list[Demonstration] = []
    test: list[Demonstration] = []
    for interaction, begin in FILES.items():
        trials = []
        for take in TAKES:
            files = [path / f"p{person}" / f"{begin}_s{person}_{take}.csv" for person in (1, 2)]
            arms = [_arm(file) for file in files]
            for number, (first, after) in enumerate(_segments(path / "segmentation" / f"{begin}_{take}.npy")):
                thing = f"trial {number} of '{files[0]}'"
                if not 0 <= first < after <= min(map(len, arms)):
                    problem = f"is from frame {first} to {after}, of {' and '.join(str(len(arm)) for arm in arms)}"
                    raise DatasetError(thing, problem, REMEDY)
                both = [numbers(thing, "motion", arm[first:after], ARM_COLUMNS) for arm in arms]
                trials.append((interaction, both, _active(both[0])))
        learned = int(LEARNED * len(trials))
        train += [_trial(len(train) + i, *trial) for i, trial in enumerate(trials[:learned])]
        test += [_trial(len(test) + i, *trial) for i, trial in enumerate(trials[learned:])]
    return Demonstrations(tuple(train), tuple(test))


def _active(arm: FloatArray) -> FloatArray:
    """(T,) 1 until the last frame in which the joints of an arm (T, 9) move, then 0."""
    moving = np.linalg.norm(np.diff(arm.reshape(len(arm), -1, 3), axis=0), axis=2).mean(axis=1) > STILL_M
    last = int(np.flatnonzero(moving)[-1]) if moving.any() else len(arm)
    return (np.arange(len(arm)) < last).astype(float)


def _trial(index: int, interaction: str, arms: list[FloatArray], active: FloatArray) -> Demonstration:
    observed, controlled = (from_the_shoulder(arm) for arm in arms)
    return Demonstration(
        trial=index,
        interaction=interaction,
        rate_hz=BUETEPAGE_HH.rate_hz,
        observed_names=BUETEPAGE_HH.observed_names,
        observed_m=observed,
        controlled_names=BUETEPAGE_HH.controlled_names,
        controlled=controlled,
        active=active,
    )


def _arm(path: Path) -> FloatArray:
    """(T, 9) the right arm of one file: shoulder, elbow, hand; x forward, y left, z up [m]."""
    thing = f"recording '{path}'"
    try:
        remedy = "give the publishers' folder 'hh', with p1, p2 and segmentation in it"
        file = io.StringIO(read_file(path, LARGEST_TABLE, remedy, DatasetError, thing).decode())
        names = file.readline(LARGEST_HEADER).strip().split(",")
        places = [place for place, name in enumerate(names) if name[-3:-2] == "P"]
        if len(places) != 3 * len(JOINTS):
            problem = f"names {len(places)} columns of positions, expected {3 * len(JOINTS)}"
            raise DatasetError(thing, problem, REMEDY)
        columns = [places[3 * JOINTS.index(joint) + axis] for joint in ARM for axis in range(3)]
        rows = np.loadtxt(file, delimiter=",", usecols=columns, ndmin=2)
    except ValueError as error:
        raise DatasetError(thing, f"cannot be read ({error})", remedy) from None
    published: FloatArray = rows.reshape(-1, 3, 3)
    turned: FloatArray = published[:, :, [2, 0, 1]] * [1.0, -1.0, 1.0]
    return turned.reshape(-1, 9)


def _segments(path: Path) -> NDArray[np.int64]:
    """(N, 2) first frame of each trial, and the one after its last."""
    thing = f"segmentation '{path}'"
    try:
        content = read_file(path, SETTINGS_BYTES, REMEDY, DatasetError)
        found = read_numbers(io.BytesIO(content), len(content))
    except (ValueError, EOFError) as error:
        raise DatasetError(thing, f"cannot be read ({error})", REMEDY) from None
    if not isinstance(found, np.ndarray) or found.dtype.kind not in "iu" or found.ndim != 2 or found.shape[1] != 2:
        raise DatasetError(thing, "holds no pairs of frame numbers", REMEDY)
    return found.astype(np.int64)


BUETEPAGE_HH = Recording(
    name="buetepage_hh",
    title="Bütepage et al.: two people",
    file="buetepage/traj_data.npz",
    rate_hz=40.0,
    interactions=tuple(FILES),
    touching=(),
    observed_names=("shoulder", "elbow", "hand"),
    observed_side="right",
    robot="",
    controlled_names=("shoulder", "elbow", "hand"),
    licence="the repository that publishes this form is GPL-3.0; the original recordings state no licence",
    spdx="GPL-3.0-only AND NOASSERTION",
    source="J. Bütepage, A. Ghadirzadeh, Ö. Öztimur Karadağ, M. Björkman, D. Kragic: Imitating by Generating, "
    "Frontiers in Robotics and AI 2020, as published in github.com/souljaboy764/phd_utils, data_preproc/buetepage "
    "(made from the folder hh of github.com/souljaboy764/human_robot_interaction_data, which --data takes as well)",
    read=read,
    protocols=protocols(window=40, keep_every=5),
    download=Download(
        "https://raw.githubusercontent.com/souljaboy764/phd_utils/"
        "b6a72a3319c3c01dff3c77b7bb930977b102caa0/"
        "data_preproc/buetepage/traj_data.npz",
        git_blob="2ca411aa0b13bbb88558114f9856c86a2e462abd",
    ),
)
