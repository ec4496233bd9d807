# SPDX-License-Identifier: Apache-2.0
"""What the guard decides by, against brute force: distances and speeds of poses, bounds between looks, breaches."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from mild_core.retargeting.clearance import BREACHES, LEAST_M_S, LOOK_SELF_M, find_breach, path_bounds
from mild_core.retargeting.guard import (
    APART_M,
    HAND_ROOM_M,
    MEETING_M,
    ROUNDING,
    TOO_FAST,
    UNPACED_M,
    UNSURE_HAND_M_S,
    UNSURE_M_S,
    Guard,
    _unsure_m_s,
)
from mild_core.retargeting.limiter import JointMotion, Limiter
from mild_core.retargeting.obstacles import NO_ONE, Obstacles
from mild_core.retargeting.robot_model.capsules import capsules_of
from mild_core.retargeting.robot_model.chain import (
    chain_of,
    frames_of,
    least_clearance,
    mount_of,
    nearest_points,
    place_capsules,
)
from mild_core.retargeting.robot_model.kinematics import read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import Solid, read_solids
from mild_core.retargeting.robots import ROBOTS
from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.settings import RetargetingSettings

SETTINGS = RetargetingSettings()
CHAIN, CAPSULES = chain_of(YUMI), capsules_of(YUMI)
STEP_S = 1e-6


@pytest.fixture(name="guard", scope="module")
def _guard() -> Guard:
    return Guard(YUMI, SETTINGS)


def placed(positions_rad: np.ndarray) -> np.ndarray:
    """(N, 3, 3) the robot's capsules: ends and middle."""
    found = np.empty((len(CAPSULES.mounted), 3, 3))
    frames = frames_of(positions_rad, CHAIN.columns, CHAIN.offsets, CHAIN.axes)
    place_capsules(frames, CAPSULES.mounted, CAPSULES.ends_m, found)
    return found


