# SPDX-License-Identifier: Apache-2.0
"""A person's arm onto a robot's arm of two joints in the shoulder and two in the elbow (Pepper, NAO), exactly.

Upper arm and forearm of the robot get the directions of the person's. Where the joints' limits forbid that, the
upper arm comes as near as it can, then the elbow is solved again for the forearm and comes as near as it can.
Plain floats: a mapping takes some 10 us, less than numpy or a compiled function would need to be called.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, asin, atan2, cos, hypot, pi, sin, sqrt, tau
from typing import NamedTuple

from mild_core.shapes import FloatArray

Direction = tuple[float, float, float]
"""A unit vector."""

Angles = tuple[float, float]
"""The two angles of a shoulder or an elbow [rad]."""

SHORTEST_M, LONGEST_M = 0.01, 2.0
"""A segment of an arm that is shorter or longer is none."""

STRAIGHT = 0.01
"""Sine of the bend of an elbow below which its yaw stays about where it was: 0.6 degrees.

Straight, an elbow may be yawed at will. Without this one that trembles about straight would whip the upper arm round
and round. The yaw's freedom falls with the third power of the bend; where the arm can do what the person does, it
costs less than 0.05 degrees of the forearm's direction.
"""

AS_GOOD_RAD = 1e-3
"""Two ways to hold the arm whose directions differ by less are as good: then the nearer one is taken."""


WORTH_TURNING_RAD = 0.1
"""A yaw at its limit crosses over to the other one, most of a turn away, only to mend 6 degrees of direction."""


class _Way(NamedTuple):
    """One way to hold the arm; what it misses of the upper arm, the forearm and where the joints were [rad]."""

    shoulder: Angles
    elbow: Angles
    misses: tuple[float, float, float]


@dataclass(frozen=True)
class FourJointArm:
    """An arm whose shoulder turns about y, then z, and whose elbow turns about x, then z; at 0 it points ahead.

    Attributes:
        elbow_m: From shoulder to elbow with both shoulder joints at 0: x forward, y left, z up.
        elbow_pitch_rad: How the elbow's axes are turned about y in the upper arm.
        lower_rad: Smallest shoulder pitch, shoulder roll, elbow yaw, elbow roll; an elbow bends to one side only.
        upper_rad: The largest ones.
    """

    elbow_m: tuple[float, float, float]
    elbow_pitch_rad: float
    lower_rad: tuple[float, float, float, float]
    upper_rad: tuple[float, float, float, float]

    def joints(self, arm_m: FloatArray, near_rad: tuple[float, ...]) -> tuple[float, ...]:
        """Shoulder pitch and roll, elbow yaw and roll [rad].

        Args:
            arm_m: (3, 3) shoulder, elbow and hand of a person; x forward, y left, z up of the trunk.
            near_rad: The joints of before; returned where the person's arm is lost, so that it has no directions.
        """
        shoulder_m, elbow_m, hand_m = arm_m.tolist()
        upper_arm, forearm = _direction(shoulder_m, elbow_m), _direction(elbow_m, hand_m)
        if upper_arm is None or forearm is None:
            return near_rad
        shoulder, elbow = self.solve(upper_arm, forearm, near_rad)
        return (*shoulder, *elbow)

    def solve(self, upper_arm: Direction, forearm: Direction, near_rad: tuple[float, ...]) -> tuple[Angles, Angles]:
        """Shoulder pitch and roll, elbow yaw and roll inside the limits.

        Args:
            upper_arm: The person's, from shoulder to elbow; x forward, y left, z up of the trunk.
            forearm: From elbow to hand.
            near_rad: The four angles of before: of those that do as well, the nearest to them is taken.

        Source: the inverse of the vendor's kinematics. There are two solutions per upper arm, and one is often
        beyond the limits. An angle about which all else turns is best nearest to its free optimum on the circle,
        because the cosine of the error is a sine of it.
        """
        first, second = [
            self._judged(shoulder, upper_arm, forearm, near_rad) for shoulder in self._shoulders(upper_arm, near_rad[0])
        ]
        for one, other, tolerance in zip(first.misses, second.misses, (AS_GOOD_RAD, AS_GOOD_RAD, 0.0), strict=True):
            if abs(one - other) > tolerance:
                first = first if one < other else second
                break
        return first.shoulder, first.elbow

    def _judged(self, shoulder: Angles, upper_arm: Direction, forearm: Direction, near: tuple[float, ...]) -> _Way:
        """The best elbow for a shoulder, and how much the two of them miss."""
        elbow = self._elbow(shoulder, forearm, near[2])
        reached = self.directions(shoulder, elbow)
        turned = sum(abs(angle - before) for angle, before in zip((*shoulder, *elbow), near, strict=False))
        return _Way(shoulder, elbow, (_between(reached[0], upper_arm), _between(reached[1], forearm), turned))

    def directions(self, shoulder: Angles, elbow: Angles) -> tuple[Direction, Direction]:
        """Unit vectors along upper arm and forearm at these angles: forward kinematics."""
        yaw, roll = elbow
        bent = (cos(roll), sin(roll) * cos(yaw), sin(roll) * sin(yaw))
        fore = _about_y(_about_z(_about_y(bent, self.elbow_pitch_rad), shoulder[1]), shoulder[0])
        return _about_y(_about_z(_unit(self.elbow_m), shoulder[1]), shoulder[0]), fore

    def _shoulders(self, upper_arm: Direction, near_pitch: float) -> tuple[Angles, Angles]:
        """Both solutions for the upper arm, each as near as the limits allow."""
        x, y, z = _unit(self.elbow_m)
        level, turned = hypot(x, y), atan2(y, x)
        up = asin(_clipped(upper_arm[1] / level, -1.0, 1.0))
        found = []
        for rise in (up, pi - up):
            ahead = level * cos(rise)
            pitch = self._inside(0, atan2(z, ahead) - atan2(upper_arm[2], upper_arm[0]))
            pitch = _toward(pitch, near_pitch, abs(ahead))
            seen = _about_y(upper_arm, -pitch)
            found.append((pitch, self._inside(1, atan2(seen[1], seen[0]) - turned)))
        return found[0], found[1]

    def _elbow(self, shoulder: Angles, forearm: Direction, near_yaw: float) -> Angles:
        """The best elbow for the forearm with the shoulder as it is."""
        seen = _about_y(_about_z(_about_y(forearm, -shoulder[0]), -shoulder[1]), -self.elbow_pitch_rad)
        bends_to = 1.0 if self.upper_rad[3] > 0.0 else -1.0
        wanted = atan2(bends_to * seen[2], bends_to * seen[1])
        yaw = self._inside(2, wanted)
        if yaw in (ends := (self.lower_rad[2], self.upper_rad[2])):
            other = ends[0] if yaw == ends[1] else ends[1]
            gain = self._elbow_error(seen, other) - self._elbow_error(seen, yaw)
            yaw = other if abs(other - near_yaw) < abs(yaw - near_yaw) and gain < WORTH_TURNING_RAD else yaw
        else:
            yaw = _toward(yaw, near_yaw, hypot(seen[1], seen[2]))
        return yaw, self._bend(seen, yaw)

    def _bend(self, seen: Direction, yaw: float) -> float:
        """The best elbow roll at a yaw for a forearm `seen` in the elbow's axes."""
        return self._inside(3, atan2(seen[1] * cos(yaw) + seen[2] * sin(yaw), seen[0]))

    def _elbow_error(self, seen: Direction, yaw: float) -> float:
        roll = self._bend(seen, yaw)
        return _between((cos(roll), sin(roll) * cos(yaw), sin(roll) * sin(yaw)), seen)

    def _inside(self, joint: int, angle: float) -> float:
        """`angle` or, on the circle, the nearest angle within the limits."""
        lower, upper = self.lower_rad[joint], self.upper_rad[joint]
        angle = (angle + pi) % tau - pi
        if lower <= angle <= upper:
            return angle
        return lower if (lower - angle) % tau < (angle - upper) % tau else upper


