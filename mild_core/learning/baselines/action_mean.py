# SPDX-License-Identifier: Apache-2.0
"""The pose a robot takes on average in an interaction: what ignoring the human and time costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.learning.data.baseline import Baseline, by_interaction
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, thin
from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class ActionMean:
    """Mean pose (J,) [rad] of each interaction."""

    protocol: Protocol
    mean: Mapping[str, FloatArray]

    def predict(self, demonstration: Demonstration) -> FloatArray:
        """The same pose in every frame of every window (see `Predictor`)."""
        windows = self.protocol.windows_of(thin(demonstration, self.protocol).frames)
        pose = self.mean[demonstration.interaction]
        return np.broadcast_to(pose, (windows, self.protocol.window, *pose.shape))


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> ActionMean:
    """Average all frames of an interaction (see `Fit`)."""
    groups = by_interaction(demonstrations).items()
    return ActionMean(protocol, {name: np.concatenate([d.controlled for d in part]).mean(0) for name, part in groups})


ACTION_MEAN = Baseline("action_mean", "mean pose", fit, seeded=False)
