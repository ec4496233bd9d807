# SPDX-License-Identifier: Apache-2.0
"""All methods of the table of errors: the plain ones, the paper's, and the one that is shipped."""

from __future__ import annotations

from mild_core.learning.baseline import Baseline
from mild_core.learning.baselines import BASELINES

METHODS: dict[str, Baseline] = {**BASELINES}
"""By name."""
