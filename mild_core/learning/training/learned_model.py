# SPDX-License-Identifier: Apache-2.0
"""Training as a method of the table: learned by torch, measured as it runs on the robot."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mild_core.inference.model import build_model
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol
from mild_core.learning.training.algorithm import EpochReport, train
from mild_core.learning.training.export import ModelFacts, export
from mild_core.learning.training.model_predictor import ModelPredictor
from mild_core.learning.training.settings import TrainingSettings
from mild_core.learning.training.trained import TrainedModel


def finished(epochs: Generator[EpochReport, None, TrainedModel]) -> TrainedModel:
    """Run a training to its end, its reports unread."""
    while True:
        try:
            next(epochs)
        except StopIteration as end:
            trained: TrainedModel = end.value
            return trained


def learn(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    settings: TrainingSettings,
    seed: int,
    start: Mapping[str, NDArray[Any]] | None = None,
) -> ModelPredictor:
    """Train a model and put it behind the run-time stage.

    Args:
        demonstrations: To learn from.
        protocol: How windows are cut.
        settings: How to train.
        seed: Of all draws.
        start: Layers of another model to start from, see `transfer_layers`.
    """
    trained = finished(train(demonstrations, protocol, settings, seed, start=start))
    joints = demonstrations[0].controlled[0].size
    # Predictions do not depend on the residual covariance, and its measurement is what this training may be for.
    manifest, arrays = export(trained, demonstrations, np.eye(joints), ModelFacts("cross_validated"))
    return ModelPredictor(build_model(manifest, arrays), protocol)
