# SPDX-License-Identifier: Apache-2.0
"""The table of faults: what goes wrong, how soon the robot must rest, and where an operator reads of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from test.faults import people, robots

Answer = Literal["rests", "rests for a while", "gives way", "goes on"]
"""What the robot does: it comes to rest and stays there, or until all is well again; it goes where it has been put; or
it goes on following."""

Processes = Literal["", "killed", "stopped", "loaded"]
"""Done to processes: inference is killed and restarted, retargeting stands still, or the machine is busy."""

STATED_S = 1.0
"""Within this time the robot rests. Half a second passes until an input counts as stale (`stale_after_s`), up to a
fifth until the tracker would have spoken again, up to 0.3 s for the smooth stop."""


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong.

    Attributes:
        name: In a word or two.
        what: In a sentence, for people.
        counted: Keys of `/diagnostics` that must rise ...
        least: ... and by how much at least.
        answer: What the robot must do ...
        within_s: ... and how soon after the fault began.
        lasts_s: How long it goes wrong.
        rate_hz: Of the tracker meanwhile.
        tracker: What the tracker says meanwhile.
        robot: What the robot says meanwhile ...
        copies: ... and how often it says each of that.
        processes: What is done to processes.
        clock_s: How far the clock of a replay jumps at the begin; 0 for not at all.
        live: Whether it happens in real time to the three nodes and a simulated robot, or to the pipeline in a replay.
        recalibrated: Whether the person has to be calibrated again, and stands still for it.
    """

    name: str
    what: str
    counted: tuple[str, ...]
    answer: Answer = "rests"
    within_s: float = STATED_S
    lasts_s: float = 1.3
    rate_hz: float = people.TRACKER_HZ
    tracker: people.TrackerFault = people.as_it_is
    robot: robots.RobotFault = robots.truthful
    copies: int = 1
    processes: Processes = ""
    clock_s: float = 0.0
    least: int = 1
    live: bool = False
    recalibrated: bool = False


STALE = "retargeting held_stale"
TOO_OLD, FROM_FUTURE = ("retargeting too_old",), ("retargeting from_future",)
NAN, INFINITE = float("nan"), float("inf")
NOTHING = ((0.0, 0.0, 0.0),) * 3
MIRROR = ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
OTHER_AXES = ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))
MILLIMETRES = ((1e3, 0.0, 0.0), (0.0, 1e3, 0.0), (0.0, 0.0, 1e3))


def _of_tracker(
    name: str, what: str, counted: str, tracker: people.TrackerFault, also: tuple[str, ...] = (), **more: Any
) -> Fault:
    """Something of which perception counts `counted`, and for want of motions the robot holds."""
    return Fault(name, what, (f"perception {counted}", *also, STALE), tracker=tracker, **more)


def _passed_over(name: str, what: str, counted: str, tracker: people.TrackerFault, **more: Any) -> Fault:
    """Something that perception counts, and that the robot does not heed."""
    return Fault(name, what, (counted,), "goes on", lasts_s=1.2, tracker=tracker, **more)


