# SPDX-License-Identifier: Apache-2.0
"""What the robot does around people: everyone is kept away from, given way to, and followed only when they mean it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mild_core.retargeting.guard import Guard
from mild_core.retargeting.human_track import AssumedPlacement
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.obstacles import KEPT_S, NO_ONE, Crowd, obstacles_of
from mild_core.retargeting.robot_model.chain import chain_of, nearest_points
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import (
    ASSUMED,
    GENTLE,
    NEVER,
    UNKNOWN_BODY,
    UNMEASURED,
    Request,
    Retargeting,
    RetargetingSettings,
)
from mild_core.shapes import FloatArray
from mild_core.signals import (
    ARM_FRAME,
    NONE,
    OFFERED,
    RESTING,
    ROBOT_FRAME,
    WATCHED_PERSON,
    BodySegments,
    PersonPose,
)
from test.bench.speed_near_people import judged
from test.core.retargeting import people
from test.core.retargeting.limits import check_limits
from test.core.retargeting.perfect import TICK_NS, window
from test.core.retargeting.run import AWAY, SECOND_NS, Run

HOME_M, MET_M = chain_of(YUMI).tool(YUMI.home_rad), chain_of(YUMI).tool(AWAY)
"""The robot's hand at home, and where it comes by what it has learned."""

