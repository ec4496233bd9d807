# SPDX-License-Identifier: Apache-2.0
"""The coordinates in which networks see and give windows: principal components, or the values themselves."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

LEAST_DEVIATION = 1e-3
"""Share of the first component's deviation below which a component is noise that whitening must not blow up."""


@dataclass(frozen=True, eq=False)
class Coordinates:
    """A linear map of windows to n numbers of a size that networks like, and back.

    Attributes:
        mean: (F,) of the windows.
        directions: (F, n) orthonormal; None: the F values themselves, untouched.
        scale: (n,) what each coordinate is divided by.
        errors: (n,) weight of a squared error in each coordinate, so that their weighted sum is the squared error of
            the window within the span of `directions`, as a share of the windows' variance.
    """

    mean: Tensor
    directions: Tensor | None
    scale: Tensor
    errors: Tensor

    @property
    def size(self) -> int:
        """n."""
        return len(self.scale)

    def project(self, windows: Tensor) -> Tensor:
        """(..., F) -> (..., n)."""
        if self.directions is None:
            return windows
        directions = self.directions / self.scale
        return windows @ directions - self.mean @ directions

    def restore(self, coordinates: Tensor) -> Tensor:
        """(..., n) -> (..., F), what of the windows lies in their span."""
        if self.directions is None:
            return coordinates
        return (coordinates * self.scale) @ self.directions.T + self.mean


def plain_coordinates(windows: Tensor) -> Coordinates:
    """The F values of windows (N, F) as they are."""
    width = windows.shape[1]
    variance = windows.to(torch.float64).var(dim=0, correction=0).sum()
    return Coordinates(torch.zeros(width), None, torch.ones(width), torch.full((width,), 1.0 / float(variance)))


def principal_coordinates(windows: Tensor, count: int, whitening: float) -> Coordinates:
    """The first principal components of windows.

    Args:
        windows: (N, F).
        count: n.
        whitening: 0 divides all by the deviation of the first, 1 each by its own, between: geometrically between.
    """
    mean = windows.mean(dim=0)
    centred = (windows - mean).to(torch.float64)
    values, vectors = torch.linalg.eigh(centred.T @ centred / len(windows))
    directions = vectors.flip(1)[:, :count]
    # The sign of an eigenvector is the library's whim: fix it, so that equal data give equal networks everywhere.
    largest = directions.abs().argmax(dim=0)
    directions = directions * torch.sign(directions[largest, torch.arange(directions.shape[1])])
    deviations = values.flip(0)[:count].clamp(min=0.0).sqrt()
    deviations = deviations.clamp(min=LEAST_DEVIATION * float(deviations[0]))
    scale = deviations**whitening * deviations[0] ** (1.0 - whitening)
    errors = scale**2 / values.sum()
    return Coordinates(mean, directions.float(), scale.float(), errors.float())
