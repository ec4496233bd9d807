# SPDX-License-Identifier: Apache-2.0
"""Training stops where the error on trials that it does not learn from has levelled off."""

import math
from dataclasses import replace

import pytest
import torch

from mild_core.errors import DatasetError
from mild_core.learning.data.windows import PROTOCOLS
from mild_core.learning.training import epoch_search
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.epoch_search import converged, lengths
from mild_core.learning.training.learned_model import finished
from mild_core.learning.training.presets import PRESETS
from test.core.learning.made_trials import made_trials
from test.core.learning.small_settings import SMALL

TRIALS, SAME = made_trials(each=4, frames=130), PROTOCOLS["same"]
SETTINGS = replace(SMALL, epochs=12, recogniser=None, learning_rate=0.03, doublings=2)


@pytest.mark.parametrize(
    ("epochs", "doublings", "tried"),
    [(360, 0, ()), (360, 3, (45, 90, 180, 360)), (12, 2, (3, 6, 12)), (2, 5, (1, 2)), (1, 1, (1,))],
)
def test_each_training_is_twice_as_long_as_the_one_before(epochs, doublings, tried):
    assert lengths(epochs, doublings) == tried


@pytest.mark.parametrize(
    ("errors", "over"),
    [
        ([], False),
        ([0.5], False),
        ([0.5, 0.4], False),
        ([0.5, 0.4, 0.399], True),  # a quarter of a per cent is chance
        ([0.5, 0.6], True),
        ([0.5, math.nan], True),
    ],
)
def test_an_error_has_levelled_off_when_twice_as_long_makes_it_no_smaller(errors, over):
    assert converged(errors) is over


def reports_and_model(settings, resume=()):
    epochs, reports = train(TRIALS, SAME, settings, 3, resume=resume), []
    while True:
        try:
            reports.append(next(epochs))
        except StopIteration as end:
            return reports, end.value


@pytest.mark.parametrize(("least_gain", "looked", "enough"), [(-10.0, 3, 12), (0.9, 2, 3)])
def test_the_members_learn_from_all_trials_for_as_long_as_was_enough_for_one_fold(
    monkeypatch, least_gain, looked, enough
):
    monkeypatch.setattr(epoch_search, "LEAST_GAIN", least_gain)
    reports, model = reports_and_model(SETTINGS)
    asked = [report for report in reports if not math.isnan(report.validation)]
    assert [(report.member, report.epochs) for report in asked] == list(enumerate((3, 6, 12)[:looked]))
    assert all(report.validation > 0.0 and report.epoch == report.epochs - 1 for report in asked)
    assert model.settings.epochs == enough
    assert len(reports) == sum((3, 6, 12)[:looked]) + enough
    assert {report.members for report in reports[-enough:]} == {looked + 1}
    trained = finished(train(TRIALS, SAME, replace(SETTINGS, epochs=enough, doublings=0), 3))
    for name, value in trained.members[0].networks.state_dict().items():
        assert torch.equal(value, model.members[0].networks.state_dict()[name]), name
    # Interrupted while the first looked, between two, and while the member learned.
    for stop in (2, 3, len(reports) - 1):
        kept = {report.member: report.snapshot for report in reports_until(stop)}
        again, found = reports_and_model(SETTINGS, list(kept.values()))
        assert len(again) == len(reports) - stop
        assert torch.equal(found.members[0].prior.means, model.members[0].prior.means)


def reports_until(stop):
    """Of an interrupted training: the newest one of each member is where that one stood."""
    epochs = train(TRIALS, SAME, SETTINGS, 3)
    return [next(epochs) for _ in range(stop)]


def test_too_few_trials_to_hold_some_out_are_refused():
    with pytest.raises(DatasetError, match="training trials"):
        next(train(made_trials(each=2, frames=130), SAME, SETTINGS, 0))


def test_the_papers_preset_runs_all_its_epochs():
    assert PRESETS["paper"].doublings == 0
