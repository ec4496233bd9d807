# SPDX-License-Identifier: Apache-2.0
"""Everything that may go wrong goes wrong, to the same real processes over DDS: they survive it, and it is counted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mild_ros.environment.processes import private_domain
from test.faults.fault_bench import ROBOT, FaultBench
from test.faults.judge import Command, problems
from test.faults.page import row_start
from test.faults.table import FAULTS, Fault
from test.faults.trial import complaints, rest_after_s, running_room, tried, turned_rad
from test.habits.tree import ROOT

STEP_NS = 10_000_000

LOGGED = [f"perception {reason}" for reason in ("missing_joint", "not_finite", "zeroed", "out_of_range", "mirrored")]
"""What cannot be used is also reported in the log of the node, with its detail."""


@pytest.fixture(scope="module")
def replayed_room(tmp_path_factory: pytest.TempPathFactory, ros_domain: int) -> Iterator[FaultBench]:
    """Processes that go on from fault to fault: that they need no restart is shown by the next one."""
    with private_domain() as domain, running_room(False, tmp_path_factory.mktemp("replayed"), domain) as room:
        yield room


@pytest.fixture(scope="module")
def live_room(tmp_path_factory: pytest.TempPathFactory, ros_domain: int) -> Iterator[FaultBench]:
    with private_domain() as domain, running_room(True, tmp_path_factory.mktemp("live"), domain) as room:
        yield room


def check_survived(room: FaultBench, fault: Fault) -> None:
    """Assert that nothing went wrong, and that a person was there to see it."""
    outcome = tried(room, fault)
    assert outcome.wrong == (), outcome
    # 25 in half a second; while a process stands still there are none.
    assert outcome.commands > 25


@pytest.mark.slow
@pytest.mark.parametrize("name", [fault.name for fault in FAULTS.values() if not fault.live])
def test_a_fault_of_messages_is_survived_and_counted(replayed_room: FaultBench, name: str) -> None:
    check_survived(replayed_room, FAULTS[name])
    if FAULTS[name].counted[0] in LOGGED:
        assert replayed_room.has_said("pipeline", f"{FAULTS[name].counted[0]}: ")


@pytest.mark.slow
def test_what_is_not_survived_is_reported(replayed_room: FaultBench) -> None:
    planted = replace(FAULTS["repetitions"], answer="rests", counted=("perception not_finite",))
    wrong = tried(replayed_room, planted).wrong
    assert wrong[0] == "perception not_finite was not counted"
    assert wrong[1].startswith("no rest within 1 s")
    assert len(wrong) == 2


@pytest.mark.slow
def test_another_reason_to_stop_is_reported(replayed_room: FaultBench) -> None:
    outcome = tried(replayed_room, replace(FAULTS["robot NaN"], counted=("perception not_finite",)))
    assert outcome.wrong == ("perception not_finite was not counted",)
    assert outcome.stopped_by == ("retargeting robot_silent",)


@pytest.mark.slow
@pytest.mark.parametrize("name", [fault.name for fault in FAULTS.values() if fault.live])
def test_a_fault_in_real_time_is_survived_and_counted(live_room: FaultBench, name: str) -> None:
    check_survived(live_room, FAULTS[name])


def turning(rad_s: float, count: int = 130) -> list[Command]:
    """Commands of a robot whose first joint turns at a constant speed."""
    rates = (rad_s, *(0.0,) * (len(ROBOT.joint_names) - 1))
    return [Command(tick * STEP_NS, (rad_s * tick * STEP_NS * 1e-9, *rates[1:]), rates) for tick in range(1, 1 + count)]


@pytest.mark.parametrize(
    ("rad_s", "hindered", "reported"), [(0.0, True, 1), (0.25, True, 1), (0.25, False, 1), (0.4, True, 0)]
)
def test_an_arm_that_stays_where_it_is_has_not_given_way(rad_s: float, hindered: bool, reported: int) -> None:
    put_rad = np.array([0.8, *[0.0] * (len(ROBOT.joint_names) - 1)])
    found = list(complaints(FAULTS["pushed"], turning(rad_s), 0.4, put_rad, hindered=hindered))
    assert found == ["the robot does not go where it was put"] * reported


@pytest.mark.parametrize(("rad_s", "rests"), [(0.0, True), (0.9, True), (1.5, False)])
def test_an_arm_that_goes_on_has_not_given_way(rad_s: float, rests: bool) -> None:
    commands = turning(rad_s)
    rest_s = rest_after_s("rests", commands, 0, round(0.5e9), turned_rad(commands[80:]))
    assert rest_s is not None
    assert (rest_s <= 0.5) is rests
    assert list(complaints(FAULTS["NaN"], (), rest_s, np.zeros(7), hindered=True)) == (
        [] if rests else ["no rest within 1 s but after 1.30 s"]
    )


def smooth() -> list[Command]:
    """A hundred commands of a joint that swings slowly, the others at home."""
    times = np.arange(100) * STEP_NS * 1e-9
    positions, velocities = np.tile(ROBOT.home_rad, (100, 1)), np.zeros((100, 7))
    positions[:, 0] += 0.1 * np.sin(2.0 * times)
    velocities[:, 0] = 0.2 * np.cos(2.0 * times)
    rows = zip(positions.tolist(), velocities.tolist(), strict=True)
    return [Command(place * STEP_NS, tuple(at), tuple(going)) for place, (at, going) in enumerate(rows, start=1)]


def spoilt(place: int, joint: int, shift_rad: float) -> list[Command]:
    """The same with one position wrong."""
    commands = smooth()
    positions = list(commands[place].positions_rad)
    positions[joint] += shift_rad
    commands[place] = commands[place]._replace(positions_rad=tuple(positions))
    return commands


def later(commands: list[Command], shift_ns: int) -> list[Command]:
    return [command._replace(stamp_ns=command.stamp_ns + shift_ns) for command in commands]


def test_commands_inside_the_limits_pass() -> None:
    commands = smooth()
    assert problems(ROBOT, commands) == []
    assert problems(ROBOT, commands[:50] + later(commands[50:], -300_000_000)) == []


@pytest.mark.parametrize(
    ("problem", "commands"),
    [
        ("the limit of position", spoilt(-1, 3, 5.0)),
        ("the limit of jerk", spoilt(50, 0, 1e-3)),
        ("a command is not finite", spoilt(50, 0, np.nan)),
        ("stamp is not later", [smooth()[0], *smooth()]),
        ("one position and one velocity", [command._replace(velocities_rad_s=()) for command in smooth()]),
        ("a command jumps", smooth()[:50] + later(spoilt(50, 0, 1.0)[50:], -300_000_000)),
        ("begins at speed", smooth()[:50] + later(smooth()[50:], 400_000_000)),
    ],
)
def test_commands_outside_the_limits_are_reported(problem: str, commands: list[Command]) -> None:
    assert any(problem in line for line in problems(ROBOT, commands))


def test_every_fault_stands_on_the_page() -> None:
    rows = [line for line in Path(ROOT, "docs", "faults.md").read_text().splitlines() if line.startswith("| ")]
    assert len(rows) == len(FAULTS) + 1
    for fault, row in zip(FAULTS.values(), rows[1:], strict=True):
        assert row.startswith(row_start(fault))
        assert all(f"`{key}`" in row for key in fault.counted)
