# SPDX-License-Identifier: Apache-2.0
"""What may be set is a field of one dataclass per stage, with its default, unit, range and meaning.

ROS parameters, `--help`, TOML files and the tables of the docs are made from these fields; nothing is stated twice.
"""

from __future__ import annotations

import math
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypeVar

from mild_core.errors import SetupError, unknown_name

Settings = TypeVar("Settings")

KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text", tuple: "a list"}
"""What to give for a parameter, by its type."""


@dataclass(frozen=True)
class About:
    """What a parameter means beside its name, type and default.

    Attributes:
        text: One sentence for the operator.
        unit: Unit of the number, "" when it has none.
        minimum: Least value allowed, None for none.
        maximum: Greatest value allowed, None for none.
        choices: The only texts allowed, empty for any.
        offered: Whether users may set it; False for what only programs set.
    """

    text: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    offered: bool = True

    def range_text(self) -> str:
        """The range as people write it, "" when there is none."""
        if self.choices:
            return ", ".join(f"`{choice}`" for choice in self.choices)
        if self.minimum is None and self.maximum is None:
            return ""
        low = "" if self.minimum is None else f"{self.minimum:g}"
        high = "" if self.maximum is None else f"{self.maximum:g}"
        return f"{low} … {high}"


def parameter(default: Any, text: str, **facts: Any) -> Any:
    """A field of a dataclass of parameters; `facts` are the fields of `About`.

    The default's type is the parameter's: a whole number given for a float is taken as one.
    """
    return field(default=default, metadata={"about": About(text, **facts)})


def about(entry: Field[Any]) -> About:
    """What is known of one parameter."""
    found = entry.metadata["about"]
    assert isinstance(found, About)
    return found


def parameters_of(kind: type[Any]) -> tuple[Field[Any], ...]:
    """The fields of a dataclass that users may set."""
    return tuple(entry for entry in fields(kind) if "about" in entry.metadata and about(entry).offered)


def chosen(kind: type[Settings], parameters: Any, **others: Any) -> Settings:
    """Settings of a kind from those fields of `parameters` that have the same names, and from `others`.

    Raises:
        SetupError: They cannot work together.
    """
    names = {entry.name for entry in fields(kind)} & {entry.name for entry in parameters_of(type(parameters))}  # type: ignore[arg-type]
    return kind(**{name: getattr(parameters, name) for name in names - others.keys()}, **others)


def checked(entry: Field[Any], value: Any, thing: str = "") -> Any:
    """The value in the parameter's type and range.

    Args:
        entry: The field.
        value: What was given for it.
        thing: What to call it in an error; its name if empty.

    Raises:
        SetupError: The type is wrong, or the value is out of range.
    """
    thing, facts = thing or entry.name, about(entry)
    wanted: type[Any] = type(entry.default)
    if wanted is float and type(value) is int:
        value = float(value)
    if wanted is tuple and (value == [] or isinstance(value, list | tuple)):
        value = tuple(value)
        if not all(isinstance(item, str) for item in value):
            raise SetupError(thing, f"is {list(value)}", "give a list of texts, e.g. [shoulder, elbow]")
    if value is None or (value == [] and wanted is not tuple):  # NAME:= and no more
        if wanted is str and entry.default == "":
            return ""
        raise SetupError(thing, "is empty", f"give {KINDS[wanted]}, or leave it out")
    if type(value) is not wanted:
        hint = "; in YAML put quotes around it" if wanted is str else ""
        raise SetupError(thing, f"is {value!r} ({type(value).__name__})", f"give {KINDS[wanted]}{hint}")
    if facts.choices and value not in facts.choices:
        raise unknown_name(thing, value, facts.choices)
    if wanted in (int, float) and not _within(value, facts.minimum, facts.maximum):
        unit = f" {facts.unit}" if facts.unit else ""
        raise SetupError(thing, f"is {value:g}{unit}", f"give a value in {facts.range_text() or 'the reals'}{unit}")
    return value


def check(settings: Any) -> None:
    """Check every parameter among the fields of a dataclass.

    Raises:
        SetupError: One has the wrong type or is out of range.
    """
    for entry in fields(settings):
        if "about" in entry.metadata:
            value = getattr(settings, entry.name)
            checked(entry, float(value) if isinstance(entry.default, float) else value)


def _within(value: float, minimum: float | None, maximum: float | None) -> bool:
    low = -math.inf if minimum is None else minimum
    high = math.inf if maximum is None else maximum
    return math.isfinite(value) and low <= value <= high
