# SPDX-License-Identifier: Apache-2.0
"""What retargeting does under interference: the operator, the clock, a hand on the robot, a saved state."""

from __future__ import annotations

import pickle
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Request, Retargeting, RetargetingSettings, RetargetingState
from test.core.retargeting.limits import check_limits
from test.core.retargeting.perfect import START_NS, measurement, window
from test.core.retargeting.run import AWAY, SECOND_NS, Given, Run


def test_disabling_stops_smoothly_and_falls_silent_and_enabling_starts_where_the_robot_is() -> None:
    run = Run()
    run.wait(0.4, AWAY)
    assert np.abs(run.last.velocities_rad_s).max() > 0.1
    assert run.give(Request("disable")) == "disabled"
    run.wait(1.0, AWAY)
    assert run.last.mode == "disabled"
    np.testing.assert_array_equal(run.last.velocities_rad_s, np.zeros(7))
    assert run.state.counts["not_enabled"] == 34
    check_limits(YUMI, run.commands)
    spoken = len(run.commands)
    run.wait(5.0)
    assert len(run.commands) == spoken
    run.give(measurement(YUMI.home_rad - 0.5, run.now_ns))  # led by hand meanwhile
    assert run.give(Request("enable")) == "enabled"
    run.wait(0.1)
    np.testing.assert_array_equal(run.commands[spoken].positions_rad, YUMI.home_rad - 0.5)
    assert run.last.mode == "idle"
    run.wait(3.0, AWAY)
    np.testing.assert_allclose(run.last.positions_rad, AWAY, atol=1e-6)


def test_it_can_start_disabled() -> None:
    run = Run(RetargetingSettings(enabled=False))
    run.wait(0.5, AWAY)
    assert run.commands == []
    run.give(Request("enable"))
    run.wait(0.5, AWAY)
    assert run.last.mode == "following"


def test_a_reset_forgets_the_motion_and_goes_home() -> None:
    run = Run()
    run.wait(1.0, AWAY)
    assert run.give(Request("reset")) == "reset"
    run.wait(0.2)
    assert run.last.mode == "holding"
    run.wait(6.0)
    assert run.last.mode == "idle"
    check_limits(YUMI, run.commands)


def test_a_clock_that_goes_backwards_stops_the_robot_smoothly() -> None:
    run = Run()
    run.wait(0.4, AWAY)
    before = run.last
    assert np.abs(before.velocities_rad_s).max() > 0.1
    run.now_ns -= 3600 * SECOND_NS
    spoken = len(run.commands)
    run.give(None)
    np.testing.assert_array_equal(run.last.positions_rad, before.positions_rad)
    np.testing.assert_array_equal(run.last.velocities_rad_s, before.velocities_rad_s)
    run.wait(1.0)
    assert run.last.mode == "holding"
    assert run.state.counts["time_backwards"] == 1
    check_limits(YUMI, run.commands[spoken:])
    run.wait(1.0, AWAY)
    assert run.last.mode == "following"


@pytest.mark.parametrize("gap_s", [0.31, 1.0, 3600.0])
def test_a_gap_in_time_does_not_make_the_robot_jump(gap_s: float) -> None:
    run = Run()
    run.wait(0.4, AWAY)
    before = run.last
    assert np.abs(before.velocities_rad_s).max() > 0.1
    run.now_ns += round(gap_s * SECOND_NS)
    spoken = len(run.commands)
    run.give(window(np.tile(AWAY, (40, 1)), run.now_ns), None)
    np.testing.assert_array_equal(run.last.positions_rad, before.positions_rad)
    np.testing.assert_array_equal(run.last.velocities_rad_s, np.zeros(7))
    run.wait(1.5, AWAY)
    np.testing.assert_allclose(run.last.positions_rad, AWAY, atol=1e-6)
    assert run.state.counts["gap"] == 1
    check_limits(YUMI, run.commands[spoken:])


def test_after_a_gap_it_waits_before_it_goes_home() -> None:
    run = Run()
    run.wait(0.4, AWAY)
    run.now_ns += SECOND_NS
    run.wait(0.9 * run.retargeting.settings.home_after_s)
    assert run.last.mode == "holding"
    run.wait(0.2 * run.retargeting.settings.home_after_s)
    assert run.last.mode == "returning"


