# SPDX-License-Identifier: Apache-2.0
"""The judge of the people bench: what it must see, shown by motions and bodies of known distance and speed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.retargeting.robots import ROBOTS
from mild_ros.assembly.perception import robot_from_camera as read_camera
from mild_ros.benchmark.bodies import HANGING, KINECT_JOINTS, Person, Sizes, arm_path, capsules_of, path
from test.bench import people
from test.bench.around_people.judge import Judgement, exceeded_limits, judge, shapes_of
from test.bench.around_people.page import CLAIMS, measured_part, page
from test.bench.around_people.run import Expectation, Run, Setting, camera_text, robot_from_camera
from test.bench.around_people.scenes import SCENES
from test.bench.people import Result, verdicts

ROBOT = ROBOTS["yumi"]
TICKS = np.arange(0.0, 0.5, 0.01)


def still_run(**changes: Any) -> Run:
    """A robot that stands at home."""
    shape = (len(TICKS), len(ROBOT.joint_names))
    run = Run(TICKS, np.broadcast_to(ROBOT.home_rad, shape), np.zeros(shape), ("ready",) * len(TICKS), {})
    return replace(run, **changes)


def turning_run(rate_rad_s: float) -> Run:
    """A robot that turns its first joint at a rate."""
    positions = np.tile(ROBOT.home_rad, (len(TICKS), 1))
    positions[:, 0] += rate_rad_s * (TICKS - TICKS[-1] / 2.0)
    velocities = np.zeros_like(positions)
    velocities[:, 0] = rate_rad_s
    return still_run(positions_rad=positions, velocities_rad_s=velocities)


def person_with_head_at(place: Any, **changes: Any) -> Person:
    """An adult whose head's middle is there."""
    sizes = Sizes(1.75)
    high = sizes.length(1.0) - sizes.head_height_m / 2.0
    person = Person(sizes, path((0.0, (place[0] - 0.015, place[1], 0.0))), floor_m=place[2] - high)
    return replace(person, **changes)


@pytest.fixture
def hand_m() -> Any:
    shapes = shapes_of("yumi")
    shapes.pose(ROBOT.home_rad)
    return shapes.tool_m()


@pytest.mark.parametrize("apart_m", [0.02, 0.1])
def test_distances_are_those_of_the_bodies(apart_m: float, hand_m: Any) -> None:
    """The gripper points forward and down: a head before the fingers' tips is as far as it is put."""
    shapes = shapes_of("yumi")
    shapes.pose(ROBOT.home_rad)
    points, _ = shapes.points()
    foremost = points[points[:, 0].argmax()]
    radius = capsules_of(Sizes(1.75))[0].radius_m
    person = person_with_head_at(foremost + np.array([radius + apart_m, 0.0, 0.0]))
    found = judge(Setting((person,), 0.5), still_run())
    assert found.clearance_m["watched head"] == pytest.approx(apart_m, abs=0.01)
    assert found.still_m_s == [0.0] * 4
    other = judge(Setting((Person(Sizes(1.7), path((0.0, (3.0, 0.0, 0.0)))), person), 0.5), still_run())
    assert other.clearance_m == {"bystander head": pytest.approx(apart_m, abs=0.01)} | {
        key: value for key, value in other.clearance_m.items() if key != "bystander head"
    }
    assert all(key.startswith("bystander") for key in other.clearance_m)


def test_an_overlap_is_negative(hand_m: Any) -> None:
    found = judge(Setting((person_with_head_at(hand_m),), 0.5), still_run())
    assert found.clearance_m["watched head"] < -0.05
    (verdict,) = [each for each in verdicts([_result(found)]) if each.promise == "distance"]
    assert not verdict.kept


def test_speeds_are_taken_on_the_surface_near_people(hand_m: Any) -> None:
    """No point is faster than the rate times the distance from the axis of the one farthest from it."""
    rate = 1.5
    found = judge(Setting((person_with_head_at(hand_m + np.array([0.25, 0.0, 0.1])),), 0.5), turning_run(rate))
    shapes = shapes_of("yumi")
    shapes.pose(ROBOT.home_rad)
    state = shapes.bullet.getLinkState(shapes.body, shapes.numbers[0], physicsClientId=shapes.client)
    axis = np.array(shapes.bullet.getMatrixFromQuaternion(state[5])).reshape(3, 3)[:, 2]
    away = shapes.points()[0] - state[4]
    farthest = np.linalg.norm(np.cross(away, axis), axis=1).max()
    fastest = max(found.still_m_s)
    assert 0.5 * rate * farthest < fastest <= rate * farthest * 1.001
    assert found.moving_m_s == [0.0] * 4
    assert (found.still_over > 0) == (fastest > 0.801)


def test_who_walks_is_judged_by_their_approach(hand_m: Any) -> None:
    """A robot that does not move is never too fast; one that moves towards a runner at all is."""
    start = hand_m + np.array([0.8, 0.0, 0.1])
    runner = person_with_head_at(start)
    (_, (x, y, yaw)) = runner.root.keys[0]
    runner = replace(runner, root=path((-1.0, (x + 1.0, y, yaw)), (1.0, (x - 1.2, y, yaw)), straight=True))
    assert judge(Setting((runner,), 0.5), still_run()).towards_over == 0
    found = [judge(Setting((runner,), 0.5), turning_run(rate)) for rate in (0.8, -0.8)]
    assert max(each.towards_m_s for each in found) > 0.1
    assert max(each.moving_m_s[-1] for each in found) > 0.1


