# SPDX-License-Identifier: Apache-2.0
"""Messages of any age as those of ROS 2 Jazzy: of ROS 1, of earlier versions, and under names that packages once had.

The bag's own definition of a type decides how its bytes are read. Where there is none, as in databases before Iron,
it is the newest version of ROS 2 that the bytes fit: every field of a message has to be there, and nothing behind it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from typing import Any

from rosbags.convert.converter import migrate_message
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from mild_ros.bag.budgets import DECODED_BYTES, FLAT_TYPES, OverBudgetError, check_types, types_from_idl, types_from_msg

RENAMED_TYPES = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
RENAMED_PACKAGES = {
    "zed_interfaces": "zed_msgs",
    "yolov8_msgs": "yolo_msgs",
    "naoqi_msgs": "naoqi_bridge_msgs",
    "nao_msgs": "naoqi_bridge_msgs",
}
"""What trackers' and robots' messages were called before; source: the changelogs of these packages."""

OLDER = tuple(
    Stores.__members__[f"ROS2_{name}"]
    for name in ("LYRICAL", "KILTED", "IRON", "HUMBLE", "GALACTIC", "FOXY", "ELOQUENT", "DASHING")
    if f"ROS2_{name}" in Stores.__members__
)
"""Versions of ROS 2 other than Jazzy, the newest first."""

NO_MESSAGE = b"\x00\x01\x00\x00"
"""Bytes that hold no message of any type, for what cannot be brought into another form."""

TRUSTED = 20
"""After so many messages in a row that fit a version, the next ones are not tried any more."""

HEADER = "std_msgs/msg/Header"

Convert = Callable[[bytes], bytes]


@cache
def jazzy_types() -> Typestore:
    """All message types of ROS 2 Jazzy, for reading and writing messages without ROS."""
    return get_typestore(Stores.ROS2_JAZZY)


def current_name(type_name: str) -> str:
    """What a type is called in Jazzy: `package/msg/Type`, in bags of every ROS distribution.

    Source: ROS 1 and some writers of mcap leave `msg` out, recorders of DDS say `package::msg::dds_::Type_`.
    """
    name = re.sub(r"^(\w+)::(\w+)::dds_::(\w+)_$", r"\1/\2/\3", type_name)
    name = re.sub(r"^(\w+)/(\w+)$", r"\1/msg/\2", name)
    package, _, rest = RENAMED_TYPES.get(name, name).partition("/")
    return f"{RENAMED_PACKAGES.get(package, package)}/{rest}" if rest else package


@lru_cache(maxsize=512)
def defined_types(text: str, type_name: str, is_idl: bool) -> Typestore | None:
    """The types of a definition, and those of Jazzy that it speaks of and leaves out; None when it cannot be read.

    Args:
        text: As bags have it, with the definitions of its parts or without.
        type_name: Its name today.
        is_idl: Whether it is written in IDL.

    Raises:
        OverBudgetError: It is longer or larger than a bag's definitions may be.
    """
    rule = "=" * 80 + "\n"
    for old, new in RENAMED_PACKAGES.items():
        text = re.sub(rf"\b{old}\b", new, text)
    try:
        if text.startswith(f"{rule}IDL: "):
            parts = [part.split("\n", 1)[1] for part in text.split(rule)[1:]]
            found = {name: kind for part in parts for name, kind in types_from_idl(part).items()}
        else:
            found = types_from_idl(text) if is_idl else types_from_msg(text, type_name)
        check_types(found)
        store = get_typestore(Stores.EMPTY)
        store.register({**_of_jazzy(type_name, found), **found})
    except OverBudgetError:
        raise
    except Exception:  # a parser on foreign bytes
        return None
    return store if type_name in store.fielddefs else None


def _of_jazzy(type_name: str, found: Mapping[str, Any]) -> dict[str, Any]:
    """The types of Jazzy that a type and its parts consist of, as far as they are not in `found`."""
    known, missing, waiting = jazzy_types().fielddefs, {}, [type_name, "builtin_interfaces/msg/Time"]
    waiting.append("builtin_interfaces/msg/Duration")
    seen = set(waiting)
    while waiting:
        name = waiting.pop()
        if name not in found and name in known:
            missing[name] = known[name]
        for part in _parts(found.get(name) or missing.get(name) or ((), ())):
            if part not in seen:
                seen.add(part)
                waiting.append(part)
    return missing


def _parts(definition: Any) -> list[str]:
    """The types that are parts of one."""
    kinds = [kind if kind[0] in (Nodetype.NAME, Nodetype.BASE) else kind[1][0] for _, kind in definition[1]]
    return [kind[1] for kind in kinds if kind[0] == Nodetype.NAME]


def have_one_form(one: Typestore, other: Typestore, type_name: str, *, is_ros1: bool = False) -> bool:
    """Whether two stores mean the same bytes and the same fields by a type.

    Args:
        one: Knows the type.
        other: Likewise.
        type_name: Its name.
        is_ros1: `one` is of ROS 1, where a header has one field more that converting skips.
    """
    if is_ros1 and type_name == HEADER:
        return True
    mine, theirs = ([(name.lower(), kind) for name, kind in store.fielddefs[type_name][1]] for store in (one, other))
    return mine == theirs and all(
        have_one_form(one, other, part, is_ros1=is_ros1) for part in _parts(one.fielddefs[type_name])
    )


class Layouts:
    """How the messages of a bag become messages of today.

    Attributes:
        types: Those of Jazzy, and of the bag's own those that Jazzy does not have, with parts of today.
    """

    def __init__(self) -> None:
        self.types = get_typestore(Stores.ROS2_JAZZY)

    def define(self, text: str, type_name: str, is_idl: bool) -> Typestore | None:
        """A bag's own types of a topic; None when it does not define them in a way that can be read.

        Args:
            text: The definition; "" for none.
            type_name: As the bag says it.
            is_idl: Whether the definition is written in IDL.

        Raises:
            OverBudgetError: As `defined_types`.
        """
        own = defined_types(text, current_name(type_name), is_idl) if text.strip() else None
        if own is not None:
            new = {name: kind for name, kind in own.fielddefs.items() if name not in self.types.fielddefs}
            if new:
                self.types.register(new)
        return own

    def convert(self, own: Typestore | None, type_name: str, *, is_ros1: bool) -> Convert | None:
        """Brings bytes of a topic into the form of `types`; None where they have it already, or theirs is unknown.

        Bytes that hold no message become `NO_MESSAGE`.

        Args:
            own: The bag's own types of it, as `define` gives them.
            type_name: As the bag says it.
            is_ros1: Whether they are of ROS 1.
        """
        name = current_name(type_name)
        if is_ros1:
            own = own or get_typestore(Stores.ROS1_NOETIC)
            if name not in own.fielddefs:
                return lambda data: NO_MESSAGE
            if have_one_form(own, self.types, name, is_ros1=True):
                return _guarded(name, lambda data: bytes(self.types.ros1_to_cdr(data, name)))
            return self._migrating(own, name, is_ros1=True)
        if own is not None:
            return None if have_one_form(own, self.types, name) else self._migrating(own, name)
        return self._fitting(name) if name in self.types.fielddefs else None

    def _migrating(self, own: Typestore, name: str, *, is_ros1: bool = False) -> Convert:
        """Field by field, by their names."""
        remembered: dict[str, object] = {}

        def migrate(data: bytes) -> bytes:
            old = own.deserialize_ros1(data, name) if is_ros1 else own.deserialize_cdr(data, name)
            new = migrate_message(own, self.types, name, name, remembered, old)
            return bytes(self.types.serialize_cdr(new, name))

        return _guarded(name, migrate)

    def _fitting(self, name: str) -> Convert | None:
        """By the version of ROS 2 whose message the bytes are; None when all versions have the same."""
        others = _other_forms(name)
        if not others:
            return None
        forms: list[tuple[Typestore, Convert]] = [(self.types, bytes)]
        forms += [(store, self._migrating(store, name)) for store in others]
        place, fitted = 0, 0

        def convert(data: bytes) -> bytes:
            nonlocal place, fitted
            if fitted < TRUSTED and len(data) <= DECODED_BYTES:
                fitting = [index for index in (place, *range(len(forms))) if _fits(forms[index][0], data, name)]
                if not fitting:
                    return data  # no message of any version: as it is, for who counts it
                fitted = fitted + 1 if fitting[0] == place else 0
                place = fitting[0]
            return forms[place][1](data)

        return convert


@cache
def _other_forms(name: str) -> tuple[Typestore, ...]:
    """Versions of ROS 2 that mean other bytes by a type of Jazzy's, one of each kind, the newest first."""
    found = [jazzy_types()]
    for version in OLDER:
        store = get_typestore(version)
        if name in store.fielddefs and not any(have_one_form(store, known, name) for known in found):
            found.append(store)
    return tuple(found[1:])


def _fits(store: Typestore, data: bytes, name: str) -> bool:
    try:
        store.deserialize_cdr(data, name)
    except Exception:  # foreign bytes
        return False
    return True


def _guarded(name: str, convert: Convert) -> Convert:
    """A conversion that makes `NO_MESSAGE` of what it cannot convert, or what would take too much memory."""

    def guarded(data: bytes) -> bytes:
        if len(data) > DECODED_BYTES and name not in FLAT_TYPES:
            return NO_MESSAGE
        try:
            return convert(data)
        except Exception:  # foreign bytes
            return NO_MESSAGE

    return guarded
