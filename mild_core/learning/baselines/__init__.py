# SPDX-License-Identifier: Apache-2.0
"""Methods that every table of errors holds beside ours, one file each."""

from __future__ import annotations

from mild_core.learning.baselines.action_mean import ACTION_MEAN
from mild_core.learning.baselines.buetepage import BUETEPAGE
from mild_core.learning.baselines.gru import GRU
from mild_core.learning.baselines.kernel_ridge import KERNEL_RIDGE
from mild_core.learning.baselines.mild_paper import MILD_PAPER
from mild_core.learning.baselines.mixture_density import MIXTURE_DENSITY, MIXTURE_DENSITY_GIVEN
from mild_core.learning.baselines.nearest_neighbours import NEAREST_NEIGHBOURS
from mild_core.learning.baselines.ridge import RIDGE
from mild_core.learning.baselines.time_indexed_mean import TIME_INDEXED_MEAN
from mild_core.learning.data.baseline import Baseline

BASELINES: dict[str, Baseline] = {
    baseline.name: baseline
    for baseline in (
        *(MILD_PAPER, BUETEPAGE, MIXTURE_DENSITY, MIXTURE_DENSITY_GIVEN, GRU),
        *(KERNEL_RIDGE, RIDGE, NEAREST_NEIGHBOURS, TIME_INDEXED_MEAN, ACTION_MEAN),
    )
}
