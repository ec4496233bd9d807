# SPDX-License-Identifier: Apache-2.0
"""A calibration outlives the node: written whole, checked when read, remade for another person."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.perception.calibration import Calibration
from mild_core.perception.stage import Perception
from mild_ros.assembly.calibration_file import CalibrationFile
from test.core.perception.scene import SETTINGS, People, at_rate, run, seen


class Complaints:
    """Where a file says that it cannot be written."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def complain(self, about: str, detail: str = "") -> None:
        self.lines.append(f"{about}: {detail}")


@pytest.fixture(name="calibration", scope="module")
def _calibration() -> Calibration:
    state, _ = run(seen(at_rate(40.0, 1.2)))
    assert state.calibration is not None
    return state.calibration


def test_what_is_kept_is_read_again_to_the_bit(tmp_path: Path, calibration: Calibration) -> None:
    path, complaints = tmp_path / "calibration.json", Complaints()
    file = CalibrationFile(str(path))
    assert file.read() is None
    file.keep(None, complaints)
    assert not path.exists()
    file.keep(calibration, complaints)
    written = path.stat().st_mtime_ns
    file.keep(calibration, complaints)
    assert path.stat().st_mtime_ns == written
    assert [found.name for found in tmp_path.iterdir()] == ["calibration.json"]
    read = CalibrationFile(str(path)).read()
    assert read is not None
    assert read.as_mapping() == calibration.as_mapping()
    file.keep(replace(calibration, stamp_ns=7), complaints)
    assert json.loads(path.read_text())["stamp_ns"] == 7
    assert complaints.lines == []


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", "null", '{"side": "right"}', "\0", "9" * 20_000])
def test_what_is_no_calibration_is_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(text)
    with pytest.raises(SetupError) as caught:
        CalibrationFile(str(path)).read()
    assert str(caught.value).startswith(f"calibration_file {path}: ")
    assert str(caught.value).endswith("; remove it and calibrate again")
    assert "\n" not in str(caught.value)


def test_a_folder_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match=r"parameter calibration_file: .*nowhere is no folder; make it first"):
        CalibrationFile(str(tmp_path / "nowhere" / "calibration.json"))


def test_a_file_that_cannot_be_written_is_a_warning_and_leaves_nothing(
    tmp_path: Path, calibration: Calibration
) -> None:
    (tmp_path / "calibration.json").mkdir()
    complaints = Complaints()
    CalibrationFile(str(tmp_path / "calibration.json")).keep(calibration, complaints)
    assert complaints.lines == ["calibration_file: cannot be written (Is a directory)"]
    assert [found.name for found in tmp_path.iterdir()] == ["calibration.json"]


def test_a_kept_calibration_in_another_frame_is_refused(calibration: Calibration) -> None:
    with pytest.raises(SetupError, match="was made in 'depth_camera_link', but frame_id is 'other'"):
        replace(SETTINGS, calibration=calibration, frame_id="other")


def longer(people: People, factor: float) -> People:
    """A person that much taller at the same place."""
    (person,) = people
    shoulder = person.positions_m[person.joint_names.index("right_shoulder")]
    return (replace(person, positions_m=shoulder + factor * (person.positions_m - shoulder)),)


def test_another_person_calibrates_again_after_a_while(calibration: Calibration) -> None:
    settings = replace(SETTINGS, calibration=calibration)
    state, windows = run([longer(people, 1.5) for people in seen(at_rate(40.0, 8.0))], settings)
    assert "bone_length" not in state.counts
    assert state.counts["forgotten"] == 1
    assert state.calibration is not None
    assert state.calibration is not calibration
    np.testing.assert_allclose(state.calibration.bone_lengths_m, [1.5 * 0.29, 1.5 * 0.335])
    assert len(windows) == 8 * 40 - state.counts["calibrating"]
    assert state.counts["calibrating"] == 40


def test_a_reset_forgets_what_was_kept(calibration: Calibration) -> None:
    perception = Perception(replace(SETTINGS, calibration=calibration))
    messages = seen(at_rate(40.0, 2.0))
    state, windows = run(messages[:20], perception.settings)
    assert len(windows) == 20
    state, windows = run(messages[20:], perception.settings, perception.reset(state))
    assert state.counts["calibrating"] == 40
    assert len(windows) == 20
