# SPDX-License-Identifier: Apache-2.0
"""CDR bytes of a message that are the same every time.

rclpy's own serialisation pads with whatever was in memory, so its bytes cannot be compared or hashed. This walks
the fields of a message (an rclpy or a rosbags one: only attributes are read) and lets rosbags write them.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from mild_ros.bag.reader import jazzy_types

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_TIME = "builtin_interfaces/msg/Time"
_BYTE_NAMES = ("byte", "char", "octet")

Moved = Callable[[int], int]
"""What a stamp [ns] becomes."""


def type_name_of(message: Any) -> str:
    """The name of a message's type as bags write it, e.g. `sensor_msgs/msg/JointState`."""
    named = getattr(message, "__msgtype__", None)
    if named:
        return str(named)
    package, kind = type(message).__module__.split(".")[:2]
    return f"{package}/{kind}/{type(message).__name__}"


def encode(message: Any, shift_ns: int = 0, types: Typestore | None = None, at_ns: int | None = None) -> bytes:
    """The CDR bytes of `message`, equal for equal messages.

    Args:
        message: Of rclpy or of rosbags.
        shift_ns: Added to every stamp in it; a stamp of zero stays zero, as it stands for none.
        types: That know its type; None for those of ROS 2 Jazzy.
        at_ns: What every stamp becomes instead; None for those that it has.
    """
    name, types = type_name_of(message), types or jazzy_types()

    def moved_ns(stamp_ns: int) -> int:
        return stamp_ns + shift_ns if at_ns is None else at_ns

    return bytes(types.serialize_cdr(_rebuilt(message, name, moved_ns if shift_ns or at_ns else None, types), name))


def restamped(data: bytes, type_name: str, decode: Callable[[], Any], shift_ns: int, types: Typestore) -> bytes:
    """A message with `shift_ns` added to every stamp in it.

    Args:
        data: Its CDR bytes.
        type_name: Its type.
        decode: Reads it; called only when the stamps cannot be found in the bytes.
        shift_ns: Nanoseconds.
        types: That know its type.

    Returns:
        CDR bytes. A MarkerArray of a tracker has the same stamp in each marker and takes ten times longer to read
        and write than to search, so there the stamps are replaced where they lie.
    """
    if type_name == "visualization_msgs/msg/MarkerArray" and data[:4] == _LITTLE_ENDIAN and len(data) > 16:
        count, sec, nanosec = struct.unpack_from("<IiI", data, 4)
        stamp_ns = sec * 10**9 + nanosec
        if stamp_ns and data.count(data[8:16]) == count:
            return data.replace(data[8:16], struct.pack("<iI", *divmod(stamp_ns + shift_ns, 10**9)))
    return encode(decode(), shift_ns, types)


def _rebuilt(message: Any, type_name: str, moved_ns: Moved | None, types: Typestore) -> Any:
    """The same message in rosbags' own class."""
    _, fields = types.fielddefs[type_name]
    values = {name: _value(getattr(message, name), kind, moved_ns, types) for name, kind in fields}
    if moved_ns is not None and type_name == _TIME and any(values.values()):
        values["sec"], values["nanosec"] = divmod(moved_ns(values["sec"] * 10**9 + values["nanosec"]), 10**9)
    return types.types[type_name](**values)


def _value(value: Any, kind: Any, moved_ns: Moved | None, types: Typestore) -> Any:
    node, detail = kind
    if node is Nodetype.NAME:
        return _rebuilt(value, detail, moved_ns, types)
    if node is Nodetype.BASE:
        return value[0] if isinstance(value, bytes) else value
    element, name = detail[0]
    if element is Nodetype.BASE and name[0] != "string":
        return np.asarray(value, dtype="uint8" if name[0] in _BYTE_NAMES else name[0])
    return [_value(item, detail[0], moved_ns, types) for item in value]