TO_ROBOT, LEFT, UP = np.array([-1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
"""Forward and left of a person who stands before the robot and faces it."""

SHOULDERS_M = np.array([0.95, 0.1, 0.5])
SHOULDER_M = SHOULDERS_M - 0.18 * LEFT
REST_M = SHOULDER_M - 0.6 * UP + 0.03 * TO_ROBOT
STANDING = AssumedPlacement((0.95, 0.1, 0.5), np.pi, {"handshake": (0.95, 0.1, 0.5)})
NOT_SEEN = np.full(3, np.nan)


class Around(Run):
    """A retargeting with a watched person before the robot, and others."""

    def __init__(self, settings: RetargetingSettings | None = None) -> None:
        super().__init__(settings)
        self.retargeting = Retargeting(YUMI, self.retargeting.settings, STANDING)
        self.facing = TO_ROBOT
        self.frame_id = ROBOT_FRAME
        self.walks_m_s = np.zeros(3)
        self.parts: Iterable[str] = tuple(people.RADII_M)

    def seen(self, hand_m: FloatArray, others: BodySegments | None = None) -> PersonPose:
        """The watched person with the hand there, and others, as the tracker shows them now."""
        head, trunk = SHOULDERS_M + 0.25 * UP, np.array([SHOULDERS_M, SHOULDERS_M - 0.55 * UP])
        one = people.pose(self.now_ns, hand_m, head, trunk, ROBOT_FRAME, facing=self.facing, parts=self.parts)
        walking = np.broadcast_to(self.walks_m_s, one.segments.velocities_m_s.shape)
        one = replace(one, segments=replace(one.segments, velocities_m_s=walking))
        if others is not None:
            own = one.segments
            both = [np.concatenate([getattr(each, name) for each in (own, others)]) for name in ARRAYS]
            one = replace(one, segments=BodySegments(own.people + others.people, own.parts + others.parts, *both))
        if self.frame_id == ARM_FRAME:
            turn = np.diag([-1.0, -1.0, 1.0])
            shift = np.array(STANDING.place_m)
            own = one.segments
            moved = replace(own, ends_m=(own.ends_m - shift) @ turn, velocities_m_s=own.velocities_m_s @ turn)
            one = PersonPose(self.now_ns, ARM_FRAME, (hand_m - shift) @ turn, one.head_m, one.trunk_m, moved, NOT_SEEN)
        return one

    def live(
        self,
        seconds: float,
        hand_m: FloatArray | Callable[[float], FloatArray] = REST_M,
        motion_rad: FloatArray | None = YUMI.home_rad,
        others: Callable[[float], BodySegments] | None = None,
        **fields: object,
    ) -> None:
        """Time passes: poses and motions at 33 Hz, ticks at 100 Hz."""
        for tick in range(round(seconds * SECOND_NS / TICK_NS)):
            self.now_ns += TICK_NS
            time_s = tick * TICK_NS * 1e-9
            if tick % 3 == 0:
                hand = hand_m(time_s) if callable(hand_m) else hand_m
                self.give(self.seen(hand, None if others is None else others(time_s)))  # type: ignore[arg-type]
                if motion_rad is not None:
                    rows = np.tile(motion_rad, (40, 1))
                    self.give(window(rows, self.now_ns, **fields))  # type: ignore[arg-type]
            self.give(None)

    def clear_m(self, ends_m: FloatArray, radius_m: float, since: int = 0) -> FloatArray:
        """(T,) clearance of the arm to a capsule at each command."""
        capsule = BodySegments((7,), ("head",), ends_m[None], np.zeros((1, 2, 3)), np.array([radius_m]))
        crowd = Crowd(capsule, ROBOT_FRAME, 0, NOT_SEEN)
        among = obstacles_of(crowd, self.retargeting.settings, None, None, NOT_SEEN, 0)
        guard = Guard(YUMI, self.retargeting.settings)
        at = np.array([command.positions_rad for command in self.commands[since:]])
        found: FloatArray = guard.evaluate_poses(np.zeros(len(at)), at, np.zeros_like(at), among, 0.5).clear_m[:, 0]
        return found


ARRAYS = ("ends_m", "velocities_m_s", "radii_m")


def ball(at_m: FloatArray, velocity_m_s: FloatArray, part: str = "head", number: int = 3) -> BodySegments:
    """The head, or another part, of a bystander."""
    ends = np.array([[at_m, at_m]])
    return BodySegments((number,), (part,), ends, np.tile(velocity_m_s, (1, 2, 1)), np.array([0.12]))


def still(at_m: FloatArray, part: str = "head") -> Callable[[float], BodySegments]:
    """One that stays."""
    return lambda _: ball(at_m, np.zeros(3), part)


@pytest.mark.parametrize("part", ["head", "trunk", "left_forearm", "right_shin"])
def test_no_part_of_a_bystander_is_come_nearer_than_the_distance_that_is_kept(part: str) -> None:
    run, at = Around(), MET_M + np.array([0.05, 0.0, 0.0])
    run.live(0.5, others=still(at, part))
    run.live(2.5, MET_M, AWAY, still(at, part))
    assert run.clear_m(np.array([at, at]), 0.12).min() >= run.retargeting.settings.keep_out_m - 1e-6
    assert run.state.counts["bystander_near"] == 1
    assert run.state.counts["bystander_paused"] >= 1
    assert "paused: a bystander is within reach" in run.state.notices(run.now_ns)
    run.live(1.5, MET_M, AWAY)
    assert run.state.notices(run.now_ns) == ()
    assert np.linalg.norm(chain_of(YUMI).tool(run.last.positions_rad) - MET_M) < 0.02, "then it goes on"
    check_limits(YUMI, run.commands)


def test_the_hand_that_is_offered_may_be_touched_and_no_other_part_of_that_person() -> None:
    run = Around()
    run.live(0.5)
    run.live(2.5, MET_M, AWAY)
    own = run.seen(MET_M).segments
    for person, part, ends, radius in zip(own.people, own.parts, own.ends_m, own.radii_m, strict=True):
        assert person == WATCHED_PERSON
        least = run.clear_m(ends, float(radius), since=50).min()
        assert (least < 0.0) if part == "right_forearm" else (least >= 0.05 - 1e-6), part


def test_in_an_interaction_without_contact_the_hand_keeps_its_distance_too() -> None:
    run = Around()
    run.live(0.5)
    run.live(2.5, MET_M, AWAY, interaction="hand_wave")
    own = run.seen(MET_M).segments
    place = own.parts.index("right_forearm")
    assert run.clear_m(own.ends_m[place], float(own.radii_m[place]), since=50).min() >= 0.05 - 1e-6


def test_a_bystander_within_reach_slows_the_arm_everywhere() -> None:
    peaks = []
    for others in (None, still(np.array([0.45, -0.75, 0.2]))):
        run = Around(RetargetingSettings(ramp_velocity_rad_s=10.0, ik="off"))
        run.parts = ()
        run.live(0.5, others=others)
        run.live(1.5, MET_M + 0.3 * UP, AWAY + 0.5, others)
        guard = Guard(YUMI, run.retargeting.settings)
        speeds = [guard.arm_speed(one.positions_rad, one.velocities_rad_s, NO_ONE) for one in run.commands]
        peaks.append(max(speeds))
    assert peaks[0] > 1.0
    assert peaks[1] <= 0.8


def test_near_people_who_stand_still_nothing_of_the_arm_is_ever_faster_than_allowed() -> None:
    found = judged(range(40, 46), 5.0, moving=False)
    assert found.followed > 2000
    assert found.above == 0, found.peaks_m_s
    assert max(found.peaks_m_s) > 0.5, "it does move near them"
    assert found.clear_m >= 0.05 - 1e-6


def test_towards_people_who_move_the_arm_is_no_faster_than_their_approach_leaves_or_it_brakes() -> None:
    found = judged(range(900, 903), 4.0, moving=True)
    assert found.near > 300
    assert found.not_braking == 0
    assert found.towards < 0.02 * found.ticks
    assert found.towards_m_s < 0.4


def approaching(target_m: FloatArray, from_m: FloatArray, speed_m_s: float) -> Callable[[float], BodySegments]:
    """A head that comes from there to the target."""
    way = target_m - from_m
    length = float(np.linalg.norm(way))

    def at(time_s: float) -> BodySegments:
        gone = min(speed_m_s * time_s, length)
        moving = speed_m_s if gone < length else 0.0
        return ball(from_m + way / length * gone, way / length * moving)

    return at


@pytest.mark.parametrize("speed_m_s", [0.3, 1.0])
@pytest.mark.parametrize("mode", ["ready", "holding", "following"])
def test_the_arm_gives_way_to_a_head_that_comes_and_goes_home_afterwards(mode: str, speed_m_s: float) -> None:
    run = Around()
    run.live(0.5)
    if mode == "holding":
        run.wait(0.7)
        run.live(0.3, motion_rad=None)
    tool = HOME_M
    if mode == "following":
        run.live(1.5, MET_M, AWAY)
        tool = MET_M
    assert run.last.mode in (mode, "ready", "idle")
    moving = len(run.commands)
    target, start = tool + np.array([0.06, 0.02, 0.0]), tool + np.array([0.66, 0.1, 0.35])
    way = approaching(target, start, speed_m_s)
    hand = MET_M if mode == "following" else REST_M
    run.live(0.75 / speed_m_s + 0.5, hand, AWAY if mode == "following" else YUMI.home_rad, way)
    ends = way(100.0).ends_m[0]
    assert run.clear_m(ends, 0.12)[-1] > 0.03
    along = [
        run.clear_m(way(0.01 * tick).ends_m[0], 0.12, since=moving + tick)[0]
        for tick in range(0, len(run.commands) - moving, 3)
    ]
    assert min(along) > 0.0
    assert run.state.counts["yielded"] >= 1
    check_limits(YUMI, run.commands)
    run.live(8.0, REST_M)
    assert np.abs(run.last.positions_rad - YUMI.home_rad).max() < 1e-6, run.last.mode


WALKER = {
    "trunk": ((0.0, -0.2), (0.0, 0.45), 0.17),
    "head": ((0.0, 0.6), (0.0, 0.7), 0.12),
    "left_upper_arm": ((-0.23, 0.4), (-0.23, 0.1), 0.06),
    "left_forearm": ((-0.23, 0.1), (-0.23, -0.25), 0.05),
    "right_upper_arm": ((0.23, 0.4), (0.23, 0.1), 0.06),
}
"""Parts of a bystander who walks along the front of the robot: x and z of both ends, and radius [m]."""


def walker(x_m: float, from_y_m: float, speed_m_s: float) -> Callable[[float], BodySegments]:
    """One who passes there."""
    way = np.array([0.0, -math.copysign(speed_m_s, from_y_m), 0.0])
    ends = np.array([[(x_m + x, from_y_m, z) for x, z in part[:2]] for part in WALKER.values()])
    moving, radii = np.tile(way, (len(ends), 2, 1)), np.array([part[2] for part in WALKER.values()])
    return lambda time_s: BodySegments((3,) * len(ends), tuple(WALKER), ends + time_s * way, moving, radii)


@pytest.mark.parametrize(("from_y_m", "speed_m_s"), [(-1.3, 0.6), (1.3, 0.5)])
def test_the_arm_is_not_caught_between_a_greeting_and_who_walks_through_it(from_y_m: float, speed_m_s: float) -> None:
    run, way = Around(), walker(0.48, from_y_m, speed_m_s)
    run.live(0.5)
    run.live(1.5, MET_M, AWAY)
    assert run.last.mode == "following"
    moving = len(run.commands)
    run.live(2.6 / speed_m_s, MET_M, AWAY, way)
    for segment, (*_, radius_m) in enumerate(WALKER.values()):
        along = [
            run.clear_m(way(0.01 * tick).ends_m[segment], radius_m, since=moving + tick)[0]
            for tick in range(0, len(run.commands) - moving, 3)
        ]
        assert min(along) > 0.02
    check_limits(YUMI, run.commands)
    run.live(1.0, MET_M, AWAY)
    assert np.linalg.norm(chain_of(YUMI).tool(run.last.positions_rad) - HOME_M) > 0.2, "the greeting goes on"


def test_an_operators_hold_stands_still_for_every_person() -> None:
    run = Around()
    run.live(0.5)
    run.give(Request("hold"))
    run.live(1.5, others=approaching(HOME_M, HOME_M + 0.5 * UP, 0.5))
    np.testing.assert_array_equal(run.last.positions_rad, run.commands[0].positions_rad)
    assert run.state.mode is Mode.HELD


def test_people_stay_where_they_were_when_the_tracker_falls_silent() -> None:
    settings = RetargetingSettings()
    crowd = Crowd(ball(MET_M, np.zeros(3)), ROBOT_FRAME, 0, NOT_SEEN)
    radii = [
        obstacles_of(crowd, settings, None, None, NOT_SEEN, round(age_s * SECOND_NS)).radii_m
        for age_s in (0.1, 0.6, 4.0)
    ]
    np.testing.assert_allclose(np.concatenate(radii), [0.12, 0.21, 0.32])
    assert not len(obstacles_of(crowd, settings, None, None, NOT_SEEN, round((KEPT_S + 0.1) * SECOND_NS)).people)
    run = Around()
    run.live(0.5)
    run.give(Request("reset"))
    assert run.state.crowd is not None, "a reset forgets no obstacle"


@pytest.mark.parametrize("allowed", [False, True])
def test_an_unmeasured_camera_is_reported_and_hands_touch_only_where_that_is_allowed(allowed: bool) -> None:
    run = Around(RetargetingSettings(allow_unmeasured_contact=allowed))
    run.frame_id = ARM_FRAME
    run.live(0.5)
    run.live(2.5, MET_M, AWAY)
    assert (run.state.touch is not None) is allowed
    assert any("camera is not measured" in notice for notice in run.state.notices(run.now_ns))
    assert run.state.no_contact.startswith("no contact") is not allowed
    if not allowed:
        assert run.state.no_contact == f"no contact: {UNMEASURED}"
    run.frame_id = ROBOT_FRAME
    run.live(0.5)
    assert run.state.notices(run.now_ns) == ()


def test_an_unmeasured_camera_is_reported_before_a_person_is_seen() -> None:
    def reasons(measured: bool | None, standing: AssumedPlacement = STANDING, **settings: Any) -> tuple[str, ...]:
        return Retargeting(YUMI, RetargetingSettings(**settings), standing, measured).init().notices(0)

    assert reasons(False) == (f"no contact: {UNMEASURED}",)
    assert reasons(True) == reasons(None) == ()
    assert reasons(False, allow_unmeasured_contact=True) == (ASSUMED,)
    nothing_touches = replace(STANDING, by_interaction={})
    assert reasons(False, nothing_touches, ik="off") == (UNMEASURED,)
    assert reasons(True, nothing_touches) == (f"no contact: {NEVER}",)
    assert reasons(False, nothing_touches) == (f"no contact: {NEVER}; {UNMEASURED}",)
    run = Around()
    run.retargeting = Retargeting(YUMI, run.retargeting.settings, STANDING, camera_measured=False)
    run.state = run.retargeting.init()
    run.wait(0.2)
    assert run.state.no_contact, "the robot alone changes nothing"


def test_without_a_measured_camera_the_uncertainty_of_the_place_is_kept_too() -> None:
    settings = RetargetingSettings()
    crowd = Crowd(ball(MET_M, np.zeros(3), number=WATCHED_PERSON), ARM_FRAME, 0, NOT_SEEN)
    unsure = obstacles_of(crowd, settings, STANDING, None, NOT_SEEN, 0)
    known = obstacles_of(replace(crowd, frame_id=ROBOT_FRAME), settings, STANDING, None, NOT_SEEN, 0)
    np.testing.assert_allclose(unsure.keep_m - known.keep_m, settings.placement_uncertainty_m)
    np.testing.assert_allclose(unsure.zones_m - known.zones_m, settings.placement_uncertainty_m)


@pytest.mark.parametrize("missing", ["head", "trunk"])
def test_no_hand_is_touched_of_whom_head_or_trunk_is_not_known_and_the_share_fades(missing: str) -> None:
    run = Around()
    run.live(0.5)
    run.live(2.0, MET_M, AWAY)
    assert run.state.touch is not None
    assert run.state.touch.share > 0.95
    run.parts = tuple(part for part in people.RADII_M if part != missing)
    shares = []
    for _ in range(60):
        run.live(0.01, MET_M, AWAY)
        shares.append(run.state.touch.share if run.state.touch is not None else 0.0)
    assert shares[-1] == 0.0
    assert np.abs(np.diff(shares)).max() < 0.05
    assert run.state.notices(run.now_ns) == (f"no contact: {UNKNOWN_BODY}",)
    check_limits(YUMI, run.commands)


@pytest.mark.parametrize("missing", ["", "head", "trunk"])
def test_only_a_hand_that_may_be_touched_is_offered_and_others_push_the_arm_away_as_they_come(missing: str) -> None:
    run = Around()
    run.parts = tuple(part for part in people.RADII_M if part != missing)
    run.live(0.5)
    run.live(0.5, MET_M, AWAY)
    among = run.retargeting._obstacles(run.state, run.now_ns)
    assert (among.offered >= 0) is (not missing)


def _raised(to_m: FloatArray) -> Callable[[float], FloatArray]:
    """A hand on its way from rest, on an arc as an elbow bends, in 0.8 s."""

    def at(time_s: float) -> FloatArray:
        share = min(time_s / 0.8, 1.0)
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        place: FloatArray = REST_M + share * (to_m - REST_M)
        return place

    return at


GREETING = _raised(MET_M)
SCRATCHING = _raised(SHOULDER_M + 0.1 * TO_ROBOT + 0.3 * UP)
POINTING = _raised(SHOULDER_M + 0.15 * TO_ROBOT - 0.58 * LEFT)


def _started(run: Around, hand_m: Callable[[float], FloatArray], **fields: object) -> float:
    """Seconds from a hand that leaves its rest to the first command that follows; infinite if there is none."""
    run.live(0.6, **fields)  # type: ignore[arg-type]
    since = len(run.commands)
    run.live(2.0, hand_m, AWAY, **fields)  # type: ignore[arg-type]
    following = [place for place, command in enumerate(run.commands[since:]) if command.mode == "following"]
    return 0.01 * following[0] if following else np.inf


def test_a_greeting_starts_a_quarter_of_a_second_after_the_hand_is_raised() -> None:
    eager = RetargetingSettings(start_watch_s=0.0, start_evidence=0.0)
    assert _started(Around(), GREETING) - _started(Around(eager), GREETING) <= 0.3
    assert _started(Around(), GREETING) < 0.8


@pytest.mark.parametrize(
    ("reason", "hand_m"), [("start_at_head", SCRATCHING), ("start_aside", POINTING)], ids=["scratching", "pointing"]
)
def test_a_hand_that_goes_to_the_own_head_or_aside_starts_nothing(
    reason: str, hand_m: Callable[[float], FloatArray]
) -> None:
    run = Around()
    assert _started(run, hand_m) == np.inf
    assert run.state.counts[reason] == 1
    run.live(0.8, lambda time_s: hand_m(0.8 - time_s), AWAY)
    assert run.last.mode == "ready", "nor on its way back"
    run.live(0.8, REST_M)
    assert _started(run, GREETING) < 0.8


def test_a_person_who_does_not_face_the_robot_or_is_far_away_starts_nothing() -> None:
    run = Around()
    run.facing = np.array([0.3, 1.0, 0.0])
    assert _started(run, GREETING) == np.inf
    assert run.state.counts["start_turned_away"] == 1
    run = Around(RetargetingSettings(start_trunk_m=0.6))
    assert _started(run, GREETING) == np.inf
    assert run.state.counts["start_too_far"] == 1
    run = Around()
    run.facing = NOT_SEEN
    assert _started(run, GREETING) < 0.8, "who is not known to be turned away is not"


def test_a_first_motion_needs_evidence_for_a_while() -> None:
    run = Around()
    run.live(0.6, interaction="")
    run.live(0.5, MET_M, AWAY, interaction="")
    since = len(run.commands)
    run.live(0.5, MET_M, AWAY)
    assert run.state.counts["start_undecided"] == 1
    late = next(place for place, command in enumerate(run.commands[since:]) if command.mode == "following")
    assert 5 <= late <= 30


def _offered(run: Around, seconds: float = 1.0) -> Around:
    """A hand is raised that is offered and gets no name."""
    run.live(0.6, interaction="", state=RESTING)
    run.live(seconds, GREETING, AWAY, interaction="", state=OFFERED)
    return run


def test_a_hand_that_is_offered_is_answered_gently_before_it_has_a_name() -> None:
    """To name it takes the better part of a second."""
    slow = RetargetingSettings(ramp_velocity_rad_s=0.3)
    run, eager = Around(slow), Around(slow)
    run.live(0.6, interaction="", state=RESTING)

    def moving(time_s: float) -> FloatArray:
        return GREETING(time_s) + 0.1 * (np.sin(6.0 * time_s) * LEFT + np.cos(6.0 * time_s) * UP)

    unnamed = _started(run, moving, interaction="", state=OFFERED)
    assert unnamed <= _started(eager, moving) < 0.8

    def fastest_rad_s(after: Around) -> float:
        following = [command for command in after.commands if command.mode == "following"][:150]
        return max(float(np.abs(command.velocities_rad_s).max()) for command in following)

    gentle_rad_s = 1.4 * GENTLE * slow.ramp_velocity_rad_s  # the planner overshoots behind a hand that moves
    assert fastest_rad_s(run) < gentle_rad_s < 0.9 * fastest_rad_s(eager)
    run.live(0.5, MET_M, AWAY, interaction="", state=NONE)
    assert run.last.mode == "holding", "in the end it was none"


@pytest.mark.parametrize("why", ["not measured", "facing unknown", "walks", "no evidence"])
def test_a_hand_without_a_name_starts_nothing_of_people_who_are_not_seen_to_stand_facing_the_robot(why: str) -> None:
    run = Around()
    if why == "not measured":
        run.frame_id = ARM_FRAME
    elif why == "facing unknown":
        run.facing = NOT_SEEN
    elif why == "walks":
        run.walks_m_s = 0.5 * TO_ROBOT
    if why == "no evidence":
        run.wait(0.6, YUMI.home_rad, interaction="", state=RESTING)
        run.wait(1.0, AWAY, interaction="", state=OFFERED)
        assert run.last.mode == "idle"
    else:
        _offered(run)
        assert run.last.mode in ("ready", "idle")
        assert run.state.counts["start_undecided"] == 1
    assert max(float(np.abs(command.velocities_rad_s).max()) for command in run.commands) == 0.0
    if why in ("not measured", "facing unknown"):
        since = len(run.commands)
        run.live(0.3, MET_M, AWAY)
        named = next(place for place, command in enumerate(run.commands[since:]) if command.mode == "following")
        assert named <= 3, "what was seen before counts once it has a name"


OFFER = {"interaction": "", "state": OFFERED}


def test_an_offered_hand_is_not_met_where_nothing_permits_to_start() -> None:
    run = Around()
    run.live(0.6, interaction="", state=RESTING)
    run.live(1.0, GREETING, AWAY, **OFFER, may_start=False)
    assert run.last.mode == "ready"


REACH_M = HOME_M + np.array([0.15, 0.05, 0.1])
"""Where a hand is offered: the robot's gets there, and what it has learned leads elsewhere."""


def speeds_rad_s(run: Around, since: int = 0) -> FloatArray:
    """(T,) of the fastest joint at each command."""
    return np.abs([command.velocities_rad_s for command in run.commands[since:]]).max(axis=1)


def tool_m(run: Around) -> FloatArray:
    return chain_of(YUMI).tool(run.last.positions_rad)


def offered_hand(run: Around, seconds: float) -> None:
    """A hand comes out and is held before the robot, for an interaction that is not known yet."""
    run.live(0.6, interaction="", state=RESTING)
    run.live(seconds, lambda t: REST_M + min(t / 0.8, 1.0) * (REACH_M - REST_M), AWAY, **OFFER, may_start=True)


def test_an_offered_hand_is_met_by_inverse_kinematics_and_slowly_until_it_waits() -> None:
    run = Around()
    offered_hand(run, 0.9)
    gentle = GENTLE * run.retargeting.settings.ramp_velocity_rad_s
    assert 0.5 * gentle < speeds_rad_s(run).max() < 1.15 * gentle, "the planner may overshoot a little"
    since = len(run.commands)
    run.live(0.6, REACH_M, AWAY, **OFFER, may_start=True)
    assert run.last.mode == "following"
    assert np.linalg.norm(tool_m(run) - REACH_M) < 0.03
    assert speeds_rad_s(run, since).max() > 1.15 * gentle, "a hand that waits is met as fast as one with a name"
    run.live(1.5, REACH_M, AWAY, **OFFER, may_start=True)
    # The hand turns back: the robot's follows it as far as it reaches, and goes home when it has come to rest.
    since = len(run.commands)
    run.live(0.7, lambda t: REACH_M + 0.2 * t * (REST_M - REACH_M), AWAY, **OFFER, may_start=False)
    moved = tool_m(run) - REACH_M
    assert float(moved @ (REST_M - REACH_M)) > 0.01
    run.live(0.8, lambda t: REACH_M + min(0.14 + t, 1.0) * (REST_M - REACH_M), AWAY, **OFFER, may_start=False)
    run.live(1.2, REST_M, AWAY, interaction="", state=RESTING)
    assert run.last.mode in ("returning", "ready")
    assert speeds_rad_s(run, since).max() < 1.5 * gentle
    check_limits(YUMI, run.commands)


def test_when_the_name_comes_the_robot_goes_on_without_a_jump() -> None:
    run = Around()
    offered_hand(run, 1.2)
    before = run.last
    run.live(0.03, REACH_M, AWAY, interaction="handshake")
    step = np.abs(np.array(run.commands[-1].positions_rad) - np.array(before.positions_rad)).max()
    assert step < 0.03, "three ticks at less than 1 rad/s"
    run.live(2.0, REACH_M, AWAY, interaction="handshake")
    assert run.last.mode == "following"
    assert [command.mode for command in run.commands].count("holding") == 0
    check_limits(YUMI, run.commands)


def test_a_hand_is_met_from_wherever_the_robot_is() -> None:
    run = Around()
    run.live(0.6)
    run.live(2.0, MET_M, AWAY)
    run.live(0.9, REST_M, AWAY, interaction="", state=RESTING)
    assert run.last.mode == "returning"
    run.live(2.5, lambda t: REST_M + min(t / 0.8, 1.0) * (REACH_M - REST_M), AWAY, **OFFER, may_start=True)
    assert np.linalg.norm(tool_m(run) - REACH_M) < 0.03
    check_limits(YUMI, run.commands)


def test_a_bystander_beside_an_offered_hand_is_kept_away_from() -> None:
    at = REACH_M + np.array([0.0, 0.18, 0.0])
    run = Around()
    run.live(0.6, interaction="", state=RESTING, others=still(at))
    run.live(3.0, lambda t: REST_M + min(t / 0.8, 1.0) * (REACH_M - REST_M), AWAY, still(at), **OFFER, may_start=True)
    assert run.clear_m(np.array([at, at]), 0.12).min() >= run.retargeting.settings.keep_out_m - 1e-6
    check_limits(YUMI, run.commands)


def test_a_given_interaction_that_is_not_the_one_performed_is_followed_slowly() -> None:
    fast = [Around(RetargetingSettings(ramp_velocity_rad_s=0.3)) for _ in range(2)]
    for run, may_start in zip(fast, (True, False), strict=True):
        run.live(0.6)
        run.live(2.0, MET_M, AWAY, may_start=may_start)
        assert run.last.mode == "following"
    gentle = GENTLE * 0.3
    assert speeds_rad_s(fast[1]).max() < 1.15 * gentle < speeds_rad_s(fast[0]).max()


def test_a_hand_that_is_back_at_its_rest_sends_the_robot_home() -> None:
    """It has no name any more, and is nothing unknown either."""
    run = Around()
    run.live(0.6)
    run.live(1.0, MET_M, AWAY)
    assert run.last.mode == "following"
    run.live(0.9, REST_M, AWAY, interaction="", state=RESTING)
    assert run.last.mode == "returning"
    assert "held_unknown" not in run.state.counts


def test_the_exact_distance_of_segments() -> None:
    rng = np.random.default_rng(3)
    shares = np.linspace(0.0, 1.0, 201)[:, None]
    for _ in range(50):
        a0, a1, b0, b1 = rng.normal(size=(4, 3))
        first, second = a0 + shares * (a1 - a0), b0 + shares * (b1 - b0)
        sampled = np.linalg.norm(first[:, None] - second[None], axis=2).min()
        distance, s, t = nearest_points(a0, a1, b0, b1)
        assert distance <= sampled + 1e-12
        assert distance == pytest.approx(sampled, abs=0.02)
        assert np.linalg.norm(a0 + s * (a1 - a0) - b0 - t * (b1 - b0)) == pytest.approx(distance)
