# SPDX-License-Identifier: Apache-2.0
"""Simulated people meet a robot: what is drawn, what is reachable, what counts as success, one meeting in physics."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from mild_core.retargeting.robots.yumi import YUMI
from mild_ros.benchmark.bodies import Array
from mild_ros.benchmark.encounters import SHARES, TOUCHING, Encounter, Stage, draw
from mild_ros.benchmark.jobs import EncounterJob, play, stage_for
from mild_ros.benchmark.reachable import Judge
from mild_ros.benchmark.run import TICK_S, Trace
from mild_ros.benchmark.summary import interval, judge, summarise
from mild_ros.command_line.main import main

STAGE = Stage((0.05, -0.07, 0.41), 0.8)
HOME_M = np.array([0.1, -0.3, 0.0])


@pytest.fixture(scope="module")
def judged() -> Judge:
    return Judge(YUMI)


def of_kind(kind: str) -> Encounter:
    return next(one for one in (draw(seed, STAGE) for seed in range(500)) if one.kind == kind)


def test_encounters_are_what_the_docs_say() -> None:
    drawn = [draw(seed, STAGE) for seed in range(400)]
    kinds = Counter(one.kind for one in drawn)
    for kind, share in SHARES.items():
        assert abs(kinds[kind] / len(drawn) - share) < 0.06, kind
    assert {one.side for one in drawn} == {"right", "left"}
    assert 1.05 < min(one.person.sizes.stature_m for one in drawn) < 1.15
    assert all(5.0 <= one.tracking.rate_hz <= 60.0 and 0.005 <= one.tracking.noise_m <= 0.02 for one in drawn)
    assert all(0.0099 <= np.linalg.norm(one.tracking.camera_off_m) <= 0.0301 for one in drawn)
    again = draw(7, STAGE)
    assert (again.place_m, again.timeline) == (drawn[7].place_m, drawn[7].timeline)
    for one in drawn:
        if one.offers:
            times = np.array([0.0, one.timeline.offered_s, one.timeline.offered_s + 1.0, one.timeline.back_s + 0.1])
            hand = one.performed(one.timeline).points(times)[f"{one.side}_hand"]
            assert np.linalg.norm(hand[1] - one.place_m) < 0.03
            np.testing.assert_allclose(hand[2], hand[1], atol=1e-9)
            np.testing.assert_allclose(hand[3], hand[0], atol=1e-9)


def test_what_is_reachable_is_found_without_our_solver(judged: Judge) -> None:
    encounter = of_kind("handshake")
    assert judged._jacobian(YUMI.home_rad).shape == (3, 7)
    step = 1e-6
    columns = []
    for joint in range(7):
        moved = np.eye(7)[joint] * step
        columns.append((judged.tool_m(YUMI.home_rad + moved) - judged.tool_m(YUMI.home_rad - moved)) / (2.0 * step))
    judged.tool_m(YUMI.home_rad)
    np.testing.assert_allclose(judged._jacobian(YUMI.home_rad), np.stack(columns, axis=1), atol=1e-6)
    home = judged.tool_m(YUMI.home_rad)
    far = replace(encounter.person, root=type(encounter.person.root)(((0.0, (5.0, 0.0, math.pi)),)))
    assert judged.reaches(home + 0.1, far, 0.0, 0)
    assert not judged.reaches(np.array([1.5, 0.0, 0.3]), far, 0.0, 0)
    near = replace(far, root=type(far.root)(((0.0, (float(home[0]) + 0.1, float(home[1]) + 0.1, math.pi)),)))
    assert not judged.reaches(home + 0.1, near, 0.0, 0), "a trunk is there"


def traced(encounter: Encounter, tool: Array, **changes: object) -> Trace:
    """What happened to a robot whose hand went this way (T, 3)."""
    timeline = encounter.timeline
    if changes.get("met_s") is not None:
        withdrawn = float(changes["met_s"]) + 2.0  # type: ignore[arg-type]
        timeline = replace(timeline, withdrawn_s=withdrawn, back_s=withdrawn + 0.75)
    times = np.arange(len(tool)) * TICK_S
    hand = encounter.performed(timeline).points(times)[f"{encounter.side}_hand"]
    states = ["named"] * len(tool)
    trace = Trace(timeline, hand, tool, ["following"] * len(tool), [""] * len(tool), states)
    for name, value in changes.items():
        setattr(trace, name, value)
    return trace


def goes(encounter: Encounter, leaves_s: float, there_s: float, goes_s: float, home_s: float) -> Array:
    """The robot's hand on its way to the offered one and home."""
    times = np.arange(0.0, 14.0, TICK_S)
    share = np.interp(times, [leaves_s, there_s, goes_s, home_s], [0.0, 1.0, 1.0, 0.0])
    way: Array = HOME_M + share[:, None] * (np.array(encounter.place_m) - HOME_M)
    return way