def test_the_offered_hand_may_be_touched(hand_m: Any) -> None:
    sizes = Sizes(1.75)
    base = Person(sizes, path((0.0, (hand_m[0] + 0.5, hand_m[1], np.pi))), floor_m=-1.2)
    reach = path((0.0, (*hand_m, 1.0)))
    greeting = replace(base, reach=(("right", reach),), right=arm_path((0.0, HANGING)))
    touched = judge(Setting((replace(greeting, offers="right"),), 0.5), still_run())
    assert touched.offered_m is not None
    assert touched.offered_m < 0.0 < touched.clearance_m.get("watched limbs", 1.0)
    assert judge(Setting((greeting,), 0.5), still_run()).clearance_m["watched limbs"] < 0.0


@pytest.mark.parametrize("kind", ["velocity", "acceleration", "jerk", "position", "not finite"])
def test_broken_limits_are_found(kind: str) -> None:
    times = np.arange(0.0, 0.2, 0.01)
    shape = (len(times), len(ROBOT.joint_names))
    velocities, positions = np.zeros(shape), np.tile(ROBOT.home_rad, (len(times), 1))
    if kind == "velocity":
        velocities[:, 0] = 1.05 * ROBOT.velocity_rad_s[0]
    elif kind == "acceleration":
        velocities[:, 0] = 1.05 * ROBOT.acceleration_rad_s2[0] * (times - 0.1)
    elif kind == "jerk":
        velocities[:, 0] = 0.5 * 1.05 * ROBOT.jerk_rad_s3[0] * (times - 0.1) ** 2
    positions[:, 0] += np.cumsum(velocities[:, 0]) * 0.01
    if kind == "position":
        positions[:, 1] = ROBOT.upper_rad[1] + 0.01
    elif kind == "not finite":
        positions[3, 2] = np.nan
    run = Run(times, positions, velocities, ("following",) * len(times), {})
    assert any(kind in each for each in exceeded_limits("yumi", run))
    assert exceeded_limits("yumi", still_run()) == []


def test_people_have_rigid_bones_and_all_joints() -> None:
    person = SCENES["bend"].make(np.random.default_rng(0)).people[0]
    points = person.points(np.linspace(0.0, 10.0, 50))
    assert set(KINECT_JOINTS) <= set(points)
    for capsule in capsules_of(person.sizes):
        lengths = np.linalg.norm(points[capsule.end] - points[capsule.start], axis=1)
        assert np.ptp(lengths) < 1e-9, capsule
    standing = replace(person, lean=path((0.0, (0.0,)))).points(np.zeros(1))
    top = standing["head"][0, 2] + person.sizes.head_height_m / 2.0
    assert top - person.floor_m == pytest.approx(person.sizes.stature_m, abs=0.02)


def test_the_camera_is_the_one_of_the_parameter() -> None:
    found = read_camera(camera_text())
    assert found is not None
    np.testing.assert_allclose(found, robot_from_camera(), atol=1e-8)


def test_every_scene_is_part_of_a_claim_and_of_the_page() -> None:
    claimed = {name for claim in CLAIMS if claim.promise in ("distance", "start") for name in claim.scenes}
    assert claimed <= set(SCENES)
    assert set(SCENES) - claimed == {"lunge"}  # faster than the arm: only its speeds are judged
    results = [_result(Judgement(clearance_m={"watched head": 0.041}, commands=10), "bend")]
    text = page("a\n<!-- measured: people -->\nold\n<!-- end -->\nb\n", results)
    assert text == f"a\n<!-- measured: people -->\n{measured_part(results)}<!-- end -->\nb\n"
    assert "4.1 cm" in text
    with pytest.raises(SetupError, match="0 places"):
        page("nothing", results)


def test_a_second_call_goes_on_where_the_first_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done: list[tuple[str, int]] = []

    def one(job: tuple[str, int]) -> Result:
        done.append(job)
        return replace(_result(Judgement(clearance_m={"watched head": 0.2}, commands=3), job[0]), seed=job[1])

    monkeypatch.setattr(people, "run_one", one)
    kept = ["--scene", "bend", "lunge", "--jobs", "1", "--json", str(tmp_path / "kept.json")]
    assert people.main([*kept, "--count", "1"]) == 0
    assert people.main([*kept, "--count", "2"]) == 0
    assert done == [("bend", 0), ("lunge", 0), ("bend", 1), ("lunge", 1)]
    assert "4 runs of 2 scenes" in capsys.readouterr().out
    monkeypatch.setattr(people, "code_digest", lambda: "another")
    assert people.main([*kept, "--count", "1"]) == 0
    assert len(done) == 6
    (tmp_path / "kept.json").write_text("[]")
    assert people.main(kept) == 2
    assert people.main(["--scene", "bendd"]) == 2
    assert "did you mean 'bend'" in capsys.readouterr().err


def _result(judgement: Judgement, scene: str = "handshake") -> Result:
    for kind in judgement.clearance_m:
        judgement.clearance_at.setdefault(kind, "")
    return Result(scene, 0, Expectation(), judgement, 0.0)