def arm(positions_rad: np.ndarray, shares: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """(M, shares, 3) points on the axes of the moving capsules, and (M,) their radii."""
    ends, moving = placed(positions_rad), CAPSULES.moving.astype(int)
    along = np.linspace(0.0, 1.0, shares)[:, None]
    points = np.array([ends[part, 0] + along * (ends[part, 1] - ends[part, 0]) for part in moving])
    return points, CAPSULES.outer_m[moving]


def among(ends_m: np.ndarray, velocities_m_s: np.ndarray, radii_m: np.ndarray, **others: object) -> Obstacles:
    count = len(radii_m)
    values = {"keep_m": np.full(count, 0.05), "zones_m": np.full(count, 0.3), "horizon_s": 10.0} | others
    return Obstacles((1,) * count, ("trunk",) * count, ends_m, velocities_m_s, radii_m, **values)  # type: ignore[arg-type]


def scene(seed: int) -> tuple[np.ndarray, np.ndarray, Obstacles]:
    """A pose, joint velocities, and three segments about the arm that move."""
    rng = np.random.default_rng(seed)
    pose = np.clip(YUMI.home_rad + rng.normal(0.0, 0.4, 7), YUMI.lower_rad, YUMI.upper_rad)
    tool = CHAIN.tool(pose)
    ends = tool + rng.normal(0.0, 0.25, (3, 1, 3)) + rng.normal(0.0, 0.15, (3, 2, 3))
    velocities = np.repeat(rng.normal(0.0, 0.5, (3, 1, 3)), 2, axis=1)
    return pose, rng.normal(0.0, 0.6, 7), among(ends, velocities, np.array([0.05, 0.1, 0.02]))


def outside_m(robot: RobotModel, solid: Solid) -> float:
    """How far corners and rims of a solid stick out of all capsules that move with its link [m]."""
    capsules, tree = capsules_of(robot), read_tree(robot.urdf_path)
    mount = mount_of(robot, tree, solid.link)
    if mount.frame < 2:  # the shoulder, or what does not move
        return 0.0
    if solid.kind == "box":
        local = np.array(list(product((-0.5, -0.2, 0.2, 0.5), repeat=3))) * solid.size_m
    elif solid.kind == "cylinder":
        around = np.linspace(0.0, 2.0 * np.pi, 23)
        rim = solid.size_m[0] * np.stack([np.cos(around), np.sin(around), np.zeros(23)], axis=1)
        local = np.concatenate([rim + np.array([0.0, 0.0, z * solid.size_m[1]]) for z in (-0.5, -0.2, 0.2, 0.5)])
    else:
        local = solid.size_m[0] * np.concatenate([np.eye(3), -np.eye(3)])
    pose = mount.pose @ solid.origin
    points = local @ pose[:3, :3].T + pose[:3, 3]
    held = []
    for part in np.flatnonzero(capsules.mounted == mount.frame):
        start, end = capsules.ends_m[part]
        far = [nearest_points(point, point, start, end)[0] for point in points]
        held.append(np.array(far) - capsules.outer_m[part])
    return float(np.min(held, axis=0).max())


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=list(ROBOTS))
def test_people_are_kept_from_all_that_the_arm_shows_and_collides_with_and_its_tool(robot: RobotModel) -> None:
    shapes = [*read_solids(robot.urdf_path), *read_solids(robot.urdf_path, "visual")]
    for solid in shapes:
        assert outside_m(robot, solid) < 0.004, solid
    capsules, tool_m = capsules_of(robot), chain_of(robot).tool_m
    last = np.flatnonzero(capsules.mounted == len(robot.joint_names))
    held = [nearest_points(tool_m, tool_m, *capsules.ends_m[part])[0] - capsules.outer_m[part] for part in last]
    assert min(held) < 1e-6


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=list(ROBOTS))
def test_no_tool_is_faster_than_the_guard_says(robot: RobotModel) -> None:
    guard, rng = Guard(robot, SETTINGS), np.random.default_rng(3)
    for _ in range(50):
        pose, rates = rng.uniform(robot.lower_rad, robot.upper_rad), rng.normal(0.0, 1.0, len(robot.joint_names))
        tool_m_s = (guard.chain.tool(pose + STEP_S * rates) - guard.chain.tool(pose - STEP_S * rates)) / (2.0 * STEP_S)
        assert guard.arm_speed(pose, rates, NO_ONE) > np.linalg.norm(tool_m_s) - 1e-6


@pytest.mark.parametrize("seed", range(6))
def test_clearance_is_the_least_distance_of_any_part_of_the_arm(guard: Guard, seed: int) -> None:
    pose, rates, people = scene(seed)
    view = guard.evaluate_poses(np.zeros(1), pose[None], rates[None], people, UNPACED_M)
    points, radii = arm(pose, 41)
    shares = np.linspace(0.0, 1.0, 41)[:, None]
    for place in range(3):
        axis = people.ends_m[place, 0] + shares * (people.ends_m[place, 1] - people.ends_m[place, 0])
        apart = np.linalg.norm(points[:, :, None] - axis, axis=-1).min(axis=(1, 2)) - radii
        wanted = apart.min() - people.radii_m[place]
        assert view.clear_m[0, place] == pytest.approx(wanted, abs=0.005)
        assert view.clear_m[0, place] <= wanted + 1e-9
    assert view.near_m == view.clear_m[0].min()


@pytest.mark.parametrize("seed", range(6))
def test_no_point_of_the_arm_is_faster_than_is_said_and_one_nearly_is(guard: Guard, seed: int) -> None:
    pose, rates, people = scene(seed)
    said = float(guard.evaluate_poses(np.zeros(1), pose[None], rates[None], people, UNPACED_M).speed_m_s[0])
    points, radii = arm(pose)
    moved = (arm(pose + STEP_S * rates)[0] - points) / STEP_S
    axis = np.linalg.norm(moved, axis=-1).max(axis=1)
    assert axis.max() <= said
    turning = np.linalg.norm(np.abs(rates).sum())
    assert said <= (axis + radii * turning).max() + 1e-9
    assert guard.arm_speed(pose, rates, people) == pytest.approx(said)
    assert guard.evaluate_poses(np.zeros(1), pose[None], 2.0 * rates[None], people, UNPACED_M).speed_m_s[
        0
    ] == pytest.approx(2.0 * said)


