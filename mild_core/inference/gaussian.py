# SPDX-License-Identifier: Apache-2.0
"""Gaussians as values, one or a batch of them in the leading axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.shapes import FloatArray, read_only

LOG_TWO_PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class Gaussian:
    """One normal distribution, or a batch of them.

    Attributes:
        mean: (..., Z).
        covariance: (..., Z, Z), symmetric and positive definite (or zero, for a point).

    Raises:
        ValueError: When the two shapes do not belong together.
    """

    mean: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", read_only(self.mean))
        object.__setattr__(self, "covariance", read_only(self.covariance))
        if self.mean.ndim < 1 or self.covariance.shape != (*self.mean.shape, self.mean.shape[-1]):
            raise ValueError(f"mean {self.mean.shape} and covariance {self.covariance.shape} do not belong together")
