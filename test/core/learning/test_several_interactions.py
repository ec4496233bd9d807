# SPDX-License-Identifier: Apache-2.0
"""One interaction after the other, without a reset: each is recognised, and so is the same one again."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.inference.model import load_model
from mild_core.inference.stage import Inference
from mild_core.learning.data.windows import feature_windows, onset_window
from mild_core.learning.datasets import DATASETS
from test.conftest import ROOT

ORDERS = (
    ("handshake", "hand_wave", "rocket", "parachute", "handshake"),
    ("parachute", "parachute", "handshake"),
)
BETWEEN = 40
"""Frames in which the arm goes over from where one trial ended to where the next one begins."""


@pytest.mark.parametrize("order", ORDERS, ids=["all", "one twice"])
def test_each_of_several_interactions_in_a_row_is_recognised(mild_data, order):
    recording = DATASETS["buetepage_hr"]
    protocol, trials = recording.protocols["ahead"], recording.read(mild_data / recording.file).train
    of = {name: [trial for trial in trials if trial.interaction == name] for name in order}
    chosen = [of[name][place] for place, name in enumerate(order)]
    parts, starts = [chosen[0].observed_m], [0]
    for trial in chosen[1:]:
        share = np.linspace(0, 1, BETWEEN)[:, None, None]
        starts.append(sum(map(len, parts)) + BETWEEN)
        parts += [(1 - share) * parts[-1][-1] + share * trial.observed_m[0], trial.observed_m]
    observed = np.concatenate(parts)
    row = replace(
        chosen[0], observed_m=observed, controlled=np.zeros((len(observed), 7)), active=np.ones(len(observed))
    )
    stage = Inference(load_model(ROOT / "models" / "yumi_buetepage_ahead"))
    state, named = stage.init(), []
    for window in feature_windows(row, protocol):
        state, (motion,) = stage.step(state, window, window.stamp_ns)
        named.append(motion.interaction)
    assert state.counts["accepted"] == len(named)
    assert not {"time_reset", "gap_reset"} & state.counts.keys()
    for start, trial in zip(starts, chosen, strict=True):
        # Half of the evidence is forgotten in two seconds; by then what was before no longer counts for more.
        started = start + onset_window(trial, protocol, after_s=2.0)
        following = named[started : started + 40]
        assert np.mean([name == trial.interaction for name in following]) > 0.9, (trial.interaction, set(following))