@pytest.mark.parametrize("seed", range(12))
def test_clearance_falls_no_faster_than_the_arm_and_the_person_come_nearer(guard: Guard, seed: int) -> None:
    """What is said of both speeds is a bound of how fast the distance can fall, whatever moves."""
    pose, rates, people = scene(seed)
    for moves, rate in ((1.0, 1.0), (0.0, 1.0), (1.0, 0.0)):
        others = among(people.ends_m, moves * people.velocities_m_s, people.radii_m)
        times, step = np.array([0.0, 1e-4]), 1e-4 * rate * rates
        view = guard.evaluate_poses(
            times, np.stack([pose, pose + step]), np.tile(rate * rates, (2, 1)), others, UNPACED_M
        )
        falls = (view.clear_m[0] - view.clear_m[1]) / 1e-4
        assert (falls <= view.toward_m_s[0] + view.approach_m_s[0] + 0.01).all()
        assert (view.toward_m_s[0] >= 0.0).all()
        if rate == 0.0:
            assert not view.toward_m_s.any()
            assert not view.speed_m_s.any()
        if moves == 0.0:
            assert not view.approach_m_s.any()


@pytest.mark.parametrize("seed", range(12))
def test_points_all_around_the_arm_count_towards_an_approaching_person(guard: Guard, seed: int) -> None:
    pose, rates, people = scene(seed)
    coming = among(people.ends_m, np.full((3, 2, 3), 1.0), people.radii_m)
    given = np.zeros(1), pose[None], rates[None]
    nearest = guard.evaluate_poses(*given, coming, UNPACED_M).toward_m_s[0]
    around = guard.evaluate_poses(*given, coming, UNPACED_M, around=True).toward_m_s[0]
    still = among(people.ends_m, np.zeros((3, 2, 3)), people.radii_m)
    np.testing.assert_array_equal(guard.evaluate_poses(*given, still, UNPACED_M, around=True).toward_m_s[0], nearest)
    assert (around >= nearest).all()
    assert (around > nearest).any()
    # Points on the surfaces themselves move as their links do.
    chain = CHAIN.columns, CHAIN.offsets, CHAIN.axes
    frames, later = frames_of(pose, *chain), frames_of(pose + STEP_S * rates, *chain)
    fastest = np.zeros(3)
    for part in CAPSULES.moving.astype(int):
        frame = int(CAPSULES.mounted[part])
        moved = later[frame] @ np.linalg.inv(frames[frame])
        for end in placed(pose)[part, :2]:
            for side in np.random.default_rng(seed).normal(size=(60, 3)):
                point = end + CAPSULES.outer_m[part] * side / np.linalg.norm(side)
                rate = (moved[:3, :3] @ point + moved[:3, 3] - point) / STEP_S
                for place in range(3):
                    way, far = toward(point, people.ends_m[place])
                    if far < 0.7:
                        fastest[place] = max(fastest[place], float(rate @ way))
    apart = guard.evaluate_poses(*given, coming, UNPACED_M).clear_m[0] > 0.05
    assert (fastest[apart] <= 1.1 * around[apart] + 0.01).all()  # to first order


def toward(point_m: np.ndarray, ends_m: np.ndarray) -> tuple[np.ndarray, float]:
    """The direction from a point to a straight line between two ends, and how far that is."""
    distance, _, share = nearest_points(point_m, point_m, *ends_m)
    way = ends_m[0] + share * (ends_m[1] - ends_m[0]) - point_m
    return way / max(float(distance), 1e-9), float(distance)


