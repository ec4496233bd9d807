# SPDX-License-Identifier: Apache-2.0
"""The model card says what a user must know, and takes its figures from the table that was measured."""

from dataclasses import replace

import pytest

from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.learning.training.card import cross_validation_entry, model_card
from test.core.inference.random_model import manifest, paper_member

INTERACTION = {"mse": 0.04, "mse_std": 0.05, "windows": 100, "trials": 8}


def made_table():
    ours = {
        "method": "mild",
        "title": "MILD",
        "macro_std": 0.0009,
        "rmse_deg": 11.5,
        "windows": 400,
        "relative": {"kernel_ridge": {"change": -0.123, "interval": [-0.2, -0.05]}},
        "interactions": dict.fromkeys(BUETEPAGE_HR.interactions, INTERACTION),
    }
    bar = {**ours, "method": "kernel_ridge", "title": "kernel ridge", "labels": "given", "macro_mean": 0.051}
    rows = [
        {**ours, "labels": "given", "macro_mean": 0.0402},
        {**ours, "labels": "recognised", "macro_mean": 0.0444},
        {**bar, "macro_std": None},
    ]
    about = {
        "protocol": "ahead",
        "dataset": "buetepage_hr",
        "folds": 4,
        "seeds": 3,
        "date": "2025-01-02",
        "unit": "rad^2",
    }
    return {**about, "methods": rows}


def test_a_card_names_data_licence_errors_limits_and_how_to_train_again():
    errors = cross_validation_entry(made_table(), "mild")
    training = {"trials": 32, "split": "train", "seeds": [0, 1], "git_revision": "abc1234"}
    described = replace(manifest((paper_member(),)), errors=errors, training=training)
    text = model_card(described, BUETEPAGE_HR, "mild train --preset ahead --out x")
    for wanted in (
        "# Model card: random",
        "GPL-3.0",
        "state no licence",
        "Trials: 32, the publishers' train split only",
        "the fifth joint of hand waving is unwrapped",
        "Seeds: 0, 1",
        "abc1234",
        "| MILD | given | 0.0402 ± 0.0009 |",
        "| MILD | recognised | 0.0444 ± 0.0009 |",
        "| kernel ridge | given | 0.0510 |",
        "| hand_wave | 0.0400 ± 0.0500 | 100 |",
        "Against kernel_ridge: -12%",
        "2025-01-02",
        "hand_wave, ",
        "mild train --preset ahead --out x",
    ):
        assert wanted in text
    # The best method stands first.
    assert text.index("| MILD | given |") < text.index("| kernel ridge |")


def test_a_model_without_measured_errors_says_so():
    text = model_card(manifest((paper_member(),)), BUETEPAGE_HR, "mild train")
    assert "Not measured." in text


def test_a_table_without_the_method_is_no_source_of_its_errors():
    with pytest.raises(ValueError, match="no method 'other'"):
        cross_validation_entry(made_table(), "other")
