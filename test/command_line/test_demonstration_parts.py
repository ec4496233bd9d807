# SPDX-License-Identifier: Apache-2.0
"""Clocks, grids and labels of recorded demonstrations, each by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.signals import JointMeasurement
from mild_ros.bag.tracker_clock import Clock, judge_clock
from mild_ros.command_line.cutting import bag_names
from mild_ros.demonstrations.labels import (
    UNLABELLED,
    UNUSABLE,
    UNWANTED,
    bag_labels,
    cleaned,
    for_all,
    label_each,
    spans_said,
)
from mild_ros.demonstrations.settings import DemonstrationSettings, read_settings
from mild_ros.demonstrations.tracks import joints_on_grid, on_grid

S = 10**9
RECEIVED = [START + index * S // 30 for START in (1_700_000_000 * S,) for index in range(300)]
KEPT = Clock(0)


def stamps(delay_s: float, jitter_s: float = 0.0) -> list[int]:
    late = delay_s + np.random.default_rng(0).normal(0.0, jitter_s, len(RECEIVED))
    return [received - round(delay * S) for received, delay in zip(RECEIVED, late, strict=True)]


@pytest.mark.parametrize("delay_s", [0.0, 0.03, 0.8])
def test_stamps_of_the_recorders_clock_stay(delay_s: float) -> None:
    assert judge_clock("it", RECEIVED, stamps(delay_s, 0.01), "auto") == KEPT


@pytest.mark.parametrize("delay_s", [-5.0, 3.0, 1_700_000_000.0])
def test_stamps_of_another_clock_are_moved_by_their_typical_delay(delay_s: float) -> None:
    clock = judge_clock("it", RECEIVED, stamps(delay_s, 0.01), "auto")
    assert "off the recorder's: moved" in clock.note
    moved = [clock.time_ns(stamp, got) for stamp, got in zip(stamps(delay_s), RECEIVED, strict=True)]
    # The median of 300 delays that differ by 10 ms.
    assert np.abs(np.subtract(moved, RECEIVED)).max() < 0.005 * S


def test_stamps_that_jump_about_and_none_give_way_to_receipts() -> None:
    clock = judge_clock("it", RECEIVED, stamps(0.0, 10.0), "auto")
    assert clock.shift_ns is None
    assert "jump about" in clock.note
    assert clock.time_ns(5, 7) == 7
    assert judge_clock("it", RECEIVED, [0] * len(RECEIVED), "auto") == Clock(None)
    assert judge_clock("it", [], [], "auto") == Clock(None)


def test_a_choice_is_obeyed() -> None:
    assert judge_clock("it", RECEIVED, stamps(-5.0), "header") == KEPT
    assert judge_clock("it", RECEIVED, stamps(0.0), "bag") == Clock(None)


def test_between_two_values_lies_the_line_and_in_a_gap_nothing() -> None:
    grid = np.arange(-1, 8) * S
    values = on_grid(grid, np.array([0, 2, 6]) * S, np.array([[0.0, 0.0], [2.0, 4.0], [6.0, 4.0]]), 2.5)
    np.testing.assert_array_equal(values[:, 0], [np.nan, 0, 1, 2, np.nan, np.nan, np.nan, np.nan, np.nan])
    np.testing.assert_array_equal(values[1:4, 1], [0, 2, 4])
    assert np.isnan(on_grid(grid, np.array([0]), np.zeros((1, 2)), 2.5)).all()


def test_joints_may_come_in_parts_in_any_order_twice_and_backwards_in_time() -> None:
    grid = np.arange(0, 5) * S
    published = [(("b", "x"), (10.0 * t, -1.0), t) for t in (0, 4, 2, 3, 1, 1)] + [(("a",), (t,), t) for t in range(5)]
    measured = [(0, JointMeasurement(t * S + 1, names, np.array(values))) for names, values, t in published]
    joints = joints_on_grid(grid + 1, measured, ("a", "b"), KEPT, 1.5)
    np.testing.assert_allclose(joints, np.outer(range(5), [1, 10]), atol=1e-12)
    with pytest.raises(SetupError, match=r"joint c: has a position in no message; there are a, b, x; give the names"):
        joints_on_grid(grid, measured, ("a", "c"), KEPT, 1.5)


def test_a_movement_shows_what_went_on_for_most_of_it() -> None:
    said = spans_said([(1.0, "shake"), (10.0, "wave"), (20.0, ""), (30.0, "shake")])
    movements = [(0.2, 0.8), (0.5, 5.0), (9.5, 14.0), (22.0, 25.0), (40.0, 50.0)]
    assert label_each("x", said, movements) == ["", "shake", "wave", "", "shake"]
    assert label_each("x", for_all("wave"), movements) == ["wave"] * 5
    assert label_each("x", spans_said([]), movements) == [""] * 5
    published = bag_labels(
        "x", [{"from_s": 0, "to_s": 6, "interaction": "a"}, {"from_s": 6, "to_s": 99, "interaction": "b"}]
    )
    assert label_each("x", published, movements) == ["a", "a", "b", "b", "b"]
    assert label_each("x", bag_labels("x", ["a", "", "b"]), movements[:3]) == ["a", "", "b"]


@pytest.mark.parametrize(
    "said",
    [3, [3], [{"from_s": 1}], [{"from_s": 2, "to_s": 1, "interaction": "a"}], [{"from_s": "a", "to_s": 1}], ["a", 1]],
)
def test_labels_that_say_nothing_are_refused(said: object) -> None:
    with pytest.raises(SetupError, match="give a text, a list of texts, or a list of"):
        bag_labels("labels", said)


def test_labels_become_names() -> None:
    assert cleaned(" hand  wave ") == ("hand_wave", "")
    assert cleaned(" ") == ("", UNLABELLED)
    assert cleaned("a/b") == cleaned("x" * 61) == ("", UNUSABLE)
    assert cleaned("wave", ("shake",)) == ("wave", UNWANTED)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("label = 3", "key 'label': is 3; give a text"),
        ("swap = 1", "key 'swap': is 1; give true or false"),
        ("touching = 'a'", "key 'touching': is 'a'; give a list"),
        ("person = 3", r"key 'person': is 3; write it as \[person\]"),
        ("[cut]\nrate_hz = 1.0", "key 'cut', parameter rate_hz: is 1 Hz; give a value in 5"),
        ("[person]\nsauce = 1", "key 'person', parameter: 'sauce' is unknown; did you mean 'source'"),
        ("label = ", "is no TOML"),
    ],
)
def test_a_wrong_file_is_named_in_one_line(tmp_path, text: str, said: str) -> None:
    (tmp_path / "cut.toml").write_text(text)
    with pytest.raises(SetupError, match=said):
        read_settings(tmp_path / "cut.toml")
    assert read_settings(None) == DemonstrationSettings()


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["one", "two"], ["one", "two"]),
        (["monday/recorded", "tuesday/recorded", "handshake"], ["monday_recorded", "tuesday_recorded", "handshake"]),
        (["a/x/recorded", "b/x/recorded"], ["a_x_recorded", "b_x_recorded"]),
        (["take 1.5", "take 1.6"], ["take 1.5", "take 1.6"]),
        (["monday/take.mcap", "tuesday/take.mcap"], ["monday_take", "tuesday_take"]),
        (["a/b_c", "a_b/c", "x/b_c", "x/c"], ["a_b_c_1", "a_b_c_2", "x_b_c_3", "x_c_4"]),
    ],
)
def test_bags_of_one_name_are_distinguished_by_the_folders_above(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, paths: list[str], names: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for path in map(Path, paths):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".mcap":
            path.touch()
        else:
            path.mkdir()
    assert bag_names([Path(path) for path in paths]) == names
    with pytest.raises(SetupError, match="is given twice"):
        bag_names([Path(paths[0]), tmp_path / paths[0]])
