# SPDX-License-Identifier: Apache-2.0
"""Two real Nuitrack streams, whole, and the table of figures that all real recordings gave."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mild_core.perception.skeletons import SOURCES
from mild_core.signals import SkeletonFrame
from mild_ros.messages.skeletons import people_from_msg
from test.bench.perception_figures import counts, table
from test.core.perception.nuitrack_raw import Recorded, as_published, read
from test.core.perception.scene import SETTINGS, newest_arms, run
from test.habits.tree import ROOT
from test.ros.driver_messages import DRIVERS


@pytest.fixture(name="recorded", params=[1, 2])
def _recorded(mild_data: Path, request: pytest.FixtureRequest) -> Recorded:
    path = mild_data / "nuisi_raw" / f"Rocket_p{request.param}.txt"
    if not path.is_file():
        pytest.skip(f"no raw Nuitrack stream: {path} is no file")
    return read(path)


def test_every_line_is_accounted_for_and_the_right_arm_nearly_always_used(recorded: Recorded) -> None:
    counted = counts(recorded, source_axes="rep103")
    assert counted["calibrated"] == 1
    assert counted["accepted"] > 0.97 * len(recorded)
    assert counted["missed"] == 12  # never came: a pause of 1.2 s after the first line
    outcomes = ("no_person", "calibrating", "accepted", "low_confidence")
    assert sum(counted.get(outcome, 0) for outcome in outcomes) == len(recorded) == 1820


def test_the_person_faces_the_camera_and_is_no_mirror_image(recorded: Recorded) -> None:
    people = [people for _, people in recorded if people][:60]
    state, windows = run(people, replace(SETTINGS, source_axes="rep103"))
    assert state.calibration is not None
    forward, _, up = state.calibration.arm_from_source
    assert forward[0] < -0.9  # towards the camera, which looks along x
    assert up[2] > 0.9
    mean = newest_arms(windows).mean(axis=0)
    assert mean[2, 2] < mean[0, 2] - 0.2  # the hand hangs


def left_handed(people: tuple[SkeletonFrame, ...]) -> tuple[SkeletonFrame, ...]:
    (person,) = people
    turned = person.positions_m * np.array([-1.0, 1.0, 1.0])
    return (SkeletonFrame(person.stamp_ns, "nuitrack", 0, person.joint_names, turned, person.confidence),)


def test_left_handed_axes_are_noticed_without_nose_and_toes(recorded: Recorded) -> None:
    wrong = [left_handed(people) for _, people in as_published(recorded)[:60]]
    state, windows = run(wrong)
    assert (state.outcome, windows) == ("mirrored", [])
    assert "left-handed axes" in state.detail


def test_the_nodes_markers_hold_what_it_saw(recorded: Recorded) -> None:
    for stamp_ns, (person,) in as_published(recorded)[::100]:
        ((_, message),) = DRIVERS["nuitrack"].messages(person)
        (read_again,) = people_from_msg(message, SOURCES["nuitrack"], 0)
        assert (read_again.stamp_ns, read_again.joint_names) == (stamp_ns, person.joint_names)
        np.testing.assert_array_equal(read_again.positions_m, person.positions_m)


def test_the_figures_in_the_documents_are_so(mild_data: Path, shared_bags: Path) -> None:
    if not (mild_data / "nuisi_raw").is_dir() or not (shared_bags / "azure_kinect_body_tracking").is_dir():
        pytest.skip("not all of the real recordings are here")
    assert table(mild_data, shared_bags) in (ROOT / "docs" / "trackers.md").read_text(), (
        "run: ./mild measure perception_figures"
    )