def _toward(angle: float, near: float, radius: float) -> float:
    """`angle`, moved towards `near` by as much as hardly matters to a point at `radius` (1 at most) from the axis."""
    freedom = (STRAIGHT / max(radius, 1e-6)) ** 3
    return angle + _clipped(near - angle, -freedom, freedom)


def _clipped(value: float, lower: float, upper: float) -> float:
    return min(max(value, lower), upper)


def _direction(start: list[float], end: list[float]) -> Direction | None:
    x, y, z = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    return _unit((x, y, z)) if SHORTEST_M < sqrt(x * x + y * y + z * z) < LONGEST_M else None


def _unit(vector: tuple[float, float, float]) -> Direction:
    length = sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    return vector[0] / length, vector[1] / length, vector[2] / length


def _between(one: Direction, other: Direction) -> float:
    """The angle between two directions [rad]."""
    return acos(_clipped(one[0] * other[0] + one[1] * other[1] + one[2] * other[2], -1.0, 1.0))


def _about_y(vector: Direction, angle: float) -> Direction:
    c, s = cos(angle), sin(angle)
    return c * vector[0] + s * vector[2], vector[1], c * vector[2] - s * vector[0]


def _about_z(vector: Direction, angle: float) -> Direction:
    c, s = cos(angle), sin(angle)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]