@pytest.mark.parametrize(("speed", "approach"), [(0.7, 0.7), (-0.7, 0.0)])
def test_a_person_who_comes_straight_at_the_hand_approaches_at_their_speed(
    guard: Guard, speed: float, approach: float
) -> None:
    pose = np.array(YUMI.home_rad)
    points, _ = arm(pose)
    foremost = points.reshape(-1, 3)[points[..., 0].argmax()]
    away = np.array([1.0, 0.0, 0.0])
    ball = np.tile(foremost + 0.45 * away, (1, 2, 1))
    people = among(ball, np.tile(-speed * away, (1, 2, 1)), np.array([0.05]), horizon_s=0.5)
    view = guard.evaluate_poses(np.array([0.0, 0.1, 0.6]), np.tile(pose, (3, 1)), np.zeros((3, 7)), people, UNPACED_M)
    assert view.approach_m_s[0, 0] >= approach - 1e-9
    assert view.approach_m_s[0, 0] == pytest.approx(approach, abs=0.15)
    # They go on at that speed, until the horizon, and then they may have turned.
    assert view.clear_m[1, 0] == pytest.approx(view.clear_m[0, 0] - 0.1 * speed, abs=0.02)
    assert view.clear_m[2, 0] == pytest.approx(view.clear_m[0, 0] - 0.5 * speed, abs=0.05)
    assert view.approach_m_s[2, 0] == 0.0


def bounds(clear: tuple[float, ...], **values: object) -> np.ndarray:
    """Of a path with two looks 0.1 s apart beside one still segment; at 0.5 m/s, 0.2 towards it."""
    given = {
        "times_s": np.array([3.0, 3.1]),
        "own": np.array([0.03, 0.01]),
        "speed": np.array([0.5, 0.4]),
        "clear": np.array(clear)[:, None],
        "toward": np.array([[0.2], [0.1]]),
        "approach": np.zeros((2, 1)),
        "people_speed_m_s": np.zeros(1),
        "zones_m": np.array([0.3]),
        "near_speed_m_s": 0.8,
        "jerk_m_s3": 0.0,
        "least_m_s": LEAST_M_S,
        "unsure_m_s": np.zeros(1),
    } | values
    found: np.ndarray = path_bounds(*given.values())
    return found[0]


def test_between_two_looks_the_arm_may_have_been_nearer_than_at_both() -> None:
    # At 0.5 m/s a way of 5 cm: 2.5 cm there and back where both ends are equally far, none where it all is needed.
    assert bounds((0.2, 0.2))[1] == pytest.approx(0.2 - 0.025)
    assert bounds((0.2, 0.15))[1] == pytest.approx(0.15)
    assert bounds((0.2, 0.18))[1] == pytest.approx(0.19 - 0.025)
    assert bounds((0.2, 0.2), people_speed_m_s=np.array([0.3]))[1] == pytest.approx(0.2 - 0.04)
    assert bounds((0.2, 0.18))[2] == 0.18  # at the looks themselves
    assert bounds((0.2, 0.2))[0] == 0.01
    # What jerk can add in between: an eighth of it times the square of the time.
    assert bounds((0.2, 0.2), jerk_m_s3=80.0)[1] == pytest.approx(0.2 - 0.5 * (0.5 + 80 * 0.01 / 8) * 0.1)