_ROWS = (
    Fault("tracker stops", "No message comes any more.", (STALE,), tracker=people.silent, live=True),
    _of_tracker("no person", "Messages come without a person in them.", "no_person", people.no_person),
    _of_tracker(
        "tracker hangs",
        "The same skeleton comes under new stamps.",
        "frozen",
        people.Frozen(),
        within_s=2.0 * STATED_S,
        lasts_s=2.5,
    ),
    _passed_over("slow tracker", "Messages come at 5 Hz.", "perception missed", people.as_it_is, rate_hz=5.0),
    _of_tracker(
        "pauses",
        "A second of silence, twice.",
        "gap_reset",
        people.pausing(0.3, 1.0),
        lasts_s=2.4,
        answer="rests for a while",
    ),
    _passed_over(
        "flood", "Messages come at 1 kHz.", "skeleton count", people.as_it_is, rate_hz=1000.0, least=200, live=True
    ),
    _passed_over(
        "heavy flood", "Messages come at 5 kHz.", "superseded skeleton", people.as_it_is, rate_hz=5000.0, live=True
    ),
    Fault(
        "robot flood",
        "joint_states come at 5 kHz.",
        ("superseded joint_states",),
        "goes on",
        copies=100,
        live=True,
    ),
    _passed_over("repetitions", "Each message comes three times.", "perception duplicate", people.repeated(3)),
    _passed_over(
        "late copies", "After each comes an old one.", "perception out_of_order", people.with_late_copies(0.2)
    ),
    _of_tracker(
        "clock back",
        "Stamps go back 10 s, later on again.",
        "time_reset",
        people.shifted(-10.0),
        TOO_OLD,
        recalibrated=True,
    ),
    _of_tracker(
        "clock ahead",
        "Stamps go on 10 s, later back again.",
        "gap_reset",
        people.shifted(10.0),
        FROM_FUTURE,
        recalibrated=True,
    ),
    _passed_over("swapped", "A second person comes; numbers are swapped.", "perception reacquired", people.renumbered),
    _of_tracker("other person", "Another person is seen instead.", "other_person", people.another_person),
    _of_tracker("elbow lost", "The elbow is missing.", "missing_joint", people.without("right_elbow")),
    _of_tracker("NaN", "The elbow is at NaN.", "not_finite", people.placed_at("right_elbow", NAN)),
    _of_tracker("infinite", "The hand is infinitely far away.", "not_finite", people.placed_at("right_hand", INFINITE)),
    _of_tracker("long arm", "The hand is a metre away.", "bone_length", people.placed_at("right_hand", 1.0)),
    _of_tracker("zeros", "All joints are at exactly zero.", "zeroed", people.turned(NOTHING)),
    _of_tracker("mirrored", "Left and right of the picture are swapped.", "mirrored", people.turned(MIRROR)),
    _of_tracker("misnamed", "Joints of left and right are swapped.", "mirrored", people.left_is_right),
    _of_tracker("other frame", "Messages name another tf frame.", "unknown_frame", people.in_frame("elsewhere")),
    _of_tracker("other axes", "z is up all of a sudden.", "other_person", people.turned(OTHER_AXES)),
    _of_tracker("millimetres", "Positions are in millimetres.", "out_of_range", people.turned(MILLIMETRES)),
    Fault("robot silent", "No joint_states come.", ("retargeting robot_silent",), robot=robots.mute, live=True),
    Fault(
        "robot NaN",
        "All joint_states are NaN.",
        ("retargeting not_finite", "retargeting robot_silent"),
        robot=robots.not_a_number,
    ),
    Fault(
        "gripper NaN",
        "joint_states hold a gripper at NaN.",
        ("retargeting measured",),
        "goes on",
        least=20,
        robot=robots.gripper_not_a_number,
    ),
    Fault(
        "two publishers",
        "Another joint_states places the arm elsewhere.",
        ("retargeting doubted", "retargeting joint_states_disagree"),
        robot=robots.two_voices,
    ),
    Fault(
        "pushed",
        "A person pushes the arm by 46°.",
        ("retargeting displaced",),
        "gives way",
        lasts_s=1.6,
        robot=robots.by_hand,
        live=True,
    ),
    Fault("busy", "Two other programs keep each core busy.", (), "goes on", processes="loaded", live=True),
    Fault(
        "stall",
        "Retargeting gets no time for 0.6 s.",
        ("retargeting gap",),
        within_s=0.3,
        lasts_s=0.6,
        processes="stopped",
        live=True,
    ),
    Fault("killed", "Inference is killed, then started.", (STALE,), processes="killed", live=True),
    Fault(
        "bag loops",
        "/clock goes back 8 s.",
        ("retargeting time_backwards", "perception time_reset"),
        clock_s=-8.0,
        recalibrated=True,
    ),
    Fault(
        "bag skips", "/clock goes on 8 s.", ("retargeting gap", "perception gap_reset"), clock_s=8.0, recalibrated=True
    ),
)

FAULTS = {fault.name: fault for fault in _ROWS}
"""By name, in the order in which they happen."""
