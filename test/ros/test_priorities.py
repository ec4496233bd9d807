# SPDX-License-Identifier: Apache-2.0
"""Who is ahead of whom: control of all, what it may have to wait for of other programs, and nothing where refused."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from mild_ros.node_kit.priorities import BESIDE, CONTROL, in_real_time

PROGRAM = """
import os, threading
from mild_ros.node_kit.priorities import in_real_time
kinds = {os.SCHED_OTHER: "other", os.SCHED_FIFO: "fifo", os.SCHED_RR: "rr"}
found, chosen, go = {}, threading.Event(), threading.Event()

def look(name):
    kind = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    found[name] = f"{kinds[kind]} {os.sched_getparam(0).sched_priority}"

def look_and_start(name):
    look(name)
    after = threading.Thread(target=look, args=(f"started by {name}",))
    after.start()
    after.join()

def beside():
    go.wait()
    look_and_start("beside")

def set_by_the_user():
    os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(7))
    chosen.set()
    go.wait()
    look("set by the user")

def control():
    chosen.wait()
    assert in_real_time()
    look_and_start("control")
    go.set()

threads = [threading.Thread(target=body) for body in (beside, set_by_the_user, control)]
for one in threads:
    one.start()
for one in threads:
    one.join()
look("main")
print("\\n".join(f"{name}: {how}" for name, how in found.items()))
"""


def test_what_control_waits_for_is_ahead_of_other_programs_and_control_ahead_of_that(real_time: bool) -> None:
    if not real_time:
        pytest.skip("real-time priority is not allowed here")
    said = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60.0)
    assert said.returncode == 0, said.stderr
    assert dict(line.split(": ") for line in said.stdout.splitlines()) == {
        "control": f"fifo {CONTROL}",
        "started by control": "other 0",
        "beside": f"fifo {BESIDE}",
        "started by beside": f"fifo {BESIDE}",
        "set by the user": "rr 7",
        "main": f"fifo {BESIDE}",
    }


@pytest.mark.parametrize("allowed", [True, False])
def test_every_thread_is_asked_for_or_none_where_it_is_not_allowed(
    monkeypatch: pytest.MonkeyPatch, allowed: bool
) -> None:
    own = threading.get_native_id()
    given: dict[int | None, tuple[int, int]] = {}

    def choose(thread: int, policy: int, parameters: os.sched_param) -> None:
        if not allowed:
            raise PermissionError
        given[thread or own] = (policy & ~os.SCHED_RESET_ON_FORK, parameters.sched_priority)

    monkeypatch.setattr(os, "sched_setscheduler", choose)
    monkeypatch.setattr(os, "sched_getscheduler", lambda thread: given.get(thread or own, (os.SCHED_OTHER,))[0])
    end = threading.Event()
    other = threading.Thread(target=end.wait)
    other.start()
    try:
        assert in_real_time() is allowed
        found = {number: given.get(number) for number in (own, other.native_id)}
    finally:
        end.set()
        other.join()
    expected = {own: (os.SCHED_FIFO, CONTROL), other.native_id: (os.SCHED_FIFO, BESIDE)}
    assert found == (expected if allowed else dict.fromkeys(expected))
    assert allowed or not given
