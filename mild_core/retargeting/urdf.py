# SPDX-License-Identifier: Apache-2.0
"""Read the links' shapes and the joints from a robot description (URDF), trusting nothing in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np

from mild_core.errors import SetupError
from mild_core.shapes import FloatArray, read_only

SIZE_LIMIT = 8_000_000
"""Bytes; vendors' descriptions of two-armed robots have under 0.2 MB."""

TURNING, SLIDING, FIXED = ("revolute", "continuous"), ("prismatic",), ("fixed",)
"""The kinds of joints that can be computed; `floating` and `planar` ones have no single position."""

SHAPES = {"box": (("size", 3),), "cylinder": (("radius", 1), ("length", 1)), "sphere": (("radius", 1),)}
"""Primitive shapes, and how many numbers each of their sizes has."""

Parts = TypeVar("Parts")


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint and the link that it carries.

    Attributes:
        name: Of the joint.
        kind: One of `TURNING`, `SLIDING`, `FIXED`.
        parent: The link before it.
        child: The link after it.
        origin: (4, 4) pose of the joint in the parent's frame [m].
        axis: (3,) unit vector in the joint's own frame.
        mimics: Name of the joint that this one copies, or "".
        multiplier: Position per position of the copied joint.
        offset: Position when the copied joint is at 0 [rad or m].
        limits: Smallest and largest position and largest speed [rad or m, and per s]; NaN where the file has none.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: FloatArray
    axis: FloatArray
    mimics: str = ""
    multiplier: float = 1.0
    offset: float = 0.0
    limits: tuple[float, float, float] = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class Solid:
    """One body of primitive shape that a link collides with.

    Attributes:
        link: Whose it is.
        kind: `box`, `cylinder` (along its z) or `sphere`.
        size_m: Edges of the box; radius and length of the cylinder; radius of the sphere.
        origin: (4, 4) pose of its centre in the link's frame [m].
    """

    link: str
    kind: str
    size_m: tuple[float, ...]
    origin: FloatArray


class _Refusing(ElementTree.TreeBuilder):
    """Builds the tree of elements but takes no document type: entities that expand without end come with one."""

    def doctype(self, name: str, pubid: str, system: str) -> None:
        raise ValueError("it declares a document type")


def read_joints(path: Path) -> tuple[Joint, ...]:
    """The joints of the description at `path`, in the order of the file.

    Raises:
        SetupError: The file is missing, too large, no URDF, or holds a joint that cannot be computed.

    Source: the URDF specification, http://wiki.ros.org/urdf/XML
    """
    return _read(path, lambda root: tuple(_joint(element) for element in root.findall("joint")))


def read_solids(path: Path) -> tuple[Solid, ...]:
    """What the links of the description at `path` collide with; meshes are passed over.

    Raises:
        SetupError: The file is missing, too large or no URDF.

    Source: the URDF specification, http://wiki.ros.org/urdf/XML
    """
    return _read(path, lambda root: tuple(solid for link in root.findall("link") for solid in _solids(link)))


def _read(path: Path, read: Callable[[ElementTree.Element], Parts]) -> Parts:
    try:
        with path.open("rb") as file:
            text = file.read(SIZE_LIMIT + 1)
    except OSError as error:
        raise SetupError(str(path), f"cannot be read ({error.strerror})", "give the path of a URDF file") from error
    try:
        if len(text) > SIZE_LIMIT:
            raise ValueError(f"it is larger than {SIZE_LIMIT // 1_000_000} MB")
        root = ElementTree.fromstring(text, parser=ElementTree.XMLParser(target=_Refusing()))
        if root.tag != "robot":
            raise ValueError(f"its root is <{root.tag}>, not <robot>")
        return read(root)
    except (ValueError, ElementTree.ParseError, LookupError) as error:
        raise SetupError(str(path), f"is no robot description: {error}", "give a valid URDF file") from error


def _solids(link: ElementTree.Element) -> Iterator[Solid]:
    for element in link.findall("collision"):
        for kind, sizes in SHAPES.items():
            shape = element.find(f"geometry/{kind}")
            if shape is None:
                continue
            size = tuple(number for name, count in sizes for number in _numbers(shape, name, (0.0,) * count))
            yield Solid(link.get("name", ""), kind, size, read_only(_pose(element.find("origin"))))


def _pose(origin: ElementTree.Element | None) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_rpy(*_numbers(origin, "rpy", (0.0, 0.0, 0.0)))
    pose[:3, 3] = _numbers(origin, "xyz", (0.0, 0.0, 0.0))
    return pose


def _joint(element: ElementTree.Element) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    if not name or kind not in TURNING + SLIDING + FIXED:
        raise ValueError(f"joint '{name}' of type '{kind}' cannot be computed")
    origin, axis, mimic, limit = (element.find(tag) for tag in ("origin", "axis", "mimic", "limit"))
    direction = np.array(_numbers(axis, "xyz", (1.0, 0.0, 0.0)))
    length = float(np.linalg.norm(direction))
    if kind not in FIXED and length < 1e-6:
        raise ValueError(f"joint '{name}' has no axis")
    return Joint(
        name=name,
        kind=kind,
        parent=_link(element, name, "parent"),
        child=_link(element, name, "child"),
        origin=read_only(_pose(origin)),
        axis=read_only(direction / max(length, 1e-6)),
        mimics="" if mimic is None else mimic.get("joint", ""),
        multiplier=_numbers(mimic, "multiplier", (1.0,))[0],
        offset=_numbers(mimic, "offset", (0.0,))[0],
        limits=(_limit(limit, "lower"), _limit(limit, "upper"), _limit(limit, "velocity")),
    )


def _link(element: ElementTree.Element, joint: str, tag: str) -> str:
    found = element.find(tag)
    link = "" if found is None else found.get("link", "")
    if not link:
        raise ValueError(f"joint '{joint}' names no {tag}")
    return link


def _limit(element: ElementTree.Element | None, name: str) -> float:
    return _numbers(element, name, (math.nan,))[0]


def _numbers(element: ElementTree.Element | None, name: str, default: tuple[float, ...]) -> tuple[float, ...]:
    text = None if element is None else element.get(name)
    if text is None:
        return default
    numbers = tuple(float(word) for word in text.split())
    if len(numbers) != len(default) or not all(math.isfinite(number) for number in numbers):
        raise ValueError(f"{name}='{text[:60]}' is not {len(default)} finite number(s)")
    return numbers


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> FloatArray:
    """(3, 3) rotation: roll about x, then pitch about y, then yaw about z, all fixed axes [rad]. Source: REP-103."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
