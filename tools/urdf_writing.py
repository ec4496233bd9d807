# SPDX-License-Identifier: Apache-2.0
"""Write a robot description (URDF) of boxes, cylinders and spheres from a few lines per link.

Masses and inertias follow from the solid shapes, taken as of one density within a link.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal
from xml.etree import ElementTree

import numpy as np

from mild_core.retargeting.robot_model.urdf import rotation_from_rpy
from mild_core.shapes import FloatArray

Vector = tuple[float, float, float]
"""x, y, z in the link's frame [m], or roll, pitch, yaw [rad]."""

ORIGIN: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Shape:
    """One body of a link.

    Attributes:
        kind: `box`, `cylinder` (along its z) or `sphere`.
        size: Edges of the box; radius and length of the cylinder; radius of the sphere [m].
        centre: Of the shape.
        turn: Roll, pitch and yaw.
        colour: Name of a material.
        solid: Whether it also has mass and collides; the others only look.
    """

    kind: Literal["box", "cylinder", "sphere"]
    size: tuple[float, ...]
    centre: Vector
    turn: Vector
    colour: str
    solid: bool

    def volume(self) -> float:
        """Cubic metres."""
        if self.kind == "box":
            return math.prod(self.size)
        if self.kind == "cylinder":
            return math.pi * self.size[0] ** 2 * self.size[1]
        return 4.0 / 3.0 * math.pi * self.size[0] ** 3

    def inertia(self) -> FloatArray:
        """(3, 3) about its centre, per mass [m^2]. Source: textbook moments of homogeneous bodies."""
        if self.kind == "box":
            x, y, z = (edge**2 for edge in self.size)
            own = np.diag([y + z, x + z, x + y]) / 12.0
        elif self.kind == "cylinder":
            across = self.size[0] ** 2 / 4.0 + self.size[1] ** 2 / 12.0
            own = np.diag([across, across, self.size[0] ** 2 / 2.0])
        else:
            own = np.eye(3) * 0.4 * self.size[0] ** 2
        rotation = rotation_from_rpy(*self.turn)
        turned: FloatArray = rotation @ own @ rotation.T
        return turned


def box(size: Vector, centre: Vector, colour: str, turn: Vector = ORIGIN, solid: bool = False) -> Shape:
    """A box."""
    return Shape("box", size, centre, turn, colour, solid)


def ball(centre: Vector, radius: float, colour: str, solid: bool = False) -> Shape:
    """A sphere."""
    return Shape("sphere", (radius,), centre, ORIGIN, colour, solid)


def rod(start: Vector, end: Vector, radius: float, colour: str, solid: bool = False) -> Shape:
    """A cylinder from `start` to `end`."""
    between = np.subtract(end, start)
    length = float(np.linalg.norm(between))
    x, y, z = (float(value) for value in between / length)
    middle = (np.add(start, end) / 2.0).tolist()
    turn = (0.0, math.acos(max(-1.0, min(1.0, z))), math.atan2(y, x))
    return Shape("cylinder", (radius, length), (middle[0], middle[1], middle[2]), turn, colour, solid)


def pill(start: Vector, end: Vector, radius: float, colour: str, solid: bool = False) -> tuple[Shape, ...]:
    """A cylinder with round ends; the ends are for the eye only."""
    return (rod(start, end, radius, colour, solid), ball(start, radius, colour), ball(end, radius, colour))


def lathed(
    profile: tuple[tuple[float, float], ...], colour: str, place: tuple[float, float] = (0.0, 0.0), step: float = 0.012
) -> tuple[Shape, ...]:
    """A body of revolution about an upright axis at `place`, of discs `step` thick, for the eye only.

    `profile` gives (height, radius) [m] from one end to the other.
    """
    shapes: list[Shape] = []
    for (low, narrow), (high, wide) in pairwise(profile):
        discs = max(1, round(abs(high - low) / step))
        for disc in range(discs):
            start, end, middle = (low + (high - low) * (disc + part) / discs for part in (0.0, 1.0, 0.5))
            radius = narrow + (wide - narrow) * (middle - low) / (high - low)
            shapes.append(rod((*place, start), (*place, end), radius, colour))
    return tuple(shapes)


def cushion(size: Vector, centre: Vector, radius: float, colour: str, facets: int = 3) -> tuple[Shape, ...]:
    """An upright box with upright edges rounded by facets; only its inner box is solid."""
    x, y, z = size
    shapes = [
        box((x, y - 2.0 * radius, z), centre, colour, solid=True),
        box((x - 2.0 * radius, y, z), centre, colour),
    ]
    opening = math.pi / 2.0 / facets
    edge = (radius, 2.0 * radius * math.tan(opening / 2.0), z)
    for place in range(4 * facets):
        angle = (place + 0.5) * opening
        along, across = math.cos(angle), math.sin(angle)
        corner = (math.copysign(x / 2.0 - radius, along), math.copysign(y / 2.0 - radius, across))
        middle = (centre[0] + corner[0] + along * radius / 2.0, centre[1] + corner[1] + across * radius / 2.0)
        shapes.append(box(edge, (*middle, centre[2]), colour, (0.0, 0.0, angle)))
    return tuple(shapes)


