# SPDX-License-Identifier: Apache-2.0
"""Networks: one list of layers, plain data, run by one compiled function for every model.

Nothing here knows of torch. What was learned there arrives as arrays by the names of the layers; a golden sample in
each model folder shows that both compute the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mild_core.compiled import compiled

Float32Array = NDArray[np.float32]

LAYERS: dict[str, dict[str, str]] = {
    "dense": {"weight": "io", "bias": "o"},
    "gru": {"weight_input": "ig", "weight_hidden": "og", "bias_input": "g", "bias_hidden": "g"},
    "normalise": {"mean": "i", "scale": "i"},
    "denormalise": {"mean": "i", "scale": "i"},
}
"""Kinds of layers, and for each its arrays with their axes: i inputs, o outputs, g three times the outputs."""

ACTIVATIONS = ("identity", "leaky_relu", "tanh", "relu", "sigmoid")
LEAK = np.float32(0.01)
"""Slope of leaky_relu below zero: torch's default."""

ONE = np.float32(1.0)
DENSE, GRU, NORMALISE, DENORMALISE = range(4)


@dataclass(frozen=True)
class LayerSpec:
    """One layer as the manifest writes it.

    Attributes:
        kind: A name of `LAYERS`. `dense`: x W + b, then the activation. `gru`: a cell with memory, its output is its
            new memory. `normalise`: (x - mean) / scale. `denormalise`: x scale + mean.
        name: Its arrays are `<network>.<name>.<array>`.
        inputs: Number of values in.
        outputs: Number of values out.
        activation: One of `ACTIVATIONS`, for `dense`.

    Raises:
        ValueError: When a word is unknown or a number is out of bounds.
    """

    kind: str
    name: str
    inputs: int
    outputs: int
    activation: str = "identity"

    def __post_init__(self) -> None:
        if self.kind not in LAYERS:
            raise ValueError(f"layer kind '{self.kind}' is unknown; use one of {', '.join(LAYERS)}")
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"activation '{self.activation}' is unknown; use one of {', '.join(ACTIVATIONS)}")
        if not (0 < self.inputs <= 8192 and 0 < self.outputs <= 8192):
            raise ValueError(f"layer '{self.name}' has {self.inputs} inputs and {self.outputs} outputs, not 1..8192")
        if self.kind in ("normalise", "denormalise") and self.inputs != self.outputs:
            raise ValueError(f"layer '{self.name}' of kind {self.kind} has as many outputs as inputs")
        if self.kind != "dense" and self.activation != "identity":
            raise ValueError(f"layer '{self.name}' of kind {self.kind} takes no activation")

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of each of its arrays by name."""
        sizes = {"i": self.inputs, "o": self.outputs, "g": 3 * self.outputs}
        return {array: tuple(sizes[axis] for axis in axes) for array, axes in LAYERS[self.kind].items()}


@dataclass(frozen=True, eq=False)
class Network:
    """A chain of layers with their parameters.

    Attributes:
        layers: In order; the outputs of one are the inputs of the next.
        program: (layers, 6) int64: kind, inputs, outputs, activation, first parameter, first value of memory.
        parameters: All arrays in one, float32.
        memory_size: Values that the cells remember between two runs.
    """

    layers: tuple[LayerSpec, ...]
    program: NDArray[np.int64]
    parameters: Float32Array
    memory_size: int

    @property
    def inputs(self) -> int:
        """Number of values in."""
        return self.layers[0].inputs

    @property
    def outputs(self) -> int:
        """Number of values out."""
        return self.layers[-1].outputs

    def first_memory(self) -> Float32Array:
        """What the cells remember before the first run: zeros."""
        return np.zeros(self.memory_size, dtype=np.float32)

    def run(self, values: Float32Array, memory: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Push values through all layers.

        Args:
            values: (inputs,) float32.
            memory: (memory_size,) from the run before, left unchanged.

        Returns:
            The outputs (outputs,) and the new memory.
        """
        after = memory.copy()
        return run_layers(self.program, self.parameters, values, after), after

    def jacobian(self, values: Float32Array, columns: range) -> NDArray[np.float64]:
        """(outputs, len(columns)) derivatives by some of the values, by central differences of this very function.

        The networks are piecewise linear or smooth on a scale of one, and computed to 1e-7: a step of 0.01 is good
        to about 1e-4, which is plenty for a covariance.
        """
        derivatives = np.zeros((self.outputs, len(columns)))
        for place, column in enumerate(columns):
            ends = []
            for step in (0.01, -0.01):
                moved = values.copy()
                moved[column] += np.float32(step)
                ends.append(self.run(moved, self.first_memory())[0].astype(np.float64))
            derivatives[:, place] = (ends[0] - ends[1]) / 0.02
        return derivatives


