# SPDX-License-Identifier: Apache-2.0
"""Rows of values of components by frame, and what `smoothing` does with stretches of them, for eight demonstrations.

What a frame multiplies a stretch by is not carried out but owed to it, until that is so large or small that it has to
be. The far end of a stretch is left out for good once it no longer counts in any of the demonstrations: where
components lie apart, a few frames remain of D. Rows are (K, frames, lanes).
"""

from __future__ import annotations

import numpy as np

from mild_core.compiled import compiled
from mild_core.inference.priors.lanes import Lanes, any_above, load, repeat, store, where_above
from mild_core.shapes import FloatArray

CEILING = 1e200
"""Bound of the backward values. Only states of no forward mass come near it; beyond it they would turn into NaN."""

LEAST_OWED, MOST_OWED = 1e-100, 1e50
"""A row may be owed a factor between these. Beyond, values would leave what a double can hold."""

VANISHED = 1e-290
"""Smaller values are zero: there arithmetic takes a hundred times as long, and nothing depends on them."""

FORGOTTEN = 1e-180
"""Share of a row's sum below which its earliest starts, or latest ends, are left out from then on.

They share all other frames with the rest of the row and differ in the remaining time alone: those frames would have to
be this much likelier after the one remaining time than after the other to bring them back.
"""

BLOCK = 8
"""So many places are left out together, and so many frames lie between two looks for them."""


@compiled
def weigh(rows: FloatArray, j: int, first: int, stop: int, durations: FloatArray) -> Lanes:
    """Sum of what row `j` holds from place `first` to `stop` times the durations (K, D) from the shortest on."""
    at, total = np.uint64(first), repeat(0.0)  # here and below: no sign to look at for each place
    for r in range(np.uint64(stop - first)):
        total += load(rows, (j, at + r)) * durations[j, r]
    return total


@compiled
def weigh_both(
    rows: FloatArray, j: int, first: int, stop: int, lasting: FloatArray, durations: FloatArray
) -> tuple[Lanes, Lanes]:
    """`weigh` with two kinds of durations at once."""
    at, last, end = np.uint64(first), repeat(0.0), repeat(0.0)
    for r in range(np.uint64(stop - first)):
        value = load(rows, (j, at + r))
        last += value * lasting[j, r]
        end += value * durations[j, r]
    return last, end


@compiled
def settle(rows: FloatArray, j: int, first: int, stop: int, owed: FloatArray, factor: Lanes) -> None:
    """Owe row `j` one more `factor` from place `first` to `stop`, or multiply it by both if that is too much."""
    before = load(owed, (j,))
    product = before * factor
    if not (any_above(LEAST_OWED, product) or any_above(product, MOST_OWED)):
        store(owed, (j,), product)
        return
    # What would vanish does so before it is multiplied: the product is what takes long.
    least = VANISHED / where_above(product, VANISHED, product, VANISHED)
    at = np.uint64(first)
    for r in range(np.uint64(stop - first)):
        value = load(rows, (j, at + r))
        value = where_above(value, least, value, 0.0) * before
        value = where_above(value, CEILING, CEILING, value) * factor
        store(rows, (j, at + r), where_above(value, CEILING, CEILING, value))
    store(owed, (j,), 1.0)


@compiled
def forget(rows: FloatArray, j: int, first: int, stop: int, total: Lanes) -> int:
    """Where row `j` from `first` to `stop` may end instead; what is left out is zero. `total` is its sum."""
    while stop - BLOCK > first:
        largest = load(rows, (j, stop - BLOCK))
        for r in range(stop - BLOCK + 1, stop):
            value = load(rows, (j, r))
            largest = where_above(value, largest, value, largest)
        if any_above(largest, total * FORGOTTEN):
            break
        for r in range(stop - BLOCK, stop):
            store(rows, (j, r), 0.0)
        stop -= BLOCK
    return stop