@dataclass
class Description:
    """A robot description under way; `text` is the URDF."""

    name: str
    comment: str
    root: ElementTree.Element = field(init=False)

    def __post_init__(self) -> None:
        self.root = ElementTree.Element("robot", name=self.name)
        self.root.append(ElementTree.Comment(f" {self.comment} "))

    def material(self, name: str, rgba: tuple[float, float, float, float]) -> None:
        """Name a colour."""
        material = ElementTree.SubElement(self.root, "material", name=name)
        ElementTree.SubElement(material, "color", rgba=_text(rgba))

    def link(self, name: str, shapes: tuple[Shape, ...] = (), mass_kg: float = 0.0) -> None:
        """Add a link; without shapes it is a mere frame."""
        link = ElementTree.SubElement(self.root, "link", name=name)
        if mass_kg > 0.0:
            centre, inertia = mass_properties(tuple(shape for shape in shapes if shape.solid), mass_kg)
            inertial = ElementTree.SubElement(link, "inertial")
            ElementTree.SubElement(inertial, "origin", xyz=_text(centre))
            ElementTree.SubElement(inertial, "mass", value=_text([mass_kg]))
            entries = {name: _text([inertia[place]]) for name, place in INERTIA_ENTRIES.items()}
            ElementTree.SubElement(inertial, "inertia", entries)
        for shape in shapes:
            for kind in ("visual", "collision") if shape.solid else ("visual",):
                part = ElementTree.SubElement(link, kind)
                ElementTree.SubElement(part, "origin", xyz=_text(shape.centre), rpy=_text(shape.turn))
                geometry = ElementTree.SubElement(part, "geometry")
                ElementTree.SubElement(geometry, shape.kind, _measures(shape))
                if kind == "visual":
                    ElementTree.SubElement(part, "material", name=shape.colour)

    def joint(self, name: str, parent: str, child: str, xyz: Vector, rpy: Vector = ORIGIN) -> ElementTree.Element:
        """Add a rigid joint; returns it, to be made movable."""
        joint = ElementTree.SubElement(self.root, "joint", name=name, type="fixed")
        ElementTree.SubElement(joint, "origin", xyz=_text(xyz), rpy=_text(rpy))
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        return joint

    def text(self) -> str:
        """The URDF."""
        ElementTree.indent(self.root, " ")
        return ElementTree.tostring(self.root, encoding="unicode", xml_declaration=True) + "\n"


INERTIA_ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""The numbers of a symmetric matrix that a URDF asks for, and where they stand."""


def movable(
    joint: ElementTree.Element, kind: str, axis: Vector, limits: tuple[float, float], velocity: float, effort: float
) -> None:
    """Let `joint` turn (`revolute`) or slide (`prismatic`) about or along `axis` [rad or m, and their rates]."""
    joint.set("type", kind)
    ElementTree.SubElement(joint, "axis", xyz=_text(axis))
    bounds = {"lower": _text(limits[:1]), "upper": _text(limits[1:])}
    ElementTree.SubElement(joint, "limit", {**bounds, "velocity": _text([velocity]), "effort": _text([effort])})


def mass_properties(solids: tuple[Shape, ...], mass_kg: float) -> tuple[FloatArray, FloatArray]:
    """Centre of mass (3,) [m] and inertia (3, 3) about it [kg m^2] of shapes of one density.

    Source: the parallel-axis theorem. Where shapes overlap, the overlap counts twice: this is a model.
    """
    volumes = np.array([shape.volume() for shape in solids])
    masses = mass_kg * volumes / volumes.sum()
    centres = np.array([shape.centre for shape in solids])
    centre: FloatArray = masses @ centres / mass_kg
    inertia = np.zeros((3, 3))
    for mass, shape, away in zip(masses, solids, centres - centre, strict=True):
        inertia += mass * (shape.inertia() + (away @ away) * np.eye(3) - np.outer(away, away))
    return centre, inertia


def _measures(shape: Shape) -> dict[str, str]:
    if shape.kind == "box":
        return {"size": _text(shape.size)}
    if shape.kind == "cylinder":
        return {"radius": _text(shape.size[:1]), "length": _text(shape.size[1:])}
    return {"radius": _text(shape.size)}


def _text(numbers: FloatArray | tuple[float, ...] | list[float]) -> str:
    # Nine digits: far below a micrometre; + 0.0 turns -0 into 0.
    return " ".join(f"{round(float(number), 9) + 0.0:.9g}" for number in numbers)
