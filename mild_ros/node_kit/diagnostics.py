# SPDX-License-Identifier: Apache-2.0
"""A node's report to its operator: one `/diagnostics` status a second, and a log line for what goes wrong."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.topic_endpoint_info import TopicEndpointInfo

from mild_core.printable import printable
from mild_ros.messages.stamps import time_to_msg
from mild_ros.node_kit.clock import steady_clock
from mild_ros.node_kit.guarded import GuardedNode


class Spread:
    """Times of the last interval [ns], reported as p50, p99 and max."""

    def __init__(self) -> None:
        self._values_ns: list[int] = []

    def add(self, value_ns: int) -> None:
        """One more."""
        self._values_ns.append(value_ns)

    def take_ms(self) -> tuple[float, float, float] | None:
        """(p50, p99, max) [ms] of what was added since the last call; None when that is nothing."""
        if not self._values_ns:
            return None
        p50, p99, greatest = np.percentile(self._values_ns, [50, 99, 100]) * 1e-6
        self._values_ns = []
        return float(p50), float(p99), float(greatest)


class Stream:
    """One topic that comes in or goes out.

    Attributes:
        count: Messages since the start.
        lost: Messages that never came, or that newer ones took the place of before they could be taken.
        newest_s: When the newest one came, on a steady clock; None before the first.
    """

    def __init__(self) -> None:
        self.count = 0
        self.lost = 0
        self.newest_s: float | None = None
        self._reported = 0

    def add(self, steady_s: float) -> None:
        """One more message."""
        self.count += 1
        self.newest_s = steady_s

    def take_rate_hz(self, elapsed_s: float) -> float:
        """Messages per second since the last call, `elapsed_s` ago."""
        new, self._reported = self.count - self._reported, self.count
        return new / elapsed_s if elapsed_s > 0.0 else 0.0


PERIOD_S = 1.0
SILENCE_S = 1.0
"""A stream that should flow and has not for so long is worth a warning."""

REPEAT_S = 5.0
"""The same complaint is logged again no sooner than this."""

LONGEST = 2000
"""Characters of a message at most: one line, whatever foreign text it quotes."""

FAILURE_S = 10.0
"""A failure of a callback is an ERROR for so long."""

OTHER_USER = ": as another user, or in a container? ./mild doctor shows"
"""Why what is published does not come: shared memory is one user's."""

UNREMARKABLE = {
    "perception": {"accepted", "calibrating", "calibrated", "no_person"},
    "inference": {"accepted", "measured", "other_joints"},
    "retargeting": {"accepted", "tick", "measured", "other_joints", "person", "not_enabled"}
    | {"enabled", "disabled", "reset", "held", "released", "shown"},
}
"""Outcomes of a stage that need no warning; any other is an input that could not be used."""


def publisher_names(offers: Sequence[TopicEndpointInfo]) -> str:
    """The full names of who publishes a topic."""
    return ", ".join(f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in offers)


