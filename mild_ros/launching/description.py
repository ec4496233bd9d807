# SPDX-License-Identifier: Apache-2.0
"""What `ros2 launch` runs, made of the table in `table.py`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler, Shutdown, TimerAction
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.substitutions import (
    LaunchConfiguration,
    NotEqualsSubstitution,
    PathJoinSubstitution,
    PythonExpression,
)
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from mild_ros.launching.table import (
    CAMERA,
    FAILED_S,
    LAUNCHES,
    LISTENERS,
    RESPAWN_DELAY_S,
    SETUP_ERROR,
    Launch,
    Started,
    camera_of,
    listeners,
)

KINDS = {"true": bool, "false": bool, "1.0": float, "0.0": float}
"""Type of a parameter by its argument's default; all others are texts."""


def describe(name: str) -> LaunchDescription:
    """The description of a launch of that table."""
    wanted = LAUNCHES[name]
    given = {argument: LaunchConfiguration(argument) for argument in wanted.arguments}
    arguments = [
        DeclareLaunchArgument(argument, default_value=default, description=text)
        for argument, (default, text) in wanted.arguments.items()
    ]
    nodes = [
        OpaqueFunction(function=_by_camera, args=[wanted, one, given])
        if one.sees_by_camera
        else _node(wanted, one, given)
        for one in wanted.nodes
    ]
    # A node that could not start has said why, and would say it again; others may be about to say the same.
    patience_s = FAILED_S if wanted.ends_with_failure else 0.5 * RESPAWN_DELAY_S

    def on_exit(event: Any, _: LaunchContext) -> TimerAction | None:
        failed = event.returncode and (wanted.ends_with_failure or event.returncode == SETUP_ERROR)
        ending = Shutdown(reason=f"{event.process_name} has failed: its reason is above")
        return TimerAction(period=patience_s, actions=[ending]) if failed else None

    return LaunchDescription([*arguments, RegisterEventHandler(OnProcessExit(on_exit=on_exit)), *nodes])


def _by_camera(
    context: LaunchContext, wanted: Launch, one: Started, given: dict[str, LaunchConfiguration]
) -> list[Node]:
    """A node with the camera's pose, if that is known."""
    camera = camera_of({name: value.perform(context) for name, value in given.items()})
    return [_node(wanted, one, given, {CAMERA: ParameterValue(camera, value_type=str)} if camera else {})]


def _node(
    wanted: Launch,
    one: Started,
    given: dict[str, LaunchConfiguration],
    overrides: Mapping[str, ParameterValue] | None = None,
) -> Node:
    """A node, as `ros2 launch` starts it."""
    stem = PythonExpression(["'", given["config"], "'.removesuffix('.yaml')"])
    # Not as `parameters`: a file that is not there would be passed over, and another robot commanded.
    config = ["--params-file", [PathJoinSubstitution([FindPackageShare("mild_ros"), "config", stem]), ".yaml"]]
    values: dict[str, Any] = {
        name: ParameterValue(given[argument], value_type=KINDS.get(wanted.arguments[argument][0] or "", str))
        for name, argument in one.parameters.items()
    }
    if one.executable == "replay":
        recorded = [str(listeners("yes")), " if '", given["record"], "' else ", str(listeners(""))]
        values[LISTENERS] = ParameterValue(PythonExpression(recorded), value_type=int)
    more: dict[str, Any] = {}
    if one.respawned:
        more |= {"respawn": given["respawn"], "respawn_delay": RESPAWN_DELAY_S}
    if one.only_with:
        more["condition"] = IfCondition(NotEqualsSubstitution(given[one.only_with], ""))
    if one.ends_all:
        more["on_exit"] = Shutdown(reason=f"{one.executable} has ended")
    return Node(
        package="mild_ros",
        executable=one.executable,
        name=one.executable,
        namespace=given["namespace"],
        ros_arguments=config if one.configured else [],
        parameters=[values | dict(one.fixed) | dict(overrides or {})],
        remappings=[(topic, given[argument]) for topic, argument in one.topics.items()],
        output="screen",
        **more,
    )