def test_inside_the_zone_the_arm_is_bounded_and_what_comes_nearer_lowers_the_bound() -> None:
    assert not bounds((0.2, 0.2))[3:].any()
    np.testing.assert_allclose(bounds((0.2, 0.2), speed=np.array([0.7, 1.0]))[3:], [0.2, 0.0])
    np.testing.assert_allclose(bounds((0.2, 0.2), toward=np.array([[0.2], [0.9]]))[3:], [0.0, 0.1 - LEAST_M_S])
    coming = np.array([[0.3], [0.65]])
    np.testing.assert_allclose(bounds((0.2, 0.2), approach=coming)[3:], [0.0, 0.2 - 0.15 - LEAST_M_S])
    seen, unsure = np.array([[0.3], [0.55]]), np.array([0.1])
    np.testing.assert_allclose(bounds((0.2, 0.2), approach=seen, unsure_m_s=unsure)[4], 0.2 - 0.15 - LEAST_M_S)
    # Of a motion that is wanted every speed counts.
    np.testing.assert_allclose(bounds((0.2, 0.2), approach=coming, least_m_s=0.0)[3:], [0.0, 0.2 - 0.15])
    # Not below a standstill.
    np.testing.assert_allclose(bounds((0.2, 0.2), approach=coming + 1.0)[3:], [0.0, 0.2 - LEAST_M_S])
    np.testing.assert_allclose(bounds((0.2, 0.2), speed=np.ones(2), jerk_m_s3=80.0)[3:], [0.3, 0.0], atol=1e-12)


@pytest.mark.parametrize(("clear", "limited"), [((0.36, 0.36), False), ((0.31, 0.31), True), ((0.5, 0.29), True)])
def test_speed_counts_as_soon_as_the_zone_may_have_been_entered(clear: tuple[float, float], limited: bool) -> None:
    found = bounds(clear, speed=np.ones(2), toward=np.ones((2, 1)))
    assert found[3:].any() == limited


KEEP = np.array([0.05, -np.inf])
FINE = np.array([0.01, 0.06, 0.06, 0.0, 0.0, -0.2, -0.2, 0.0, 0.0])
"""Nothing is wrong: two segments, of which the second may be touched."""


def breach(changes: dict[int, float], least: dict[int, float] | None = None) -> tuple[str, int]:
    paths = []
    for values in (changes, least):
        path = np.tile(FINE, (3, 1))
        for place, value in (values or {}).items():
            path[1, place] = value
        paths.append(path)
    rule, segment = find_breach(paths[0], paths[1] if least is not None else np.empty((0, 9)), KEEP, ROUNDING)
    return BREACHES[rule], segment


def test_every_rule_is_found_and_of_whom() -> None:
    assert breach({}) == ("", -1)
    assert breach({0: -1e-9}) == ("refused_self_collision", -1)
    assert breach({1: 0.05 - 1e-9}) == ("refused_keep_out", 0)
    assert breach({1: 0.05}) == ("", -1)
    for place, segment in ((3, 0), (4, 0), (7, 1), (8, 1)):
        assert breach({place: 0.01}) == (TOO_FAST, segment)
    assert breach({5: -1.0, 6: -1.0}) == ("", -1)


def test_what_a_stop_would_break_as_badly_is_allowed_and_nothing_worse() -> None:
    for place, value, worse in ((0, -0.1, -0.2), (3, 0.3, 0.4), (4, 0.3, 0.4), (8, 0.3, 0.4)):
        assert breach({place: value}, {place: value}) == ("", -1)
        assert breach({place: worse}, {place: value})[0] != ""
        assert breach({place: value}, {})[0] != ""
    # A person who is too close: what counts is how near the looks themselves come, beside those of a stop.
    assert breach({1: 0.0, 2: 0.02}, {1: 0.01, 2: 0.02}) == ("", -1)
    assert breach({1: 0.0, 2: 0.03}, {1: 0.01, 2: 0.02}) == ("", -1)
    assert breach({1: 0.0, 2: 0.01}, {1: 0.01, 2: 0.02}) == ("refused_keep_out", 0)
    # A stop that leaves more room than is needed asks no more of anything else.
    assert breach({}, {0: 0.06, 1: 5.0, 2: 5.0}) == ("", -1)


def still_ball(metres: float) -> Obstacles:
    """A person's ball of 5 cm before the arm at home, so far from it."""
    points, radii = arm(np.array(YUMI.home_rad))
    flat = points.reshape(-1, 3)
    foremost = flat[:, 0].argmax()
    centre = flat[foremost] + (0.05 + np.repeat(radii, 9)[foremost] + metres) * np.array([1.0, 0.0, 0.0])
    return among(np.tile(centre, (1, 2, 1)), np.zeros((1, 2, 3)), np.array([0.05]))


