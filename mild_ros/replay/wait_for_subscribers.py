# SPDX-License-Identifier: Apache-2.0
"""Waiting until everybody listens: a message that is sent before is lost."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mild_core.errors import SetupError
from mild_ros.node_kit.dds_variables import heard_remedy

LOOK_PERIOD_S = 0.05

SETTLING_S = 0.5
"""A publisher sees a subscriber before that one sees it: they get this long."""


class SubscriberWait:
    """Who is to hear a replay.

    Args:
        topic: What they listen to, for messages.
        wanted: What to count, and how many are wanted of each; the listeners first.
        patience_s: How long to wait.
    """

    def __init__(self, topic: str, wanted: Sequence[tuple[Callable[[], int], int]], patience_s: float) -> None:
        self._topic, self._wanted, self._patience_s = topic, wanted, patience_s
        self._waited_s = self._settled_s = 0.0

    def is_there(self, since_s: float) -> bool:
        """Whether all have been there for long enough; to be asked every `since_s`.

        Raises:
            SetupError: They do not come.
        """
        counts = [count() for count, _ in self._wanted]
        heard = all(found >= wanted for found, (_, wanted) in zip(counts, self._wanted, strict=True))
        self._waited_s += since_s
        self._settled_s = self._settled_s + since_s if heard else 0.0
        if not heard and self._waited_s > self._patience_s:
            remedy = "start the pipeline (in lock-step with -p report_handled:=true -p use_sim_time:=true)"
            problem = f"{counts[0]} subscribers of {self._topic} after {self._waited_s:.0f} s"
            raise SetupError("replay", problem, heard_remedy(remedy))
        return self._settled_s >= SETTLING_S
