# SPDX-License-Identifier: Apache-2.0
"""Errors a user can read: one line that names the thing, what is wrong with it and what would work."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from mild_core.printable import printable

THING_LIMIT, PROBLEM_LIMIT = 500, 1500
"""Characters of a part of an error that are shown: paths are long, foreign names may be endless."""


class MildError(Exception):
    """Root of every error that mild_ros raises on purpose."""


class SetupError(MildError):
    """Something was set up wrongly: raised while constructing, ends the program with a non-zero exit.

    Args:
        thing: What is at fault, as the user named it (a parameter, a file, a model).
        problem: What is wrong with it, with the evidence.
        remedy: What would work.
    """

    def __init__(self, thing: str, problem: str, remedy: str) -> None:
        self.thing, self.problem, self.remedy = thing, problem, remedy
        parts = ((thing, THING_LIMIT), (problem, PROBLEM_LIMIT), (remedy, PROBLEM_LIMIT))
        shown = [printable(" ".join(part[: 2 * limit].split()), limit) for part, limit in parts]
        super().__init__("{}: {}; {}".format(*shown))

    def __reduce__(self) -> tuple[type[SetupError], tuple[str, str, str]]:
        """Lets the error come back whole from another process."""
        return type(self), (self.thing, self.problem, self.remedy)


class ModelError(SetupError):
    """A model folder that cannot be trusted or does not fit."""


class DatasetError(SetupError):
    """A recording that cannot be read or does not hold what it should."""


class BagError(SetupError):
    """A bag that cannot be opened, read or written."""


class DataError(MildError):
    """One input that cannot be used. It never stops a node: it is counted by its reason and the robot holds.

    Args:
        reason: A short word that stays the same for the same fault, for counting (`"not_finite"`).
        detail: What was seen, for the log.
    """

    def __init__(self, reason: str, detail: str) -> None:
        self.reason, self.detail = reason, printable(detail, PROBLEM_LIMIT)
        super().__init__(f"{reason}: {self.detail}")


def near(name: str, known: Iterable[str]) -> str:
    """What to use in place of a name that is in no table: the names that are likest, or else some that there are."""
    names = list(known)
    close = get_close_matches(name[:THING_LIMIT], names, n=3, cutoff=0.5)
    if close:
        return f"did you mean '{chr(39).join(close[:1])}'?" if len(close) == 1 else f"did you mean {', '.join(close)}?"
    return f"there are {', '.join(names[:10])}{' and others' * (len(names) > 10)}"


def unknown_name(thing: str, name: str, known: Iterable[str]) -> SetupError:
    """The error for a name that is in no table: lists the names that would have worked, the likeliest first."""
    names = list(known)
    close = get_close_matches(name[:THING_LIMIT], names, n=1)
    hint = f"did you mean '{close[0]}'? " if close else ""
    return SetupError(thing, f"'{name}' is unknown", f"{hint}use one of {', '.join(names) or '(none)'}")
