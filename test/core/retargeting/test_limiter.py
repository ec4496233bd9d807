# SPDX-License-Identifier: Apache-2.0
"""Plans as mathematics has them: inside three limits, each joint by itself as fast as it can, to rest."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mild_core.retargeting.limiter import JointMotion, Limiter

VELOCITY, ACCELERATION, JERK = np.array([1.0, 2.0]), np.array([4.0, 5.0]), np.array([40.0, 60.0])
DT_S = 0.004
MOVING = JointMotion((0.1, -0.3), (0.5, -1.2), (1.5, 2.0))
OTHER = JointMotion((0.5, 0.7), (-0.1, 0.4), (-2.0, 0.5))


@pytest.fixture(name="limiter")
def _limiter() -> Limiter:
    return Limiter(VELOCITY, ACCELERATION, JERK)


def rows(motion: JointMotion) -> np.ndarray:
    """(3, J) positions, velocities, accelerations."""
    return np.array([motion.position_rad, motion.velocity_rad_s, motion.acceleration_rad_s2])


def way(limiter: Limiter, start: JointMotion, target: tuple[float, ...], seconds: float) -> np.ndarray:
    """(N, 3, J) the motions of each step towards a target."""
    motions = [start]
    for _ in range(round(seconds / DT_S)):
        motions.append(limiter.toward(motions[-1], target, DT_S))
    return np.array([rows(motion) for motion in motions])


@pytest.mark.parametrize("start", [JointMotion.at_rest((0.0, 0.0)), MOVING])
def test_a_way_keeps_all_three_limits_reaches_them_and_ends_at_rest(limiter, start):
    found = way(limiter, start, (3.0, -4.0), 6.0)
    for order, limit in ((1, VELOCITY), (2, ACCELERATION)):
        most = np.abs(found[:, order]).max(axis=0)
        assert (most <= limit + 1e-9).all()
        assert (most > 0.98 * limit).all()
    jerks = np.abs(np.diff(found[:, 2], axis=0)).max(axis=0) / DT_S
    assert (jerks <= JERK * (1.0 + 1e-6)).all()
    assert (jerks > 0.98 * JERK).all()
    np.testing.assert_allclose(found[-1], [[3.0, -4.0], [0.0, 0.0], [0.0, 0.0]], atol=1e-9)


def test_a_slow_joint_delays_no_quick_one(limiter):
    alone, beside = (way(limiter, JointMotion.at_rest((0.0, 0.0)), (far, 0.05), 1.0)[:, 0, 1] for far in (0.0, 9.0))
    np.testing.assert_allclose(alone, beside, atol=1e-9)
    # Without cruising or a whole ramp of acceleration, a way of d takes 4 (d / (2 j))^(1/3) seconds.
    arrived = int((np.abs(alone - 0.05) < 1e-6).argmax()) * DT_S
    assert arrived == pytest.approx(4.0 * (0.05 / (2.0 * JERK[1])) ** (1.0 / 3.0), abs=2 * DT_S)


def test_a_step_is_the_same_in_one_or_in_many(limiter):
    whole = rows(limiter.toward(MOVING, (1.0, 1.0), 25 * DT_S))
    np.testing.assert_allclose(way(limiter, MOVING, (1.0, 1.0), 25 * DT_S)[-1], whole, atol=1e-9)


def test_a_stop_ends_where_the_resting_place_is_as_soon_as_it_can(limiter):
    place, motion, steps = np.array(limiter.resting_place(MOVING)), MOVING, 0
    while not motion.resting:
        motion, steps = limiter.stop(motion, DT_S), steps + 1
    np.testing.assert_allclose(motion.position_rad, place, atol=1e-9)
    # At full jerk to full brakes and back, from a speed v, is v / a + a / j; the acceleration at first adds to it.
    assert steps * DT_S < max(VELOCITY / ACCELERATION + 2.0 * ACCELERATION / JERK)
    np.testing.assert_allclose(np.array(limiter.resting_place(JointMotion.at_rest((0.3, 0.4)))), [0.3, 0.4])


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_between_two_motions_lies_a_share_of_everything(share):
    wanted = rows(MOVING) + share * (rows(OTHER) - rows(MOVING))
    np.testing.assert_allclose(rows(MOVING.toward(OTHER, share)), wanted, atol=1e-12)


@pytest.mark.parametrize("joint", [0, 1])
def test_one_joint_of_another_motion_takes_all_of_it_along(joint):
    wanted = rows(MOVING)
    wanted[:, joint] = rows(OTHER)[:, joint]
    np.testing.assert_array_equal(rows(MOVING.with_joint(joint, OTHER)), wanted)


@pytest.mark.parametrize(("speed", "acceleration", "rests"), [(0, 0, True), (1e-6, 0, False), (0, -1e-6, False)])
def test_only_what_neither_moves_nor_is_about_to_rests(speed, acceleration, rests):
    assert JointMotion((0.0, 1.0), (0.0, speed), (0.0, acceleration)).resting == rests


def test_a_joint_that_is_about_to_move_is_not_stopped_dead(limiter):
    about = JointMotion((0.0, 0.0), (0.0, 0.0), (2.0, 0.0))
    after = limiter.stop(about, DT_S)
    assert after.acceleration_rad_s2[0] == pytest.approx(2.0 - JERK[0] * DT_S)
    assert limiter.toward(about, (0.0, 0.0), DT_S).velocity_rad_s[0] > 0.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("joint", [0, 1])
def test_what_is_borne_is_inside_the_limits_of_speed_and_acceleration(limiter, joint, sign):
    for order, limits in ((1, VELOCITY), (2, ACCELERATION)):
        for share, borne in ((0.999, True), (1.001, False)):
            parts = np.zeros((3, 2))
            parts[order, joint] = sign * share * limits[joint]
            assert limiter.bears(JointMotion(*map(tuple, parts.tolist()))) == borne


def test_what_stands_at_its_target_stays_there_to_the_bit(limiter):
    here = JointMotion.at_rest((0.1 + 0.2, math.pi))
    assert limiter.toward(here, here.position_rad, DT_S) == here
    assert limiter.stop(here, DT_S) == here
