# SPDX-License-Identifier: Apache-2.0
"""Whether a person does any known interaction: how far they have lately been from where each one's windows lie.

One frame is weak evidence, since a handshake passes through places where a fist bump has been too. A person who does a
known interaction stays near the windows of that one interaction all the while.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mild_core.shapes import FloatArray, read_only

TakeArray = Callable[[str, tuple[int | None, ...]], FloatArray]
"""(name, shape) -> a finite array of that shape, or ValueError."""


@dataclass(frozen=True, eq=False)
class NoveltyDetector:
    """Where the windows of each interaction lie.

    Attributes:
        weight: (W D, F) from a window to coordinates.
        bias: (F,).
        centres: (M, F) means of clusters of windows.
        owners: (M,) number of the interaction whose windows a cluster holds, rising from 0.
        reach: Root of the largest mean squared distance that people should have from their interaction.
        kept: Share of that mean that is left from one frame to the next.

    Raises:
        ValueError: Its parts do not belong together.
    """

    weight: FloatArray
    bias: FloatArray
    centres: FloatArray
    owners: FloatArray
    reach: float
    kept: float

    def __post_init__(self) -> None:
        steps = np.diff(self.owners, prepend=-1.0, append=self.owners[-1:] + 1.0)
        if not (len(self.owners) and np.isin(steps, (0.0, 1.0)).all() and self.owners[0] == 0.0):
            raise ValueError("array territory.owners does not number the interactions in order")
        if not (self.reach > 0.0 and 0.0 <= self.kept < 1.0):
            raise ValueError("array territory.scale holds no reach above zero and no share of one")

    @cached_property
    def _first(self) -> tuple[list[int], FloatArray]:
        """Number of the first cluster of each interaction, and the squared norms of all centres."""
        first = np.flatnonzero(np.diff(self.owners, prepend=-1.0)).tolist()
        return first, (self.centres**2).sum(axis=1)

    def init(self) -> FloatArray:
        """(P,) initial score: no novelty yet."""
        return read_only(np.zeros(len(self._first[0])))

    def follow(self, novelty: FloatArray, window: FloatArray) -> FloatArray:
        """Take one window.

        Args:
            novelty: (P,) fading mean of the squared distances from each interaction, in units of `reach` squared.
            window: (W, D) features.

        Returns:
            (P,) the same with this window.
        """
        first, norms = self._first
        point = window.ravel() @ self.weight + self.bias
        squares = norms - self.centres @ (2.0 * point) + point @ point
        nearest = np.minimum.reduceat(squares, first)
        return read_only(self.kept * novelty + ((1.0 - self.kept) / self.reach**2) * np.maximum(nearest, 0.0))

    def score(self, novelty: FloatArray) -> float:
        """Root mean squared distance from the interaction that is nearest on the whole; above 1 it is none of them."""
        return float(np.sqrt(novelty.min()))

    def to_arrays(self) -> dict[str, FloatArray]:
        """What `take_novelty_detector` takes."""
        arrays = {"weight": self.weight, "bias": self.bias, "centres": self.centres, "owners": self.owners}
        return {f"territory.{name}": a for name, a in arrays.items()} | {
            "territory.scale": np.array([self.reach, self.kept])
        }


def take_novelty_detector(take: TakeArray, window_values: int, interactions: int) -> NoveltyDetector:
    """Put a territory together from a model's arrays.

    Raises:
        ValueError: One is missing, has another shape, or they do not belong together.
    """
    weight = take("territory.weight", (window_values, None))
    centres = take("territory.centres", (None, weight.shape[1]))
    owners = take("territory.owners", (len(centres),))
    reach, kept = take("territory.scale", (2,)).tolist()
    if len(set(owners.tolist())) != interactions:
        raise ValueError("array territory.owners does not name every interaction")
    return NoveltyDetector(weight, take("territory.bias", weight.shape[1:]), centres, owners, reach, kept)
