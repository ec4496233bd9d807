# SPDX-License-Identifier: Apache-2.0
"""Hands meet: people from generated bags and from recordings before the simulated robot, through the whole pipeline."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mild_core.learning.datasets.buetepage_hr import BUETEPAGE_HR
from mild_core.pipeline import Pipeline
from mild_core.retargeting.robots.pepper import PEPPER
from mild_ros.assembly.inference import load
from mild_ros.assembly.perception import skeleton_source
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.retargeting import make_retargeting
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.bag.camera import with_camera
from mild_ros.replay.in_process import Inputs, replay_in_process
from mild_ros.replay.recorded import read_run
from mild_ros.viewing.report import used_limits
from mild_ros.viewing.staging import stage
from test.bench.contact import ROBOT, Episode, Story, play, story
from test.conftest import ROOT
from test.core.retargeting.limits import check_limits
from tools.scenes import RATE_HZ, ROCKET_KNEELING, SCENES, arm_track

TOUCHING = ("handshake", "rocket", "parachute")


@pytest.fixture(scope="module")
def pipeline() -> Pipeline:
    return make_pipeline(PipelineParameters(), load(PipelineParameters().model))


@pytest.fixture(scope="module")
def generated(pipeline: Pipeline) -> Callable[[str], tuple[Story, Episode]]:
    """Inputs of retargeting in a scene and its commands, once for all tests."""

    @cache
    def recorded(interaction: str) -> tuple[Story, Episode]:
        scene = next(scene for scene in SCENES if scene.name == interaction)
        made = story(pipeline, arm_track(scene), RATE_HZ, interaction)
        return made, play(pipeline.retargeting, made)

    return recorded


def _check(episode: Episode, within_m: float) -> None:
    apart_m = episode.apart_m()
    assert len(apart_m) > 30, "the person's hand is within reach for a while"
    assert np.median(apart_m) < within_m
    assert min(command.stiffness for command in episode.commands) < 0.5, "the arm is soft in contact"
    check_limits(ROBOT, episode.commands)


@pytest.mark.parametrize("interaction", TOUCHING)
def test_hands_of_generated_people_and_the_robot_meet(
    generated: Callable[[str], tuple[Story, Episode]], interaction: str
) -> None:
    # The hand of a parachute rises fast and far, and has a name only when it is up.
    _check(generated(interaction)[1], 0.03 if interaction == "parachute" else 0.02)


@pytest.mark.parametrize("interaction", ["handshake", "rocket"])
def test_hands_of_recorded_people_and_the_robot_meet(pipeline: Pipeline, mild_data: Path, interaction: str) -> None:
    """At 0.8 m/s near people the robot is late for the quickest of them, and for the short contact of a parachute."""
    trials = BUETEPAGE_HR.read(mild_data / BUETEPAGE_HR.file).train
    # The last but one: the handshake in which the person is the quickest.
    trial = [trial for trial in trials if trial.interaction == interaction][-2]
    episode = play(pipeline.retargeting, story(pipeline, trial.observed_m, trial.rate_hz, interaction))
    assert np.min(episode.apart_m()) < 0.02
    assert min(command.stiffness for command in episode.commands) < 0.5, "the arm is soft in contact"
    check_limits(ROBOT, episode.commands)


def test_before_the_approach_the_motion_is_the_learned_one(
    generated: Callable[[str], tuple[Story, Episode]],
) -> None:
    recorded, episode = generated("parachute")
    model = load(PipelineParameters().model)
    learned = play(make_retargeting(PipelineParameters(ik="off"), model.manifest), recorded)
    assert episode.before_deg(learned) < 5.0


def test_a_thigh_in_the_way_is_kept_away_from(tmp_path: Path) -> None:
    """Of a person on one knee the raised thigh lies where the fists would meet: the arm reaches out and stops short."""
    bag = ROOT / "bags" / ROCKET_KNEELING.name
    parameters = PipelineParameters(model="pepper_nuisi_next", robot="pepper", interaction="rocket")
    parameters = with_camera(parameters, bag)
    model = load(parameters.model)
    whole, source = make_pipeline(parameters, model), skeleton_source(parameters)
    summary = replay_in_process(bag, whole, Inputs(source, PEPPER), tmp_path / "a", rate_hz=100.0)
    assert summary.counts["retargeting"]["refused_keep_out"] > 10
    run = read_run(tmp_path / "a", source)
    staged = stage(run, whole.perception, model.manifest, PEPPER)
    assert staged.interaction == "rocket"
    assert 0.05 < staged.gap_m.min() < 0.25
    assert run.commands is not None
    assert used_limits(run.commands, PEPPER).kept
