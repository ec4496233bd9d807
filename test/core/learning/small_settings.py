# SPDX-License-Identifier: Apache-2.0
"""The shipped and the paper's way to train, small enough for a test."""

from dataclasses import replace

from mild_core.learning.training.presets import PAPER, SAME
from mild_core.learning.training.settings import Architecture, Augmentation, PriorSettings, ReservoirSettings

TWO = ("reach", "push")

SMALL = replace(
    SAME,
    architecture=replace(
        SAME.architecture, latent=2, question_coordinates=4, answer_coordinates=3, context_hidden=8, memory=8
    ),
    prior=replace(SAME.prior, components=3, every=2, iterations=2),
    augmentation=replace(SAME.augmentation or Augmentation(), copies=1),
    reservoir=ReservoirSettings(count=1, units=20, sources=4),
    epochs=8,
    members=1,
)
SMALL_PAPER = replace(
    PAPER,
    architecture=replace(PAPER.architecture, latent=2, encoder_hidden=(16, 8), decoder_hidden=(8, 16)),
    prior=PriorSettings(components=3, every=1, iterations=1, frozen_from=1.0),
    epochs=6,
    observed_share=1 / 3,
    samples=2,
)
SMALL_PAPER = replace(SMALL_PAPER, architecture=replace(SMALL_PAPER.architecture, counterpart_hidden=(16, 8)))
PLAIN = Architecture(context=(), encoder=("window",), residual=(), decoder=("controlled",))
