# SPDX-License-Identifier: Apache-2.0
"""A training that goes on from what was written is the same training, and nothing else is gone on from."""

import resource
from dataclasses import replace

import pytest
import torch

from mild_core.errors import SetupError
from mild_core.learning.data.windows import PROTOCOLS
from mild_core.learning.training.algorithm import train
from mild_core.learning.training.checkpoint import Checkpoint, identity
from mild_core.learning.training.learned_model import finished
from test.core.learning.made_trials import made_trials
from test.core.learning.small_settings import SMALL, SMALL_PAPER

TRIALS, SAME = made_trials(each=3, frames=130), PROTOCOLS["same"]


@pytest.mark.parametrize("settings", [SMALL, SMALL_PAPER], ids=["ours", "paper"])
def test_every_epoch_is_a_place_to_go_on_from(settings, tmp_path):
    settings = replace(settings, recogniser=None, epochs=4)  # the prior is frozen, and the human alone learned, for two
    whole = finished(train(TRIALS, SAME, settings, 3)).members[0]
    checkpoint = Checkpoint(tmp_path / "training", identity(TRIALS, SAME, settings, 3))
    for _ in range(settings.epochs):
        # One epoch, then everything is gone but the file.
        epochs = train(TRIALS, SAME, settings, 3, resume=checkpoint.read(settings.members))
        report = next(epochs)
        checkpoint.write(report.member, report.snapshot)
    assert report.epoch == settings.epochs - 1
    again = finished(train(TRIALS, SAME, settings, 3, resume=checkpoint.read(1))).members[0]
    for name, value in whole.networks.state_dict().items():
        assert torch.equal(value, again.networks.state_dict()[name]), name
    assert torch.equal(whole.prior.path, again.prior.path)
    assert torch.equal(whole.prior.means, again.prior.means)


def test_only_the_same_training_is_gone_on_with(tmp_path):
    ours = identity(TRIALS, SAME, SMALL, 0)
    snapshot = next(train(TRIALS, SAME, SMALL, 0)).snapshot
    Checkpoint(tmp_path, ours).write(0, snapshot)
    assert Checkpoint(tmp_path, ours).read(3)[0].epochs == 1
    others = [
        identity(TRIALS[1:], SAME, SMALL, 0),
        identity(TRIALS, PROTOCOLS["ahead"], SMALL, 0),
        identity(TRIALS, SAME, replace(SMALL, epochs=9), 0),
        identity(TRIALS, SAME, SMALL, 1),
        identity(TRIALS, SAME, SMALL, 0, {"a": snapshot.tensors["widening/0"].numpy()}),
    ]
    assert len({ours, *others}) == 6
    for other in others:
        with pytest.raises(SetupError, match="is of another training"):
            Checkpoint(tmp_path, other).read(1)
    with pytest.raises((RuntimeError, KeyError, ValueError)):
        next(
            train(
                TRIALS, SAME, replace(SMALL, architecture=replace(SMALL.architecture, memory=9)), 0, resume=[snapshot]
            )
        )


def test_a_disk_that_takes_no_more_is_one_line_and_the_last_snapshot_stays(tmp_path):
    checkpoint = Checkpoint(tmp_path, "a")
    snapshot = next(train(TRIALS, SAME, SMALL, 0)).snapshot
    checkpoint.write(0, snapshot)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        with pytest.raises((SetupError, OSError)) as error:
            checkpoint.write(0, replace(snapshot, epochs=2))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "\n" not in str(error.value)
    assert checkpoint.read(1)[0].epochs == 1
