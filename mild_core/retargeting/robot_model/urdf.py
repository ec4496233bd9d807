# SPDX-License-Identifier: Apache-2.0
"""Read the links' shapes and the joints from a robot description (URDF), trusting nothing in it.

A description may come from an untrusted latched topic, and what loads it later is native code that dies of what it does
not expect. So every description is examined here first, for every caller, within budgets far above any robot's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from mild_core.budgets import read_file
from mild_core.errors import SetupError
from mild_core.printable import printable
from mild_core.shapes import FloatArray, read_only

SIZE_LIMIT = 8_000_000
"""Bytes; vendors' descriptions of two-armed robots have under 0.2 MB."""

DEPTH_LIMIT, ELEMENTS_LIMIT = 32, 100_000
LINKS_LIMIT, SHAPES_LIMIT, CHAIN_LIMIT = 300, 1000, 100
"""Links and as many joints; visuals and collisions; joints one after the other. Humanoids with hands have a third."""

NAME_LIMIT = 200
"""Characters of a name; PyBullet has room for 1023."""

LARGEST_M, HEAVIEST_KG, LARGEST_KG_M2 = 100.0, 1e5, 1e7
"""Of a part of a robot."""

ROUNDING_KG_M2 = 1e-9
"""An inertia that is below zero by less is what a program that wrote it has rounded."""

TURNING, SLIDING = ("revolute", "continuous"), ("prismatic",)
LOOSE = ("floating", "planar")
"""Kinds of joints without a single position: what they carry is taken to stay where the file puts it."""

FIXED = ("fixed", *LOOSE)
"""The kinds that do not move."""

MACRO = re.compile(r"\$[{(]")
"""In a value: what xacro puts something in place of."""

WIDE, DECLARED = (b"\xff\xfe", b"\xfe\xff"), re.compile(rb"""\s*<\?xml[^>]*encoding=["']([^"']*)["'][^>]*\?>""")
"""How a file of two bytes per character begins; the line in which a file declares its encoding."""

SHAPES = {"box": (("size", 3),), "cylinder": (("radius", 1), ("length", 1)), "sphere": (("radius", 1),)}
"""Primitive shapes, and how many numbers each of their sizes has."""

NUMBERS_OF_JOINTS: Mapping[str, tuple[str, ...]] = {
    "axis": ("xyz",),
    "limit": ("lower", "upper", "velocity", "effort"),
    "mimic": ("multiplier", "offset"),
    "safety_controller": ("soft_lower_limit", "soft_upper_limit"),
}
"""By the part of a joint its attributes that are numbers."""

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
        limits: Smallest and largest position and largest speed [rad or m, and per s]; NaN where the file has none that
            a joint could move in. Where the robot's own safety controller keeps narrower ones, these.
        soft: What became of the limits of its safety controller: `kept` where they are narrower, `no room` where they
            leave none and do not count, else "".
        effort: Largest torque or force [N m or N]; 0 where the file has none.
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
    soft: str = ""
    effort: float = 0.0


