# SPDX-License-Identifier: Apache-2.0
"""Under which licences the data stand that a model learned from."""

from __future__ import annotations

from collections.abc import Iterable

from mild_core.inference.manifest import Manifest
from mild_core.learning.datasets import DATASETS

NOASSERTION = "NOASSERTION"
"""SPDX's word for an unknown licence."""


def both(expressions: Iterable[str]) -> str:
    """The SPDX expression of what all of these bind together, each licence once."""
    parts = [part for one in expressions for part in (one or NOASSERTION).split(" AND ")]
    return " AND ".join(dict.fromkeys(parts)) or NOASSERTION


def sources_of(manifest: Manifest) -> dict[str, str]:
    """SPDX expressions of what a model learned from, by name of the recording.

    Folders that were written before it was kept name their recordings in words.
    """
    kept = manifest.training.get("sources")
    if isinstance(kept, dict) and kept:
        return {str(name): str(spdx) for name, spdx in kept.items()}
    named = [str(manifest.training.get("dataset", "unknown"))]
    named += [name for name in DATASETS if f"{name} (" in str(manifest.training.get("gestures", ""))]
    return {name: DATASETS[name].spdx if name in DATASETS else NOASSERTION for name in dict.fromkeys(named)}


def licence_of(manifest: Manifest) -> str:
    """The SPDX expression of all that a model learned from."""
    return manifest.licence or both(sources_of(manifest).values())
