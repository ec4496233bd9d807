# SPDX-License-Identifier: Apache-2.0
"""The average demonstration, played open loop from the first frame: what looking at the human must beat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mild_core.learning.data.baseline import Baseline, by_interaction
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, thin
from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class TimeIndexedMean:
    """Mean motion (T, J) [rad] of each interaction at the protocol's rate."""

    protocol: Protocol
    mean: Mapping[str, FloatArray]

    def predict(self, demonstration: Demonstration) -> FloatArray:
        """The frames of the mean motion at the time of the answer; its last pose when it is over."""
        frames = thin(demonstration, self.protocol).frames
        windows, width = self.protocol.windows_of(frames), self.protocol.window
        motion = self.mean[demonstration.interaction]
        motion = motion[np.minimum(np.arange(frames), len(motion) - 1)]
        first = width - 1 + self.protocol.lead_frames
        return np.moveaxis(sliding_window_view(motion, width, axis=0), -1, 1)[first : first + windows]


def _mean_motion(demonstrations: Sequence[Demonstration], protocol: Protocol) -> FloatArray:
    """Mean over trials in each frame; a trial that is over stands in its last pose."""
    motions = [thin(demonstration, protocol).controlled for demonstration in demonstrations]
    frames = np.arange(max(len(motion) for motion in motions))
    mean: FloatArray = np.mean([motion[np.minimum(frames, len(motion) - 1)] for motion in motions], axis=0)
    return mean


def fit(demonstrations: Sequence[Demonstration], protocol: Protocol, seed: int) -> TimeIndexedMean:
    """Average the trials of an interaction frame by frame (see `Fit`)."""
    groups = by_interaction(demonstrations).items()
    return TimeIndexedMean(protocol, {name: _mean_motion(part, protocol) for name, part in groups})


TIME_INDEXED_MEAN = Baseline("time_indexed_mean", "mean motion", fit, seeded=False)
