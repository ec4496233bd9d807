# SPDX-License-Identifier: Apache-2.0
"""A node's parameters are the fields of one frozen dataclass: see `mild_core/parameters.py`.

From them come the declared ROS parameters, their descriptors, the refusal of a wrong value in one line, and
the table in docs/reference.md. Every parameter is read-only: a node is set up once, and started again to be changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field
from typing import TYPE_CHECKING, Any, TypeVar

from mild_core.errors import unknown_name
from mild_core.parameters import about, checked, parameters_of

if TYPE_CHECKING:
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.node import Node

Parameters = TypeVar("Parameters")

OF_ROS = ("use_sim_time", "start_type_description_service")
"""Parameters that every ROS node has."""


def from_values(kind: type[Parameters], given: Mapping[str, Any]) -> Parameters:
    """Parameters of a kind from values by name; the rest are defaults.

    Raises:
        SetupError: For a name that is unknown, or a value of the wrong type or out of range.
    """
    known = {entry.name: entry for entry in parameters_of(kind)}
    for name in given:
        if name not in known:
            raise unknown_name("parameter", name, [*known, OF_ROS[0]])
    return kind(**{name: checked(known[name], value, f"parameter {name}") for name, value in given.items()})


def declare(node: Node, kind: type[Parameters]) -> Parameters:
    """Declare the parameters of `kind` on `node`, read-only, with what was given on the command line or in a file.

    Undeclared names are noticed here; ROS drops them in silence and shows them through no public method.

    Raises:
        SetupError: As `from_values`.
    """
    given = {
        name: _plain(override.value)
        for name, override in node._parameter_overrides.items()
        if name not in OF_ROS and not name.startswith("qos_overrides.")
    }
    parameters = from_values(kind, given)
    for entry in parameters_of(kind):
        value = getattr(parameters, entry.name)
        value = list(value) if isinstance(value, tuple) else value
        node.declare_parameter(entry.name, value, _descriptor(entry), ignore_override=True)
    _fix_time(node)
    return parameters


def _fix_time(node: Node) -> None:
    """Let the node keep the kind of time with which it started, and rclpy's own clock survive a negative `/clock`.

    rclpy itself lets `use_sim_time` be set at any time, and a moving robot's node would wait for a `/clock` for ever.
    """
    from rcl_interfaces.msg import SetParametersResult

    simulated = node.get_parameter(OF_ROS[0]).value

    def refuse(changed: list[Any]) -> Any:
        for entry in changed:
            if entry.name == OF_ROS[0] and entry.value is not simulated:
                reason = f"{OF_ROS[0]} is {str(simulated).lower()} from start to end: start the node again to change it"
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(refuse)
    for subscription in node.subscriptions:
        if subscription.topic_name == "/clock":
            subscription.callback = _without_negative(subscription.callback)


def _without_negative(on_clock: Callable[[Any], None]) -> Callable[[Any], None]:
    """What takes `/clock`, but for negative times, of which rclpy raises out of the executor."""

    def take(message: Any) -> None:
        if message.clock.sec >= 0:
            on_clock(message)

    return take


def table_markdown(kind: type[Any]) -> str:
    """The parameters as a Markdown table for docs/reference.md."""
    lines = ["| Parameter | Default | Unit | Range | Meaning |", "|---|---|---|---|---|"]
    for entry in parameters_of(kind):
        facts = about(entry)
        cells = (f"`{entry.name}`", _default_text(entry), facts.unit, facts.range_text(), facts.text)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def help_text(kind: type[Any]) -> str:
    """The parameters as plain lines for a terminal."""
    lines = []
    for entry in parameters_of(kind):
        facts = about(entry)
        extent = facts.range_text().replace("`", "")
        bounds = f" [{extent}{' ' + facts.unit if facts.unit else ''}]" if extent or facts.unit else ""
        lines.append(f"  {entry.name} (default {_default_text(entry).strip('`')}){bounds}\n      {facts.text}")
    return "\n".join(lines)


def _default_text(entry: Field[Any]) -> str:
    assert entry.default is not MISSING
    if isinstance(entry.default, bool):
        return f"`{str(entry.default).lower()}`"
    if isinstance(entry.default, tuple):
        return f"`[{', '.join(entry.default)}]`"
    return f"`{entry.default}`" if entry.default != "" else '`""`'


def _plain(value: Any) -> Any:
    """A parameter's value without rclpy's array types; an empty list arrives as no value at all."""
    if value is None:
        return []
    return value if isinstance(value, str | bytes) or not isinstance(value, Iterable) else list(value)


def _descriptor(entry: Field[Any]) -> ParameterDescriptor:
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    facts = about(entry)
    unit = f" [{facts.unit}]" if facts.unit else ""
    descriptor = ParameterDescriptor(
        name=entry.name, description=facts.text + unit, additional_constraints=facts.range_text(), read_only=True
    )
    if facts.minimum is not None and facts.maximum is not None:
        if isinstance(entry.default, float):
            bounds = FloatingPointRange(from_value=float(facts.minimum), to_value=float(facts.maximum))
            descriptor.floating_point_range = [bounds]
        elif isinstance(entry.default, int):
            descriptor.integer_range = [
                IntegerRange(from_value=int(facts.minimum), to_value=int(facts.maximum), step=1)
            ]
    return descriptor
