# SPDX-License-Identifier: Apache-2.0
"""The golden sample of a model folder: a short synthetic input and what the model made of it where it was trained."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mild_core.inference.manifest import AUTO, Manifest
from mild_core.inference.motion_model import MildModel
from mild_core.inference.stage import Inference
from mild_core.shapes import FloatArray
from mild_core.signals import FeatureWindow

TOLERANCE = 1e-4
"""Three BLAS kernels and three compilers give three last digits of float32; anything worse is another model."""

OUTPUTS = ("positions", "covariance", "belief", "probability", "phase")


def synthetic_windows(model: MildModel) -> FloatArray:
    """(N, W, D) consecutive windows; synthetic, but close to the training data.

    They sway about the mean of the first `normalise` layer that takes whole windows, by a fifth of its scale: far
    from all components, last digits of float32 would grow into visible differences of the belief. A model without
    such a layer gets an arm of its bone lengths that sways. N is enough for each copy of what remembers to be used
    twice.
    """
    manifest = model.manifest
    count, shape = 2 * manifest.stride + 2, (manifest.window, manifest.frame_values)
    mean, scale = _hanging_arm(manifest), np.full(shape, 0.1)
    for name, network in model.members[0].networks.items():
        if manifest.members[0][name].inputs[0] == "window" and network.layers[0].kind == "normalise":
            size = network.layers[0].inputs
            mean = network.parameters[:size][: shape[0] * shape[1]].astype(np.float64).reshape(shape)
            scale = network.parameters[size : 2 * size][: shape[0] * shape[1]].astype(np.float64).reshape(shape)
            break
    frames = np.arange(count)[:, None, None] + np.arange(shape[0])[:, None]
    swaying: FloatArray = mean + 0.2 * scale * np.sin(4.0 * frames / manifest.rate_hz + np.arange(shape[1]))
    return swaying


def _hanging_arm(manifest: Manifest) -> FloatArray:
    """(W, D) of an arm that hangs down."""
    upper, fore = manifest.observed.bone_lengths_m
    row = np.zeros(manifest.frame_values)
    heights = [0.0, -upper] + [-upper - fore] * len(manifest.observed.joint_names)
    for joint in range(len(manifest.observed.joint_names)):
        row[3 * joint + 2] = heights[joint]
    return np.tile(row, (manifest.window, 1))


def replay(model: MildModel, windows: FloatArray) -> dict[str, FloatArray]:
    """What the model makes of consecutive windows: the last answer, for each interaction given and for "auto".

    Returns:
        By name of `OUTPUTS`, (P + 1, ...).
    """
    manifest = model.manifest
    answers: dict[str, list[FloatArray]] = {name: [] for name in OUTPUTS}
    for interaction in (*manifest.interactions, AUTO):
        stage = Inference(model, interaction)
        state = stage.init()
        for index, features in enumerate(windows):
            stamp_ns = 1_000_000_000 + round(index * 1e9 / manifest.rate_hz)
            window = FeatureWindow(stamp_ns, "", manifest.observed.joint_names, features)
            state, motions = stage.step(state, window, stamp_ns)
        for name in OUTPUTS:
            answers[name].append(np.asarray(getattr(motions[0], name), dtype=np.float64))
    return {name: np.stack(parts) for name, parts in answers.items()}


def make_golden(model: MildModel) -> dict[str, FloatArray]:
    """The arrays of `golden.npz`."""
    windows = synthetic_windows(model)
    return {"windows": windows, **replay(model, windows)}


def check_golden(model: MildModel, golden: Mapping[str, NDArray[Any]]) -> None:
    """Replay a golden sample.

    Raises:
        ValueError: It is no golden sample of this model, or the model answers otherwise by more than `TOLERANCE`.
    """
    manifest = model.manifest
    if set(golden) != {"windows", *OUTPUTS}:
        raise ValueError(f"holds {', '.join(sorted(golden))[:200]} instead of windows, {', '.join(OUTPUTS)}")
    windows = golden["windows"]
    fits = windows.ndim == 3 and windows.shape[1:] == (manifest.window, manifest.frame_values)
    if not fits or not 0 < len(windows) <= 1000 or windows.dtype.kind != "f" or not np.isfinite(windows).all():
        raise ValueError(f"windows {windows.dtype} {windows.shape} are none of this model")
    for name, answer in replay(model, windows.astype(np.float64)).items():
        expected = golden[name]
        if expected.shape != answer.shape or expected.dtype.kind != "f":
            raise ValueError(f"{name} has shape {expected.shape}, the model answers {answer.shape}")
        apart = float(abs(answer - expected).max())
        if not apart <= TOLERANCE:
            raise ValueError(f"{name} is off by {apart:.2g}, more than {TOLERANCE:g}: this is not what was trained")