def test_who_moves_may_come_faster_than_they_are_seen_to_but_where_hands_meet(guard: Guard) -> None:
    home = np.array([YUMI.home_rad])

    def allowed_for(metres: float, speed_m_s: float, offered: int) -> float:
        coming = np.tile([-speed_m_s, 0.0, 0.0], (1, 2, 1))
        people = replace(still_ball(metres), velocities_m_s=coming, offered=offered)
        seen = guard.evaluate_poses(np.zeros(1), home, 0.0 * home, people, UNPACED_M)
        return float(_unsure_m_s(people, seen)[0])

    assert allowed_for(0.1, 0.5, -1) == UNSURE_M_S
    assert allowed_for(0.1, 0.5, 0) == UNSURE_HAND_M_S
    assert allowed_for(0.1, 0.06, 0) == allowed_for(0.1, 0.06, -1) == pytest.approx(0.06)
    assert allowed_for(-0.5 * MEETING_M, 0.5, 0) == UNSURE_HAND_M_S
    assert allowed_for(-1.5 * MEETING_M, 0.5, 0) == 0.0
    assert allowed_for(-1.5 * MEETING_M, 0.5, -1) == UNSURE_M_S


def checked(guard: Guard, speed_rad_s: float, people: Obstacles) -> str:
    """Why a motion of all joints at a speed is refused."""
    limiter = Limiter(YUMI.velocity_rad_s, YUMI.acceleration_rad_s2, YUMI.jerk_rad_s3)
    rates = speed_rad_s * np.sign(CHAIN.jacobian(YUMI.home_rad)[1])
    now = JointMotion(tuple(YUMI.home_rad.tolist()), tuple(rates.tolist()), (0.0,) * 7)
    then = JointMotion(tuple((YUMI.home_rad + 0.01 * rates).tolist()), tuple(rates.tolist()), (0.0,) * 7)
    return guard.check_motion(limiter, now, then, 0.01, guard.here(now, people), people).refusal


def test_while_a_person_comes_fast_only_an_arm_that_gives_way_may_turn_a_little_towards_them(guard: Guard) -> None:
    still = still_ball(0.2)
    people = among(still.ends_m, np.tile([-1.0, 0.0, 0.0], (1, 2, 1)), still.radii_m, horizon_s=0.05)
    limiter = Limiter(YUMI.velocity_rad_s, YUMI.acceleration_rad_s2, YUMI.jerk_rad_s3)
    forward = CHAIN.jacobian(YUMI.home_rad)[0]
    rates = 0.015 * forward / float(forward @ forward)  # 1.5 cm/s
    rest = JointMotion.at_rest(tuple(YUMI.home_rad.tolist()))
    then = JointMotion(tuple((YUMI.home_rad + 0.005 * rates).tolist()), tuple(rates.tolist()), (0.0,) * 7)
    given = limiter, rest, then, 0.01, guard.here(rest, people), people
    assert guard.check_motion(*given).refusal == TOO_FAST
    assert guard.check_motion(*given, giving_way=True).refusal == ""


def test_beside_a_person_a_fast_motion_is_rejected_and_a_slow_one_taken(guard: Guard) -> None:
    near, far = still_ball(0.2), still_ball(2.0)
    assert checked(guard, 0.0, near) == ""
    assert checked(guard, 0.1, near) == ""
    fast = 1.0 / guard.arm_speed(YUMI.home_rad, np.sign(CHAIN.jacobian(YUMI.home_rad)[1]), near)
    assert checked(guard, fast, far) == ""
    assert checked(guard, fast, near) in ("", TOO_FAST)  # a stop from there is as fast at first
    limiter = Limiter(YUMI.velocity_rad_s, YUMI.acceleration_rad_s2, YUMI.jerk_rad_s3)
    rates = np.sign(CHAIN.jacobian(YUMI.home_rad)[1]) * fast
    rest = JointMotion.at_rest(tuple(YUMI.home_rad.tolist()))
    then = JointMotion(tuple((YUMI.home_rad + 0.005 * rates).tolist()), tuple(rates.tolist()), (0.0,) * 7)
    verdicts = [guard.check_motion(limiter, rest, then, 0.01, guard.here(rest, who), who) for who in (near, far)]
    assert [verdict.refusal for verdict in verdicts] == [TOO_FAST, ""]


