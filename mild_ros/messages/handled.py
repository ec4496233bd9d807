# SPDX-License-Identifier: Apache-2.0
"""The outcome of one input, as a `std_msgs/Header`: how a replay over DDS knows when a stage is done with it.

The frame_id reads "<stage> <number of outputs handed to the next stage> <outcome>", the stamp is the input's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mild_core.errors import DataError
from mild_ros.messages.stamps import ns_from_msg, time_to_msg
from mild_ros.messages.standard import Header


@dataclass(frozen=True)
class Handled:
    """What a stage did with one input.

    Attributes:
        stage: Which stage: perception, inference, retargeting or pipeline.
        outputs: How many inputs of the next stage came of it.
        outcome: One word, a key of the stage's counts.
        stamp_ns: Stamp of the input, of the clock for a tick.
    """

    stage: str
    outputs: int
    outcome: str
    stamp_ns: int


def handled_to_msg(handled: Handled) -> Header:
    """The message of an outcome."""
    text = f"{handled.stage} {handled.outputs} {handled.outcome}"
    return Header(stamp=time_to_msg(handled.stamp_ns), frame_id=text)


def handled_from_msg(message: Any) -> Handled:
    """The outcome in a message.

    Raises:
        DataError: `wrong_layout` when the text is another.
    """
    words = str(message.frame_id).split(" ")
    if len(words) != 3 or not words[1].isdecimal():
        raise DataError("wrong_layout", f"'{message.frame_id}' is not '<stage> <outputs> <outcome>'")
    return Handled(words[0], int(words[1]), words[2], ns_from_msg(message.stamp))
