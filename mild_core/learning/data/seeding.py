# SPDX-License-Identifier: Apache-2.0
"""Draws that depend on given numbers alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def drawing_from(*numbers: int) -> Iterator[None]:
    """Make torch's draws inside depend on `numbers` alone, and leave no trace outside."""
    with torch.random.fork_rng(devices=[]):
        seed = 0
        for number in numbers:
            seed = (seed * 1_000_003 + number + 1) % (2**63 - 1)
        torch.manual_seed(seed)
        yield
