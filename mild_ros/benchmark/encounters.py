# SPDX-License-Identifier: Apache-2.0
"""Who meets the robot, where, how, and how they are seen: drawn from a seed, with no model of ours in it.

Sources: reach 0.92 +- 0.45 s (of handing over, as in the benchmark's issue); minimum jerk, Flash and Hogan 1985;
body sizes, `bodies.Sizes`; walking at 1.3 m/s, Bohannon 1997.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mild_ros.benchmark.bodies import HANGING, Array, Path, Person, Sizes, arm_path, mirrored, path

TOUCHING = ("handshake", "rocket", "parachute")
SHARES = {
    "handshake": 0.18,
    "rocket": 0.14,
    "parachute": 0.14,
    "wave": 0.14,
    "feint": 0.1,
    "withdrawn": 0.1,
    "passer_by": 0.12,
    "two_people": 0.08,
}
"""How many of the encounters are of each kind; those with two people are handshakes beside another person."""

STANDS_S = (2.0, 3.0)
"""A person stands so long before the hand is raised."""

REACH_S, REACH_DEVIATION_S, LEAST_REACH_S, MOST_REACH_S = 0.92, 0.45, 0.4, 2.0
WAITS_S, CONTACT_S, RETURN_S, EARLY_RETURN_S = 3.0, 2.0, 0.75, 0.45
AFTERWARDS_S = 9.0
"""The robot has so long to go home."""

BEFORE_ARM_M = 0.25
"""The middle of a person's trunk is so far beyond the waiting arm at least."""

FLOOR_M = -0.85
"""Height of the floor where the robot does not know it: it stands on a table."""


@dataclass(frozen=True)
class Timeline:
    """When the hand does what [s]; only the withdrawal depends on the robot.

    Attributes:
        raised_s: It leaves its rest ...
        offered_s: ... and has come to its place.
        withdrawn_s: It goes back, ...
        back_s: ... and is at rest again.
        moves_s: It starts to shake, rise or sink; infinite if hands have not met.
    """

    raised_s: float
    offered_s: float
    withdrawn_s: float
    back_s: float
    moves_s: float = math.inf


@dataclass(frozen=True)
class Tracking:
    """How people are seen.

    Attributes:
        rate_hz: Messages per second.
        noise_m: Standard deviation of each coordinate of each joint.
        loss: Share of messages that never come.
        delay_s: Least and largest time from the picture to the message.
        camera_off_m: (3,) by how much the calibrated camera is off.
    """

    rate_hz: float
    noise_m: float
    loss: float
    delay_s: tuple[float, float]
    camera_off_m: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Encounter:
    """One seed.

    Attributes:
        seed: Of all draws.
        kind: Of `SHARES`.
        interaction: What the person does: of `TOUCHING`, "wave" or "".
        side: Of the hand.
        person: Who, without the raised hand.
        others: Everyone else.
        place_m: (3,) where the hand is offered, in the robot's base frame.
        goes_m: (3,) how far it goes from there once hands have met ...
        goes_s: ... in so long; 0 for one that shakes by `goes_m`.
        timeline: As planned, if hands do not meet.
        tracking: How they are seen.
        duration_s: Until it is over, if nothing ends it before.
    """

    seed: int
    kind: str
    interaction: str
    side: str
    person: Person
    others: tuple[Person, ...]
    place_m: tuple[float, float, float]
    goes_m: tuple[float, float, float]
    goes_s: float
    timeline: Timeline
    tracking: Tracking
    duration_s: float

    @property
    def offers(self) -> bool:
        """Whether a hand is held out to be met."""
        return self.kind in (*TOUCHING, "two_people")

    def performed(self, timeline: Timeline) -> Person:
        """The person with the hand where a timeline says."""
        if self.kind == "passer_by":
            return self.person
        return replace(self.person, reach=((self.side, self._hand(timeline)),))

    def _hand(self, timeline: Timeline) -> Path:
        """x, y, z and the share of the hand's place over its hanging."""
        place, share = np.array(self.place_m), [0.0, 1.0]
        keys = [(timeline.raised_s, (*place, share[0])), (timeline.offered_s, (*place, share[1]))]
        last = place
        if self.kind == "wave":
            times = np.arange(timeline.offered_s, timeline.withdrawn_s - 0.2, 0.3)
            for number, time_s in enumerate(times[1:].tolist()):
                keys.append((time_s, (*(place + (1.0 if number % 2 else -1.0) * np.array(self.goes_m)), 1.0)))
        elif math.isfinite(timeline.moves_s) and self.goes_s > 0.0:
            last = place + np.array(self.goes_m)
            keys.append((timeline.moves_s, (*place, 1.0)))
            keys.append((min(timeline.moves_s + self.goes_s, timeline.withdrawn_s - 0.01), (*last, 1.0)))
        elif math.isfinite(timeline.moves_s):
            for number, time_s in enumerate(np.arange(timeline.moves_s, timeline.withdrawn_s - 0.25, 0.25).tolist()):
                keys.append((time_s, (*(place + (0, 1, 0, -1)[number % 4] * np.array(self.goes_m)), 1.0)))
        keys.append((timeline.withdrawn_s, (*last, 1.0)))
        keys.append((timeline.back_s, (*last, 0.0)))
        return path(*keys)


