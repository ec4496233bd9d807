# SPDX-License-Identifier: Apache-2.0
"""Configurations: what a file says arrives, all else is the preset's, and what it cannot say is named."""

import pytest

from mild_core.errors import SetupError
from mild_core.learning.datasets import DATASETS
from mild_core.learning.training.configuration import (
    configuration_for,
    configuration_names,
    overridden,
    read_configuration,
)
from mild_core.learning.training.presets import PRESETS
from mild_core.learning.training.settings import Augmentation, TrainingSettings

HEAD = 'dataset = "nuisi"\nprotocol = "next"\n'


def read(folder, text):
    (folder / "mine.toml").write_text(text)
    return read_configuration(str(folder / "mine.toml"))


def test_what_is_not_named_is_the_presets(tmp_path):
    found = read(tmp_path, HEAD)
    assert (found.name, found.dataset, found.protocol, found.seed, found.start_from) == ("mine", "nuisi", "next", 0, "")
    assert found.settings == PRESETS["next"]
    assert found.text == HEAD


def test_what_is_named_arrives_at_every_depth(tmp_path):
    text = HEAD + 'preset = "paper"\nseed = 3\nstart_from = "nuisi_partner_same"\n'
    text += "[settings]\nmembers = 2\ndropout = 0\naugmentation = true\n"
    text += '[settings.prior]\nkind = "gmm"\n[settings.architecture]\nencoder_hidden = [7, 8]\n'
    found = read(tmp_path, text)
    assert (found.seed, found.start_from) == (3, "nuisi_partner_same")
    settings, paper = found.settings, PRESETS["paper"]
    assert (settings.members, settings.dropout, settings.augmentation) == (2, 0.0, Augmentation())
    assert isinstance(settings.dropout, float)
    assert (settings.prior.kind, settings.prior.components) == ("gmm", paper.prior.components)
    assert settings.architecture.encoder_hidden == (7, 8)
    assert settings.architecture.decoder_hidden == paper.architecture.decoder_hidden


def test_an_optional_part_is_left_out_by_false_and_changed_by_a_table():
    assert overridden(TrainingSettings(), {"augmentation": False}, "x").augmentation is None
    changed = overridden(TrainingSettings(augmentation=None), {"augmentation": {"copies": 5}}, "x")
    assert changed.augmentation == Augmentation(copies=5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD + "sead = 3", "key: 'sead' is unknown; did you mean 'seed'"),
        (HEAD + "[settings]\nmember = 3", "settings, key: 'member' is unknown; did you mean 'members'"),
        (HEAD + "[settings.prior]\nparts = 3", "settings.prior, key: 'parts' is unknown"),
        (HEAD + '[settings]\nmembers = "3"', "settings.members: is '3'; give a whole number"),
        (HEAD + "[settings]\nmembers = 2.5", "is 2.5; give a whole number"),
        (HEAD + "[settings]\nmembers = true", "is True; give a whole number"),
        (HEAD + "[settings]\ndropout = true", "is True; give a number"),
        (HEAD + "[settings]\nstart_pose = 1", "is 1; give true or false"),
        (HEAD + "[settings]\nprior = 3", "settings.prior: is 3; give a table"),
        (HEAD + "[settings.architecture]\nencoder_hidden = 3", "is 3; give a list"),
        (HEAD + '[settings.architecture]\nencoder_hidden = ["a"]', "is 'a'; give a whole number"),
        (HEAD + "[settings]\ngradient_stride = 2\nstride = 3", "equal strides"),
        (HEAD + "[settings]\nreservoir = false", "start_pose is learned from what a reservoir errs in"),
        (HEAD + 'preset = "papr"', "did you mean 'paper'"),
        (HEAD + "seed = 1.5", "key 'seed': is 1.5"),
        ('dataset = "nuisi"', "key 'protocol' is missing"),
        ('dataset = "x"\nprotocol = "same"', "'x' is unknown"),
        ('dataset = "nuisi"\nprotocol = "sane"', "did you mean 'same'"),
        ("dataset = ", "is no TOML"),
    ],
)
def test_what_cannot_be_is_named_in_one_line(tmp_path, text, said):
    with pytest.raises(SetupError) as refused:
        read(tmp_path, text)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", configuration_names())
def test_every_shipped_configuration_is_what_its_recording_is_trained_with(name):
    found = read_configuration(name)
    assert found.protocol in DATASETS[found.dataset].protocols
    if found.preset == "paper":
        assert found.settings == PRESETS["paper"]
    else:
        assert configuration_for(found.dataset, found.protocol) == found
    assert configuration_for("nuisi_v1", "ahead") is None