def test_a_robot_led_by_hand_is_not_pulled_back() -> None:
    run = Run()
    run.wait(1.5, AWAY)
    hand = YUMI.home_rad - 0.4
    for _ in range(60):
        run.give(measurement(hand, run.now_ns))
        run.wait(0.01, AWAY)
    assert run.state.counts["displaced"] == 1
    # The command came to the robot instead, ...
    nearest = min(float(np.abs(command.positions_rad - hand).max()) for command in run.commands)
    assert nearest < 0.5 * run.retargeting.settings.displaced_rad
    for _ in range(300):
        run.give(measurement(run.last.positions_rad, run.now_ns))
        run.wait(0.01, AWAY)
    # ... and once the robot was let go, it went on from there.
    np.testing.assert_allclose(run.last.positions_rad, AWAY, atol=1e-6)
    assert run.state.counts["displaced"] == 1
    check_limits(YUMI, run.commands)


def test_a_robot_that_lags_is_not_displaced() -> None:
    run = Run()
    for tick in range(300):
        goal = YUMI.home_rad + 0.6 * np.sin(0.03 * tick)
        run.wait(0.01, goal)
        if len(run.commands) > 10:
            run.give(measurement(run.commands[-10].positions_rad, run.now_ns))  # a tenth of a second late
    assert "displaced" not in run.state.counts


def _story() -> Iterable[tuple[int, Given]]:
    rng = np.random.default_rng(7)
    now_ns, goal = START_NS, np.array(YUMI.home_rad)
    yield now_ns, measurement(YUMI.home_rad)
    for step in range(600):
        now_ns += int(rng.integers(1, 20_000_000))
        goal = goal + rng.normal(0, 0.05, 7)
        kind = rng.integers(0, 10)
        if kind < 4:
            yield now_ns, window(goal + rng.normal(0, 0.02, (40, 7)), now_ns - 30_000_000)
        elif kind < 5:
            yield now_ns, measurement(YUMI.home_rad, now_ns)
        elif step % 200 == 150:
            yield now_ns, Request("reset")
        else:
            yield now_ns, None


def _ensembles(retargeting: Retargeting, state: RetargetingState, story: Iterable[tuple[int, Given]]) -> list[bytes]:
    said = []
    for now_ns, given in story:
        state, commands = retargeting.step(state, given, now_ns)
        said += [pickle.dumps(command) for command in commands]
    return said


def test_the_same_story_gives_the_same_bits_from_any_saved_state() -> None:
    story = list(_story())
    whole = Retargeting(YUMI)
    said = _ensembles(whole, whole.init(), story)
    assert len(said) > 300
    used, state, spoken = Retargeting(YUMI), whole.init(), 0
    for place, (now_ns, given) in enumerate(story):
        if place % 100 == 50:
            saved = pickle.loads(pickle.dumps(state))
            # A planner that has just worked on something else, and one that never worked.
            assert _ensembles(used, saved, story[place:]) == said[spoken:]
            assert _ensembles(Retargeting(YUMI), saved, story[place:]) == said[spoken:]
        state, commands = used.step(state, given, now_ns)
        spoken += len(commands)


def test_a_measurement_while_disabled_restarts_the_commands() -> None:
    run = Run()
    run.wait(0.1)
    run.give(Request("disable"), measurement(AWAY, run.now_ns), Request("enable"))
    run.now_ns += 1
    run.give(None)
    # A nanosecond after the last command at home: a first command, where the robot is now.
    np.testing.assert_array_equal(run.last.positions_rad, AWAY)
    assert run.state.commanded_ns == run.now_ns
    assert "gap" not in run.state.counts


def test_without_a_plan_the_robot_is_commanded_to_stay_and_it_is_counted() -> None:
    run = Run()
    run.wait(0.5, AWAY)
    assert run.state.motion is not None
    # No input leads to this: a saved state that was damaged.
    run.state = replace(run.state, motion=replace(run.state.motion, velocity_rad_s=(float("nan"),) * 7))
    before = run.last
    run.wait(0.01)
    np.testing.assert_array_equal(run.last.positions_rad, before.positions_rad)
    np.testing.assert_array_equal(run.last.velocities_rad_s, np.zeros(7))
    assert run.state.counts["no_plan"] == 1
    run.wait(2.0, AWAY)
    np.testing.assert_allclose(run.last.positions_rad, AWAY, atol=1e-6)
