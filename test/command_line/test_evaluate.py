# SPDX-License-Identifier: Apache-2.0
"""`mild evaluate` and `mild models`: figures for people and machines, and one line for what cannot be measured."""

import json

import numpy as np
import pytest

from mild_core.resources import share_folder
from test.command_line.test_main import run
from test.command_line.test_train import smooth_track
from test.core.learning.test_buetepage_hr import one_hot, track, write
from test.core.learning.test_nuisi import write as write_nuisi


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    tracks = [0.2 * track(index, 90 + index) for index in range(6)]
    labels = [one_hot(index // 2, 90 + index) for index in range(6)]
    return write(tmp_path_factory.mktemp("data") / "a.npz", tracks, labels)


NOTHING = {"mse": None, "mse_std": None, "mean_absolute_deg": None}


def evaluate(model, data, *options):
    return run("evaluate", "--model", str(model), "--data", str(data), *options)


@pytest.mark.parametrize("labels", ["given", "recognised", "started"])
def test_json_holds_the_figures_and_nothing_else(model, data, labels, capsys):
    assert evaluate(model, data, "--labels", labels, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["protocol"] == "ahead"
    assert printed["labels"] == labels
    # 90 and 91 frames, 80 of which one window and its answer take.
    assert printed["interactions"]["hand_wave"]["windows"] == 11 + 12
    assert printed["interactions"]["parachute"] == {**NOTHING, "windows": 0, "trials": 0}
    errors = [printed["interactions"][name]["mse"] for name in ("hand_wave", "handshake", "rocket")]
    assert printed["macro"]["mse"] == pytest.approx(np.mean(errors))
    assert printed["windows"] == sum(row["windows"] for row in printed["interactions"].values()) == 81
    assert printed["rmse_deg"] > 0
    assert (printed["recognised_share"] is None) == (labels != "recognised")


def test_live_is_what_the_robot_runs_also_after_standing(model, data, capsys):
    assert evaluate(model, data, "--labels", "live", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    later = found["after_standing"]
    assert later["seconds"] == 3.0
    assert found["windows"] == later["windows"] == 81, "windows of the standing itself are not scored"
    assert found["recognised_share"] is not None
    assert found["macro"]["mse"] != later["macro"]["mse"]
    assert evaluate(model, data, "--labels", "live") == 0
    assert "after 3 s of standing" in " ".join(capsys.readouterr().out.split())


def test_a_model_of_two_people_has_no_robot_that_starts_somewhere(data, capsys):
    two_people = str(share_folder("models") / "nuisi_partner_next")
    nuisi = data.with_name("nuisi.npz")
    tracks = [np.random.default_rng(index).normal(size=(30, 18)) for index in range(2)]
    write_nuisi(nuisi, tracks, [0, 1])
    assert run("evaluate", "--model", two_people, "--data", str(nuisi), "--labels", "started") == 2
    said = capsys.readouterr().err
    assert "there is no robot that could say where it starts; use labels given, recognised or live" in said
    assert len(said.strip().splitlines()) == 1
    assert run("evaluate", "--model", two_people, "--data", str(nuisi), "--labels", "live") == 0


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
    printed = json.loads(capsys.readouterr().out)
    assert printed["macro"]["mse"] is None
    assert printed["windows"] == 0
    assert "is empty" in printed["note"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--protocol", "same"), "was trained for protocol 'ahead'"),
        (("--protocol", "sane"), "did you mean 'same'"),
        (("--split", "tset"), "did you mean 'test'"),
        (("--labels", "maybe"), "use one of given, recognised"),
        (("--dataset", "nuisi_v9"), "'nuisi_v9' is unknown"),
        (("--cv",), "--cv, --unknown and --strangers learn their own"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_one_line(model, data, options, said, capsys):
    assert evaluate(model, data, *options) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == 1


def test_an_absent_recording_and_an_absent_model_are_named(model, data, tmp_path, capsys):
    assert evaluate(model, tmp_path / "none.npz") == 2
    assert "there is no such file" in capsys.readouterr().err
    assert evaluate(tmp_path / "none", data) == 2
    assert "no such folder" in capsys.readouterr().err


def test_the_default_recording_is_below_mild_data(model, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MILD_DATA", str(tmp_path))
    assert run("evaluate", "--model", str(model)) == 2
    assert f"{tmp_path}/buetepage_hr/traj_data.npz" in capsys.readouterr().err


TINY = """
dataset = "buetepage_hr"
protocol = "next"
[settings]
epochs = 2
members = 1
augmentation = false
[settings.prior]
components = 2
"""
"""A way to train that takes no time and learns nothing."""


@pytest.fixture(scope="module")
def four_by_four(tmp_path_factory):
    """Four trials of each interaction."""
    tracks = [smooth_track(index, 90) for index in range(16)]
    return write(tmp_path_factory.mktemp("data") / "b.npz", tracks, [one_hot(index // 4, 90) for index in range(16)])


def test_cross_validation_writes_its_tables_and_what_happened_at_run_time(four_by_four, tmp_path, capsys):
    (tmp_path / "tiny.toml").write_text(TINY)
    options = ("--method", "action_mean", "--method", "mild", "--workers", "1", "--seeds", "1")
    options += ("--config", str(tmp_path / "tiny.toml"), "--data", str(four_by_four))
    assert run("evaluate", "--cv", *options, "--out", str(tmp_path / "out"), "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    stem = tmp_path / "out" / "cross_validation_buetepage_hr_next"
    assert printed == json.loads(stem.with_suffix(".json").read_text())
    assert [(row["method"], row["labels"]) for row in printed["methods"] if row["method"] != "mild"] == [
        ("action_mean", "given")
    ]
    assert {row["windows"] for row in printed["methods"]} == {16 * (18 - 9)}
    ours = printed["run_time"].pop("mild")
    assert printed["run_time"] == {}
    assert ours["trials"] == 16
    assert 0 <= ours["wrong_after_s"]["5"] <= 16
    macro = {row["labels"]: row["macro_mean"] for row in printed["methods"] if row["method"] == "mild"}
    assert sum(ours["recognition_adds"].values()) == pytest.approx(macro["recognised"] / macro["given"] - 1.0, abs=1e-9)
    assert 0.0 <= ours["called_unknown"] <= 1.0
    for name, curves in ours["reliability"].items():
        assert ours["covariance_scale"][name] > 0.0
        assert 0.0 < ours["radii"][name][0] < ours["radii"][name][1]
        assert len(curves["joint"]) == len(curves["marginal_unscaled"]) == len(ours["levels"])
        assert sorted(curves["marginal"]) == curves["marginal"]
    for picture in (stem.with_suffix(".png"), stem.with_name(f"{stem.name}_mild_reliability.png")):
        assert picture.read_bytes().startswith(b"\x89PNG")
    written = stem.with_suffix(".md").read_text()
    assert "| mean pose | given |" in written
    assert "| wrong after 1 s |" in written


def test_interactions_left_out_are_reported_by_share_and_area(four_by_four, tmp_path, capsys):
    options = ("--unknown", "--data", str(four_by_four), "--protocol", "next", "--out", str(tmp_path / "out"))
    assert run("evaluate", *options, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    for name in ("hand_wave", "handshake", "rocket", "parachute"):
        for score in ("ours", "nearest_neighbour"):
            assert 0.0 <= printed[name][score]["share"] <= 1.0
            assert 0.0 <= printed[name][score]["area"] <= 1.0
    assert "| rocket |" in (tmp_path / "out" / "unknown_buetepage_hr_next.md").read_text()
    few = write(tmp_path / "few.npz", [smooth_track(i, 90) for i in range(8)], [one_hot(i // 4, 90) for i in range(8)])
    assert run("evaluate", "--unknown", "--data", str(few)) == 2
    assert "shows only hand_wave, handshake" in capsys.readouterr().err


def test_too_few_trials_for_folds_are_said_before_anything_starts(tmp_path, capsys):
    data = write(
        tmp_path / "a.npz",
        [smooth_track(index, 90) for index in range(5)],
        [one_hot(int(index > 2), 90) for index in range(5)],
    )
    assert run("evaluate", "--cv", "--data", str(data), "--out", str(tmp_path / "out")) == 2
    assert "interaction 'handshake' has 2 training trials" in capsys.readouterr().err
    frames = [79, *[90] * 15]
    tracks, labels = (
        [smooth_track(i, n) for i, n in enumerate(frames)],
        [one_hot(i // 4, n) for i, n in enumerate(frames)],
    )
    for what in ("--cv", "--unknown"):
        write(tmp_path / "a.npz", tracks, labels)
        assert run("evaluate", what, "--data", str(data), "--protocol", "ahead") == 2
        assert "trial 0 (hand_wave): its 79 frames are too few" in capsys.readouterr().err
    write(tmp_path / "a.npz", [], [])
    assert run("evaluate", "--cv", "--data", str(data)) == 2
    assert "training split is empty" in capsys.readouterr().err


def test_models_are_listed_with_their_figures_and_their_cards_shown(model, capsys):
    assert run("models", str(model)) == 0
    assert "Model card: made" in capsys.readouterr().out
    assert run("models", str(model), "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed[str(model)]["protocol"] == "ahead"


def test_a_narrow_terminal_costs_no_figure(monkeypatch, capsys):
    from mild_ros.command_line.error_tables import print_cells

    monkeypatch.setenv("COLUMNS", "60")
    figures = [f"0.{number:04d}" for number in range(1234, 1244)]
    print_cells("a table", [["method", *(f"interaction_{i}" for i in range(10))], ["a method", *figures]], 1)
    shown = capsys.readouterr().out
    assert all(figure in shown for figure in figures)
