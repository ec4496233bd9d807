# SPDX-License-Identifier: Apache-2.0
"""The scenes in which the robot is judged: what people do around it, redrawn for every seed.

The watched person stands before YuMi where people stood before it in the model's recordings, or near that place; the
hands of a handshake meet at about x 0.7, y -0.15, z 0.3 m in the robot's base frame, its own hand waits at
x 0.1, y -0.3, z -0.05 m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mild_core.retargeting.robots import ROBOTS
from mild_ros.benchmark.bodies import (
    HANGING,
    HEAD_JOINTS,
    KINECT_JOINTS,
    LOWER_JOINTS,
    Arm,
    Array,
    Path,
    Person,
    Sizes,
    arm_path,
    mirrored,
    path,
)
from test.bench.around_people.run import Expectation, Setting, Tracker
from tools.scenes import SCENES as GESTURES

Rng = np.random.Generator

FACING_ROBOT = math.pi
FLOOR_M = -0.7
"""YuMi stands on a table of 0.6 m; adults before it are then as high as in the recordings."""

START_S = 2.6
"""When the watched person raises the hand: a second to be calibrated and as long again for the first window."""

SHOULDER_M = {
    "handshake": (0.8926, 0.128, 0.7504),
    "rocket": (0.8701, 0.0405, 0.9008),
    "parachute": (1.0731, 0.095, 0.5418),
    "hand_wave": (0.9453, 0.0879, 0.731),
}
"""Where the right shoulder of people was in the recordings, in YuMi's base frame."""

PEPPER_SHOULDER_M = (0.7854, 0.1975, -0.0015)
PEPPER = {"model": "pepper_nuisi_next", "robot": "pepper"}
GREETING = Expectation(0.035, "wanted", True)
SMALL_NOISE_M = 0.015
"""What 4 mm of noise may take from a distance that is kept: nearly four standard deviations."""

KEPT = 0.05 - SMALL_NOISE_M
"""The distance that is kept, less the tracker's noise."""


@dataclass(frozen=True)
class Scene:
    """One kind of scene.

    Attributes:
        name: Short.
        what: What happens, in a sentence.
        make: Draws the numbers of one.
        quick: Whether it is among the few of `--quick`.
    """

    name: str
    what: str
    make: Callable[[Rng], Setting]
    quick: bool = False


SCENES: dict[str, Scene] = {}


def scene(what: str, quick: bool = False) -> Callable[[Callable[[Rng], Setting]], Callable[[Rng], Setting]]:
    """Add a scene to the table, under the name of the function that draws it."""

    def added(make: Callable[[Rng], Setting]) -> Callable[[Rng], Setting]:
        SCENES[make.__name__] = Scene(make.__name__, what, make, quick)
        return make

    return added


# People and what they do.


def gesture(name: str, rng: Rng, start_s: float = START_S, side: str = "right") -> tuple[Path, float]:
    """An arm that does what an interaction wants, a little differently every time; and when it is at rest again."""
    (chosen,) = [each for each in GESTURES if each.name == name]
    pace = rng.uniform(0.92, 1.08)
    keys: list[tuple[float, Arm]] = [(0.0, HANGING), (start_s, HANGING)]
    time_s = start_s
    for pose in chosen.poses:
        time_s += pose.after_s * pace
        upper, fore = (tuple(np.array(each) + rng.normal(0.0, 0.015, 3)) for each in (pose.upper, pose.fore))
        keys.append((time_s, (upper, fore)))  # type: ignore[arg-type] # three numbers each
    keys[-1] = (time_s, HANGING)
    if side == "left":
        keys = [(when, mirrored(arm)) for when, arm in keys]
    return arm_path(*keys), time_s


