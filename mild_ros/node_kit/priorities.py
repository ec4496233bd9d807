# SPDX-License-Identifier: Apache-2.0
"""Control gets a processor before other programs do, and so does whatever it may have to wait for.

Control waits for Python's lock and for those of DDS (of a publisher's history, of a port in shared memory). A thread
that holds one and loses its processor to another program keeps control waiting: with real-time priority for control
alone, floods on busy cores left gaps of 50 to 120 ms in the commands. So every thread of its process is ahead of
other programs, and control is ahead of these.
"""

from __future__ import annotations

import os
from contextlib import suppress

CONTROL = 50
"""Of control among real-time threads; source: what ros2_control gives its own."""

BESIDE = 1
"""Of all other threads of its process: the lowest there is, ahead of ordinary programs only."""


def in_real_time() -> bool:
    """Give this thread real-time priority and the others of this process the lowest; whether that is allowed.

    Limits.conf or root allow it. Threads that are real-time ones already stay as they are; those to come are what the
    thread is that starts them, but for this one's, which are ordinary.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(CONTROL))
    except (OSError, AttributeError):  # not allowed; no such thing on this system
        return False
    for thread in map(int, os.listdir("/proc/self/task")):
        with suppress(ProcessLookupError):  # it has ended by now
            if os.sched_getscheduler(thread) == os.SCHED_OTHER:
                os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(BESIDE))
    return True
