# SPDX-License-Identifier: Apache-2.0
"""The judge of commands is judged: every limit has a curve that breaks it by a little, and one that keeps it by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mild_core.retargeting.limit_check import exceeded_limits
from mild_core.retargeting.robots.yumi import YUMI

JOINTS = len(YUMI.joint_names)
LIMIT = 2.0
"""Of the derivative in question, all others being out of the way."""

LIMITS = {"velocity": "velocity_rad_s", "acceleration": "acceleration_rad_s2", "jerk": "jerk_rad_s3"}
WIDE = np.full(JOINTS, 1e6)
ROBOT = replace(
    YUMI,
    home_rad=np.zeros(JOINTS),
    lower_rad=-WIDE,
    upper_rad=WIDE,
    velocity_rad_s=WIDE,
    acceleration_rad_s2=WIDE,
    jerk_rad_s3=WIDE,
)
TIMES_S = np.cumsum(np.random.default_rng(0).uniform(0.004, 0.02, 40))
STAMPS_NS = np.round(TIMES_S * 1e9).astype(np.int64)


def curve(joint: int, coefficients: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, J) and velocities of one joint on a polynomial of time, the others at rest."""
    polynomial = np.polynomial.Polynomial(coefficients)
    positions, velocities = np.zeros((2, len(TIMES_S), JOINTS))
    times_s = (STAMPS_NS - STAMPS_NS[0]) * 1e-9
    positions[:, joint], velocities[:, joint] = polynomial(times_s), polynomial.deriv()(times_s)
    return positions, velocities


def named(lines: tuple[str, ...]) -> set[str]:
    return {line.removeprefix("the limit of ").split(" is broken")[0] for line in lines}


@pytest.mark.parametrize("joint", [0, JOINTS - 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("name", "derivative"), [("velocity", (0.0, 1.0)), ("acceleration", (0, 0, 0.5)), ("jerk", (0, 0, 0, 1 / 6))]
)
def test_a_derivative_is_judged_to_the_thousandth_at_any_spacing(name, derivative, sign, joint):
    robot = replace(ROBOT, **{LIMITS[name]: np.full(JOINTS, LIMIT)})
    for share, broken in ((0.999, False), (1.001, True)):
        positions, velocities = curve(joint, tuple(sign * share * LIMIT * one for one in derivative))
        found = named(exceeded_limits(robot, STAMPS_NS, positions, velocities))
        assert (name in found) == broken
        assert found <= {name, f"{name} as said", "position after velocity"}


@pytest.mark.parametrize(("limit", "sign"), [("lower_rad", -1.0), ("upper_rad", 1.0)])
def test_a_position_may_reach_its_limit_and_not_pass_it(limit, sign):
    robot = replace(ROBOT, **{limit: np.full(JOINTS, sign)})
    for beyond, broken in ((0.0, set()), (1e-9, {"position"})):
        positions, velocities = curve(3, (sign * (1.0 + beyond),))
        assert named(exceeded_limits(robot, STAMPS_NS, positions, velocities)) == broken


def test_a_velocity_that_is_not_that_of_the_positions_is_found():
    robot = replace(ROBOT, acceleration_rad_s2=np.full(JOINTS, LIMIT))
    positions, velocities = curve(2, (0.0, 0.5))
    assert exceeded_limits(robot, STAMPS_NS, positions, velocities) == ()
    assert named(exceeded_limits(robot, STAMPS_NS, positions, 1.2 * velocities)) == {"position after velocity"}
    one_off = velocities.copy()
    one_off[20, 2] += 1.2 * LIMIT * 0.02
    assert "acceleration as said" in named(exceeded_limits(robot, STAMPS_NS, positions, one_off))


def test_a_velocity_beyond_its_limit_is_found_where_the_positions_keep_it():
    robot = replace(ROBOT, velocity_rad_s=np.full(JOINTS, LIMIT))
    positions, velocities = curve(2, (0.0, 0.5))
    velocities[5, 4] = -1.001 * LIMIT
    assert "velocity as said" in named(exceeded_limits(robot, STAMPS_NS, positions, velocities))


@pytest.mark.parametrize("spoil", [lambda p, v: (p * np.nan, v), lambda p, v: (p, v + np.inf)])
def test_what_is_no_number_is_within_no_limit(spoil):
    assert exceeded_limits(ROBOT, STAMPS_NS, *spoil(*curve(0, (0.0, 0.5)))) == ("a command is not finite",)


def test_commands_that_do_not_follow_each_other_are_found():
    stamps_ns = STAMPS_NS.copy()
    stamps_ns[7] = stamps_ns[6]
    assert exceeded_limits(ROBOT, stamps_ns, *curve(0, (0.0,))) == (
        "a command's stamp is not later than the one before",
    )
