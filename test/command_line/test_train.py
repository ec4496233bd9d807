# SPDX-License-Identifier: Apache-2.0
"""`mild train`: a folder that loads, answers and says what it is; and one line for what cannot be learned."""

import json

import numpy as np
import pytest
from scipy.stats import chi2

from mild_core.inference.model import load_model
from test.command_line.test_main import run
from test.core.learning.made_trials import smooth_track
from test.core.learning.test_buetepage_hr import one_hot, write
from test.core.learning.test_nuisi import write as write_people

MINE = """
dataset = "buetepage_hr"
protocol = "same"
seed = 7

[settings.prior]
kind = "hmm"
components = 3
"""

QUICK = ("--epochs", "2", "--members", "1")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    tracks = [smooth_track(index, 320 + index) for index in range(8)]
    labels = [one_hot(index // 2, 320 + index) for index in range(8)]
    return write(tmp_path_factory.mktemp("data") / "a.npz", tracks, labels)


def table(path, protocol):
    row = {
        "method": "mild",
        "title": "MILD, ours",
        "labels": "given",
        "macro_mean": 0.0444,
        "macro_std": 0.001,
        "rmse_deg": 11.0,
        "windows": 100,
        "relative": {},
        "interactions": {},
        "residual_covariance": (0.03 * np.eye(7)).tolist(),
    }
    about = {
        "protocol": protocol,
        "dataset": "buetepage_hr",
        "folds": 4,
        "seeds": 3,
        "date": "2025-01-02",
        "unit": "rad^2",
    }
    run_time = {"mild": {"covariance_scale": {"hand_wave": 0.5, "rocket": 2.0}, "radii": {"rocket": [2.0, 3.5]}}}
    path.write_text(json.dumps({**about, "methods": [row], "run_time": run_time}))
    return path


def test_a_trained_folder_loads_and_carries_measured_errors(data, tmp_path, capsys):
    errors = table(tmp_path / "cv.json", "ahead")
    out = tmp_path / "made of #1"
    options = ("--data", str(data), "--out", str(out), "--errors", str(errors))
    assert run("train", "--config", "yumi_buetepage_ahead", *options, *QUICK) == 0
    printed = capsys.readouterr()
    assert f"written: {out}" in printed.out
    assert "network 1/1 epoch 2" in printed.err
    model = load_model(out)
    manifest = model.manifest
    assert (manifest.name, manifest.protocol, manifest.lead_frames) == ("made of #1", "ahead", 1)
    assert manifest.training["trials"] == 8
    assert manifest.errors["cross_validation"]["rows"][0]["macro_mean"] == 0.0444
    np.testing.assert_allclose(model.residual_covariance, 0.03 * np.eye(7))
    np.testing.assert_allclose(model.covariance_scale, [0.5, 1.0, 2.0, 1.0])
    np.testing.assert_allclose(model.radii[2], [2.0, 3.5])
    np.testing.assert_allclose(model.radii[1] ** 2, chi2.ppf([0.5, 0.9], 7), rtol=0.01)  # of a Gaussian
    assert set(manifest.robot_from_human.by_interaction) == {"handshake", "rocket", "parachute"}
    card = (out / "REPORT.md").read_text()
    assert "0.0444 ± 0.0010" in card
    assert "Epochs: 2 (as configured)." in card
    command = f"mild train --config yumi_buetepage_ahead --data {data} --seed 0 --epochs 2 --members 1 --out '{out}'"
    assert f"{command} --errors {errors}" in card  # as a shell takes it
    assert 'preset = "ahead"' in card
    assert run("evaluate", "--model", str(out), "--data", str(data), "--json") == 0
    assert json.loads(capsys.readouterr().out)["windows"] == sum(320 + index - 79 for index in range(8))


def test_a_folder_without_measured_errors_says_so(data, tmp_path):
    out = tmp_path / "made"
    (tmp_path / "mine.toml").write_text(MINE)
    assert run("train", "--config", str(tmp_path / "mine.toml"), "--data", str(data), "--out", str(out), *QUICK) == 0
    assert "Not measured." in (out / "REPORT.md").read_text()
    manifest = load_model(out).manifest
    assert manifest.training["residual_covariance"] == "training trials: too small"
    assert manifest.training["configuration"] == MINE
    assert (manifest.training["seeds"], manifest.prior.kind, manifest.prior.components) == ([7], "hmm", 3)


@pytest.mark.parametrize(
    ("least_gain", "epochs", "why"),
    [(0.99, 2, "levelled off, of at most 4"), (-10.0, 4, "the most allowed: not levelled off")],
)
def test_a_card_says_whether_the_error_levelled_off(tmp_path, monkeypatch, capsys, least_gain, epochs, why):
    monkeypatch.setattr("mild_core.learning.training.epoch_search.LEAST_GAIN", least_gain)
    tracks = [smooth_track(index, 320 + index) for index in range(6)]
    path = write(tmp_path / "a.npz", tracks, [one_hot(index // 3, 320 + index) for index in range(6)])
    (tmp_path / "mine.toml").write_text(MINE)
    of, to = ("--data", str(path), "--epochs", "4", "--members", "1"), ("--out", str(tmp_path / "made"))
    assert run("train", "--config", str(tmp_path / "mine.toml"), *of, "--doublings", "1", *to) == 0
    assert "2 epochs: error on held-out trials " in capsys.readouterr().err
    report = (tmp_path / "made" / "REPORT.md").read_text()
    assert f"Epochs: {epochs} ({why})." in report
    assert "--doublings 1" in report


def test_a_partners_arm_is_learned_and_scored_in_metres_and_starts_another(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("mild_ros.command_line.train._gestures", lambda *_: ({}, ()))
    tracks = [np.tile(smooth_track(index, 60 + index)[:, :9], 2) for index in range(8)]
    data = write_people(tmp_path / "a.npz", tracks, [index // 2 for index in range(8)])
    out = tmp_path / "made"
    assert run("train", "--config", "nuisi_partner_same", "--data", str(data), "--out", str(out), *QUICK) == 0
    manifest = load_model(out).manifest
    assert (manifest.controlled.kind, manifest.controlled.unit) == ("human_arm", "m")
    assert (manifest.window, manifest.rate_hz, manifest.lead_frames) == (5, 30.0, -4)
    assert "a second person" in (out / "REPORT.md").read_text()
    capsys.readouterr()
    assert run("evaluate", "--model", str(out), "--data", str(data), "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["dataset"], printed["unit"]) == ("nuisi", "m^2")
    assert 0 < printed["mean_absolute_cm"] < printed["rmse_cm"] < 100
    assert printed["windows"] == sum(60 + index - 4 for index in range(8))
    heir = f'dataset = "nuisi"\nprotocol = "same"\nstart_from = "{out}"\n'
    (tmp_path / "heir.toml").write_text(heir + "[settings.prior]\ncomponents = 3\n")
    again = ("train", "--config", str(tmp_path / "heir.toml"), "--data", str(data), *QUICK, "--out")
    assert run(*again, str(tmp_path / "heir")) == 0
    started = load_model(tmp_path / "heir").manifest.training["start_from"]
    assert started.startswith("made (")
    assert "decoder." in started
    assert f"Hidden layers from {started}." in (tmp_path / "heir" / "REPORT.md").read_text()
    capsys.readouterr()
    preset = 'preset = "paper"\n[settings.prior]\ncomponents = 3\n'
    (tmp_path / "heir.toml").write_text(heir + preset)
    assert run(*again, str(tmp_path / "none")) == 2
    assert "start_from: no hidden layer of it has the name and size" in capsys.readouterr().err


def test_errors_of_another_protocol_are_refused(data, tmp_path, capsys):
    errors = table(tmp_path / "cv.json", "same")
    options = (
        "--config",
        "yumi_buetepage_ahead",
        "--data",
        str(data),
        "--out",
        str(tmp_path / "made"),
        "--errors",
        str(errors),
    )
    assert run("train", *options, *QUICK) == 2
    assert "holds buetepage_hr, protocol 'same'" in capsys.readouterr().err
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("content", ["{", "[]", '{"methods": 3}'])
def test_a_table_that_is_none_is_refused_in_one_line(data, tmp_path, content, capsys):
    (tmp_path / "cv.json").write_text(content)
    options = ("--data", str(data), "--out", str(tmp_path / "made"), "--errors", str(tmp_path / "cv.json"))
    assert run("train", *options, *QUICK) == 2
    printed = capsys.readouterr().err
    assert "is no table of a cross-validation" in printed
    assert printed.count("\n") == 1


def test_wrong_names_and_an_unwritable_folder_are_refused_before_training(data, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    for options, said in (
        (("--config", "yumi_butepage_same", "--out", str(tmp_path / "made")), "did you mean 'yumi_buetepage_same'"),
        (("--config", "none.toml", "--out", str(tmp_path / "made")), "there is no such file"),
        (("--out", str(tmp_path / "file")), "File exists"),
    ):
        assert run("train", "--data", str(data), *options, *QUICK) == 2
        assert said in capsys.readouterr().err


def test_an_interrupted_training_goes_on_and_ends_as_if_nothing_had_happened(data, tmp_path, monkeypatch, capsys):
    import mild_core.learning.training.checkpoint

    (tmp_path / "mine.toml").write_text(MINE)
    options = ("--config", str(tmp_path / "mine.toml"), "--data", str(data), "--epochs", "2", "--members", "2")
    assert run("train", *options, "--out", str(tmp_path / "whole")) == 0
    write, written = mild_core.learning.training.checkpoint.Checkpoint.write, []

    def interrupted(self, member, snapshot):
        write(self, member, snapshot)
        written.append(member)
        if len(written) == 3:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(mild_core.learning.training.checkpoint.Checkpoint, "write", interrupted)
        assert run("train", *options, "--out", str(tmp_path / "made")) == 130
    assert written == [0, 0, 1]
    assert "the same command goes on" in capsys.readouterr().err
    kept = tmp_path / "made" / "training"
    assert sorted(path.name for path in kept.iterdir()) == ["member_0.safetensors", "member_1.safetensors"]
    for again, said in (
        (("--seed", "8"), "is of another training"),
        ((), "cannot be read"),
    ):
        whole = (kept / "member_1.safetensors").read_bytes()
        (kept / "member_1.safetensors").write_bytes(whole if again else b"\x80\x04cos\nsystem\n(S'true'\ntR.")
        assert run("train", *options, *again, "--out", str(tmp_path / "made")) == 2
        printed = capsys.readouterr().err
        assert said in printed
        assert printed.count("\n") == 1
        (kept / "member_1.safetensors").write_bytes(whole)
    assert run("train", *options, "--out", str(tmp_path / "made")) == 0
    assert "epoch 2" in capsys.readouterr().err
    assert not kept.exists()
    one, other = ((tmp_path / name / "weights.safetensors").read_bytes() for name in ("whole", "made"))
    assert one == other


def test_ctrl_c_before_the_first_epoch_leaves_nothing(data, tmp_path, monkeypatch, capsys):
    import mild_core.learning.training.algorithm

    def interrupted(*arguments):
        yield from ()
        raise KeyboardInterrupt

    monkeypatch.setattr(mild_core.learning.training.algorithm, "train", interrupted)
    assert run("train", "--data", str(data), "--out", str(tmp_path / "made"), *QUICK) == 130
    assert "nothing was written" in capsys.readouterr().err
    assert not (tmp_path / "made").exists()


def test_a_trial_too_short_for_the_prior_is_one_line(tmp_path, capsys):
    tracks = [smooth_track(index, 120) for index in range(8)]
    short = write(tmp_path / "short.npz", tracks, [one_hot(index // 2, 120) for index in range(8)])
    assert run("train", "--data", str(short), "--out", str(tmp_path / "made"), *QUICK) == 2
    printed = capsys.readouterr().err
    assert "120 frames" in printed
    assert "Traceback" not in printed


def test_a_recording_of_one_interaction_makes_a_model_that_knows_no_other(tmp_path):
    tracks = [smooth_track(index, 240) for index in range(3)]
    data = write(tmp_path / "one.npz", tracks, [one_hot(2, 240)] * 3)
    (tmp_path / "mine.toml").write_text(MINE)
    options = ("--config", str(tmp_path / "mine.toml"), "--data", str(data), "--out", str(tmp_path / "made"))
    assert run("train", *options, *QUICK) == 0
    assert load_model(tmp_path / "made").manifest.interactions == ("rocket",)


def test_one_trial_is_no_recording_to_learn_from(tmp_path, capsys):
    one = write(tmp_path / "one.npz", [smooth_track(0, 320)], [one_hot(0, 320)])
    assert run("train", "--data", str(one), "--out", str(tmp_path / "made"), *QUICK) == 2
    assert "holds 1 training trials" in capsys.readouterr().err
    assert not (tmp_path / "made").exists()
