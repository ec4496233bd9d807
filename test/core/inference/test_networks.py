# SPDX-License-Identifier: Apache-2.0
"""Layers against their formulas in double precision."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.inference.networks import ACTIVATIONS, LayerSpec, build_network

SINGLE = 2e-6  # Sums of some dozen products of order one in single precision.


def sigmoid(x):
    return 1.0 / (1.0 + np.exp(-x))


FORMULAS = {
    "identity": lambda x: x,
    "leaky_relu": lambda x: np.where(x > 0.0, x, 0.01 * x),
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "sigmoid": sigmoid,
}


def arrays_for(layers, seed=0):
    rng = np.random.default_rng(seed)
    return {
        f"n.{layer.name}.{name}": rng.normal(0.0, 0.5, shape) + (2.0 if name == "scale" else 0.0)
        for layer in layers
        for name, shape in layer.shapes().items()
    }


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("inputs", [1, 4, 11])
def test_dense_and_scaling_layers_are_their_formulas(activation, inputs):
    layers = (
        LayerSpec("normalise", "before", inputs, inputs),
        LayerSpec("dense", "middle", inputs, 7, activation),
        LayerSpec("denormalise", "after", 7, 7),
    )
    arrays = arrays_for(layers)
    network = build_network(layers, arrays, "n")
    values = np.random.default_rng(1).normal(size=inputs).astype(np.float32)
    x = (values - arrays["n.before.mean"]) / arrays["n.before.scale"]
    x = FORMULAS[activation](x @ arrays["n.middle.weight"] + arrays["n.middle.bias"])
    expected = x * arrays["n.after.scale"] + arrays["n.after.mean"]
    found, memory = network.run(values, network.first_memory())
    np.testing.assert_allclose(found, expected, atol=SINGLE)
    assert memory.shape == (0,)
    assert found.dtype == np.float32


def test_two_gated_cells_remember_apart_and_leave_the_given_memory_alone():
    layers = (LayerSpec("gru", "first", 3, 4), LayerSpec("gru", "second", 4, 5))
    arrays = arrays_for(layers, 2)
    network = build_network(layers, arrays, "n")
    hidden = [np.zeros(4), np.zeros(5)]
    memory = network.first_memory()
    for step in range(6):
        values = np.random.default_rng(step).normal(size=3).astype(np.float32)
        before = memory.copy()
        found, after = network.run(values, memory)
        np.testing.assert_array_equal(memory, before)
        x = values.astype(np.float64)
        for place, name in enumerate(("first", "second")):
            size, h = len(hidden[place]), hidden[place]
            a = x @ arrays[f"n.{name}.weight_input"] + arrays[f"n.{name}.bias_input"]
            b = h @ arrays[f"n.{name}.weight_hidden"] + arrays[f"n.{name}.bias_hidden"]
            reset, update = sigmoid(a[:size] + b[:size]), sigmoid(a[size : 2 * size] + b[size : 2 * size])
            new = np.tanh(a[2 * size :] + reset * b[2 * size :])
            x = hidden[place] = (1.0 - update) * new + update * h
        np.testing.assert_allclose(found, x, atol=SINGLE)
        np.testing.assert_allclose(after, np.concatenate(hidden), atol=SINGLE)
        memory = after


def test_jacobian_is_that_of_the_formula():
    layers = (LayerSpec("dense", "one", 5, 8, "tanh"), LayerSpec("dense", "two", 8, 6))
    arrays = arrays_for(layers, 3)
    values = np.random.default_rng(4).normal(size=5).astype(np.float32)
    slope = 1.0 - np.tanh(values @ arrays["n.one.weight"] + arrays["n.one.bias"]) ** 2
    expected = ((arrays["n.one.weight"] * slope) @ arrays["n.two.weight"]).T
    found = build_network(layers, arrays, "n").jacobian(values, range(1, 4))
    # Central differences with a step of 0.01 in single precision: 1e-4 from curvature, as much from rounding.
    np.testing.assert_allclose(found, expected[:, 1:4], atol=5e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda arrays: arrays.pop("n.one.bias"), "n.one.bias is missing"),
        (lambda arrays: arrays.update({"n.one.bias": np.zeros(3)}), "n.one.bias has shape"),
        (lambda arrays: arrays["n.one.weight"].__setitem__((0, 0), np.nan), "n.one.weight holds values"),
        (lambda arrays: arrays["n.in.scale"].__setitem__(0, 0.0), "n.in.scale holds a scale of zero"),
    ],
)
def test_wrong_arrays_are_named(change, words):
    layers = (LayerSpec("normalise", "in", 2, 2), LayerSpec("dense", "one", 2, 2))
    arrays = arrays_for(layers)
    change(arrays)
    with pytest.raises(ValueError, match=words):
        build_network(layers, arrays, "n")


@pytest.mark.parametrize(
    "values",
    [
        ("convolution", "a", 1, 1),
        ("dense", "a", 1, 1, "gelu"),
        ("dense", "a", 0, 1),
        ("normalise", "a", 2, 3),
        ("gru", "a", 2, 3, "tanh"),
    ],
)
def test_layers_that_cannot_be_are_refused(values):
    with pytest.raises(ValueError, match=r"layer|activation"):
        LayerSpec(*values)


def test_layers_that_do_not_fit_each_other_are_refused():
    layers = (LayerSpec("dense", "one", 2, 3), LayerSpec("dense", "two", 4, 2))
    with pytest.raises(ValueError, match="'two' takes 4, 'one' before gives 3"):
        build_network(layers, arrays_for(layers), "n")
