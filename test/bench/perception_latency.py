# SPDX-License-Identifier: Apache-2.0
"""How long one skeleton takes through perception: `./mild measure perception_latency`.

One thread, a body of 32 joints at the model's rate, from people to window and person; and what reading the tracker's
bytes takes before it. Time of the processor, not of the wall, and the best median of several runs: other processes only
ever make it longer.
"""

from __future__ import annotations

import argparse
import gc
from collections.abc import Callable
from time import thread_time_ns
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message

from mild_core.perception.skeletons import SOURCES
from mild_core.perception.stage import Perception
from mild_ros.messages.marker_array import people_from_marker_array, people_to_marker_array
from mild_ros.messages.marker_array_bytes import marker_array_from_bytes
from test.core.perception.scene import SETTINGS, at_rate, seen

RUNS = 10


def microseconds(one: Callable[[Any], Any], inputs: list[Any]) -> float:
    """Median time of a call."""
    times = np.empty(len(inputs))
    gc.collect()
    gc.disable()
    for index, given in enumerate(inputs):
        start = thread_time_ns()
        one(given)
        times[index] = thread_time_ns() - start
    gc.enable()
    return float(np.median(times)) / 1e3


def main() -> None:
    """Measure and print."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    source, perception = SOURCES["azure_kinect"], Perception(SETTINGS)
    messages = seen(at_rate(40.0, 12.0))
    data = [serialize_message(people_to_marker_array(people, source)) for people in messages]
    read = min(
        microseconds(lambda given: people_from_marker_array(marker_array_from_bytes(given), source, 0), data)
        for _ in range(RUNS)
    )
    steps = []
    for _ in range(RUNS):
        state = perception.init()
        for people in messages[:60]:
            state, _ = perception.step(state, people, people[0].stamp_ns)
        states = [state]

        def step(people: Any, states: list[Any] = states) -> None:
            states[0], windows = perception.step(states[0], people, people[0].stamp_ns)
            assert len(windows) == 1

        steps.append(microseconds(step, messages[60:]))
    print(f"reading a MarkerArray of 32 joints: {read:.0f} us; a step of perception: {min(steps):.0f} us")


if __name__ == "__main__":
    main()
