# SPDX-License-Identifier: Apache-2.0
"""Hands meet: people from generated bags and from recordings before the simulated robot, through the whole pipeline."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.pipeline import Pipeline
from mild_core.retargeting.stage import Retargeting
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.retargeting import make_retargeting
from mild_ros.scenes import RATE_HZ, SCENES, arm_track
from mild_ros.settings import PipelineParameters
from test.bench.contact import ROBOT, Story, play, story
from test.core.retargeting.limits import check_limits

TOUCHING = ("handshake", "rocket", "parachute")


@pytest.fixture(scope="module")
def pipeline() -> Pipeline:
    return make_pipeline(PipelineParameters(), load(PipelineParameters().model))


def _check(retargeting: Retargeting, told: Story) -> None:
    episode = play(retargeting, told)
    apart_m = episode.apart_m()
    assert len(apart_m) > 30, "the person's hand is within reach for a while"
    assert np.median(apart_m) < 0.02
    assert min(command.stiffness for command in episode.commands) < 0.5, "the arm is soft in contact"
    check_limits(ROBOT, episode.commands)


@pytest.mark.parametrize("interaction", TOUCHING)
def test_hands_of_generated_people_and_the_robot_meet(pipeline: Pipeline, interaction: str) -> None:
    scene = next(scene for scene in SCENES if scene.name == interaction)
    _check(pipeline.retargeting, story(pipeline, arm_track(scene), RATE_HZ, interaction))


@pytest.mark.parametrize("interaction", TOUCHING)
def test_hands_of_recorded_people_and_the_robot_meet(pipeline: Pipeline, mild_data: Path, interaction: str) -> None:
    trials = BUETEPAGE_HR.read(mild_data / BUETEPAGE_HR.file).train
    # The last but one: the parachute and the handshake in which the person is the quickest.
    trial = [trial for trial in trials if trial.interaction == interaction][-2]
    _check(pipeline.retargeting, story(pipeline, trial.observed_m, trial.rate_hz, interaction))


def test_before_the_approach_the_motion_is_the_learned_one(pipeline: Pipeline) -> None:
    scene = next(scene for scene in SCENES if scene.name == "parachute")
    told = story(pipeline, arm_track(scene), RATE_HZ, "parachute")
    model = load(PipelineParameters().model)
    learned = play(make_retargeting(PipelineParameters(ik="off"), model.manifest), told)
    assert play(pipeline.retargeting, told).before_deg(learned) < 5.0
