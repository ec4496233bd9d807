# SPDX-License-Identifier: Apache-2.0
"""People as the bytes of a tracker's message, made once for each posture: at 1 kHz there is no time to build them."""

from __future__ import annotations

import struct
from dataclasses import replace

from rclpy.serialization import serialize_message

from mild_core.perception.skeletons import SOURCES
from mild_ros.messages.marker_array import people_to_marker_array
from test.faults.people import People

_STAND_IN_NS = 1_234_567_890_123_456_789
"""A stamp that is replaced where it lies: no coordinates look like it."""


def _stamp(stamp_ns: int) -> bytes:
    return struct.pack("<iI", *divmod(stamp_ns, 10**9))


class EncodedPeople:
    """Makes messages, and keeps them for the next time that people stand so."""

    def __init__(self) -> None:
        self._kept: dict[object, bytes] = {}

    def message(self, people: People) -> bytes:
        """The message that an Azure Kinect would send of people, who have one stamp."""
        key = tuple((one.person_id, one.frame_id, one.joint_names, one.positions_m.tobytes()) for one in people)
        if key not in self._kept:
            stopped = [replace(one, stamp_ns=_STAND_IN_NS) for one in people]
            self._kept[key] = serialize_message(people_to_marker_array(stopped, SOURCES["azure_kinect"]))
        data = self._kept[key]
        return data.replace(_stamp(_STAND_IN_NS), _stamp(people[0].stamp_ns)) if people else data
