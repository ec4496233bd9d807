# SPDX-License-Identifier: Apache-2.0
"""What signals do to a node: while it loads they cut it short, afterwards it only knows that it is to end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator

import pytest

from mild_ros.node_kit.running import _Interruption

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(autouse=True)
def _handlers_as_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    # One that is not taken over ends nothing: the test is to fail, not to die.
    before = {number: signal.signal(number, lambda *_: None) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_at_work_a_signal_is_only_remembered(number: int) -> None:
    with _Interruption() as interruption:
        interruption.end_of_loading()
        assert not interruption.wanted
        signal.raise_signal(number)
        assert interruption.wanted
    assert not interruption.cut_short


@pytest.mark.parametrize("number", SIGNALS)
def test_while_it_loads_a_signal_ends_it(number: int) -> None:
    with _Interruption() as interruption, pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    assert interruption.cut_short
    with pytest.raises(KeyboardInterrupt):
        interruption.end_of_loading()
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_with_nohup_a_closed_terminal_is_nothing_and_all_others_work() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with _Interruption() as interruption:
        interruption.end_of_loading()
        signal.raise_signal(signal.SIGHUP)
        assert not interruption.wanted
        signal.raise_signal(signal.SIGTERM)
        assert interruption.wanted
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
