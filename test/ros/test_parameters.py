# SPDX-License-Identifier: Apache-2.0
"""Parameters come from one dataclass, and a wrong one is refused in one line that says what would work."""

from __future__ import annotations

from dataclasses import dataclass, fields

import pytest
import rclpy
from rclpy.parameter import Parameter

from mild_core.errors import SetupError
from mild_core.parameters import about, check, chosen, parameter, parameters_of
from mild_core.perception.settings import TrackingSettings
from mild_core.retargeting.settings import RetargetingSettings
from mild_ros.assembly.settings import NODES, PipelineParameters, RetargetingParameters
from mild_ros.node_kit.parameters import declare, from_values, help_text, table_markdown


@dataclass(frozen=True)
class Example:
    model: str = parameter("yumi", "Which model.")
    rate_hz: float = parameter(100.0, "How often.", unit="Hz", minimum=1.0, maximum=500.0)
    depth: int = parameter(5, "How many.", minimum=1)
    side: str = parameter("right", "Which arm.", choices=("right", "left"))
    on: bool = parameter(True, "Whether.")
    joint_names: tuple[str, ...] = parameter((), "In which order.")


@pytest.fixture
def node_with():
    """A node as if its parameters had been given on the command line."""
    rclpy.init()
    made = []

    def make(given):
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        made.append(rclpy.create_node("example", parameter_overrides=overrides))
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()
    rclpy.shutdown()


def test_what_is_given_arrives_and_the_rest_is_default(node_with):
    node = node_with({"rate_hz": 50, "joint_names": ["a", "b"], "use_sim_time": True})
    assert declare(node, Example) == Example(rate_hz=50.0, joint_names=("a", "b"))
    assert node.get_parameter("rate_hz").value == 50.0
    assert node.get_parameter("model").value == "yumi"
    assert list(node.get_parameter("joint_names").value) == ["a", "b"]


def test_parameters_are_described_and_cannot_change(node_with):
    node = node_with({})
    declare(node, Example)
    descriptor = node.describe_parameter("rate_hz")
    assert descriptor.description == "How often. [Hz]"
    assert descriptor.read_only
    assert (descriptor.floating_point_range[0].from_value, descriptor.floating_point_range[0].to_value) == (1.0, 500.0)
    (result,) = node.set_parameters([Parameter("rate_hz", value=60.0)])
    assert not result.successful
    assert node.get_parameter("rate_hz").value == 100.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rate_h": 3}, "parameter: 'rate_h' is unknown; did you mean 'rate_hz'? use one of model, rate_hz"),
        ({"rate_hz": 0}, "parameter rate_hz: is 0 Hz; give a value in 1 … 500 Hz"),
        ({"rate_hz": float("nan")}, "parameter rate_hz: is nan Hz; give a value in 1 … 500 Hz"),
        ({"rate_hz": "fast"}, "parameter rate_hz: is 'fast' (str); give a number"),
        ({"depth": 0}, "parameter depth: is 0; give a value in 1 …"),
        ({"depth": 1.5}, "parameter depth: is 1.5 (float); give a whole number"),
        ({"depth": True}, "parameter depth: is True (bool); give a whole number"),
        ({"model": 3}, "parameter model: is 3 (int); give a text; in YAML put quotes around it"),
        ({"model": True}, "parameter model: is True (bool); give a text; in YAML put quotes around it"),
        ({"side": "lefty"}, "parameter side: 'lefty' is unknown; did you mean 'left'? use one of right, left"),
        ({"on": "yes"}, "parameter on: is 'yes' (str); give true or false"),
        ({"joint_names": [1, 2]}, "parameter joint_names: is [1, 2]; give a list of texts"),
        ({"joint_names": "elbow"}, "parameter joint_names: is 'elbow' (str); give a list"),
    ],
)
def test_a_wrong_parameter_is_one_line(node_with, given, message):
    with pytest.raises(SetupError) as caught:
        declare(node_with(given), Example)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_values_are_checked_without_ros_too():
    assert from_values(Example, {"depth": 7}) == Example(depth=7)
    with pytest.raises(SetupError):
        from_values(Example, {"depth": 0})


def test_the_table_holds_every_fact():
    table = table_markdown(Example)
    assert "| `rate_hz` | `100.0` | Hz | 1 … 500 | How often. |" in table
    assert "| `model` | `yumi` |" in table
    assert "`right`, `left`" in table
    assert "rate_hz (default 100.0) [1 … 500 Hz]" in help_text(Example)


@pytest.mark.parametrize("name", NODES)
def test_every_parameter_of_ours_is_explained_and_its_default_allowed(name):
    kind = NODES[name]
    from_values(kind, {entry.name: entry.default for entry in parameters_of(kind)})
    for entry in parameters_of(kind):
        assert about(entry).text.endswith("."), entry.name
        if isinstance(entry.default, float):
            assert about(entry).range_text(), f"{entry.name} has no range"


def test_the_pipeline_takes_what_the_stages_take():
    assert {entry.name for entry in fields(PipelineParameters)} >= {
        entry.name for entry in fields(RetargetingParameters)
    }


def test_a_stage_gets_what_its_node_was_given(node_with):
    given = {"keep_out_m": 0.1, "ik": "only", "interaction_s": 12, "max_gap_s": 0.25}
    parameters = from_values(PipelineParameters, given)
    settings = chosen(RetargetingSettings, parameters, execution_delay_s=0.16)
    assert (settings.keep_out_m, settings.ik, settings.interaction_s) == (0.1, "only", 12.0)
    assert (settings.execution_delay_s, settings.near_m) == (0.16, RetargetingSettings.near_m)
    assert chosen(TrackingSettings, parameters).max_gap_s == 0.25


@pytest.mark.parametrize(("name", "value"), [("near_m", 0.5), ("execution_delay_s", 0.1), ("bone_tolerance", 0.2)])
def test_what_only_programs_set_is_no_parameter(name, value):
    assert hasattr(PipelineParameters(), name)
    with pytest.raises(SetupError, match=f"'{name}' is unknown"):
        from_values(PipelineParameters, {name: value})
    assert name not in help_text(PipelineParameters)


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        (RetargetingSettings, {"keep_out_m": -0.1}),
        (RetargetingSettings, {"near_m": float("nan")}),
        (RetargetingSettings, {"ik": "maybe"}),
        (TrackingSettings, {"forget_s": 0.0}),
    ],
)
def test_settings_made_without_ros_are_held_to_the_same_ranges(kind, given):
    with pytest.raises(SetupError, match=next(iter(given))):
        check(kind(**given))
