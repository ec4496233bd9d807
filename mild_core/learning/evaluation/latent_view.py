# SPDX-License-Identifier: Apache-2.0
"""What goes on in the latent spaces of a trained model while it watches a trial: for figures, not for learning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.inference.member import MemberState, compile_member
from mild_core.inference.motion_model import MildModel
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol, cut
from mild_core.shapes import FloatArray, read_only


@dataclass(frozen=True, eq=False)
class LatentTrack:
    """One trial in the latent spaces of one member.

    Attributes:
        interaction: Which it was, as given to the model.
        observed: (N, Q) posterior mean of each window of the human.
        controlled: (N, C) what the prior expects of the other agent's latent, mixed by the belief.
        weights: (N, K) that belief over components.
    """

    interaction: str
    observed: FloatArray
    controlled: FloatArray
    weights: FloatArray


def latent_track(model: MildModel, demonstration: Demonstration, protocol: Protocol, member: int = 0) -> LatentTrack:
    """Follow a trial with the interaction given, as `Inference` does.

    Args:
        model: A trained model.
        demonstration: The trial.
        protocol: The model's.
        member: Whose latent spaces.
    """
    manifest = model.manifest
    number = manifest.interactions.index(demonstration.interaction)
    ready = compile_member(model.members[member], number, model.residual_covariance)
    stride = manifest.stride
    states, rows = [ready.init()] * stride, []
    for index, features in enumerate(cut(demonstration, protocol).observed):
        copy = index % stride
        seen = ready.observe(states[copy], read_only(features), 0 if index >= stride else -1)
        states[copy] = MemberState(seen.context_memory, seen.memory)
        rows.append((seen.latent, seen.weights @ seen.means, seen.weights))
    observed, controlled, beliefs = (np.array(part) for part in zip(*rows, strict=True))
    return LatentTrack(demonstration.interaction, observed, controlled, beliefs)
