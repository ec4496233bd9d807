# SPDX-License-Identifier: Apache-2.0
"""A node that no message kills: whatever a callback raises is counted, reported as an ERROR, and the node goes on.

Bad data is `DataError` and has a reason of its own, where it is read. What arrives here is a fault of ours that some
message has found: it is never silent, names the exception's type, and costs that message only.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import wraps
from typing import Any

from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from mild_core.errors import DataError
from mild_core.printable import printable, printable_lines

UNUSABLE = "unusable"
"""The reason under which it is counted."""

REPEAT_S = 5.0
"""The same failure is logged again no sooner than this."""

Failed = Callable[[str, str, str], None]
"""Takes where it happened, the reason and what was raised."""


class _PrintableLogger:
    """A node's logger that writes printable lines only; each severity has a line of its own, as rclpy wants it."""

    def __init__(self, logger: Any) -> None:
        self._logger = logger

    def __getattr__(self, name: str) -> Any:
        return getattr(self._logger, name)

    def info(self, text: str) -> None:
        self._logger.info(printable_lines(text))

    def warning(self, text: str) -> None:
        self._logger.warning(printable_lines(text))

    def error(self, text: str) -> None:
        self._logger.error(printable_lines(text))


class GuardedNode(Node):
    """A node whose subscriptions, timers and services are guarded, those of its helpers too.

    Attributes:
        on_failed: Counts and reports a failure; `Diagnostics` puts itself here. Without one it is only logged.
        on_lost: Called after a message was lost that way, for a replay in lock-step that waits for its outcome.
    """

    def __init__(self, name: str, **given: Any) -> None:
        self.executable = name
        self.on_failed: Failed = self._log
        self.on_lost: Callable[[], None] = lambda: None
        self._logged_s: dict[str, float] = {}
        super().__init__(name, **given)

    def get_logger(self) -> Any:
        """As of a node; foreign text in what is logged is made printable."""
        return _PrintableLogger(super().get_logger())  # type: ignore[no-untyped-call]

    def guard(self, where: str, callback: Callable[..., Any]) -> Callable[..., Any]:
        """The callback, made safe; `where` names the topic, timer or service."""

        @wraps(callback)
        def guarded(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except ExternalShutdownException:
                raise
            except Exception as error:
                if not self.context.ok():
                    raise  # the end of the program, whose publishers are gone already
                self._failed(where, error)
                return self._answer(arguments, error)

        return guarded

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., Any], *more: Any, **given: Any
    ) -> Any:
        """As of a node, guarded."""
        return super().create_subscription(msg_type, topic, self.guard(topic, callback), *more, **given)

    def create_timer(self, timer_period_sec: float, callback: Callable[..., Any], *more: Any, **given: Any) -> Any:
        """As of a node, guarded."""
        name = getattr(callback, "__name__", "timer").strip("_")
        return super().create_timer(timer_period_sec, self.guard(name, callback), *more, **given)

    def create_service(self, srv_type: Any, srv_name: str, callback: Callable[..., Any], **given: Any) -> Any:
        """As of a node, guarded; a failure is an answer without success."""
        return super().create_service(srv_type, srv_name, self.guard(srv_name, callback), **given)

    def _failed(self, where: str, error: Exception) -> None:
        try:
            reason = error.reason if isinstance(error, DataError) else UNUSABLE
            self.on_failed(where, reason, f"{type(error).__name__}: {printable(str(error), 200)}")
            self.on_lost()
        except Exception as second:  # to report a failure must not be one
            self._log(where, UNUSABLE, f"{type(error).__name__}, then {type(second).__name__} while reporting it")

    def _log(self, where: str, reason: str, detail: str) -> None:
        now_s = time.monotonic()
        if now_s - self._logged_s.get(where, -REPEAT_S) >= REPEAT_S:
            self._logged_s[where] = now_s
            self.get_logger().error(f"{where} {reason}: {detail}")

    @staticmethod
    def _answer(arguments: tuple[Any, ...], error: Exception) -> Any:
        """What a service answers after a failure: its untouched answer, as no success where it knows of such."""
        if len(arguments) != 2:
            return None
        answer = arguments[1]
        if hasattr(answer, "success"):
            answer.success, answer.message = False, f"failed ({type(error).__name__}); see the log"
        return answer
