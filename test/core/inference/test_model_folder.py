# SPDX-License-Identifier: Apache-2.0
"""The model folder: what was saved comes back, and whatever is wrong with one is named in one line."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from safetensors.numpy import load_file, save

from mild_core.errors import ModelError
from mild_core.inference.model import load_model, read_manifest, save_model
from test.core.inference.random_model import manifest, paper_member, random_arrays, recurrent_member


@pytest.fixture
def folder(model_folder, tmp_path):
    return shutil.copytree(model_folder, tmp_path / "model")


def edit_manifest(folder, change):
    path = folder / "manifest.json"
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


def replace_file(folder, name, content):
    """Change a file and its digest with it, as someone would who means it."""
    (folder / name).write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    edit_manifest(folder, lambda data: data["sha256"].update({name: digest}))


def refused(folder, *words):
    with pytest.raises(ModelError) as caught:
        load_model(folder)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 600
    for word in words:
        assert word in message


def test_what_was_saved_comes_back(tmp_path):
    of = manifest((recurrent_member(),), components=4, stride=3, training={"seeds": [1, 2]}, errors={"same": 0.05})
    saved = save_model(tmp_path / "m", of, random_arrays(of), "card")
    again = load_model(tmp_path / "m")
    assert again.manifest == saved.manifest
    assert replace(again.manifest, sha256={}) == of
    assert set(again.manifest.sha256) == {"weights.safetensors", "golden.npz", "REPORT.md"}
    assert (tmp_path / "m" / "REPORT.md").read_text() == "card"
    for name, network in again.members[0].networks.items():
        np.testing.assert_array_equal(network.parameters, saved.members[0].networks[name].parameters)


def test_a_folder_that_is_none(tmp_path):
    refused(tmp_path / "nowhere", "nowhere", "manifest.json")
    (tmp_path / "manifest.json").write_text("[" * 100_000)
    refused(tmp_path, "no JSON")
    (tmp_path / "manifest.json").write_text("[]")
    refused(tmp_path, "no JSON object")
    (tmp_path / "manifest.json").write_text(" " * (2 << 20))
    refused(tmp_path, "larger than")


@pytest.mark.parametrize("name", ["weights.safetensors", "golden.npz"])
def test_a_missing_or_altered_file(folder, name):
    content = bytearray((folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / name).write_bytes(content)
    refused(folder, name, "SHA-256")
    (folder / name).unlink()
    refused(folder, name, "missing")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.pop("window"), ("key 'window'", "missing")),
        (lambda d: d.update(windw=3), ("key 'windw'", "unknown")),
        (lambda d: d.update(window=10**9), ("key 'window'",)),
        (lambda d: d.update(window=2.5), ("key 'window'", "whole")),
        (lambda d: d.update(format_version=2), ("key 'format_version'", "version 1")),
        (lambda d: d.update(protocol="later"), ("key 'protocol'", "same, ahead, next")),
        (lambda d: d.update(lead_frames=7), ("key 'lead_frames'", "ahead")),
        (lambda d: d.update(rate_hz=float("nan")), ("key 'rate_hz'",)),
        (lambda d: d.update(rate_hz=True), ("key 'rate_hz'",)),
        (lambda d: d.update(interactions=["a", "a", "b", "c"]), ("key 'interactions'", "twice")),
        (lambda d: d.update(members=[]), ("key 'members'",)),
        (lambda d: d["observed"].update(side="up"), ("key 'observed.side'", "right, left")),
        (lambda d: d["observed"].update(bone_lengths_m=[0.1]), ("key 'observed.bone_lengths_m'",)),
        (lambda d: d["controlled"].update(unit="deg"), ("key 'controlled.unit'",)),
        (lambda d: d["prior"].update(kind="markov"), ("key 'prior.kind'", "hsmm")),
        (lambda d: d["prior"].update(max_duration=3), ("durations", "max_duration")),
        (lambda d: d["members"][0].pop("decoder"), ("key 'members.0.decoder'",)),
        (lambda d: d["members"][0]["encoder"].update(inputs=["controlled"]), ("key 'members.0.encoder.inputs'",)),
        (lambda d: d["members"][0]["encoder"].update(inputs=["context", "window"]), ("there is no such network",)),
        (
            lambda d: d["members"][0]["encoder"]["layers"][0].update(name="../x"),
            ("key 'members.0.encoder.layers.0.name",),
        ),
        (lambda d: d["members"][0]["encoder"]["layers"][0].update(kind="eval"), ("kind 'eval' is unknown",)),
        (lambda d: d["members"][0]["encoder"]["layers"][0].update(inputs=10**7), ("inputs",)),
        (lambda d: d["robot_from_human"].update(by_interaction={"dance": [0, 0, 0]}), ("by_interaction.dance",)),
        (lambda d: d["contact"].update(dance=[0, 1]), ("contact.dance",)),
        (lambda d: d["contact"].update({d["interactions"][0]: [0.8, 0.2]}), ("contact.", "goes from 0.8 to 0.2")),
        (lambda d: d["contact"].update({d["interactions"][0]: [0.8]}), ("contact.",)),
        (lambda d: d.update(sha256={"../../etc/passwd": "0" * 64}), ("key 'sha256.weights.safetensors'",)),
        (lambda d: d["sha256"].update({"golden.npz": "xyz"}), ("key 'sha256.golden.npz'",)),
    ],
)
def test_a_manifest_that_says_something_impossible(folder, change, words):
    edit_manifest(folder, change)
    refused(folder, *words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: a.pop("member_0.encoder.hidden_0.bias"), ("member_0.encoder.hidden_0.bias", "missing")),
        (lambda a: a.update({"member_0.encoder.hidden_0.bias": np.zeros(3, np.float32)}), ("hidden_0.bias", "shape")),
        (lambda a: a["member_0.decoder.hidden_0.weight"].fill(np.nan), ("hidden_0.weight", "finite")),
        (lambda a: a["member_0.prior.rocket.means"].fill(np.inf), ("member_0.prior.rocket.means", "finite")),
        (lambda a: a["member_0.prior.rocket.initial"].fill(0.7), ("member_0.prior.rocket", "sum to one")),
        (lambda a: a["member_0.prior.rocket.covariances"].__imul__(-1), ("rocket.covariances", "positive definite")),
        (lambda a: a["member_0.latent_radius"].fill(0.0), ("member_0.latent_radius",)),
        (lambda a: a.update(residual_covariance=np.eye(3)), ("residual_covariance", "shape")),
        (lambda a: a.update(residual_covariance=np.eye(7, dtype=np.int64)), ("residual_covariance",)),
        (lambda a: a.update(recognition=np.array([2.0, 0.5])), ("recognition",)),
        (lambda a: a.update(secret=np.zeros(3)), ("secret", "belongs to nothing")),
    ],
)
def test_weights_that_do_not_fit_are_named(folder, change, words):
    arrays = {name: array.copy() for name, array in load_file(folder / "weights.safetensors").items()}
    change(arrays)
    replace_file(folder, "weights.safetensors", save(arrays))
    refused(folder, *words)


@pytest.mark.parametrize("content", [b"", b"\x80\x04\x95", b"\xff" * 100, (10**15).to_bytes(8, "little") + b"{}"])
def test_weights_that_are_none(folder, content):
    replace_file(folder, "weights.safetensors", content)
    refused(folder, "weights.safetensors", "cannot be read")


def golden_with(folder, **changes):
    with np.load(folder / "golden.npz") as arrays:
        values = {name: arrays[name] for name in arrays.files} | changes
    buffer = io.BytesIO()
    np.savez(buffer, **{name: value for name, value in values.items() if value is not None})
    replace_file(folder, "golden.npz", buffer.getvalue())


def test_a_golden_sample_that_the_model_answers_otherwise(folder):
    arrays = {name: array.copy() for name, array in load_file(folder / "weights.safetensors").items()}
    arrays["member_0.decoder.output.mean"] += np.float32(0.001)
    replace_file(folder, "weights.safetensors", save(arrays))
    refused(folder, "golden.npz", "positions is off by 0.001")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"windows": np.zeros((3, 2, 2))}, ("windows", "none of this model")),
        ({"windows": np.full((3, 40, 9), np.nan)}, ("windows",)),
        ({"positions": np.zeros(3)}, ("positions has shape",)),
        ({"phase": None}, ("windows, positions",)),
        ({"windows": np.array([{}], dtype=object)}, ("holds objects",)),
    ],
)
def test_a_golden_sample_that_is_none(folder, changes, words):
    golden_with(folder, **changes)
    refused(folder, "golden.npz", *words)


def test_a_golden_sample_that_unpacks_to_too_much(folder):
    buffer = io.BytesIO()
    np.savez_compressed(buffer, windows=np.zeros(10 << 20))
    assert len(buffer.getvalue()) < 1 << 20
    replace_file(folder, "golden.npz", buffer.getvalue())
    refused(folder, "golden.npz", "unpacks")


def test_the_manifest_can_be_read_alone(folder):
    (folder / "weights.safetensors").unlink()
    assert read_manifest(folder).observed.joint_names == ("shoulder", "elbow", "hand")


def test_arrays_that_do_not_fit_are_not_saved(tmp_path):
    of = manifest((paper_member(hidden=(20, 12)),), components=4)
    arrays = random_arrays(of)
    del arrays["member_0.latent_radius"]
    with pytest.raises(ModelError, match=r"member_0\.latent_radius is missing"):
        save_model(tmp_path / "m", of, arrays, "card")
    assert not (tmp_path / "m").exists()
