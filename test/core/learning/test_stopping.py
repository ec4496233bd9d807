# SPDX-License-Identifier: Apache-2.0
"""Training stops where the error on trials that it does not learn from has levelled off."""

import math
from dataclasses import replace

import pytest
import torch

from mild_core.errors import DatasetError
from mild_core.learning import stopping
from mild_core.learning.learned_model import finished
from mild_core.learning.presets import PRESETS
from mild_core.learning.stopping import best_epoch, levelled_off
from mild_core.learning.training import train
from mild_core.learning.windows import PROTOCOLS
from test.core.learning.made_trials import made_trials
from test.core.learning.small_settings import SMALL

TRIALS, SAME = made_trials(each=4, frames=130), PROTOCOLS["same"]
SETTINGS = replace(SMALL, epochs=12, recogniser=None, learning_rate=0.03, decaying=False, patience=1)


@pytest.mark.parametrize(
    ("errors", "best", "over"),
    [
        ([], 1, False),
        ([0.5], 1, False),
        ([0.5, 0.4, 0.3], 3, False),
        ([0.5, 0.4, 0.41, 0.399], 2, True),  # a quarter of a per cent is chance
        ([0.5, 0.4, 0.41, 0.39], 4, False),
        ([math.nan, math.nan, math.nan], 1, True),
    ],
)
def test_an_error_has_levelled_off_when_no_clearly_better_one_comes(errors, best, over):
    assert best_epoch(errors) == best
    assert levelled_off(errors, 2) is over


def test_the_members_learn_from_all_trials_for_as_long_as_was_best_for_one_fold(monkeypatch):
    monkeypatch.setattr(stopping, "LEAST_GAIN", 0.1)  # reached within a dozen epochs
    epochs, reports = train(TRIALS, SAME, SETTINGS, 3), []
    while True:
        try:
            reports.append(next(epochs))
        except StopIteration as end:
            model = end.value
            break
    watched = [report.validation for report in reports if report.member == 0]
    assert {report.members for report in reports} == {2}
    assert all(math.isnan(report.validation) for report in reports if report.member == 1)
    assert 0.0 < min(watched) < watched[0]
    assert len(watched) < SETTINGS.epochs
    assert model.settings.epochs == best_epoch(watched) == len(watched) - SETTINGS.patience
    assert len(reports) == len(watched) + model.settings.epochs
    told = finished(train(TRIALS, SAME, replace(SETTINGS, epochs=model.settings.epochs, patience=0), 3))
    for name, value in told.members[0].networks.state_dict().items():
        assert torch.equal(value, model.members[0].networks.state_dict()[name]), name
    # Interrupted while it looked, and again after.
    for stop in (2, len(watched) + 1):
        kept, again = {}, train(TRIALS, SAME, SETTINGS, 3)
        for _ in range(stop):
            report = next(again)
            kept[report.member] = report.snapshot
        found = finished(train(TRIALS, SAME, SETTINGS, 3, resume=list(kept.values())))
        assert torch.equal(found.members[0].prior.means, model.members[0].prior.means)


def test_too_few_trials_to_hold_some_out_are_refused():
    with pytest.raises(DatasetError, match="training trials"):
        next(train(made_trials(each=2, frames=130), SAME, SETTINGS, 0))


def test_the_papers_preset_runs_all_its_epochs():
    assert PRESETS["paper"].patience == 0