def build_network(layers: Sequence[LayerSpec], arrays: Mapping[str, NDArray[Any]], prefix: str) -> Network:
    """Put layers and their arrays together.

    Args:
        layers: In order.
        arrays: Holds `<prefix>.<layer>.<array>` for each.
        prefix: What the names begin with, `member_0.encoder` for instance.

    Raises:
        ValueError: When layers do not fit each other, or an array is missing, of another shape or not finite.
    """
    if not layers:
        raise ValueError(f"{prefix} has no layers")
    rows: list[tuple[int, ...]] = []
    parts: list[Float32Array] = []
    memory = 0
    for index, layer in enumerate(layers):
        if index and layer.inputs != layers[index - 1].outputs:
            before = layers[index - 1]
            raise ValueError(
                f"{prefix}: '{layer.name}' takes {layer.inputs}, '{before.name}' before gives {before.outputs}"
            )
        first = sum(part.size for part in parts)
        kind = list(LAYERS).index(layer.kind)
        rows.append((kind, layer.inputs, layer.outputs, ACTIVATIONS.index(layer.activation), first, memory))
        memory += layer.outputs if layer.kind == "gru" else 0
        parts += [_array(arrays, f"{prefix}.{layer.name}.{name}", shape) for name, shape in layer.shapes().items()]
    parameters = np.concatenate([part.ravel() for part in parts])
    program = np.array(rows, dtype=np.int64)
    for array in (parameters, program):
        array.flags.writeable = False
    return Network(tuple(layers), program, parameters, memory)


def _array(arrays: Mapping[str, NDArray[Any]], name: str, shape: tuple[int, ...]) -> Float32Array:
    if name not in arrays:
        raise ValueError(f"array {name} is missing")
    array = np.asarray(arrays[name], dtype=np.float32)
    if array.shape != shape:
        raise ValueError(f"array {name} has shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"array {name} holds values that are not finite")
    if name.endswith(".scale") and not (abs(array) > 1e-12).all():
        raise ValueError(f"array {name} holds a scale of zero")
    return array


@compiled
def dense(parameters: Float32Array, first: int, values: Float32Array, outputs: Float32Array, bias: int) -> None:
    """Fill `outputs` with values W + b; W lies row by row from parameter `first` on, b from parameter `bias` on.

    Four rows at a time, in a fixed order: sums run over whole vectors of outputs, which needs no reordering.
    """
    inputs, size = values.shape[0], outputs.shape[0]
    for j in range(size):
        outputs[j] = parameters[bias + j]
    whole = inputs - inputs % 4
    for i in range(0, whole, 4):
        row = first + i * size
        w0, w1 = parameters[row : row + size], parameters[row + size : row + 2 * size]
        w2, w3 = parameters[row + 2 * size : row + 3 * size], parameters[row + 3 * size : row + 4 * size]
        x0, x1, x2, x3 = values[i], values[i + 1], values[i + 2], values[i + 3]
        for j in range(size):
            outputs[j] += (x0 * w0[j] + x1 * w1[j]) + (x2 * w2[j] + x3 * w3[j])
    for i in range(whole, inputs):
        w0, x0 = parameters[first + i * size : first + (i + 1) * size], values[i]
        for j in range(size):
            outputs[j] += x0 * w0[j]


@compiled
def activate(kind: int, values: Float32Array) -> None:
    """Apply an activation, a place in `ACTIVATIONS`, to each value in place."""
    if kind == 0:
        return
    for i in range(values.shape[0]):
        value = values[i]
        if kind == 1 and value < 0.0:
            values[i] = LEAK * value
        elif kind == 2:
            values[i] = np.tanh(value)
        elif kind == 3 and value < 0.0:
            values[i] = 0.0
        elif kind == 4:
            values[i] = ONE / (ONE + np.exp(-value))


@compiled
def remember(
    parameters: Float32Array, first: int, values: Float32Array, memory: Float32Array, place: int, after: Float32Array
) -> None:
    """One step of a gated recurrent unit whose memory (H,) begins at `place`; `after` (H,) is filled with the new one.

    Source: Cho et al. (2014) in torch's form: gates in the order reset, update, new; the reset gate acts on
        W h + b.
    """
    size = after.shape[0]
    from_input, from_memory = np.empty(3 * size, dtype=np.float32), np.empty(3 * size, dtype=np.float32)
    second = first + values.shape[0] * 3 * size
    bias = second + size * 3 * size
    for j in range(size):
        after[j] = memory[place + j]
    dense(parameters, first, values, from_input, bias)
    dense(parameters, second, after, from_memory, bias + 3 * size)
    for j in range(size):
        reset = ONE / (ONE + np.exp(-from_input[j] - from_memory[j]))
        update = ONE / (ONE + np.exp(-from_input[size + j] - from_memory[size + j]))
        new = np.tanh(from_input[2 * size + j] + reset * from_memory[2 * size + j])
        after[j] = (ONE - update) * new + update * after[j]
        memory[place + j] = after[j]


@compiled
def run_layers(
    program: NDArray[np.int64], parameters: Float32Array, values: Float32Array, memory: Float32Array
) -> Float32Array:
    """Run a program of layers; `memory` is changed in place."""
    current = values
    for layer in range(program.shape[0]):
        kind, inputs, size, activation = program[layer, 0], program[layer, 1], program[layer, 2], program[layer, 3]
        first, place = program[layer, 4], program[layer, 5]
        after = np.empty(size, dtype=np.float32)
        if kind == DENSE:
            dense(parameters, first, current, after, first + inputs * size)
            activate(activation, after)
        elif kind == GRU:
            remember(parameters, first, current, memory, place, after)
        elif kind == NORMALISE:
            for i in range(size):
                after[i] = (current[i] - parameters[first + i]) / parameters[first + size + i]
        else:
            for i in range(size):
                after[i] = current[i] * parameters[first + size + i] + parameters[first + i]
        current = after
    return current
