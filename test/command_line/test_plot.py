# SPDX-License-Identifier: Apache-2.0
"""`mild plot`: every figure shows the numbers of a model and its recording, and what cannot be drawn is said."""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import typer
from PIL import Image

from mild_core.inference.model import load_model
from mild_core.learning.data.baseline import RECOGNISED, STARTED, UNKNOWN
from mild_core.learning.data.windows import cut
from mild_core.learning.datasets import DATASETS
from mild_core.learning.evaluation.errors import errors_of_trial
from mild_core.learning.evaluation.latent_view import latent_track
from mild_core.learning.evaluation.methods import METHODS
from mild_core.learning.training.configuration import configuration_names
from mild_core.learning.training.model_predictor import ModelPredictor
from mild_core.resources import model_names
from mild_ros.command_line.held_out import learn_without
from mild_ros.command_line.main import assemble
from mild_ros.command_line.plot_data import errors_over_window, latent_spaces, moments_of_each, motion_of, watched
from test.command_line.test_main import run
from test.command_line.test_train import smooth_track
from test.conftest import ROOT
from test.core.learning.test_buetepage_hr import one_hot, write


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    tracks = [smooth_track(index, 120) for index in range(8)]
    labels = [one_hot(index // 2, 120) for index in range(8)]
    return write(tmp_path_factory.mktemp("data") / "a.npz", tracks, labels)


QUICK = """
dataset = "buetepage_hr"
protocol = "same"
preset = "paper"
[settings]
epochs = 4
[settings.architecture]
encoder_hidden = [8]
decoder_hidden = [8]
counterpart_hidden = [8]
[settings.prior]
components = 3
"""


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """A configuration that is learned in a second."""
    path = tmp_path_factory.mktemp("configuration") / "quick.toml"
    path.write_text(QUICK)
    return path


def is_drawn(path):
    """Whether a figure has the width of a paper, and something in more than shades of one colour in it."""
    picture = np.asarray(Image.open(path).convert("RGB"))
    assert picture.shape[1] in (round(3.5 * 300), round(7.16 * 300))
    return (np.ptp(picture.astype(int), axis=2) > 60).mean() > 0.001


@pytest.mark.parametrize("name", ["window", "joints", "skeletons"])
def test_a_figure_of_trials_that_were_learned_from_is_drawn_when_it_is_asked_for(model, data, name, tmp_path, capsys):
    out = tmp_path / "deep" / "figure.png"
    wanted = ("plot", name, "--model", str(model), "--data", str(data), "--out", str(out))
    assert run(*wanted) == 2
    assert "no trial that the model did not learn from" in capsys.readouterr().err
    assert run(*wanted, "--split", "train") == 0
    assert f"written: {out}" in capsys.readouterr().out
    assert is_drawn(out)


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """Where figures of held-out trials are drawn: models learned for one are found by the others."""
    return tmp_path_factory.mktemp("work")


@pytest.mark.parametrize("name", ["latent", "window", "skeletons"])
def test_a_figure_shows_trials_that_were_held_out(quick, data, name, work, monkeypatch):
    monkeypatch.chdir(work)
    wanted = ("--model", str(quick), "--data", str(data), "--fold", "1", "--out", f"{name}.png")
    assert run("plot", name, *wanted) == 0
    assert is_drawn(f"{name}.png")


def test_what_was_learned_without_a_fold_is_found_again_and_nothing_else(quick, data, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    wanted = ("plot", "joints", "--data", str(data), "--fold", "1", "--out", "a.png", "--model")
    assert run(*wanted, str(quick)) == 0
    assert "learning quick without fold 1: 4 of 8 trials" in capsys.readouterr().err
    assert is_drawn("a.png")
    assert run(*wanted, str(quick)) == 0
    assert "learning quick" not in capsys.readouterr().err
    quick_but_longer = tmp_path / "quick.toml"
    quick_but_longer.write_text(QUICK.replace("epochs = 4", "epochs = 5"))
    assert run(*wanted, str(quick_but_longer)) == 0
    assert "learning quick" in capsys.readouterr().err


def test_what_is_held_out_was_not_learned(quick, data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    without = learn_without(str(quick), data, 0)
    held_out = [trial.trial for trial in without.held_out]
    assert held_out == [0, 2, 4, 6]
    assert sorted(held_out + [trial.trial for trial in without.learned]) == list(range(8))
    for trial, latents in zip(without.held_out, without.controlled_latents, strict=True):
        assert latents.shape == (len(cut(trial, without.protocol).controlled), 5)
        assert np.ptp(latents, axis=0).max() > 0.0
    tracks = [smooth_track(index + 20 * (index in held_out), 120) for index in range(8)]
    others = write(tmp_path / "others.npz", tracks, [one_hot(index // 2, 120) for index in range(8)])
    learned = (tmp_path / "out" / "folds" / "quick_without_0" / "weights.safetensors").read_bytes()
    shutil.rmtree(tmp_path / "out")
    learn_without(str(quick), others, 0)  # what is held out has no influence on what is learned
    assert (tmp_path / "out" / "folds" / "quick_without_0" / "weights.safetensors").read_bytes() == learned
    seen = watched(str(quick), data, fold=0)
    for trial, person in zip(seen.trials, latent_spaces(seen)["person"].values(), strict=True):
        np.testing.assert_array_equal(person.tracks[0], latent_track(without.model, trial, without.protocol).observed)


def test_the_error_over_the_window_adds_up_to_the_error_of_the_tables(model, data):
    seen = watched(str(model), data, "train")
    errors, times_s = errors_over_window([seen])
    assert list(errors) == ["MILD, ours"]  # nothing else is learned from what it would be shown on
    predictor = ModelPredictor(seen.model, seen.protocol)
    for place, trial in enumerate(seen.trials[:2]):
        printed = errors_of_trial(trial, seen.protocol, predictor.predict(trial)).squared.mean()
        assert errors["MILD, ours"]["hand_wave"][place].mean() == pytest.approx(printed, rel=1e-9)
    # Protocol "ahead": from the frame after the newest one to a second ahead.
    np.testing.assert_allclose([times_s[0], times_s[-1]], [0.025, 1.0])


@pytest.mark.heavy
def test_buetepages_error_over_the_window_is_of_the_same_held_out_trials(quick, data, work, monkeypatch):
    monkeypatch.chdir(work)
    seen = watched(str(quick), data, fold=1)
    errors, _ = errors_over_window([seen])
    beside = METHODS["buetepage"]
    assert list(errors) == ["MILD, ours", beside.title]
    fitted = beside.fit(seen.learned, seen.protocol, 0)
    shown = errors_of_trial(seen.trials[0], seen.protocol, fitted.predict(seen.trials[0])).squared.mean()
    assert errors[beside.title]["hand_wave"][0].mean() == pytest.approx(shown, rel=1e-6)


def test_all_interactions_are_shown_at_equal_times(model, data):
    rows = moments_of_each(watched(str(model), data, "train"), 5)
    assert list(rows) == ["hand wave", "handshake", "rocket", "parachute"]
    times = [[moment.time_s for moment in row] for row in rows.values()]
    assert all(row == times[0] for row in times)


def test_a_joint_is_shown_at_the_time_that_its_prediction_is_for(model, data):
    motion = motion_of(watched(str(model), data, "train").only(3))
    assert motion.predicted_s[0] == pytest.approx(79 / 40)
    assert motion.predicted_s[-1] == pytest.approx(motion.true_s[-1])
    assert motion.predicted.shape == motion.deviation.shape == (41, 7)


def test_latents_are_followed_as_inference_follows_them(model, data):
    """The controlled latents, decoded, are the very answers of the stage."""
    seen, loaded = watched(str(model), data, "train").only(4), load_model(model)
    track = latent_track(loaded, seen.trials[0], seen.protocol)
    decoder = loaded.members[0].networks["decoder"]
    answers = ModelPredictor(loaded, seen.protocol).predict(seen.trials[0])
    for latent, answer in zip(track.controlled[::10], answers[::10], strict=True):
        decoded = decoder.run(latent.astype(np.float32), decoder.first_memory())[0]
        # Single precision of values of order one.
        np.testing.assert_allclose(decoded.reshape(answer.shape), answer, atol=2e-6)
    np.testing.assert_allclose(track.weights.sum(axis=1), 1.0, rtol=1e-9)


def test_a_filmstrip_shows_a_bag_from_rest_to_rest(tmp_path, capsys):
    out = tmp_path / "film.png"
    assert run("plot", "filmstrip", str(ROOT / "bags" / "handshake"), "--out", str(out)) == 0
    assert f"written: {out}" in capsys.readouterr().out
    picture = np.asarray(Image.open(out).convert("RGB")).astype(int)
    assert picture.shape[1] > 4 * picture.shape[0] / 2
    # The person's hand is raised in the middle of the strip and hangs at its ends: the panels differ.
    panels = np.split(picture[:, : picture.shape[1] // 6 * 6], 6, axis=1)
    assert abs(panels[2] - panels[0]).mean() > abs(panels[5] - panels[0]).mean()


def test_what_cannot_be_drawn_is_one_line(model, data, tmp_path, capsys):
    shared = ("--model", str(model), "--data", str(data), "--out", str(tmp_path / "a.png"))
    for arguments, said in (
        (("joints", *shared, "--split", "train", "--trial", "8"), "there are 8 training trials"),
        (("joints", *shared, "--split", "train", "--fold", "1"), "are both given"),
        (("joints", *shared, "--fold", "1"), "does not say how it was learned"),
        (("joints", *shared, "--model", "yumi_buetepage_same", "--fold", "4"), "there are 4; give 0 to 3"),
        (("window", *shared, "--split", "test"), "its test split is empty"),
        (("window", *shared, "--split", "tset"), "did you mean 'test'"),
        (("filmstrip", str(tmp_path / "none")), "none"),
    ):
        assert run("plot", *arguments) == 2
        printed = capsys.readouterr().err
        assert said in printed
        assert printed.count("\n") == 1


def measured(path: Path) -> Path:
    interaction = {"mse": 0.04, "mse_std": 0.05, "windows": 9}
    row = {
        **{"method": "mild", "title": "MILD, ours", "labels": "given", "macro_mean": 0.0412, "macro_std": 0.0011},
        **{"macro": {"interval": [0.035, 0.047]}, "interactions": {"hand_wave": interaction}},
    }
    papers = {"paper_mse": 4.0, "paper_mse_std": 5.0, "p_against_buetepage": 0.04}
    starred = {**row, "title": "starred", "interactions": {"hand_wave": {**interaction, **papers}}}
    bar = {**row, "method": "kernel_ridge", "title": "kernel ridge", "macro_mean": 0.051, "macro_std": None}
    others = [{**row, "labels": labels, "macro_mean": 0.05} for labels in (RECOGNISED, STARTED, UNKNOWN)]
    about = {"dataset": "nuisi_v1", "protocol": "same", "folds": 4, "seeds": 1, "date": "2025-01-02", "unit": "m^2"}
    path.write_text(json.dumps({**about, "methods": [row, bar, starred, *others]}))
    return path


def test_a_measured_table_becomes_latex_markdown_and_a_figure(tmp_path, capsys):
    source = measured(tmp_path / "cv.json")
    for ending, wanted in (
        (
            ".tex",
            (
                r"\toprule",
                r"MILD, ours, given & 0.0400 $\pm$ 0.0500 &",
                r"nuisi\_v1",
                r"[m$^2$]",
                "0.0510",
                r"5.00) & ",
            ),
        ),
        (
            ".md",
            (
                "| [m²] | hand wave | all (± over seeds) |",
                "| MILD, ours, given | 0.0400 ± 0.0500 | 0.0412 ± 0.0011 |",
                "| starred, given | 0.0400 ± 0.0500* (4.00 ± 5.00) | 0.0412 ± 0.0011 |",
                "*: p < .05 against Bütepage et al.",
                "[m²]",
                " 1 seed, ",
            ),
        ),
    ):
        out = tmp_path / f"table{ending}"
        assert run("plot", "table", str(source), "--out", str(out)) == 0
        assert all(text in out.read_text() for text in wanted)
    assert run("plot", "comparison", str(source), "--out", str(tmp_path)) == 0
    assert (tmp_path / "cv.png").read_bytes().startswith(b"\x89PNG")
    assert run("plot", "table", str(source), "--out", str(tmp_path / "a.doc")) == 2
    assert "ends in '.doc'" in capsys.readouterr().err
    source.write_text("[]")
    assert run("plot", "comparison", str(source)) == 2
    assert "is no table of a cross-validation" in capsys.readouterr().err


PAGE = (ROOT / "docs" / "paper.md").read_text()
COMMANDS = sorted(set(re.findall(r"\./mild ([^`\n|]*)", PAGE)))


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_of_the_page_on_the_paper_can_be_given(line):
    """Its options are those that there are, and what it names there is; the long ones are not run."""
    words = shlex.split(line)
    command = typer.main.get_command(assemble(words[0])).commands[words[0]]
    rest = words[1:]
    while rest and hasattr(command, "commands"):
        command, rest = command.commands[rest[0]], rest[1:]
    given = command.make_context(words[0], rest).params
    for name in {given.get("model"), given.get("config")} - {None, "", "MODEL"}:
        assert name in (*configuration_names(), *model_names(), "pepper")
    assert given.get("dataset") in (None, "", *DATASETS)
    for table in given.get("tables") or ():
        dataset, protocol = table.stem.removeprefix("cross_validation_").rsplit("_", 1)
        assert protocol in DATASETS[dataset].protocols


def test_the_page_on_the_paper_has_a_command_for_every_table_and_figure():
    rows = dict(re.findall(r"^\| ([IVX]+|\d) \|(.*)$", PAGE, re.MULTILINE))
    assert set(rows) == {"I", "II", "III", *"3456789"}
    assert all("./mild " in row for row in rows.values())
