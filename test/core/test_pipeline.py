# SPDX-License-Identifier: Apache-2.0
"""The pipeline is its three stages, one after the other: nothing is added, dropped or taken in another order."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from mild_core.inference.model import build_model
from mild_core.inference.stage import Inference
from mild_core.perception.stage import Perception
from mild_core.pipeline import Pipeline, PipelineOutput
from mild_core.retargeting.human_track import AssumedPlacement
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Request, Retargeting, RetargetingInput, RetargetingState
from mild_core.signals import JointCommand, JointMeasurement, MotionWindow, PersonPose
from test.core.inference.random_model import manifest, paper_member, random_arrays
from test.core.perception.scene import SECOND, SETTINGS, at_rate, seen

STANDING = AssumedPlacement((0.9, 0.1, 0.7), np.pi, {"rocket": (0.7, 0.0, 0.7)})


@pytest.fixture(name="pipeline", scope="module")
def _pipeline() -> Pipeline:
    of = manifest((paper_member(hidden=(20, 12)),), components=4)
    return Pipeline(
        Perception(SETTINGS),
        Inference(build_model(of, random_arrays(of)), "rocket"),
        Retargeting(YUMI, standing=STANDING),
    )


def inputs(rate_hz: float) -> list[tuple[Any, int]]:
    """A robot at home, a person at some rate of the tracker, ticks between, and a moment without the person."""
    given: list[tuple[Any, int]] = [(JointMeasurement(0, YUMI.joint_names, YUMI.home_rad), 0)]
    for people in seen(at_rate(rate_hz, 2.5)):
        now_ns = people[0].stamp_ns
        given += [(None, now_ns), (people, now_ns)]
    given += [((), 3 * SECOND), (None, 3 * SECOND + 1), (Request("hold"), 3 * SECOND + 2)]
    return given


def by_hand(pipeline: Pipeline, given: list[tuple[Any, int]]) -> list[PipelineOutput]:
    """The stages one by one, in the words of README."""
    perception, inference, retargeting = (
        stage.init() for stage in (pipeline.perception, pipeline.inference, pipeline.retargeting)
    )
    outputs = []
    for one, now_ns in given:
        windows, motions, commands, person = [], [], [], None
        for_retargeting = [one]
        if isinstance(one, tuple):
            perception, windows = pipeline.perception.step(perception, one, now_ns)
            person, for_retargeting = perception.person, []
            for window in windows:
                inference, made = pipeline.inference.step(inference, window, now_ns)
                motions += made
            # The person first: what a motion leads to depends on where they are by the same message.
            for_retargeting = ([] if person is None else [person]) + motions
        elif isinstance(one, JointMeasurement):
            inference, _ = pipeline.inference.step(inference, one, now_ns)
        for part in for_retargeting:
            retargeting, made = pipeline.retargeting.step(retargeting, part, now_ns)
            commands += made
        outputs.append(PipelineOutput(tuple(windows), tuple(motions), tuple(commands), person))
    return outputs


def same(one: Any, other: Any) -> bool:
    """Whether two signals are equal to the bit; NaN, for what is not known, equals itself."""
    for field in fields(one):
        values = getattr(one, field.name), getattr(other, field.name)
        if isinstance(values[0], np.ndarray | int | float | str):
            np.testing.assert_array_equal(*values)
    return type(one) is type(other)


@pytest.mark.parametrize("rate_hz", [15.0, 40.0])
def test_every_input_goes_through_the_stages_in_order(pipeline: Pipeline, rate_hz: float) -> None:
    given, state = inputs(rate_hz), pipeline.init()
    wanted = by_hand(pipeline, given)
    total = {"windows": 0, "motions": 0, "commands": 0}
    for (one, now_ns), expected in zip(given, wanted, strict=True):
        state, output = pipeline.step(state, one, now_ns)
        for name in total:
            found, should = getattr(output, name), getattr(expected, name)
            assert len(found) == len(should)
            assert all(same(a, b) for a, b in zip(found, should, strict=True))
            total[name] += len(found)
        assert (output.person is None) == (expected.person is None)
        if output.person is not None and expected.person is not None:
            assert same(output.person, expected.person)
    assert total["windows"] == total["motions"] > 50
    assert total["commands"] > 35
    assert max(len(expected.windows) for expected in wanted) == (1 if rate_hz == 40.0 else 3)


def test_where_the_robot_is_goes_to_inference_and_to_retargeting(pipeline: Pipeline) -> None:
    state, output = pipeline.step(pipeline.init(), JointMeasurement(0, YUMI.joint_names, YUMI.home_rad), 0)
    assert state.inference.outcome == "measured"
    np.testing.assert_array_equal(state.retargeting.measured_rad, YUMI.home_rad)
    assert output == PipelineOutput()


class Watched(Retargeting):
    """Retargeting that keeps what it was given."""

    def step(self, state: RetargetingState, given: RetargetingInput, now_ns: int) -> Any:
        GIVEN.append(type(given))
        return super().step(state, given, now_ns)


GIVEN: list[type] = []


class Answering(Retargeting):
    """Retargeting that answers each part of an input with a command, numbered."""

    def step(self, state: RetargetingState, given: RetargetingInput, now_ns: int) -> Any:
        GIVEN.append(type(given))
        return state, (JointCommand(len(GIVEN), YUMI.joint_names, YUMI.home_rad, YUMI.home_rad),)


def test_every_command_comes_out_in_order(pipeline: Pipeline) -> None:
    answering = replace(pipeline, retargeting=Answering(YUMI))
    state, most = answering.init(), 0
    for one, now_ns in inputs(15.0):
        GIVEN.clear()
        state, output = answering.step(state, one, now_ns)
        assert [command.stamp_ns for command in output.commands] == list(range(1, len(GIVEN) + 1))
        most = max(most, len(GIVEN))
    assert most == 4


def test_retargeting_knows_where_the_person_is_before_it_gets_the_motions_that_answer_them(pipeline: Pipeline) -> None:
    watched = replace(pipeline, retargeting=Watched(YUMI))
    state = watched.init()
    for one, now_ns in inputs(15.0):
        GIVEN.clear()
        state, output = watched.step(state, one, now_ns)
        if isinstance(one, tuple):
            assert [PersonPose] * (output.person is not None) + [MotionWindow] * len(output.motions) == GIVEN
        else:
            assert [type(one)] == GIVEN
