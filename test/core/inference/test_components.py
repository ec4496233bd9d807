# SPDX-License-Identifier: Apache-2.0
"""What each component of a prior expects by itself, for people who look on."""

from __future__ import annotations

import numpy as np

from mild_core.inference.stage import Inference
from test.core.inference.test_stage import CLOSE, ByHand, posterior, run, windows


def test_each_component_alone_expects_its_own_conditional_and_nothing_is_remembered(paper_model):
    by_hand, stage = ByHand(paper_model, 0, 2), Inference(paper_model, "rocket")
    *before, last = windows(5)
    state, _ = run(stage, before)
    _, (mixed,) = stage.step(state, last, 0)
    motions = stage.by_component(state, last)
    latents = by_hand.prior.explain(*posterior(by_hand.run("encoder", {"window": last.features})[0])).conditioned.mean
    assert len(motions) == len(latents) == len(mixed.belief)
    for number, (motion, latent) in enumerate(zip(motions, latents, strict=True)):
        alone = np.eye(len(latents))[number]
        expected = by_hand.run("decoder", {"controlled": latent, "belief": alone})[0].reshape(40, 7)
        np.testing.assert_allclose(motion.positions, expected, atol=CLOSE)
        np.testing.assert_array_equal(motion.belief, alone)
    _, (again,) = stage.step(state, last, 0)
    np.testing.assert_array_equal(again.positions, mixed.positions)
