# SPDX-License-Identifier: Apache-2.0
"""A folder of trials reads as it was written, may be edited by hand, and says in one line what is wrong with it."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import DatasetError, SetupError
from mild_core.inference.manifest import ControlledAgent, HumanPlacement, ObservedAgent
from mild_core.learning.data.trials import ARRAYS, MANIFEST, TrialEntry, Trials, write_trials
from mild_core.learning.data.units import ANGLES, POSITIONS
from mild_core.learning.datasets import recording_named
from mild_core.learning.training.configuration import configuration_for, read_configuration
from test.core.learning.made_trials import ARM, JOINTS, made_trials

PLACED = HumanPlacement((1.1, -0.2, 0.3), 3.0, {"reach": (1.0, 0.1, 0.2)}, (0.3, 0.32))
YUMI = ControlledAgent("robot_joints", "yumi", JOINTS, "rad")


def described(demonstrations, controlled=YUMI, placed=PLACED):
    """The manifest of made trials; the last of each interaction is put aside."""
    entries = tuple(
        TrialEntry(d.trial, d.interaction, "test" if d.trial in (3, 7) else "train", 'täke "1"', 2.0, 2.5, 3.5, 4.25)
        for d in demonstrations
    )
    observed = ObservedAgent("human_arm", ARM, "m", (0.18, 0.23), "right")
    return Trials("mine", "made here", "Apache-2.0", 40.0, ("reach", "push"), observed, controlled, placed, entries)


@pytest.fixture(name="folder")
def _folder(tmp_path):
    demonstrations = made_trials(each=4)
    write_trials(tmp_path / "mine", described(demonstrations), demonstrations)
    return tmp_path / "mine"


def edited(folder, before, after):
    text = (folder / MANIFEST).read_text()
    assert before in text
    (folder / MANIFEST).write_text(text.replace(before, after, 1))


def test_what_was_written_is_read(folder):
    recording, written = recording_named(str(folder)), made_trials(each=4)
    read = recording.read(folder)
    assert [trial.trial for trial in read.train] == [0, 1, 2, 4, 5, 6]
    assert [trial.trial for trial in read.test] == [3, 7]
    for trial in (*read.train, *read.test):
        np.testing.assert_array_equal(trial.observed_m, written[trial.trial].observed_m)
        np.testing.assert_array_equal(trial.controlled, written[trial.trial].controlled)
        assert trial.interaction == written[trial.trial].interaction
        assert trial.active.sum() == 40  # one second at 40 Hz
    assert (recording.name, recording.robot, recording.unit, recording.placement) == ("mine", "yumi", ANGLES, PLACED)
    assert (recording.controlled_names, recording.rate_hz) == (JOINTS, 40.0)
    assert {name: (p.window, p.keep_every) for name, p in recording.protocols.items()} == {
        "same": (40, 1),
        "ahead": (40, 1),
        "next": (5, 5),
    }


def test_the_numbers_load_without_pickle(folder):
    with np.load(folder / ARRAYS, allow_pickle=False) as arrays:
        assert {array.dtype for array in arrays.values()} == {np.dtype(np.float64)}
        assert arrays["trial_0"].shape == (90, 9 + 3)


def test_a_partners_arm_is_read_in_metres(tmp_path):
    demonstrations = tuple(replace(d, controlled=d.observed_m, controlled_names=ARM) for d in made_trials(each=1))
    human = ControlledAgent("human_arm", "human", ARM, "m")
    write_trials(tmp_path / "people", described(demonstrations, human, None), demonstrations)
    recording = recording_named("no matter", tmp_path / "people")
    assert (recording.robot, recording.unit, recording.placement) == ("", POSITIONS, None)
    assert recording.read(tmp_path / "people").train[0].partner


def test_a_person_may_put_trials_aside_and_take_them_out(folder):
    edited(folder, 'split = "train"', 'split = "test"')
    text = (folder / MANIFEST).read_text()
    (folder / MANIFEST).write_text(text[: text.rindex("[[trial]]")])
    read = recording_named(str(folder)).read(folder)
    assert [trial.trial for trial in read.test] == [0, 3]
    assert [trial.trial for trial in read.train] == [1, 2, 4, 5, 6]


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ('interaction = "push"', 'interaction = "psuh"', "key 'trial.4.interaction' is 'psuh'; use one of reach, push"),
        ('split = "test"', 'split = "tset"', "use one of train, test"),
        ("number = 1\n", "number = 0\n", "holds a number twice"),
        ("number = 1\n", "number = 91\n", "has no array 'trial_91'"),
        ("rate_hz = 40.0", "rate_hz = nan", "key 'rate_hz' is no finite number"),
        ("format_version = 1", "format_version = 99", "this program reads version 1"),
        ("format_version = 1", "format_version = ", "is no TOML"),
        ('name = "mine"', 'nome = "mine"', "key 'nome' is unknown"),
        ('unit = "rad"', 'unit = "deg"', "key 'controlled.unit' is 'deg'"),
        ('joint_names = ["a", "b", "c"]', 'joint_names = ["a", "b"]', "expected (frames, 11)"),
        ("[robot_from_human.by_interaction]\nreach", "[robot_from_human.by_interaction]\nrich", "'rich' is unknown"),
    ],
)
def test_a_wrong_edit_is_named_in_one_line(folder, before, after, said):
    edited(folder, before, after)
    with pytest.raises(SetupError) as refused:
        recording_named(str(folder)).read(folder)
    assert said in str(refused.value).replace("robot_from_human.by_interaction.", "")
    assert "\n" not in str(refused.value)


def test_what_is_no_folder_of_trials_is_said(tmp_path, folder):
    for given, said in ((tmp_path, "has no trials.toml"), (tmp_path / "none", "has no trials.toml")):
        with pytest.raises(DatasetError, match=said):
            recording_named(str(given))
    with pytest.raises(SetupError, match="the path of a folder of trials"):
        recording_named("nune")
    (folder / ARRAYS).write_bytes(b"PK nothing")
    with pytest.raises(DatasetError, match="is broken or no"):
        recording_named(str(folder)).read(folder)


def test_trials_that_were_made_into_the_folder_of_recordings_are_known_by_their_name(folder, monkeypatch):
    monkeypatch.setenv("MILD_DATA", str(folder.parent))
    assert recording_named(folder.name).file == str(folder.resolve())
    with pytest.raises(SetupError, match="what mild data makes"):
        recording_named("kinematic_nao")


def test_a_configuration_may_name_a_folder_beside_it_and_is_made_for_one_without(tmp_path, folder):
    (tmp_path / "how.toml").write_text('dataset = "mine"\nprotocol = "same"\n[settings]\nmembers = 1\n')
    found = read_configuration(str(tmp_path / "how.toml"))
    assert recording_named(found.dataset).name == "mine"
    assert found.settings.members == 1
    made = configuration_for(str(folder), "ahead")
    assert made is not None
    assert (made.settings.stride, made.settings.gradient_stride, made.protocol) == (16, 16, "ahead")
    assert "stride = 16" in made.text
