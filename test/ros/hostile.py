# SPDX-License-Identifier: Apache-2.0
"""Any message of a type, made hostile: numbers that are none, sizes that do not fit, texts that command."""

from __future__ import annotations

import array
import copy
import dataclasses
import random
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

FLOATS = (float("nan"), float("inf"), -float("inf"), 0.0, -0.0, 1e308, -1e308, 5e-324, 1e30)
TEXTS = (
    "",
    "\0",
    "\x1b[2J\x1b]0;owned\x07",
    "a\nb",
    "\u202e",
    "/",
    "human",
    "x" * 100_000,
    "yumi_joint_1_r",
    "-1",
    "nan",
)
LENGTHS = (0, 1, 2, 3, 17, 1000)


def hostile(message: Any, seed: int, count: int) -> Iterator[Any]:
    """Copies of a good message: an empty one, then each with some fields changed, from a single one to most of them."""
    rng = random.Random(seed)
    if hasattr(message, "get_fields_and_field_types"):
        yield type(message)()
    for number in range(count):
        bad = copy.deepcopy(message)
        _change(bad, rng, (0.02, 0.1, 0.5, 0.9)[number % 4])
        yield bad


def _change(message: Any, rng: random.Random, share: float) -> None:
    if not hasattr(message, "get_fields_and_field_types"):
        _change_foreign(message, rng, share)
        return
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            _change(value, rng, share)
        elif isinstance(value, list | array.array | np.ndarray):
            _change_sequence(message, name, kind, rng, share)
        elif rng.random() < share:
            setattr(message, name, _scalar(kind, value, rng))


def _change_foreign(message: Any, rng: random.Random, share: float) -> None:
    """The same of a message whose package is not installed here, as `rosbags` makes it."""
    for one in dataclasses.fields(message):
        value = getattr(message, one.name)
        if dataclasses.is_dataclass(value):
            _change_foreign(value, rng, share)
        elif isinstance(value, list):
            for item in filter(dataclasses.is_dataclass, value):
                _change_foreign(item, rng, share)
            if value and rng.random() < share:
                changed = [*value, *value] if rng.random() < 0.5 else value[:-1]
                object.__setattr__(message, one.name, changed)
        elif isinstance(value, np.ndarray):
            if value.dtype.kind == "f" and rng.random() < share:
                with np.errstate(over="ignore"):
                    changed = np.array([rng.choice(FLOATS) for _ in value.flat]).astype(value.dtype)
                object.__setattr__(message, one.name, changed.reshape(value.shape))
        elif isinstance(value, str | float | int) and rng.random() < share:
            kind = "int32" if isinstance(value, int) else "double"
            object.__setattr__(message, one.name, _scalar(kind, value, rng))


def _change_sequence(message: Any, name: str, kind: str, rng: random.Random, share: float) -> None:
    value, element = getattr(message, name), re.sub(r"sequence<([^,>]*).*>|(.*)\[\d*\]", r"\1\2", kind)
    if isinstance(value, np.ndarray):  # of a fixed length
        setattr(message, name, np.array([_scalar(element, one, rng) for one in value], dtype=value.dtype))
        return
    items = list(value)
    for place, item in enumerate(items):
        if hasattr(item, "get_fields_and_field_types"):
            _change(item, rng, share)
        elif rng.random() < share:
            items[place] = _scalar(element, item, rng)
    if items and rng.random() < share:
        length = rng.choice(LENGTHS)
        items = [items[place % len(items)] for place in range(length)] if rng.random() < 0.5 else items[:-1]
    setattr(message, name, array.array(value.typecode, items) if isinstance(value, array.array) else items)


def _scalar(kind: str, value: Any, rng: random.Random) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return rng.choice(TEXTS)
    if isinstance(value, bytes):
        return bytes([rng.randrange(256)])
    if isinstance(value, float):
        with np.errstate(over="ignore"):
            return float(np.float32(rng.choice(FLOATS))) if kind == "float" else rng.choice(FLOATS)
    found = re.fullmatch(r"(u?)int(\d+)", kind)
    if found is None:
        return type(value)(rng.randrange(256))
    bits, unsigned = int(found[2]), bool(found[1])
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return rng.choice((low, high, 0, 1, high // 2, rng.randint(low, high)))
