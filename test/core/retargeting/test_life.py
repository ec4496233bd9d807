# SPDX-License-Identifier: Apache-2.0
"""The life of an interaction: ready, a person starts, the hands meet, it ends, home, ready again; and the emergency."""

from __future__ import annotations

import numpy as np
import pytest

from mild_core.retargeting.guard import Guard
from mild_core.retargeting.human_track import AssumedPlacement
from mild_core.retargeting.obstacles import Crowd, Obstacles, obstacles_of
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Request, Retargeting, RetargetingSettings
from mild_core.shapes import FloatArray
from mild_core.signals import ARM_FRAME, JointCommand, PersonPose
from test.core.retargeting.limits import check_limits
from test.core.retargeting.people import RADII_M, pose
from test.core.retargeting.perfect import TICK_NS, window
from test.core.retargeting.run import AWAY, SECOND_NS, Run

STANDING = AssumedPlacement((0.9, 0.1, 0.7), np.pi, {"handshake": (0.9, 0.1, 0.7)})
REST_M = np.array([0.05, 0.0, -0.6])
"""Where the hand hangs, from the person's own shoulder."""

BODY_M = np.array([[0.0, 0.2, 0.2], [0.0, 0.2, 0.0], [0.0, 0.2, -0.5]])
TOOL_M = chain_of(YUMI).tool(AWAY)
MEETING_M = (np.array([0.9, 0.1, 0.7]) - TOOL_M) * [1, 1, -1]
"""Where the person's hand is, in the arm frame, when it is where the robot's comes by what it has learned."""


def seen(
    stamp_ns: int, hand_m: FloatArray, body_m: FloatArray = BODY_M, parts: tuple[str, ...] = tuple(RADII_M)
) -> PersonPose:
    """The person before the robot, seen by a calibrated camera; places are given in the arm frame."""
    hand, head, *trunk = STANDING.placed(np.stack([hand_m, *body_m]), ARM_FRAME, STANDING.place_m)
    return pose(stamp_ns, hand, head, np.array(trunk), facing=np.array([-1.0, 0.0, 0.0]), parts=parts)


class Meeting(Run):
    """A retargeting with a person before the robot."""

    def __init__(self, settings: RetargetingSettings | None = None, parts: tuple[str, ...] = tuple(RADII_M)) -> None:
        super().__init__(settings)
        self.parts = parts
        self.retargeting = Retargeting(YUMI, self.retargeting.settings, STANDING)

    def meet(
        self, seconds: float, hand_m: FloatArray, motion_rad: FloatArray = YUMI.home_rad, interaction: str = "handshake"
    ) -> None:
        """Time passes with the hand there, seen 30 times a second, and a motion to follow."""
        for tick in range(round(seconds * SECOND_NS / TICK_NS)):
            self.now_ns += TICK_NS
            if tick % 3 == 0:
                self.give(seen(self.now_ns, hand_m, parts=self.parts))
                self.give(window(np.tile(motion_rad, (40, 1)), self.now_ns, interaction=interaction))
            self.give(None)

    def modes(self) -> list[str]:
        """What happened, each once in a row."""
        words = [command.mode for command in self.commands]
        return [word for place, word in enumerate(words) if place == 0 or words[place - 1] != word]

    def apart_m(self, hand_m: FloatArray) -> float:
        """Between the commanded hand and the person's."""
        hand = STANDING.placed(hand_m, ARM_FRAME, STANDING.place_m)
        return float(np.linalg.norm(chain_of(YUMI).tool(self.last.positions_rad) - hand))


def looked_at(guard: Guard, commands: list[JointCommand], among: Obstacles) -> tuple[FloatArray, FloatArray]:
    """(T, S) how near the robot is to each segment [m], and (T,) how fast its fastest point [m/s]."""
    positions, velocities = (
        np.array([getattr(command, name) for command in commands]) for name in ("positions_rad", "velocities_rad_s")
    )
    found = guard.evaluate_poses(np.zeros(len(positions)), positions, velocities, among, 1.0)
    return found.clear_m, found.speed_m_s


def test_two_interactions_in_a_row_go_through_every_mode() -> None:
    run = Meeting()
    for _ in range(2):
        run.meet(0.5, REST_M)
        run.meet(2.0, MEETING_M, AWAY)
        run.meet(4.0, REST_M)
    assert run.modes() == ["idle", "ready", *["following", "returning", "ready"] * 2]
    check_limits(YUMI, run.commands)


def test_an_interaction_that_ends_in_full_flight_breaks_no_limit() -> None:
    end = YUMI.home_rad - np.eye(7)[2] * 0.7  # near the end of that joint's range
    run = Meeting(RetargetingSettings(ramp_velocity_rad_s=10.0, interaction_s=0.25, ik="off"))
    run.meet(0.5, REST_M)
    run.meet(4.0, MEETING_M, end)
    assert run.modes()[-2:] == ["returning", "ready"]
    first = next(command for command in run.commands if command.mode == "returning")
    assert np.abs(first.velocities_rad_s).max() > 2.0 * run.retargeting.settings.home_velocity_rad_s
    check_limits(YUMI, run.commands)


def test_the_robot_stays_at_home_while_no_one_starts() -> None:
    run = Meeting()
    run.meet(2.0, REST_M, AWAY)
    assert run.last.mode == "ready"
    np.testing.assert_allclose(run.last.positions_rad, YUMI.home_rad, atol=1e-9)


