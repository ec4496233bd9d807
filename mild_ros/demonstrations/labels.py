# SPDX-License-Identifier: Apache-2.0
"""What a movement shows: from a topic while it was recorded, or from a file written afterwards."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mild_core.errors import SetupError

LABEL_TYPE = "std_msgs/msg/String"
TOPIC = "topic:"
"""What a label begins with that names a topic."""

UNLABELLED, UNUSABLE, UNWANTED = "unlabelled", "unusable label", "another interaction"


@dataclass(frozen=True)
class Span:
    """What goes on for a while.

    Attributes:
        from_s: Its begin, since the bag's first message.
        to_s: Its end.
        interaction: Its name; "" for nothing.
    """

    from_s: float
    to_s: float
    interaction: str


@dataclass(frozen=True)
class BagLabels:
    """What a file says of a bag: one of these.

    Attributes:
        spans: What went on when.
        each: One interaction for each movement that could be a trial, in order.
    """

    spans: tuple[Span, ...] = ()
    each: tuple[str, ...] | None = None


def for_all(interaction: str) -> BagLabels:
    """Every movement of a bag shows the same."""
    return BagLabels((Span(float("-inf"), float("inf"), interaction),))


def bag_labels(thing: str, said: Any) -> BagLabels:
    """What a file says of a bag.

    Args:
        thing: What to call it in an error.
        said: A text, a list of texts, or a list of tables with from_s, to_s and interaction.

    Raises:
        SetupError: It is none of these.
    """
    if isinstance(said, str):
        return for_all(said)
    if isinstance(said, list) and all(isinstance(one, str) for one in said):
        return BagLabels(each=tuple(said))
    try:
        return BagLabels(tuple(_span(**table) for table in said))
    except TypeError:
        remedy = "give a text, a list of texts, or a list of {from_s, to_s, interaction}"
        raise SetupError(thing, f"is {str(said)[:60]}", remedy) from None


def _span(from_s: float, to_s: float, interaction: str) -> Span:
    if isinstance(from_s, str) or isinstance(to_s, str) or not isinstance(interaction, str) or not from_s < to_s:
        raise TypeError("no span")
    return Span(float(from_s), float(to_s), interaction)


def spans_said(said: Sequence[tuple[float, str]]) -> BagLabels:
    """What was said on a topic, at which times [s]: each word holds until the next one."""
    ends_s = [*(time_s for time_s, _ in said[1:]), float("inf")]
    return BagLabels(tuple(Span(from_s, to_s, word) for (from_s, word), to_s in zip(said, ends_s, strict=False)))


def label_each(thing: str, labels: BagLabels, movements_s: Sequence[tuple[float, float]]) -> list[str]:
    """The interaction of each movement: what went on for most of it; "" where nothing did.

    Args:
        thing: What to call the labels in an error.
        labels: Of the bag.
        movements_s: Begin and end of each, since the bag's first message.

    Raises:
        SetupError: There is not one label for each movement, where each has its own.
    """
    if labels.each is not None:
        if len(labels.each) != len(movements_s):
            problem = f"has {len(labels.each)} labels for {len(movements_s)} movements"
            remedy = 'look at its picture, and give one for each that is numbered, "" to leave it out'
            raise SetupError(thing, problem, remedy)
        return list(labels.each)
    return [_most(labels.spans, *movement) for movement in movements_s]


def _most(spans: Sequence[Span], begin_s: float, end_s: float) -> str:
    shares: dict[str, float] = {"": 0.0}
    for span in spans:
        overlap = min(span.to_s, end_s) - max(span.from_s, begin_s)
        shares[span.interaction] = shares.get(span.interaction, 0.0) + max(0.0, overlap)
    return max(shares, key=lambda name: shares[name])


def cleaned(label: str, wanted: Sequence[str] = ()) -> tuple[str, str]:
    """A label as the name of an interaction, and why it is none; "" when it is one.

    Args:
        label: As it was said.
        wanted: The only interactions that are; empty for any.
    """
    name = re.sub(r"\s+", "_", label.strip())
    if not name:
        return "", UNLABELLED
    if not re.fullmatch(r"[\w-]{1,60}", name):
        return "", UNUSABLE
    return name, UNWANTED if wanted and name not in wanted else ""