class Diagnostics:
    """Everything worth knowing of one node, gathered as it happens and published once a second.

    Args:
        node: Whom it is about.
        expected: Topics that should flow; silence on them is a warning.
        hardware_id: The robot or the tracker.
        look: Called before each report, for what has to be looked up.
    """

    def __init__(
        self,
        node: GuardedNode,
        expected: tuple[str, ...],
        hardware_id: str = "",
        look: Callable[[], None] = lambda: None,
    ) -> None:
        self.facts: dict[str, str] = {}
        self.alarms: dict[str, tuple[bytes, str]] = {}
        self.summary = "ready"
        self.newest_detail = ""
        self._lock = threading.RLock()  # reception, control and the executor are threads of their own
        self._node, self._expected, self._hardware_id, self._look = node, expected, hardware_id, look
        self._streams: dict[str, Stream] = {name: Stream() for name in expected}
        self._spreads: dict[str, Spread] = {}
        self._counts: dict[str, Mapping[str, int]] = {}
        self._unusable: Counter[str] = Counter()
        self._unreadable: Counter[str] = Counter()
        self._superseded: Counter[str] = Counter()
        self._complained_s: dict[str, float] = {}
        self._reported_s = self._started_s = time.monotonic()
        self._failures: dict[str, float] = {}
        node.on_failed = self.failed
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_timer(PERIOD_S, self._report, clock=steady_clock())

    def expect(self, topic: str) -> None:
        """From now on silence on this topic is a warning too."""
        self._expected = (topic, *self._expected)
        self._streams.setdefault(topic, Stream())

    def flowed(self, topic: str) -> None:
        """A message came or went."""
        with self._lock:
            self._streams.setdefault(topic, Stream()).add(time.monotonic())

    def lost(self, topic: str, number: int) -> None:
        """Messages never came, or newer ones took their place in DDS."""
        with self._lock:
            self._streams.setdefault(topic, Stream()).lost += number

    def took(self, what: str, duration_ns: int) -> None:
        """Something took a time or had an age."""
        with self._lock:
            self._spreads.setdefault(what, Spread()).add(duration_ns)

    def superseded(self, what: str, number: int) -> None:
        """Messages were dropped, as newer ones came before they could be used."""
        with self._lock:
            self._superseded[what] += number
            self._counts["superseded"] = self._superseded

    def ended(self, stage: str, outcome: str, counts: Mapping[str, int], detail: str = "") -> None:
        """A stage is done with an input."""
        with self._lock:
            self._counts[stage] = counts
            if outcome not in UNREMARKABLE[stage]:
                self.newest_detail = f"{outcome}: {detail}" if detail else self.newest_detail
                self._unusable[f"{stage} {outcome}"] += 1
                self.complain(f"{stage} {outcome}", detail)

    def usable(self, stage: str) -> int:
        """How many inputs of a stage there were that need no warning."""
        return sum(self._counts.get(stage, {}).get(outcome, 0) for outcome in UNREMARKABLE[stage])

    def unreadable(self, topic: str, reason: str, detail: str) -> None:
        """A message could not even be read."""
        with self._lock:
            self._unreadable[reason] += 1
            self._counts["messages"] = self._unreadable
            self._unusable[f"{topic} {reason}"] += 1
            self.newest_detail = f"{reason}: {detail}"
            self.complain(f"{topic} {reason}", detail)

    def failed(self, where: str, reason: str, detail: str) -> None:
        """A callback raised an unexpected exception, see `guarded`: an ERROR for a while, beside the count."""
        self.unreadable(where, reason, detail)
        with self._lock:
            self._failures[printable(f"{where} {detail}", 160)] = time.monotonic()

    def complain(self, about: str, detail: str = "") -> None:
        """Log a warning, but the same one not all the time."""
        now_s = time.monotonic()
        if now_s - self._complained_s.get(about, -REPEAT_S) >= REPEAT_S:
            self._complained_s[about] = now_s
            self._node.get_logger().warning(printable(f"{about}: {detail}" if detail else about))

    def _report(self) -> None:
        self._look()
        now_s = time.monotonic()
        with self._lock:
            level, problems = self._judged(now_s)
            values = self._values(now_s)
            self._unusable.clear()
        message = "; ".join(problems) or self.summary
        status = DiagnosticStatus(level=level, message=printable(message, LONGEST), hardware_id=self._hardware_id)
        status.name = self._node.get_fully_qualified_name().lstrip("/")
        status.values = [KeyValue(key=printable(key), value=printable(value)) for key, value in values.items()]
        stamp = time_to_msg(self._node.get_clock().now().nanoseconds)
        array = DiagnosticArray(status=[status])
        array.header.stamp = stamp
        self._publisher.publish(array)
        self._reported_s = now_s

    def _judged(self, now_s: float) -> tuple[bytes, list[str]]:
        """The level and what is wrong, the worst first."""
        found = list(self.alarms.values())
        self._failures = {text: when for text, when in self._failures.items() if now_s - when <= FAILURE_S}
        found += [(DiagnosticStatus.ERROR, f"failed: {text}") for text in self._failures]
        for topic in self._expected:
            newest_s = self._streams[topic].newest_s
            silent_s = now_s - (self._started_s if newest_s is None else newest_s)
            if silent_s > SILENCE_S:
                ever = f"yet{self._unheard(topic)}" if newest_s is None else f"for {silent_s:.1f} s"
                found.append((DiagnosticStatus.WARN, f"no {topic} {ever}"))
        if self._unusable:
            listed = ", ".join(f"{reason} {count}" for reason, count in self._unusable.most_common())
            found.append((DiagnosticStatus.WARN, f"not usable in the last second: {listed}"))
        found.sort(key=lambda problem: problem[0], reverse=True)
        return (found[0][0] if found else DiagnosticStatus.OK), [text for _, text in found]

    def _unheard(self, topic: str) -> str:
        """Who publishes a topic of which nothing has come; "" for no publisher."""
        offers = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))
        return f", which {publisher_names(offers)} could publish{OTHER_USER}" if offers else ""

    def _values(self, now_s: float) -> dict[str, str]:
        elapsed_s = now_s - self._reported_s
        values = dict(self.facts)
        for topic, stream in self._streams.items():
            values[f"{topic} rate [Hz]"] = f"{stream.take_rate_hz(elapsed_s):.1f}"
            values[f"{topic} count"] = str(stream.count)
            if stream.lost:
                values[f"{topic} dropped before the callback"] = str(stream.lost)
        for what, spread in self._spreads.items():
            if (times_ms := spread.take_ms()) is not None:
                for name, value in zip(("p50", "p99", "max"), times_ms, strict=True):
                    values[f"{what} {name} [ms]"] = f"{value:.3f}"
        for stage, counts in self._counts.items():
            values.update({f"{stage} {reason}": str(count) for reason, count in sorted(counts.items())})
        return values