def standing(
    rng: Rng, shoulder: tuple[float, float, float], stature_m: float | None = None, near_m: float = 0.0
) -> tuple[Sizes, Path]:
    """A person whose right shoulder is about there, facing the robot."""
    sizes = Sizes(stature_m or rng.uniform(1.6, 1.9), rng.uniform(0.95, 1.1))
    x, y = shoulder[0] - near_m + rng.normal(0.0, 0.015), shoulder[1] + rng.normal(0.0, 0.015)
    return sizes, path((0.0, (x, y - sizes.length(0.1055), FACING_ROBOT)))


def greeter(rng: Rng, name: str = "handshake", **changes: Any) -> tuple[Person, float]:
    """The watched person, who greets the robot; and when the hand is back at rest."""
    arm, end_s = gesture(name, rng)
    sizes, root = standing(rng, SHOULDER_M[name])
    floor = SHOULDER_M[name][2] - sizes.length(0.818)
    offers = "" if name == "hand_wave" else "right"
    person = Person(sizes, root, right=arm, floor_m=floor, offers=offers)
    return replace(person, **changes), end_s


def bystander(rng: Rng, x: float, y: float, yaw: float, stature_m: float | None = None, **changes: Any) -> Person:
    """Another person who stands there."""
    sizes = Sizes(stature_m or rng.uniform(1.55, 1.9), rng.uniform(0.95, 1.1))
    return replace(Person(sizes, path((0.0, (x, y, yaw))), floor_m=FLOOR_M, number=lambda _: 2), **changes)


def arriving(person: Person, rng: Rng) -> Person:
    """The same person, who comes to their place once the watched person is calibrated, and who stays there.

    Perception watches whom it sees nearest to the camera at first.
    """
    (_, (x, y, yaw)) = person.root.keys[0]
    away = -1.3 if y < 0.1 else 1.3
    start = rng.uniform(1.1, 1.3)
    return replace(person, root=path((start, (x, y + away, yaw)), (start + 1.5, (x, y, yaw))))


def keeping_hand(person: Person, from_s: float, until_s: float) -> Person:
    """The same person, whose right hand stays where it is at a time, whatever the body does, until another."""
    hand = person.points(np.array([from_s]))["right_hand"][0].tolist()
    way = path((from_s - 0.1, (*hand, 0.0)), (from_s + 0.2, (*hand, 1.0)), (until_s - 0.6, (*hand, 1.0)))
    return replace(person, reach=(("right", Path((*way.keys, (until_s, (*hand, 0.0))))),))


def stepping(person: Person, *steps: tuple[float, float, float, float]) -> Person:
    """The same person, who goes: (from [s], to [s], x, y by which) one after the other."""
    (_, (x, y, yaw)) = person.root.keys[0]
    keys: list[tuple[float, tuple[float, ...]]] = [(0.0, (x, y, yaw))]
    for start_s, end_s, dx, dy in steps:
        keys.append((start_s, (x, y, yaw)))
        x, y = x + dx, y + dy
        keys.append((end_s, (x, y, yaw)))
    return replace(person, root=path(*keys))


def at_work(rng: Rng) -> tuple[Person, float]:
    """A greeter for scenes whose subject is another person: handshake or parachute."""
    return greeter(rng, ("handshake", "parachute", "handshake", "rocket")[rng.integers(4)])


def _greeting(name: str, rng: Rng) -> Setting:
    person, end_s = greeter(rng, name)
    expectation = replace(GREETING, touches=name != "hand_wave")
    return Setting((person,), end_s + 3.0, expectation, greets_s=START_S)


# As it is meant to be.


@scene("A handshake.", quick=True)
def handshake(rng: Rng) -> Setting:
    return _greeting("handshake", rng)


@scene("A rocket fist bump.")
def rocket(rng: Rng) -> Setting:
    return _greeting("rocket", rng)


@scene("A parachute fist bump.")
def parachute(rng: Rng) -> Setting:
    return _greeting("parachute", rng)


@scene("A wave, without contact.")
def hand_wave(rng: Rng) -> Setting:
    return _greeting("hand_wave", rng)