@dataclass(frozen=True)
class Stage:
    """Where a robot's arm is, for people to stand before it.

    Attributes:
        shoulder_m: (3,) of its first joint in its base frame.
        reach_m: How far its tool comes from there.
        floor_m: Height of the floor.
        home_m: How far ahead of there or aside the tool waits: no person comes to stand in the arm.
    """

    shoulder_m: tuple[float, float, float]
    reach_m: float
    floor_m: float = FLOOR_M
    home_m: float = 0.0


def draw(seed: int, stage: Stage) -> Encounter:
    """The encounter of a seed with a robot that stands so."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(list(SHARES), p=np.array(list(SHARES.values())) / sum(SHARES.values())))
    interaction = kind if kind in (*TOUCHING, "wave") else "" if kind == "passer_by" else str(rng.choice(TOUCHING))
    if kind == "two_people":
        interaction = "handshake"
    sizes = Sizes(1.1 if rng.random() < 0.1 else float(rng.uniform(1.5, 2.0)), float(rng.uniform(0.9, 1.15)))
    side = "left" if rng.random() < 0.3 else "right"
    sign = 1.0 if side == "left" else -1.0
    most_m = min(1.2, 0.85 * (stage.reach_m + sum(sizes.arm_m)))
    least_m = max(0.5, stage.home_m + BEFORE_ARM_M)
    away_m, bearing = (
        float(rng.uniform(least_m, max(most_m, least_m + 0.1))),
        float(rng.uniform(-math.pi / 4, math.pi / 4)),
    )
    x, y = np.array(stage.shoulder_m[:2]) + away_m * np.array([math.cos(bearing), math.sin(bearing)])
    facing = math.atan2(stage.shoulder_m[1] - y, stage.shoulder_m[0] - x) + float(rng.uniform(-0.15, 0.15))
    person = Person(sizes, path((0.0, (x, y, facing))), *_arms(rng), floor_m=stage.floor_m, offers=side)
    shoulder = person.points(np.zeros(1))[f"{side}_shoulder"][0]
    place = _place(interaction, shoulder, sizes, facing, stage, sign, rng)
    goes, goes_s = _goes(interaction, facing, rng)
    raised = float(rng.uniform(*STANDS_S))
    reach_s = float(np.clip(rng.normal(REACH_S, REACH_DEVIATION_S), LEAST_REACH_S, MOST_REACH_S))
    waits_s, back_s = float(rng.uniform(2.0, WAITS_S)) if kind == "wave" else WAITS_S, RETURN_S
    if kind == "feint":
        share = float(rng.uniform(0.4, 0.8))
        hanging = person.points(np.zeros(1))[f"{side}_hand"][0]
        place = hanging + share * (place - hanging)
        reach_s, waits_s, back_s = share * reach_s, 0.0, share * RETURN_S
    if kind == "withdrawn":
        waits_s, back_s = float(rng.uniform(0.1, 0.6)), EARLY_RETURN_S
    offered = raised + reach_s
    timeline = Timeline(raised, offered, offered + waits_s + 0.01, offered + waits_s + back_s + 0.01)
    others: tuple[Person, ...] = ()
    if kind == "passer_by":
        person, timeline = _walker(sizes, stage, rng), Timeline(math.inf, math.inf, math.inf, math.inf)
    if kind == "two_people":
        turn = facing + float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.9, 1.3))
        beside = np.array([x, y]) - 0.5 * np.array([math.cos(facing), math.sin(facing)])
        beside = beside + 0.75 * np.array([math.cos(turn), math.sin(turn)]) * np.array([1.0, 1.0])
        other = Sizes(float(rng.uniform(1.5, 1.95)))
        others = (Person(other, path((0.0, (*beside, facing))), floor_m=stage.floor_m, number=lambda _: 2),)
    duration_s = 6.0 if kind == "passer_by" else timeline.back_s + CONTACT_S + AFTERWARDS_S
    return Encounter(
        seed, kind, interaction, side, person, others, _three(place), _three(goes), goes_s, timeline,
        _tracking(rng), duration_s,
    )  # fmt: skip


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _arms(rng: np.random.Generator) -> tuple[Path, Path]:
    """A right and a left arm that hang."""
    upper, fore = (np.array(each) + rng.normal(0.0, 0.04, 3) for each in HANGING)
    right = ((upper[0], upper[1], upper[2]), (fore[0], fore[1], fore[2]))
    return arm_path((0.0, right)), arm_path((0.0, mirrored(right)))


def _place(
    interaction: str,
    shoulder: Array,
    sizes: Sizes,
    facing: float,
    stage: Stage,
    sign: float,
    rng: np.random.Generator,
) -> Array:
    """(3,) where a hand is held out: where the robot's arm seems to come, as far as one's own arm is.

    The height is between one's own habit for what one does and the robot's shoulder.
    """
    arm, tall = sum(sizes.arm_m), sizes.stature_m
    below = {"handshake": -0.14, "rocket": -0.06, "parachute": 0.03, "wave": 0.06, "": -0.1}[interaction]
    bearing = facing + math.pi + float(rng.normal(0.0, 0.15))
    out_m = float(rng.uniform(0.5, 0.9)) * stage.reach_m
    height = stage.shoulder_m[2] + below * stage.reach_m
    own = float(shoulder[2]) + (below + float(rng.normal(0.0, 0.025))) * tall
    height += float(rng.uniform(0.1, 0.6)) * (own - height)
    aimed = np.array([*(stage.shoulder_m[:2] + out_m * np.array([math.cos(bearing), math.sin(bearing)])), height])
    if interaction == "wave":
        aimed = shoulder + np.array([*(0.4 * arm * np.array([math.cos(facing), math.sin(facing)])), below * tall])
    aimed[:2] += sign * float(rng.uniform(-0.05, 0.1)) * np.array([-math.sin(facing), math.cos(facing)])
    before = aimed[:2] - shoulder[:2]
    far_m = max(float(np.linalg.norm(before)), 1e-6)
    aimed[:2] = shoulder[:2] + before * max(far_m, 0.65 * arm) / far_m
    far = aimed - shoulder
    place: Array = shoulder + far * np.clip(1.0, 0.4 * arm / np.linalg.norm(far), 0.93 * arm / np.linalg.norm(far))
    return place


def _goes(interaction: str, facing: float, rng: np.random.Generator) -> tuple[Array, float]:
    """What a hand does once it was met, or while it waves."""
    left = np.array([-math.sin(facing), math.cos(facing), 0.0])
    if interaction == "wave":
        return float(rng.uniform(0.08, 0.16)) * left, 0.0
    up = np.array([0.0, 0.0, 1.0])
    if interaction == "rocket":
        return float(rng.uniform(0.1, 0.3)) * up, float(rng.uniform(0.8, 1.2))
    if interaction == "parachute":
        return -float(rng.uniform(0.1, 0.3)) * up, float(rng.uniform(0.8, 1.2))
    return float(rng.uniform(0.01, 0.03)) * up, 0.0


def _walker(sizes: Sizes, stage: Stage, rng: np.random.Generator) -> Person:
    """A person who walks past out of the arm's way, arms swinging."""
    speed = float(np.clip(rng.normal(1.3, 0.2), 0.8, 1.8))
    distance = stage.reach_m + float(rng.uniform(0.8, 1.6))
    direction = float(rng.choice([-1.0, 1.0]))
    heading = direction * (math.pi / 2.0) + float(rng.normal(0.0, 0.1))
    x, y = stage.shoulder_m[0] + distance, stage.shoulder_m[1] - 3.0 * speed * direction
    end = np.array([x, y]) + 6.0 * speed * np.array([math.cos(heading), math.sin(heading)])
    root = path((0.0, (x, y, heading)), (6.0, (*end, heading)), straight=True)
    swing = [
        (
            0.5 * number,
            ((0.35 * (1 if number % 2 else -1), -0.08, -1.0), (0.35 * (1 if number % 2 else 0), -0.06, -1.0)),
        )
        for number in range(13)
    ]
    other = [
        (0.5 * number, mirrored(((-0.35 if number % 2 else 0.35, -0.08, -1.0), (0.1, -0.06, -1.0))))
        for number in range(13)
    ]
    return Person(sizes, root, right=arm_path(*swing), left=arm_path(*other), floor_m=stage.floor_m)


def _tracking(rng: np.random.Generator) -> Tracking:
    off = rng.normal(size=3)
    off *= float(rng.uniform(0.01, 0.03)) / float(np.linalg.norm(off))
    return Tracking(
        rate_hz=float(np.exp(rng.uniform(math.log(5.0), math.log(60.0)))),
        noise_m=float(rng.uniform(0.005, 0.02)),
        loss=float(rng.uniform(0.0, 0.1)),
        delay_s=(0.02, 0.05),
        camera_off_m=_three(off),
    )
