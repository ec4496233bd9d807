# SPDX-License-Identifier: Apache-2.0
"""`mild plot`: every figure shows the numbers of a model and its recording, and what cannot be drawn is said."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mild_core.inference.model import load_model
from mild_core.learning.data.baseline import RECOGNISED, STARTED, UNKNOWN
from mild_core.learning.evaluation.errors import errors_of_trial
from mild_core.learning.evaluation.latent_view import latent_track
from mild_core.learning.training.model_predictor import ModelPredictor
from mild_ros.command_line.plot_data import errors_over_window, motion_of, watched
from test.command_line.test_main import run
from test.command_line.test_train import smooth_track
from test.conftest import ROOT
from test.core.learning.test_buetepage_hr import one_hot, write


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    tracks = [smooth_track(index, 120) for index in range(8)]
    labels = [one_hot(index // 2, 120) for index in range(8)]
    return write(tmp_path_factory.mktemp("data") / "a.npz", tracks, labels)


FIGURES = ("latent", "window", "joints", "skeletons")


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_drawn_at_the_width_of_a_paper(model, data, name, tmp_path, capsys):
    out = tmp_path / "deep" / "figure.png"
    assert run("plot", name, "--model", str(model), "--data", str(data), "--out", str(out)) == 0
    assert f"written: {out}" in capsys.readouterr().out
    picture = np.asarray(Image.open(out).convert("RGB"))
    assert picture.shape[1] in (round(3.5 * 300), round(7.16 * 300))
    # Something is drawn, in more than shades of one colour.
    assert (np.ptp(picture.astype(int), axis=2) > 60).mean() > 0.001


def test_the_error_over_the_window_adds_up_to_the_error_of_the_tables(model, data):
    seen = watched(str(model), data, "train")
    errors, times_s = errors_over_window(seen)
    predictor = ModelPredictor(seen.model, seen.protocol)
    for place, trial in enumerate(seen.trials[:2]):
        printed = errors_of_trial(trial, seen.protocol, predictor.predict(trial)).squared.mean()
        assert errors["hand_wave"][place].mean() == pytest.approx(printed, rel=1e-9)
    # Protocol "ahead": from the frame after the newest one to a second ahead.
    np.testing.assert_allclose([times_s[0], times_s[-1]], [0.025, 1.0])


def test_a_joint_is_shown_at_the_time_that_its_prediction_is_for(model, data):
    motion = motion_of(watched(str(model), data, "train", 3))
    assert motion.predicted_s[0] == pytest.approx(79 / 40)
    assert motion.predicted_s[-1] == pytest.approx(motion.true_s[-1])
    assert motion.predicted.shape == motion.deviation.shape == (41, 7)


def test_latents_are_followed_as_inference_follows_them(model, data):
    """The controlled latents, decoded, are the very answers of the stage."""
    seen, loaded = watched(str(model), data, "train", 4), load_model(model)
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
        (("joints", *shared, "--trial", "8"), "there are 8 train trials"),
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