@dataclass(frozen=True, eq=False)
class Solid:
    """One body of primitive shape that a link collides with, or looks like.

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

    def __init__(self) -> None:
        super().__init__()
        self._depth = self._count = 0

    def start(self, tag: str, attributes: dict[str, str], /) -> ElementTree.Element:
        self._depth += 1
        self._count += 1
        if self._depth > DEPTH_LIMIT or self._count > ELEMENTS_LIMIT:
            raise ValueError(f"it has more than {ELEMENTS_LIMIT} elements, or {DEPTH_LIMIT} in each other")
        return super().start(tag, attributes)

    def end(self, tag: str, /) -> ElementTree.Element:
        self._depth -= 1
        return super().end(tag)


def _parsed(text: bytes) -> ElementTree.Element:
    """The elements of a description, whatever prefixes their names have: `<drake:joint>` needs no declaration."""
    building, parser = _Refusing(), expat.ParserCreate()

    def refuse(*_: object) -> None:
        raise ValueError("it declares a document type")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = building.start, building.end
    parser.Parse(text, True)
    return building.close()


def _in_utf_8(text: bytes) -> bytes:
    """The same; a file that is not what it claims, or claims nothing, is taken for Latin-1, as old editors write."""
    try:
        text.decode()
    except UnicodeDecodeError:
        declared = DECLARED.match(text[:200])
        if not text.startswith(WIDE) and (declared is None or declared[1].lower() in (b"utf-8", b"us-ascii")):
            return text[declared.end() if declared else 0 :].decode("latin-1").encode()
    return text


def read_joints(path: Path) -> tuple[Joint, ...]:
    """The joints of the description at `path`, in the order of the file.

    Raises:
        SetupError: The file is missing, too large, no URDF, or holds a joint that cannot be computed.

    Source: the URDF specification, http://wiki.ros.org/urdf/XML
    """
    return _read(path, lambda root: tuple(_joint(element) for element in root.findall("joint")))


def read_solids(path: Path, tag: Literal["collision", "visual"] = "collision") -> tuple[Solid, ...]:
    """What the links of the description at `path` collide with, or look like; meshes are passed over.

    Raises:
        SetupError: The file is missing, too large or no URDF.

    Source: the URDF specification, http://wiki.ros.org/urdf/XML
    """
    return _read(path, lambda root: tuple(solid for link in root.findall("link") for solid in _solids(link, tag)))


def read_description(path: Path) -> ElementTree.Element:
    """The examined description at `path`, as a tree of elements.

    Raises:
        SetupError: The file is missing, too large, no URDF, or outside a budget.
    """
    return _read(path, lambda root: root)


def _read(path: Path, read: Callable[[ElementTree.Element], Parts]) -> Parts:
    text = read_file(path, SIZE_LIMIT, "give the path of a URDF file")
    try:
        root = _parsed(_in_utf_8(text))
        if root.tag != "robot":
            raise ValueError(f"its root is <{root.tag}>, not <robot>")
        _refuse_macros(path, root)
        _examine(root)
        return read(root)
    except (ValueError, expat.ExpatError, LookupError) as error:
        raise SetupError(str(path), f"is no robot description: {error}", "give a valid URDF file") from error


def _refuse_macros(path: Path, root: ElementTree.Element) -> None:
    """Raise SetupError for a file of macros, from which a description has yet to be made."""
    for element in root.iter():
        if element.tag.startswith("xacro:") or any(MACRO.search(value) for value in element.attrib.values()):
            raise SetupError(
                str(path),
                f"is xacro, not URDF yet: <{element.tag}>",
                f"give what 'xacro {path.name} > robot.urdf' makes of it",
            )


def _examine(root: ElementTree.Element) -> None:
    """Raise ValueError for what no robot has, and what programs that load it may die of."""
    links, joints = root.findall("link"), root.findall("joint")
    parts = [part for link in links for tag in ("visual", "collision") for part in link.findall(tag)]
    if max(len(links), len(joints)) > LINKS_LIMIT or len(parts) > SHAPES_LIMIT:
        counts = f"{len(links)} links, {len(joints)} joints and {len(parts)} shapes"
        raise ValueError(f"it has {counts}; at most {LINKS_LIMIT}, {LINKS_LIMIT} and {SHAPES_LIMIT} are read")
    for element in (*links, *joints):
        name = element.get("name", "")
        if not name or len(name) > NAME_LIMIT or not name.isprintable():
            raise ValueError(f"a {element.tag} is called '{printable(name, 60)}'")
    for element in (*links, *joints):
        try:
            _examine_numbers(element)
        except ValueError as error:
            raise ValueError(f"{element.tag} '{element.get('name')}': {error}") from None
    _examine_tree(_distinct("link", links), joints)


def _distinct(what: str, elements: list[ElementTree.Element]) -> set[str]:
    """Their names. Raises ValueError where two have the same."""
    names: set[str] = set()
    for element in elements:
        if (name := element.get("name", "")) in names:
            raise ValueError(f"two {what}s are called '{name}': two of one name")
        names.add(name)
    return names


def _examine_numbers(element: ElementTree.Element) -> None:
    """Raise ValueError for numbers of a link or a joint that none has."""
    parts = [part for tag in ("visual", "collision", "inertial") for part in element.findall(tag)]
    for placed in (*parts, element):
        _finite(placed.find("origin"), "xyz", 3, LARGEST_M)
        _finite(placed.find("origin"), "rpy", 3, 1e6)
    for part in parts:
        _examine_shape(part.find("geometry"))
    for tag, names in NUMBERS_OF_JOINTS.items():
        for name in names:
            _numbers(element.find(tag), name, (0.0,) * (3 if name == "xyz" else 1))
    for inertial in element.findall("inertial"):
        _finite(inertial.find("mass"), "value", 1, HEAVIEST_KG, 0.0)
        for place in ("ixx", "iyy", "izz"):
            _finite(inertial.find("inertia"), place, 1, LARGEST_KG_M2, -ROUNDING_KG_M2)
        for place in ("ixy", "ixz", "iyz"):
            _finite(inertial.find("inertia"), place, 1, LARGEST_KG_M2)


def _examine_shape(geometry: ElementTree.Element | None) -> None:
    if geometry is None:
        return
    for shape in geometry:
        for name, count in (*SHAPES.get(shape.tag, ()), *((("radius", 1), ("length", 1)) * (shape.tag == "capsule"))):
            if shape.get(name) is None:
                raise ValueError(f"a {shape.tag} has no {name}")
            if min(_finite(shape, name, count, LARGEST_M)) <= 0.0:
                raise ValueError(f"a {shape.tag} has {name}='{shape.get(name)}', which is not above 0")
        if shape.tag == "mesh":
            _finite(shape, "scale", 3, 1e4)


def _examine_tree(links: set[str], joints: list[ElementTree.Element]) -> None:
    """Raise ValueError unless the links hang together, none too far from the first."""
    parents: dict[str, str] = {}
    _distinct("joint", joints)
    for joint in joints:
        ends = [found.get("link", "") for tag in ("parent", "child") if (found := joint.find(tag)) is not None]
        if len(ends) != 2 or not all(ends):
            raise ValueError(f"joint '{joint.get('name')}' does not name a parent and a child")
        for end in ends:
            if end not in links:
                raise ValueError(f"joint '{joint.get('name')}' names a link '{end}' that it does not have")
        if ends[0] == ends[1]:
            raise ValueError(f"joint '{joint.get('name')}' joins link '{ends[0]}' to itself")
        if ends[1] in parents:
            raise ValueError(f"link '{ends[1]}' hangs on two joints, so it is no tree")
        parents[ends[1]] = ends[0]
    alone = sorted(links - parents.keys() - set(parents.values()))
    if alone and len(links) > 1:
        raise ValueError(f"link '{alone[0]}' hangs on no joint")
    for link in sorted(links):
        above = [link]
        while above[-1] in parents and len(above) <= CHAIN_LIMIT:
            above.append(parents[above[-1]])
            if (at := above[-1]) in above[:-1]:
                loop = above[above.index(at) : -1]
                first = loop.index(min(loop))
                raise ValueError(f"links hang on each other in a loop: {', '.join([*loop[first:], *loop[:first]][:5])}")
        if above[-1] in parents:
            raise ValueError(f"from '{link}' on, joints form a chain of more than {CHAIN_LIMIT}")
    roots = sorted(links - parents.keys())
    if len(roots) != 1:
        raise ValueError(f"its links form no tree: {', '.join(roots[:5]) or 'each'} hang on nothing")


def _finite(
    element: ElementTree.Element | None, name: str, count: int, largest: float, least: float = -math.inf
) -> tuple[float, ...]:
    numbers = _numbers(element, name, (0.0,) * count)
    if any(abs(number) > largest or number < least for number in numbers):
        given = ("", "") if element is None else (element.tag, element.get(name))
        raise ValueError(f"{given[0]} {name}='{given[1]}' is out of any robot's range")
    return numbers


def _solids(link: ElementTree.Element, tag: str) -> Iterator[Solid]:
    for element in link.findall(tag):
        for kind, sizes in SHAPES.items():
            shape = element.find(f"geometry/{kind}")
            if shape is None:
                continue
            size = tuple(number for name, count in sizes for number in _numbers(shape, name, (0.0,) * count))
            yield Solid(link.get("name", ""), kind, size, read_only(pose_of(element.find("origin"))))


def pose_of(origin: ElementTree.Element | None) -> FloatArray:
    """(4, 4) what an `<origin>` says [m]; none says nothing."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_rpy(*_numbers(origin, "rpy", (0.0, 0.0, 0.0)))
    pose[:3, 3] = _numbers(origin, "xyz", (0.0, 0.0, 0.0))
    return pose


