# SPDX-License-Identifier: Apache-2.0
"""The letters for array dimensions, used in every docstring, and the check at each public border.

T frames of a recording, W frames of a window, J joints, D features of a frame, Q latent dimensions of one
agent, Z latent dimensions of both agents, K components of a prior, B windows in a batch, S posterior samples.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def require_shape(name: str, array: NDArray[Any], shape: tuple[int | None, ...]) -> None:
    """Raise ValueError unless `array` has `shape`; None stands for any length.

    Source: the convention of the glossary above.
    """
    if array.shape == shape:
        return
    if len(array.shape) != len(shape) or any(s is not None and s != a for a, s in zip(array.shape, shape, strict=True)):
        wanted = "(" + ", ".join("any" if s is None else str(s) for s in shape) + ")"
        raise ValueError(f"{name} has shape {array.shape}, expected {wanted}")


def read_only(values: ArrayLike) -> FloatArray:
    """An immutable float64 array: `values` itself where it already is one, otherwise a copy."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and not values.flags.writeable:
        return values
    array: FloatArray = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array