@pytest.mark.parametrize("inside_m", [0.02, 0.1])
def test_a_point_is_pushed_out_of_whom_it_must_not_touch(guard: Guard, inside_m: float) -> None:
    ends = np.array([[[0.4, 0.0, 0.0], [0.4, 0.0, 0.4]]])
    people = among(ends, np.zeros((1, 2, 3)), np.array([0.14]))
    point = np.array([0.4 - inside_m, 0.0, 0.2])
    wanted = np.array([0.4 - (0.14 + 0.05 + HAND_ROOM_M), 0.0, 0.2])
    np.testing.assert_allclose(guard.push_out(point, people)[0], wanted, atol=1e-9)
    assert guard.push_out(point, people)[1] == 0
    np.testing.assert_array_equal(guard.push_out(np.array([0.1, 0.0, 0.2]), people)[0], [0.1, 0.0, 0.2])
    may_be_touched = among(ends, np.zeros((1, 2, 3)), np.array([0.14]), keep_m=np.array([-np.inf]))
    np.testing.assert_array_equal(guard.push_out(point, may_be_touched)[0], point)
    assert guard.push_out(point, may_be_touched)[1] == -1


def test_the_robot_s_own_clearance_is_less_what_its_parts_keep(guard: Guard) -> None:
    poses = np.vstack([YUMI.home_rad, np.linspace(YUMI.lower_rad, YUMI.upper_rad, 20)])
    found = guard.own_clearance_m(poses)
    for pose, said in zip(poses, found, strict=True):
        body, sizes = placed(pose), CAPSULES.sizes_m
        wanted = least_clearance(body, sizes, body, sizes, CAPSULES.pairs, LOOK_SELF_M) - APART_M
        assert said == pytest.approx(wanted)
    assert found.min() < 0.0 < found[0]


@pytest.mark.parametrize(("outside_m", "nearness"), [(-0.1, 1.0), (0.0, 1.0), (0.1, 0.5), (0.2, 0.0), (1.0, 0.0)])
def test_the_nearer_a_person_is_the_more_hands_may_hurry_to_meet(
    guard: Guard, outside_m: float, nearness: float
) -> None:
    assert guard.nearness(SETTINGS.near_m + outside_m) == pytest.approx(nearness)


def test_targets_near_people_are_as_fast_as_is_allowed_and_far_from_them_as_they_are(guard: Guard) -> None:
    rest = JointMotion.at_rest(tuple(YUMI.home_rad.tolist()))
    rates = np.sign(CHAIN.jacobian(YUMI.home_rad)[1])
    rates = rates * 2.0 / guard.arm_speed(YUMI.home_rad, rates, still_ball(0.2))
    to_rad = YUMI.home_rad + 0.01 * rates
    for people, crowded, most in (
        (still_ball(0.2), False, 0.85 * SETTINGS.near_speed_m_s),
        (still_ball(2.0), False, math.inf),
        (still_ball(2.0), True, 0.85 * SETTINGS.near_speed_m_s),
    ):
        paced = guard.limit_speed(YUMI.home_rad, to_rad, guard.here(rest, people), people, crowded, 0.01)
        speed = guard.arm_speed(YUMI.home_rad, (paced - YUMI.home_rad) / 0.01, people)
        assert speed == pytest.approx(min(2.0, most), rel=1e-3)
        share = (paced - YUMI.home_rad) @ rates / (0.01 * rates @ rates)
        np.testing.assert_allclose(paced, YUMI.home_rad + share * 0.01 * rates, atol=1e-12)  # straight on
