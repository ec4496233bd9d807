# SPDX-License-Identifier: Apache-2.0
"""The model folder: `manifest.json`, `weights.safetensors`, `golden.npz` and the model card `REPORT.md`.

A folder may come from anywhere, so nothing of it is trusted: no pickle, no file but these, bounded sizes, every array
checked by name, shape and value, and the golden sample replayed before anything moves.
"""

from __future__ import annotations

import hashlib
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_arrays
from safetensors.numpy import save as save_arrays

from mild_core.budgets import read_file, read_npz
from mild_core.errors import ModelError
from mild_core.inference.golden import check_golden, make_golden
from mild_core.inference.manifest import Manifest
from mild_core.inference.manifest_reading import read_manifest
from mild_core.inference.motion_model import Arrays, MildModel, build_model

__all__ = ["Manifest", "MildModel", "build_model", "load_model", "read_manifest", "save_model"]

WEIGHTS, GOLDEN, REPORT = "weights.safetensors", "golden.npz", "REPORT.md"
LARGEST_BYTES = {WEIGHTS: 256 << 20, GOLDEN: 64 << 20, REPORT: 4 << 20}
"""A shipped model has about one megabyte."""

RETRAIN = "take the folder as it was trained, or retrain it"


def load_model(folder: Path) -> MildModel:
    """Read a model folder, check all of it and replay its golden sample.

    Raises:
        ModelError: What is missing, broken, out of bounds, altered or answers otherwise than where it was trained.
    """
    manifest = read_manifest(folder)
    contents = {name: _checked_bytes(folder, name, manifest) for name in (WEIGHTS, GOLDEN)}
    try:
        arrays = load_arrays(contents[WEIGHTS])
    except (SafetensorError, ValueError, KeyError) as error:
        raise ModelError(str(folder / WEIGHTS), f"cannot be read ({error})", RETRAIN) from None
    try:
        model = build_model(manifest, arrays)
    except ModelError as error:
        raise ModelError(str(folder / WEIGHTS), error.problem, error.remedy) from None
    try:
        check_golden(model, _read_golden(contents[GOLDEN]))
    except ValueError as error:
        raise ModelError(str(folder / GOLDEN), str(error), RETRAIN) from None
    return model


def save_model(folder: Path, manifest: Manifest, arrays: Arrays, report: str) -> MildModel:
    """Write a model folder that `load_model` accepts.

    Args:
        folder: Made when it does not exist; files of these names are replaced.
        manifest: Its digests are filled in here.
        arrays: See `build_model`.
        report: The model card, Markdown.

    Returns:
        The model, read back from the folder.

    Raises:
        ModelError: The arrays do not fit the manifest.
    """
    stored = {name: np.ascontiguousarray(_stored(name, array)) for name, array in sorted(arrays.items())}
    model = build_model(manifest, stored)
    golden = io.BytesIO()
    np.savez_compressed(golden, **make_golden(model))  # type: ignore[arg-type]
    contents = {WEIGHTS: save_arrays(stored), GOLDEN: golden.getvalue(), REPORT: report.encode()}
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    (folder / "manifest.json").write_text(replace(manifest, sha256=digests).to_json())
    return load_model(folder)


def _stored(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """Networks in single precision, as they run, and matrices of what answers or judges beside them; else double."""
    network = name.startswith("member_") and ".prior." not in name and name.count(".") == 3
    single = network or (name.startswith(("territory.", "reservoir.")) and array.ndim >= 2)
    return np.asarray(array, dtype=np.float32 if single else np.float64)


def _checked_bytes(folder: Path, name: str, manifest: Manifest) -> bytes:
    """The content of one of the folder's files, once its size is bounded and its digest right."""
    path = folder / name
    if not path.exists():
        raise ModelError(str(path), "is missing", RETRAIN)
    content = read_file(path, LARGEST_BYTES[name], RETRAIN, ModelError)
    if name not in manifest.sha256:
        raise ModelError(str(folder / "manifest.json"), f"key 'sha256.{name}' is missing", RETRAIN)
    digest = hashlib.sha256(content).hexdigest()
    if digest != manifest.sha256[name]:
        problem = f"has SHA-256 {digest[:12]}..., the manifest says {manifest.sha256[name][:12]}...: it was altered"
        raise ModelError(str(path), problem, RETRAIN)
    return content


def _read_golden(content: bytes) -> dict[str, NDArray[Any]]:
    """The arrays of a golden sample; numbers only, and no more of them unpacked than a bounded size."""
    return read_npz(content, LARGEST_BYTES[GOLDEN])
