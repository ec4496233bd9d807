# SPDX-License-Identifier: Apache-2.0
"""Our LLVM code for eight numbers equals numpy."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.compiled import compiled
from mild_core.inference.priors.lanes import LANES, any_above, load, repeat, store, where_above


@compiled
def calculate(given: np.ndarray, number: float, made: np.ndarray) -> bool:
    left, right = load(given, (0, 1)), load(given, (1, 0))
    store(made, (0,), left + right)
    store(made, (1,), left * right * number)
    store(made, (2,), number / right)
    store(made, (3,), where_above(left, right, left, number))
    total = repeat(number)
    for row in range(2):
        total += load(given, (row, row))
    store(made, (4,), total)
    return any_above(left, right)


@pytest.mark.parametrize("above", [None, *range(LANES)])
def test_lanes_calculate_as_numpy_does(above):
    rng = np.random.default_rng(0)
    given, made = rng.uniform(1.0, 2.0, (2, 2, LANES)), np.full((6, LANES), 7.0)
    given[1, 0] = 3.0
    if above is not None:
        given[0, 1, above] = 4.0
    left, right = given[0, 1], given[1, 0]
    assert calculate(given, 0.5, made) == (above is not None)
    expected = [left + right, left * right * 0.5, 0.5 / right, np.where(left > right, left, 0.5)]
    np.testing.assert_array_equal(made[:4], expected)
    # Three numbers may be added in one go.
    np.testing.assert_allclose(made[4], 0.5 + given[0, 0] + given[1, 1], rtol=1e-15)
    np.testing.assert_array_equal(made[5], 7.0)


def test_what_is_no_number_is_above_nothing():
    given, made = np.ones((2, 2, LANES)), np.empty((6, LANES))
    given[0, 1] = np.nan
    assert not calculate(given, 0.5, made)
    np.testing.assert_array_equal(made[3], 0.5)
