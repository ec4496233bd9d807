# SPDX-License-Identifier: Apache-2.0
"""`mild evaluate` and `mild models`: figures for people and machines, and one line for what cannot be measured."""

import json

import numpy as np
import pytest

from test.command_line.test_main import run
from test.core.learning.test_buetepage_hr import one_hot, track, write


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    tracks = [0.2 * track(index, 90 + index) for index in range(6)]
    labels = [one_hot(index // 2, 90 + index) for index in range(6)]
    return write(tmp_path_factory.mktemp("data") / "a.npz", tracks, labels)


NOTHING = {"mse": None, "mse_std": None, "mean_absolute_deg": None}


def evaluate(model, data, *options):
    return run("evaluate", "--model", str(model), "--data", str(data), *options)


@pytest.mark.parametrize("labels", ["given", "recognised"])
def test_json_holds_the_figures_and_nothing_else(model, data, labels, capsys):
    assert evaluate(model, data, "--labels", labels, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["protocol"] == "ahead"
    assert told["labels"] == labels
    # 90 and 91 frames, 80 of which one window and its answer take.
    assert told["interactions"]["hand_wave"]["windows"] == 11 + 12
    assert told["interactions"]["parachute"] == {**NOTHING, "windows": 0, "trials": 0}
    errors = [told["interactions"][name]["mse"] for name in ("hand_wave", "handshake", "rocket")]
    assert told["macro"]["mse"] == pytest.approx(np.mean(errors))
    assert told["windows"] == sum(row["windows"] for row in told["interactions"].values()) == 81
    assert told["rmse_deg"] > 0
    assert (told["recognised_share"] is None) == (labels == "given")


def test_the_table_says_that_training_trials_are_no_test(model, data, capsys):
    assert evaluate(model, data, "--protocol", "ahead") == 0
    shown = capsys.readouterr().out
    assert "handshake" in shown
    assert "macro" in shown
    assert "has learned from them" in shown


def test_an_empty_test_split_is_said_and_is_no_fault(model, data, capsys):
    assert evaluate(model, data, "--split", "test") == 0
    assert "the test split of" in capsys.readouterr().out
    assert evaluate(model, data, "--split", "test", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["macro"]["mse"] is None
    assert told["windows"] == 0
    assert "is empty" in told["note"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--protocol", "same"), "was trained for protocol 'ahead'"),
        (("--protocol", "sane"), "did you mean 'same'"),
        (("--split", "tset"), "did you mean 'test'"),
        (("--labels", "maybe"), "use one of given, recognised"),
        (("--dataset", "nuisi_v9"), "'nuisi_v9' is unknown"),
        (("--cv",), "--cv learns its own models"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_one_line(model, data, options, said, capsys):
    assert evaluate(model, data, *options) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def test_an_absent_recording_and_an_absent_model_are_named(model, data, tmp_path, capsys):
    assert evaluate(model, tmp_path / "none.npz") == 2
    assert "there is no such file" in capsys.readouterr().err
    assert evaluate(tmp_path / "none", data) == 2
    assert "no such folder" in capsys.readouterr().err


def test_the_default_recording_is_below_mild_data(model, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MILD_DATA", str(tmp_path))
    assert run("evaluate", "--model", str(model)) == 2
    assert f"{tmp_path}/buetepage_hr/traj_data.npz" in capsys.readouterr().err


def test_cross_validation_writes_its_tables(tmp_path, capsys):
    tracks = [track(index, 90) for index in range(16)]
    data = write(tmp_path / "a.npz", tracks, [one_hot(index // 4, 90) for index in range(16)])
    options = ("--method", "action_mean", "--method", "time_indexed_mean", "--workers", "1", "--protocol", "next")
    assert run("evaluate", "--cv", "--data", str(data), *options, "--out", str(tmp_path / "out"), "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads((tmp_path / "out" / "cross_validation_buetepage_hr_next.json").read_text())
    assert {row["method"] for row in told["methods"]} == {"action_mean", "time_indexed_mean"}
    assert {row["windows"] for row in told["methods"]} == {16 * (18 - 9)}
    assert (tmp_path / "out" / "cross_validation_buetepage_hr_next.png").read_bytes().startswith(b"\x89PNG")
    assert "| mean pose | given |" in (tmp_path / "out" / "cross_validation_buetepage_hr_next.md").read_text()


def test_too_few_trials_for_folds_are_said_before_anything_starts(tmp_path, capsys):
    data = write(
        tmp_path / "a.npz",
        [track(index, 90) for index in range(5)],
        [one_hot(int(index > 2), 90) for index in range(5)],
    )
    assert run("evaluate", "--cv", "--data", str(data), "--out", str(tmp_path / "out")) == 2
    assert "interaction 'handshake' has 2 training trials" in capsys.readouterr().err
    write(tmp_path / "a.npz", [], [])
    assert run("evaluate", "--cv", "--data", str(data)) == 2
    assert "training split is empty" in capsys.readouterr().err


def test_models_are_listed_with_their_figures_and_their_cards_shown(model, capsys):
    assert run("models", str(model)) == 0
    assert "Model card: made" in capsys.readouterr().out
    assert run("models", str(model), "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told[str(model)]["protocol"] == "ahead"