def test_hands_meet_where_the_person_holds_theirs_and_the_arm_is_soft_then() -> None:
    hand_m = MEETING_M + np.array([0.05, -0.05, 0.04])  # 8 cm from where the model expects it
    run, learned = Meeting(), Meeting(RetargetingSettings(ik="off"), parts=())  # whose hand is nothing to keep from
    for each in (run, learned):
        each.meet(0.5, REST_M)
        each.meet(3.0, hand_m, AWAY)
    assert run.apart_m(hand_m) < 0.01
    assert learned.apart_m(hand_m) == pytest.approx(0.081, abs=0.005)
    assert run.last.stiffness < 0.5
    assert learned.last.stiffness == 1.0
    check_limits(YUMI, run.commands)
    hand = STANDING.placed(hand_m, ARM_FRAME, STANDING.place_m)
    for here, there in zip(run.commands, learned.commands, strict=True):
        if np.linalg.norm(chain_of(YUMI).tool(there.positions_rad) - hand) > 0.35:
            assert np.abs(here.positions_rad - there.positions_rad).max() < np.deg2rad(5), "before the approach"
        if np.linalg.norm(chain_of(YUMI).tool(here.positions_rad) - hand) > 0.15:
            assert here.stiffness == 1.0, "an arm that reaches is stiff"


def test_no_hand_is_met_in_an_interaction_without_touch() -> None:
    run = Meeting()
    run.meet(0.5, REST_M, interaction="hand_wave")
    run.meet(2.0, MEETING_M + np.array([-0.25, 0.0, 0.1]), AWAY, interaction="hand_wave")
    np.testing.assert_allclose(run.last.positions_rad, AWAY, atol=1e-3)


def test_without_learned_motion_the_hand_is_reached_for_when_it_is_within_reach() -> None:
    run = Meeting(RetargetingSettings(ik="only"))
    run.meet(0.5, REST_M)
    run.meet(3.0, MEETING_M)
    assert run.apart_m(MEETING_M) < 0.02


def test_a_hold_stops_at_once_stays_and_goes_home_when_released() -> None:
    run = Meeting()
    run.meet(0.5, REST_M)
    run.meet(0.6, MEETING_M, AWAY)
    run.now_ns += TICK_NS // 2
    assert run.give(Request("hold")) == "held"
    assert run.last.mode == "held"
    assert run.last.stamp_ns == run.now_ns, "not only at the next tick"
    run.meet(2.0, MEETING_M, AWAY)
    assert run.last.mode == "held"
    assert not run.last.velocities_rad_s.any()
    run.meet(1.0, REST_M)
    run.give(Request("release"))
    run.meet(5.0, REST_M)
    assert run.modes()[-3:] == ["holding", "returning", "ready"]
    check_limits(YUMI, run.commands)


def test_a_hand_that_stays_up_far_away_is_at_rest_there_and_an_interaction_without_end_ends() -> None:
    run = Meeting(RetargetingSettings(ik="off"))  # else the hand would be met, and not stay far away
    run.meet(0.5, REST_M)
    run.meet(5.0, REST_M + np.array([0.2, 0.0, 0.4]), AWAY)
    assert run.state.counts["ended_still"] == 1
    assert run.last.mode != "following"
    run = Meeting(RetargetingSettings(interaction_s=1.0))
    run.meet(0.5, REST_M)
    run.meet(2.0, MEETING_M, AWAY)
    assert run.state.counts["ended_too_long"] == 1


def test_the_robot_keeps_out_of_the_head_and_is_slow_near_the_person() -> None:
    settings = RetargetingSettings(start_watch_s=0.0)
    guard, run = Guard(YUMI, settings), Meeting(settings)
    run.meet(0.5, REST_M)
    head_in_the_way = np.array([MEETING_M + np.array([0.0, 0.13, 0.0]), BODY_M[1], BODY_M[2]])
    for tick in range(200):
        run.now_ns += TICK_NS
        if tick % 3 == 0:
            run.give(seen(run.now_ns, MEETING_M, head_in_the_way))
            run.give(window(np.tile(AWAY, (40, 1)), run.now_ns))
        run.give(None)
    crowd = Crowd.of(seen(run.now_ns, MEETING_M, head_in_the_way))
    everyone = obstacles_of(crowd, run.retargeting.settings, STANDING, None, np.full(3, np.nan), run.now_ns)
    clear, speed = looked_at(guard, run.commands, everyone)
    kept = np.array([part != "right_forearm" for part in everyone.parts])
    assert clear[:, kept].min() > run.retargeting.settings.keep_out_m - 1e-6
    assert run.state.counts["refused_keep_out"] > 0
    near = clear.min(axis=1) < run.retargeting.settings.near_m
    assert 0.4 < speed[near].max() <= run.retargeting.settings.near_speed_m_s


def test_a_motion_into_the_robots_own_body_is_refused_and_one_out_of_it_taken() -> None:
    inside = np.array(YUMI.home_rad)
    inside[1], inside[2] = -2.2, -2.46  # the upper arm folds back until the forearm meets the trunk
    inside[4] += 0.5  # the forearm's own turn does no harm
    guard = Guard(YUMI, RetargetingSettings())
    way = YUMI.home_rad + np.linspace(0.0, 1.0, 21)[:, None] * (inside - YUMI.home_rad)
    clear = guard.own_clearance_m(way)
    assert min(clear) < -0.01, "the way there does collide"
    run = Run()
    run.wait(3.0, inside)
    at = np.array([command.positions_rad for command in run.commands])
    assert guard.own_clearance_m(at).min() > -1e-3
    assert run.state.counts["refused_self_collision"] > 0
    assert abs(run.last.positions_rad[4] - inside[4]) < 1e-2, "a joint that does no harm goes on"
    check_limits(YUMI, run.commands)
    run.wait(3.0, YUMI.home_rad)
    np.testing.assert_allclose(run.last.positions_rad, YUMI.home_rad, atol=1e-3)
