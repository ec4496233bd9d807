# SPDX-License-Identifier: Apache-2.0
"""A radial-basis-function network: the controlled agent's window straight from the human's, beside the members.

Its centres are means of clusters of windows, its weights the solution of one linear system: it knows nothing of phases
and errs in other ways than the members do, so that the mean of both errs less than either.

Source: Poggio, Girosi, "Networks for approximation and learning", Proc. IEEE 78 (1990).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mild_core.inference.territory import TakeArray
from mild_core.shapes import FloatArray, read_only

NAMES = ("weight", "bias", "centres", "owners", "width", "coefficients", "offsets", "back", "mean", "share")


@dataclass(frozen=True, eq=False)
class RadialBasis:
    """The network of all interactions.

    Attributes:
        weight: (W D + T 3 J, F) from a window and the past to coordinates.
        bias: (F,).
        centres: (M, F).
        owners: (M,) number of the interaction whose centre it is.
        width: (1,) squared distance from a centre at which its height has fallen to 1/e.
        coefficients: (M, A) from heights to coordinates of the answer.
        offsets: (P, A) answer of each interaction far from all its centres.
        back: (A, W N) from coordinates to the controlled agent's window.
        mean: (W N,) of those windows.
        share: (1,) that its answer has beside the members'.

    Raises:
        ValueError: Its parts do not belong together.
    """

    weight: FloatArray
    bias: FloatArray
    centres: FloatArray
    owners: FloatArray
    width: FloatArray
    coefficients: FloatArray
    offsets: FloatArray
    back: FloatArray
    mean: FloatArray
    share: FloatArray

    def __post_init__(self) -> None:
        if not np.isin(self.owners, np.arange(len(self.offsets))).all():
            raise ValueError("array radial_basis.owners does not number interactions")
        if not (self.width[0] > 0.0 and 0.0 < self.share[0] <= 1.0):
            raise ValueError("array radial_basis.width or .share is no width above zero or no share of one")

    @cached_property
    def _ready(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Twice the centres, their squared norms, and which interaction each belongs to, (M, P)."""
        return 2.0 * self.centres, (self.centres**2).sum(axis=1), np.eye(len(self.offsets))[self.owners.astype(int)]

    def answer(self, window: FloatArray, past: FloatArray, label: FloatArray) -> FloatArray:
        """(W N,) expected window of the controlled agent [rad or m].

        Args:
            window: (W, D) features.
            past: (T, 3 J) see `past.fade`.
            label: (P,) probability of each interaction.
        """
        doubled, norms, owned = self._ready
        point = np.concatenate([window.ravel(), past.ravel()]) @ self.weight + self.bias
        squares = np.maximum(norms - doubled @ point + point @ point, 0.0)
        heights = np.exp(-squares / self.width[0]) * (owned @ label)
        answer: FloatArray = (heights @ self.coefficients + label @ self.offsets) @ self.back + self.mean
        return answer

    def blend(self, motion: FloatArray, covariance: FloatArray, answer: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The members' window (W, N) and `answer`, each with its share, and the covariance (N, N) of both.

        That also holds how far they disagree.
        """
        share, apart = self.share[0], answer.reshape(motion.shape) - motion
        return motion + share * apart, covariance + share * (1.0 - share) * apart.T @ apart / len(apart)

    def to_arrays(self) -> dict[str, FloatArray]:
        """What `take_radial_basis` takes."""
        return {f"radial_basis.{name}": getattr(self, name) for name in NAMES}


def take_radial_basis(take: TakeArray, question_values: int, answer_values: int, interactions: int) -> RadialBasis:
    """Put a network together from a model's arrays.

    Raises:
        ValueError: One is missing, has another shape, or they do not belong together.
    """
    weight = take("radial_basis.weight", (question_values, None))
    back = take("radial_basis.back", (None, answer_values))
    centres = take("radial_basis.centres", (None, weight.shape[1]))
    shapes: dict[str, tuple[int | None, ...]] = {
        "bias": weight.shape[1:],
        "owners": (len(centres),),
        "width": (1,),
        "coefficients": (len(centres), len(back)),
        "offsets": (interactions, len(back)),
        "mean": (answer_values,),
        "share": (1,),
    }
    taken = {name: read_only(take(f"radial_basis.{name}", shape)) for name, shape in shapes.items()}
    return RadialBasis(weight=weight, centres=centres, back=back, **taken)