@scene("A handshake before Pepper, whose arm is short.")
def pepper_handshake(rng: Rng) -> Setting:
    arm, end_s = gesture("handshake", rng)
    sizes, root = standing(rng, PEPPER_SHOULDER_M, rng.uniform(1.2, 1.4), near_m=0.08)
    person = Person(sizes, root, right=arm, floor_m=PEPPER_SHOULDER_M[2] - sizes.length(0.818), offers="right")
    return Setting((person,), end_s + 3.0, replace(GREETING, touches=False), parameters=PEPPER, greets_s=START_S)


@scene("A greeting with the left arm, with the parameter `side` at left.")
def left_arm(rng: Rng) -> Setting:
    arm, end_s = gesture("handshake", rng, side="left")
    sizes = Sizes(rng.uniform(1.6, 1.9))
    root = path((0.0, (SHOULDER_M["handshake"][0], -0.38 + sizes.length(0.1055) + rng.normal(0.0, 0.02), FACING_ROBOT)))
    person = Person(sizes, root, left=arm, floor_m=FLOOR_M, offers="left")
    expectation = Expectation(KEPT, "wanted")
    return Setting((person,), end_s + 3.0, expectation, parameters={"side": "left"}, greets_s=START_S)


# Others around.


@scene("During a greeting a bystander crosses between the two, at 0.3 to 0.9 m/s.", quick=True)
def bystander_crossing(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    speed, x = rng.uniform(0.3, 0.9), rng.uniform(0.42, 0.6)
    sign = 1.0 if rng.random() < 0.5 else -1.0
    start = rng.uniform(3.0, 4.5)
    walker = bystander(rng, x, 0.0, sign * math.pi / 2.0)
    yaw = sign * math.pi / 2.0
    way = path((start, (x, -1.4 * sign, yaw)), (start + 2.8 / speed, (x, 1.4 * sign, yaw)), straight=True)
    keep = 0.0 if speed <= 0.6 else None
    return Setting((person, replace(walker, root=way)), max(end_s, start + 2.8 / speed) + 1.5, Expectation(keep))


@scene("A bystander stands where the arm of a greeting goes, and stays.", quick=True)
def bystander_staying(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    other = bystander(rng, rng.uniform(0.42, 0.58), rng.uniform(-0.5, -0.18), rng.uniform(-math.pi, math.pi))
    return Setting((person, arriving(other, rng)), end_s + 3.0, Expectation(KEPT))


@scene("A bystander stands close beside a greeting.")
def bystander_beside(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    other = bystander(rng, rng.uniform(0.6, 0.85), rng.uniform(-0.62, -0.48), rng.uniform(2.0, 4.0))
    return Setting((person, arriving(other, rng)), end_s + 3.0, Expectation(KEPT))


@scene("Two bystanders, one on each side.")
def two_bystanders(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    one = bystander(rng, rng.uniform(0.4, 0.6), rng.uniform(-0.6, -0.35), rng.uniform(1.5, 4.0))
    two = bystander(rng, rng.uniform(0.35, 0.5), rng.uniform(0.25, 0.45), rng.uniform(-4.0, -1.5))
    two = replace(two, number=lambda _: 3)
    return Setting((person, arriving(one, rng), arriving(two, rng)), end_s + 3.0, Expectation(KEPT))


@scene("A bystander reaches into the way of the arm and stays there.")
def arm_reaching_in(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    start = rng.uniform(3.2, 4.5)
    hand = (rng.uniform(0.4, 0.6), rng.uniform(-0.35, -0.1), rng.uniform(0.1, 0.3))
    way = path((start, (*hand, 0.0)), (start + rng.uniform(0.8, 1.5), (*hand, 1.0)))
    other = bystander(rng, 0.62, -0.85, math.pi / 2.0 + 0.3, reach=(("left", way),))
    return Setting((person, other), end_s + 3.0, Expectation(0.0))


@scene("A bystander rests a hand in the way of the arm all the time.")
def arm_resting_in_the_way(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    hand = (rng.uniform(0.4, 0.55), rng.uniform(-0.35, -0.15), rng.uniform(0.05, 0.25))
    way = path((1.2, (*hand, 0.0)), (2.4, (*hand, 1.0)))
    other = bystander(rng, 0.62, -0.85, math.pi / 2.0 + 0.3, reach=(("left", way),))
    return Setting((person, other), end_s + 3.0, Expectation(KEPT))


@scene("A bystander looks at the robot's hand from close by: the head comes into it, at up to 0.5 m/s.", quick=True)
def head_into_hand(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    out = rng.random() < 0.5
    hand = np.array([0.58, -0.2, 0.22]) if out else np.array([0.13, -0.31, -0.02])
    sizes = Sizes(rng.uniform(1.6, 1.85))
    long, lean = sizes.length(0.41), rng.uniform(0.9, 1.1)
    yaw = rng.uniform(1.8, 2.6)
    floor = float(hand[2]) - (sizes.length(0.53) + long * math.cos(lean))
    reach = long * math.sin(lean)
    x, y = hand[0] - reach * math.cos(yaw), hand[1] - reach * math.sin(yaw)
    start, takes = (4.2, rng.uniform(1.5, 2.5)) if out else (0.5, rng.uniform(1.5, 2.5))
    leaning = path((start, (0.0,)), (start + takes, (lean,)))
    other = Person(sizes, path((0.0, (float(x), float(y), yaw))), floor_m=floor, lean=leaning, number=lambda _: 2)
    return Setting((person, other), end_s + 3.0, Expectation(0.0))


@scene("A bystander's trunk comes into the arm, at up to 0.6 m/s.")
def trunk_into_arm(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    x, start = rng.uniform(0.4, 0.55), rng.uniform(3.8, 5.0)
    other = bystander(rng, x, -1.1, math.pi / 2.0)
    other = stepping(other, (start, start + rng.uniform(2.2, 3.2), 0.0, rng.uniform(0.7, 0.9)))
    return Setting((person, other), end_s + 3.0, Expectation(0.0))


@scene("Two people greet the robot at once, from the left and from the right.")
def two_greeting(rng: Rng) -> Setting:
    person, end_s = greeter(rng)
    arm, _ = gesture("handshake", rng, START_S + rng.uniform(-0.3, 0.6))
    other = bystander(rng, rng.uniform(0.72, 0.85), rng.uniform(-0.75, -0.6), FACING_ROBOT - 0.4, right=arm)
    other = arriving(other, rng)
    return Setting((person, other), end_s + 3.0, Expectation(KEPT))


@scene("The tracker swaps the numbers of the tracked person and of a bystander, twice.")
def numbers_swapped(rng: Rng) -> Setting:
    person, end_s = greeter(rng)
    first, second = sorted(rng.uniform(3.0, end_s, 2))
    watched = replace(person, number=lambda time_s: 2 if first <= time_s < second else 1)
    other = bystander(rng, rng.uniform(0.65, 0.8), rng.uniform(-0.65, -0.5), rng.uniform(2.5, 3.5))
    other = replace(arriving(other, rng), number=lambda time_s: 1 if first <= time_s < second else 2)
    return Setting((watched, other), end_s + 3.0, Expectation(KEPT))


@scene("An adult leads a child of 1.1 m past during a greeting; the child stops at the arm.")
def child_beside(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    start = rng.uniform(3.2, 4.2)
    child = bystander(rng, rng.uniform(0.45, 0.6), -1.2, math.pi / 2.0, rng.uniform(1.05, 1.2))
    child = stepping(child, (start, start + rng.uniform(2.0, 3.0), 0.0, rng.uniform(0.7, 0.95)))
    return Setting((person, child), end_s + 3.0, Expectation(0.0))


@scene("A bystander stands close to Pepper's arm while a person greets it.")
def pepper_bystander(rng: Rng) -> Setting:
    arm, end_s = gesture("handshake", rng)
    sizes, root = standing(rng, PEPPER_SHOULDER_M, rng.uniform(1.2, 1.4), near_m=0.08)
    floor = PEPPER_SHOULDER_M[2] - sizes.length(0.818)
    person = Person(sizes, root, right=arm, floor_m=floor, offers="right")
    other = bystander(rng, rng.uniform(0.28, 0.4), rng.uniform(-0.4, -0.15), rng.uniform(1.5, 4.5), 1.2, floor_m=-0.82)
    return Setting((person, arriving(other, rng)), end_s + 3.0, Expectation(KEPT), parameters=PEPPER)


# What is not seen, or not known.


@scene("The camera's place is not known, and the person stands 0.25 m nearer than in the recordings.", quick=True)
def place_unmeasured(rng: Rng) -> Setting:
    name = ("handshake", "rocket", "parachute")[rng.integers(3)]
    arm, end_s = gesture(name, rng)
    sizes, root = standing(rng, SHOULDER_M[name], near_m=0.25)
    floor = SHOULDER_M[name][2] - sizes.length(0.818)
    person = Person(sizes, root, right=arm, floor_m=floor)
    return Setting((person,), end_s + 3.0, Expectation(0.0), measured=False)


@scene("The head is never seen well enough: of a child as high as the arm, or of an adult who bends in.", quick=True)
def head_unseen(rng: Rng) -> Setting:
    hidden = _unseen(HEAD_JOINTS)
    if rng.random() < 0.7:
        setting = child(rng)
        (small,) = setting.people
        return replace(setting, people=(replace(small, confidence=hidden),))
    person, end_s = greeter(rng, confidence=hidden)
    return Setting((_bent(rng, person, end_s),), end_s + 3.0, Expectation(0.0))


@scene("Pelvis, hips and legs are hidden from the first second on, and the person leans in.")
def hips_unseen(rng: Rng) -> Setting:
    person, end_s = greeter(rng, confidence=_unseen(LOWER_JOINTS, 2.0))
    return Setting((_bent(rng, person, end_s),), end_s + 3.0, Expectation(0.0))


@scene("Only shoulders and the right arm are seen, from the second second on, and the person leans in.")
def shoulders_only(rng: Rng) -> Setting:
    kept = {f"right_{part}" for part in ("shoulder", "elbow", "wrist", "hand", "hand_tip", "thumb")} | {"left_shoulder"}
    person, end_s = greeter(rng, confidence=_unseen(tuple(set(KINECT_JOINTS) - kept), 2.0))
    return Setting((_bent(rng, person, end_s),), end_s + 3.0, Expectation(0.0))


@scene("A bystander in the way of the arm of whom the tracker sees the upper body only, without the head.")
def bystander_half_seen(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    hidden = _unseen((*HEAD_JOINTS, *LOWER_JOINTS))
    place = rng.uniform(0.42, 0.58), rng.uniform(-0.5, -0.2), rng.uniform(-math.pi, math.pi)
    return Setting((person, arriving(bystander(rng, *place, confidence=hidden), rng)), end_s + 3.0, Expectation(0.0))


# No greeting for the robot.


def _turned(rng: Rng, right: Path, end_s: float, yaw: float) -> Setting:
    sizes = Sizes(rng.uniform(1.6, 1.9))
    root = path((0.0, (rng.uniform(0.85, 1.1), rng.uniform(-0.25, 0.25), yaw)))
    return Setting((Person(sizes, root, right=right, floor_m=FLOOR_M),), end_s + 2.0, Expectation(KEPT, "unwanted"))


@scene("Turned away from the robot, the person greets another person.", quick=True)
def turned_away(rng: Rng) -> Setting:
    name = ("handshake", "rocket", "parachute", "hand_wave")[rng.integers(4)]
    return _turned(rng, *gesture(name, rng), rng.uniform(-1.2, 1.2))


@scene("Facing the robot, the person scratches the head.")
def scratching(rng: Rng) -> Setting:
    up: Arm = ((0.45, -0.55, 0.1), (-0.25, 0.55, 0.85))
    rub: Arm = ((0.4, -0.6, 0.2), (-0.15, 0.65, 0.75))
    keys = [(0.0, HANGING), (START_S, HANGING), (START_S + rng.uniform(0.7, 1.0), up)]
    for beat in range(6):
        keys.append((keys[-1][0] + rng.uniform(0.2, 0.35), rub if beat % 2 == 0 else up))
    keys.append((keys[-1][0] + 0.8, HANGING))
    return _turned(rng, arm_path(*keys), keys[-1][0], FACING_ROBOT + rng.normal(0.0, 0.1))


@scene("Facing the robot, the person points aside.")
def pointing(rng: Rng) -> Setting:
    out: Arm = ((0.3, -0.9, rng.uniform(-0.3, 0.1)), (0.15, -1.0, rng.uniform(-0.1, 0.2)))
    keys = [(0.0, HANGING), (START_S, HANGING), (START_S + rng.uniform(0.7, 1.0), out)]
    keys += [(keys[-1][0] + rng.uniform(1.0, 2.0), out)]
    keys.append((keys[-1][0] + 0.8, HANGING))
    return _turned(rng, arm_path(*keys), keys[-1][0], FACING_ROBOT + rng.normal(0.0, 0.1))


# The watched person does something else.


def _bent(rng: Rng, person: Person, end_s: float) -> Person:
    """The same person, who bends over the hand that stays where it is, and up again."""
    start, takes, lean = rng.uniform(3.8, 4.6), rng.uniform(1.2, 2.0), rng.uniform(0.65, 0.95)
    back = max(start + takes + 1.0, end_s - 1.5)
    way = path((start, (0.0,)), (start + takes, (lean,)), (back, (lean,)), (back + 1.5, (0.0,)))
    return replace(keeping_hand(person, start, back), lean=way)


def _moved_in(rng: Rng, person: Person, start: float, takes: float, by: float) -> Person:
    if rng.random() < 0.6 and start < 6.0:
        person = keeping_hand(person, start, start + takes + 2.0)
    return stepping(person, (start, start + takes, -by, rng.uniform(-0.1, 0.05)))


@scene("While hands touch, the person lunges at the robot: 0.35 m in 0.5 to 0.9 s.")
def lunge(rng: Rng) -> Setting:
    person, end_s = greeter(rng)
    moved = _moved_in(rng, person, rng.uniform(4.0, 5.5), rng.uniform(0.5, 0.9), rng.uniform(0.25, 0.4))
    return Setting((moved,), end_s + 3.0, Expectation(None))


@scene("While hands touch, the person bends over them, the head into the working space.", quick=True)
def bend(rng: Rng) -> Setting:
    person, end_s = greeter(rng)
    return Setting((_bent(rng, person, end_s),), end_s + 3.0, Expectation(0.0))


@scene("While hands touch, the person walks into the arm, at up to 0.5 m/s.")
def walks_in(rng: Rng) -> Setting:
    person, end_s = greeter(rng)
    moved = _moved_in(rng, person, rng.uniform(4.0, 5.0), rng.uniform(1.6, 2.4), rng.uniform(0.3, 0.4))
    return Setting((moved,), end_s + 3.0, Expectation(0.0))


@scene("The person comes nearer while the robot goes home.")
def approach_going_home(rng: Rng) -> Setting:
    person, end_s = greeter(rng)
    moved = _moved_in(rng, person, end_s - rng.uniform(0.0, 0.5), rng.uniform(0.8, 1.4), rng.uniform(0.3, 0.45))
    return Setting((moved,), end_s + 4.0, Expectation(0.0))


@scene("While hands touch, the person jerks the hand back, in 0.2 to 0.35 s.")
def hand_jerked_back(rng: Rng) -> Setting:
    person, _ = greeter(rng)
    kept = [key for key in person.right.keys if key[0] < rng.uniform(4.5, 6.0)]
    fast = kept[-1][0] + rng.uniform(0.2, 0.35)
    rest = person.right.keys[0][1]
    return Setting((replace(person, right=Path((*kept, (fast, rest)))),), fast + 4.0, Expectation(KEPT))


@scene("In the middle of a greeting the person turns round and walks off.")
def walk_off(rng: Rng) -> Setting:
    person, end_s = greeter(rng)
    start = rng.uniform(4.5, 6.0)
    (_, (x, y, yaw)) = person.root.keys[0]
    turn = yaw + rng.choice([-1.0, 1.0]) * rng.uniform(2.2, 3.1)
    root = path((start, (x, y, yaw)), (start + 0.9, (x + 0.1, y, turn)), (start + 3.0, (x + 1.8, y, turn)))
    return Setting((replace(person, root=root),), end_s + 1.0, Expectation(KEPT))


@scene("A child of 1.1 m greets YuMi, with the head as high as the arm.")
def child(rng: Rng) -> Setting:
    name = ("handshake", "parachute", "hand_wave")[rng.integers(3)]
    arm, end_s = gesture(name, rng)
    sizes, root = standing(rng, (0.72, 0.1, 0.0), rng.uniform(1.05, 1.25), rng.uniform(-0.05, 0.15))
    person = Person(sizes, root, right=arm, floor_m=FLOOR_M + rng.uniform(0.0, 0.2), offers="right")
    return Setting((person,), end_s + 3.0, Expectation(KEPT))


@scene("A person on a high chair greets YuMi; the knees are below the arm.")
def seated(rng: Rng) -> Setting:
    name = ("handshake", "parachute", "rocket")[rng.integers(3)]
    arm, end_s = gesture(name, rng)
    sizes, root = standing(rng, (0.9, 0.1, 0.0))
    floor = rng.uniform(-0.62, -0.45)
    person = Person(sizes, root, right=arm, floor_m=floor, seated=True, offers="right")
    return Setting((person,), end_s + 3.0, Expectation(KEPT))


@scene("A bystander sits beside the robot with the knees near its arm.")
def knees_near(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    sizes = Sizes(rng.uniform(1.6, 1.85))
    root = path((0.0, (rng.uniform(0.35, 0.5), -0.95, math.pi / 2.0)))
    other = Person(sizes, root, floor_m=rng.uniform(-0.55, -0.4), seated=True, number=lambda _: 2)
    return Setting((person, arriving(other, rng)), end_s + 3.0, Expectation(KEPT))


@scene("A person stands still near the arm while it goes from pose to pose as fast as it may.", quick=True)
def near_fast_motion(rng: Rng) -> Setting:
    robot = ROBOTS["yumi"]
    poses = rng.uniform(robot.lower_rad, robot.upper_rad, (40, len(robot.joint_names)))
    poses = robot.home_rad + np.clip(poses - robot.home_rad, -1.3, 1.3)
    changes = np.cumsum(rng.uniform(0.4, 1.2, len(poses)))

    def target(time_s: float) -> Array:
        chosen: Array = poses[min(int(np.searchsorted(changes, time_s)), len(poses) - 1)]
        return chosen

    hand = (rng.uniform(0.35, 0.6), rng.uniform(-0.45, 0.05), rng.uniform(0.1, 0.45))
    # A hand that stays where it is for 3 s has ended the interaction: it goes a little up and down.
    beats = [(time_s, (*hand[:2], hand[2] + 0.07 * (beat % 2), 1.0)) for beat, time_s in enumerate(range(5, 14, 2), 1)]
    beats = [each for time_s, key in beats for each in ((time_s - 0.4, key), (time_s + 1.0, key))]
    way = path((1.8, (*hand, 0.0)), (2.6, (*hand, 1.0)), *beats)
    sizes, root = standing(rng, (hand[0] + rng.uniform(0.38, 0.48), hand[1] + rng.uniform(-0.1, 0.25), 0.0))
    person = Person(sizes, root, floor_m=FLOOR_M, offers="right", reach=(("right", way),))
    return Setting((person,), 14.0, Expectation(KEPT), motions=target)


@scene("A bystander stands still near the arm while it goes from pose to pose as fast as it may.")
def bystander_near_fast_motion(rng: Rng) -> Setting:
    setting = near_fast_motion(rng)
    other = bystander(rng, rng.uniform(0.25, 0.5), rng.uniform(-0.8, -0.6), math.pi / 2.0)
    return replace(setting, people=(*setting.people, arriving(other, rng)))


# A worse tracker.


def _worse(rng: Rng, keep_m: float, touches: bool, **changes: Any) -> Setting:
    person, end_s = greeter(rng)
    return Setting((person,), end_s + 3.0, Expectation(keep_m, "any", touches), Tracker(**changes), greets_s=START_S)


@scene("25 mm of noise, and every fifth message is lost; a bystander stands in the way.")
def noise_and_loss(rng: Rng) -> Setting:
    person, end_s = at_work(rng)
    other = bystander(rng, rng.uniform(0.42, 0.58), rng.uniform(-0.5, -0.25), rng.uniform(-math.pi, math.pi))
    return Setting((person, arriving(other, rng)), end_s + 3.0, Expectation(-0.02), Tracker(noise_m=0.025, loss=0.2))


@scene("A greeting with a tracker of 5 Hz.")
def tracker_5_hz(rng: Rng) -> Setting:
    return _worse(rng, KEPT, False, rate_hz=5.0, delay_s=(0.03, 0.08))


@scene("A greeting with a tracker of 10 Hz.")
def tracker_10_hz(rng: Rng) -> Setting:
    return _worse(rng, KEPT, False, rate_hz=10.0)


@scene("A greeting with a tracker of 60 Hz.")
def tracker_60_hz(rng: Rng) -> Setting:
    return _worse(rng, KEPT, True, rate_hz=60.0)


@scene("The tracker falls silent for 0.3 to 1 s, three times, while the robot moves; the person leans in meanwhile.")
def drop_outs(rng: Rng) -> Setting:
    starts = np.array([3.2, 5.2, 7.2]) + rng.uniform(-0.4, 0.4, 3)
    pauses = tuple((float(start), float(start + rng.uniform(0.3, 1.0))) for start in starts)
    person, end_s = greeter(rng)
    first = pauses[1][0]
    lean = path((first, (0.0,)), (first + 0.8, (rng.uniform(0.15, 0.3),)))
    return Setting((replace(person, lean=lean),), end_s + 3.0, Expectation(0.0), Tracker(pauses=pauses))


@scene("The tracker shows the person 0.2 to 0.5 m elsewhere for 0.03 to 0.2 s, five times.")
def pose_jumps(rng: Rng) -> Setting:
    jumps = []
    for start in np.arange(3.0, 8.0) + rng.uniform(0.0, 0.7, 5):
        way = rng.normal(0.0, 1.0, 3)
        way *= rng.uniform(0.2, 0.5) / np.linalg.norm(way)
        jumps.append((float(start), float(start + rng.uniform(0.03, 0.2)), *(float(each) for each in way)))
    person, end_s = greeter(rng)
    return Setting((person,), end_s + 3.0, Expectation(0.0), Tracker(jumps=tuple(jumps)))  # type: ignore[arg-type]


def _unseen(names: tuple[str, ...], from_s: float = 0.0) -> Callable[[float, str], float]:
    """Confidence of a tracker that only guesses these joints from a time on; 0.3 is the Azure Kinect's for these."""
    hidden = frozenset(names)
    return lambda time_s, name: 0.3 if name in hidden and time_s >= from_s else 1.0