def test_a_hand_that_is_met_in_time_let_go_and_left_is_a_success() -> None:
    encounter = of_kind("handshake")
    offered = encounter.timeline.offered_s
    tool = goes(encounter, offered - 0.4, offered + 0.8, offered + 2.9, offered + 6.0)
    good = traced(encounter, tool, met_s=offered + 0.8)
    assert judge(encounter, good, True, False).causes == ()
    late = traced(encounter, goes(encounter, offered, offered + 1.9, offered + 4.0, offered + 7.0), met_s=offered + 1.9)
    assert judge(encounter, late, True, False).causes == ("met late",)
    assert judge(encounter, traced(encounter, np.tile(HOME_M, (900, 1))), True, False).causes == ("did not start",)
    assert judge(encounter, traced(encounter, np.tile(HOME_M, (900, 1))), False, False).success, "it cannot be reached"
    for change, cause in (
        ({"kept_m": 0.04}, "not safe"),
        ({"speed_m_s": 0.9}, "not safe"),
        ({"collided": True}, "not safe"),
    ):
        assert judge(encounter, traced(encounter, tool, met_s=offered + 0.8, **change), True, False).causes == (cause,)
    away = tool.copy()
    away[-1] += 0.1
    assert judge(encounter, traced(encounter, away, met_s=offered + 0.8), True, False).causes == ("not home again",)


def test_a_robot_that_holds_on_or_follows_what_it_should_not_fails() -> None:
    encounter = of_kind("withdrawn")
    hand = encounter.performed(encounter.timeline).points(np.arange(0.0, 14.0, TICK_S))[f"{encounter.side}_hand"]
    begin = int(encounter.timeline.withdrawn_s / TICK_S)
    held = np.concatenate([np.tile(HOME_M, (begin, 1)), hand[begin:]])
    held[-1] = HOME_M
    assert "did not let go" in judge(encounter, traced(encounter, held), None, False).causes
    feint = of_kind("feint")
    turned = feint.timeline.withdrawn_s
    followed = goes(feint, turned, turned + 1.2, turned + 1.5, turned + 4.0)
    assert judge(feint, traced(feint, followed), None, False).causes == ("followed a feint",)
    passing = of_kind("passer_by")
    assert judge(passing, traced(passing, np.tile(HOME_M, (600, 1))), None, False).success
    moved = judge(passing, traced(passing, goes(passing, 1.0, 2.0, 2.5, 4.0)), None, False)
    assert moved.false_start
    wave = of_kind("wave")
    away = goes(wave, 4.0, 5.0, 6.0, 8.0)
    waved = traced(wave, away, named=["hand_wave"] * len(away))
    assert judge(wave, waved, None, False).success
    shaken = traced(wave, away, named=["handshake"] * len(away))
    assert judge(wave, shaken, None, False).causes == ("took a wave for an offered hand",)


def test_shares_come_with_wilsons_interval() -> None:
    """Source: Brown, Cai and DasGupta 2001, as statsmodels.stats.proportion.proportion_confint(..., "wilson") gives."""
    assert interval(9, 10) == pytest.approx((0.5958499, 0.9821238), abs=1e-6)
    assert interval(0, 20) == pytest.approx((0.0, 0.1611252), abs=1e-6)


def test_a_hand_is_met_in_physics_and_equal_seeds_are_equal() -> None:
    """The first handshake of the seeds that a tracker sees well."""
    seed = next(
        seed
        for seed in range(300)
        if (one := draw(seed, stage_for("yumi"))).kind == "handshake"
        and one.tracking.rate_hz > 25.0
        and one.tracking.noise_m < 0.01
        and np.linalg.norm(np.subtract(one.place_m, stage_for("yumi").shoulder_m)) < 0.6
    )
    encounter, trace = play(EncounterJob("yumi", "yumi_buetepage_ahead", True, seed))
    _, again = play(EncounterJob("yumi", "yumi_buetepage_ahead", True, seed))
    np.testing.assert_array_equal(trace.tool_m, again.tool_m)
    found = judge(encounter, trace, True, True)
    assert not found.violations
    assert found.met_after_s is not None
    assert found.met_after_s < 2.5
    assert summarise([found])["met_reachable"]["share"] == 1.0
    assert encounter.interaction in TOUCHING


def test_the_command_prints_one_object_and_leaves_every_encounter(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(
        "sys.argv",
        ["mild", "benchmark", "--count", "2", "--seed", "1000", "--workers", "1", "--json", "--out", str(tmp_path)],
    )
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    found = json.loads(capsys.readouterr().out)
    assert found["encounters"] == 2
    assert {
        "success",
        "met_reachable",
        "reachable",
        "median_distance_m",
        "violations",
        "false_starts",
        "causes",
    } <= set(found)
    lines = (tmp_path / "yumi_auto.jsonl").read_text().splitlines()
    assert [json.loads(line)["seed"] for line in lines] == [1000, 1001]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--interaction", "maybe"], "--interaction: is 'maybe'; give one of auto, given"),
        (["--robot", "yumii"], "yumi"),
        (["--model", "pepper_nuisi_next"], "model pepper_nuisi_next"),
    ],
)
def test_a_wrong_set_up_is_one_line(options, said, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("sys.argv", ["mild", "benchmark", "--out", str(tmp_path), *options])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.strip().splitlines()) == 1
