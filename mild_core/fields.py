# SPDX-License-Identifier: Apache-2.0
"""Reading values that came from outside, one key at a time; what is wrong is named by its full key."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from mild_core.errors import ModelError, SetupError, near


@dataclass(frozen=True)
class Fields:
    """One object of an untrusted file: JSON or TOML.

    Attributes:
        source: The file, for messages.
        path: The key of this object in the file, with a dot at its end; empty at the top.
        values: What it holds.
        remedy: What to do about a value that is wrong, if nothing better is known.
        error: The kind of error to raise.
    """

    source: str
    path: str
    values: Mapping[str, Any]
    remedy: str = "take the folder as it was trained, or retrain it"
    error: type[SetupError] = ModelError

    def wrong(self, key: str, problem: str, remedy: str = "") -> SetupError:
        """The error for a key."""
        return self.error(self.source, f"key '{self.path}{key}' {problem}", remedy or self.remedy)

    def below(self, key: str, values: Mapping[str, Any]) -> Fields:
        """An object under `key`."""
        return replace(self, path=f"{self.path}{key}.", values=values)

    def only(self, known: Iterable[str]) -> None:
        """Refuse keys that mean nothing: a misspelt one would be ignored silently."""
        names = sorted(known)
        for key in self.values:
            if key not in names:
                raise self.wrong(str(key)[:40], "is unknown", near(str(key), names) if names else "leave it out")

    def take(self, key: str) -> Any:
        """The value of a required key."""
        if key not in self.values:
            raise self.wrong(key, "is missing")
        return self.values[key]

    def text(self, key: str, allowed: Iterable[str] = ()) -> str:
        """A short text, one of `allowed` when there are any."""
        value, choices = self.take(key), tuple(allowed)
        if not isinstance(value, str) or not 0 < len(value) <= 200:
            raise self.wrong(key, "is no text of 1 to 200 characters")
        if choices and value not in choices:
            raise self.wrong(key, f"is '{value}'", f"use one of {', '.join(choices)}")
        return value

    def number(self, key: str, lower: float, upper: float) -> float:
        """A finite number within bounds."""
        value = self.take(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.wrong(key, "is no finite number")
        if not lower <= value <= upper:
            raise self.wrong(key, f"is {value}, not within {lower:g} to {upper:g}")
        return float(value)

    def flag(self, key: str) -> bool:
        """True or false."""
        value = self.take(key)
        if not isinstance(value, bool):
            raise self.wrong(key, "is neither true nor false")
        return value

    def integer(self, key: str, lower: int, upper: int) -> int:
        """A whole number within bounds."""
        value = self.number(key, lower, upper)
        if value != int(value):
            raise self.wrong(key, f"is {value}, no whole number")
        return int(value)

    def numbers(self, key: str, count: int, lower: float, upper: float) -> tuple[float, ...]:
        """A list of `count` finite numbers within bounds."""
        values = self.take(key)
        if not isinstance(values, list) or len(values) != count:
            raise self.wrong(key, f"is no list of {count} numbers")
        rows = self.below(key, {str(i): value for i, value in enumerate(values)})
        return tuple(rows.number(str(i), lower, upper) for i in range(count))

    def names(self, key: str, most: int) -> tuple[str, ...]:
        """A list of 1 to `most` different names."""
        values = self.take(key)
        if not isinstance(values, list) or not 0 < len(values) <= most:
            raise self.wrong(key, f"is no list of 1 to {most} names")
        rows = self.below(key, {str(i): value for i, value in enumerate(values)})
        names = tuple(rows.text(str(i)) for i in range(len(values)))
        if len(set(names)) != len(names):
            raise self.wrong(key, "holds a name twice")
        return names

    def object(self, key: str) -> Fields:
        """An object below this one."""
        value = self.take(key)
        if not isinstance(value, dict):
            raise self.wrong(key, "is no object")
        return self.below(key, value)

    def objects(self, key: str, most: int) -> tuple[Fields, ...]:
        """A list of 1 to `most` objects."""
        values = self.take(key)
        if not isinstance(values, list) or not 0 < len(values) <= most:
            raise self.wrong(key, f"is no list of 1 to {most} objects")
        rows = self.below(key, {str(i): value for i, value in enumerate(values)})
        return tuple(rows.object(str(i)) for i in range(len(values)))