def _joint(element: ElementTree.Element) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    if not name or kind not in TURNING + SLIDING + FIXED:
        raise ValueError(f"joint '{name}' of type '{printable(kind, 60)}' cannot be computed")
    origin, axis, mimic = (element.find(tag) for tag in ("origin", "axis", "mimic"))
    direction = np.array(_numbers(axis, "xyz", (1.0, 0.0, 0.0)))
    length = float(np.linalg.norm(direction))
    if kind not in FIXED and length < 1e-6:
        raise ValueError(f"joint '{name}' has no axis")
    limits, soft = _limits(element, kind)
    return Joint(
        name=name,
        kind=kind,
        parent=_link(element, name, "parent"),
        child=_link(element, name, "child"),
        origin=read_only(pose_of(origin)),
        axis=read_only(direction / max(length, 1e-6)),
        mimics="" if mimic is None else mimic.get("joint", ""),
        multiplier=_numbers(mimic, "multiplier", (1.0,))[0],
        offset=_numbers(mimic, "offset", (0.0,))[0],
        limits=limits,
        soft=soft,
        effort=max(0.0, _numbers(element.find("limit"), "effort", (0.0,))[0]),
    )


def _limits(element: ElementTree.Element, kind: str) -> tuple[tuple[float, float, float], str]:
    """Smallest and largest position and largest speed, NaN for what is not given or leaves no room; `Joint.soft`.

    Exporters write 0 where they know nothing. Soft limits count where they are narrower.
    Source: http://wiki.ros.org/pr2_controller_manager/safety_limits
    """
    limit, controller = element.find("limit"), element.find("safety_controller")
    lower, upper, velocity = (_limit(limit, name) for name in ("lower", "upper", "velocity"))
    if kind == "continuous":
        lower, upper = math.nan, math.nan
    elif limit is not None:
        lower, upper = _both(lower, upper)
        if lower == upper:
            lower, upper = math.nan, math.nan
    softest = _both(*(_limit(controller, name) for name in ("soft_lower_limit", "soft_upper_limit")))
    narrowed, soft = (float(np.fmax(lower, softest[0])), float(np.fmin(upper, softest[1]))), ""
    if not math.isnan(softest[0]) and kind not in FIXED:
        if softest[0] >= softest[1] or narrowed[0] >= narrowed[1]:
            soft = "no room"
        elif narrowed != (lower, upper):
            soft, (lower, upper) = "kept", narrowed
    return (lower, upper, velocity if velocity > 0.0 else math.nan), soft


def _both(lower: float, upper: float) -> tuple[float, float]:
    """Two limits of which the specification takes one that is left out (NaN) for 0; both are left out as they are."""
    if math.isnan(lower) and math.isnan(upper):
        return lower, upper
    return (0.0 if math.isnan(lower) else lower), (0.0 if math.isnan(upper) else upper)


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
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        numbers = ()
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
