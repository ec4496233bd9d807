# SPDX-License-Identifier: Apache-2.0
"""What may be set of inference. What a model was trained with comes from its folder."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.inference.manifest import AUTO
from mild_core.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class InferenceSettings:
    """What is asked of a model."""

    interaction: str = parameter(AUTO, "An interaction of the model, or `auto` to recognise it.")
    cautious: bool = parameter(
        False, "Start by the name of an interaction alone, and on more evidence: fewer false starts, later ones."
    )
