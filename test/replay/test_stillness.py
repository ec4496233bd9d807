# SPDX-License-Identifier: Apache-2.0
"""A run in which the robot never moved says why, with a remedy that works; no count in a report is negative."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mild_core.errors import BagError
from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_core.retargeting.robots.yumi import YUMI
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.bag.encoding import encode
from mild_ros.bag.people import source_fault
from mild_ros.bag.reader import open_bag
from mild_ros.bag.writer import create_bag
from mild_ros.command_line.main import main
from mild_ros.command_line.results import _lines
from mild_ros.messages.handled import Handled
from mild_ros.messages.standard import Marker, MarkerArray
from mild_ros.replay.recorded import JointTrack, RecordedRun, read_run
from mild_ros.viewing.report import make_report
from mild_ros.viewing.stillness import counts_of, has_moved, why_still
from test.replay.made_model import save_random_model
from test.replay.test_inputs import HAND, START_NS, Transforms, tracked, transform

AUTO = PipelineParameters()
AZURE, NUITRACK = SOURCES["azure_kinect"], SOURCES["nuitrack"]
MARKERS = "visualization_msgs/msg/MarkerArray"


def in_time(index: int, time_ns: int) -> int:
    return time_ns


def run(path: Path, **values: object) -> RecordedRun:
    nothing: dict[str, object] = dict.fromkeys(("commands", "measured", "truth"))
    return RecordedRun(path, (), np.arange(343), **{**nothing, "motions": (), **values})  # type: ignore[arg-type]


def commanded(*positions: float) -> JointTrack:
    rows = np.tile(np.array(positions)[:, None], 7)
    stamps = np.arange(len(positions)) * 10**7
    return JointTrack(YUMI.joint_names, stamps, stamps, rows, np.zeros_like(rows))


def test_a_robot_that_trembles_at_home_has_not_moved() -> None:
    assert not has_moved(None)
    assert not has_moved(commanded(0.1, 0.1, 0.1001))
    assert has_moved(commanded(0.1, 0.11, 0.1))


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        ({"messages": {"undecodable": 347}}, "never calibrated: 347 messages were 'undecodable'"),
        ({"perception": {"calibrating": 14, "unknown_frame": 317}}, "317 messages were 'unknown_frame' (the detail)"),
        ({"perception": {"calibrating": 14}}, "never calibrated: 14 messages were 'calibrating'"),
        ({"perception": {"no_person": 60}}, "60 messages were 'no_person'"),
        ({"perception": {"calibrated": 1, "accepted": 3}}, "too shortly for a prediction"),
        (
            {
                "perception": {"calibrated": 1, "accepted": 317},
                "inference": {"accepted": 400},
                "retargeting": {"too_old": 390, "accepted": 2},
            },
            "390 predictions were 'too_old'",
        ),
        (
            {"perception": {"calibrated": 1, "accepted": 317}, "inference": {"accepted": 400}, "retargeting": {}},
            "the robot published no joint states",
        ),
    ],
)
def test_the_stage_at_which_the_person_was_lost_is_named(
    tmp_path: Path, counts: dict[str, dict[str, int]], words: str
) -> None:
    why, remedy = why_still(run(tracked(tmp_path / "bag", in_time)), AZURE, counts, AUTO, "the detail")
    assert words in why
    assert remedy


def test_what_nodes_counted_is_read_from_their_newest_diagnostics(tmp_path: Path) -> None:
    status = {"perception accepted": "3", "retargeting too_old": "7", "step p99 [ms]": "1", "mode": "idle"}
    counts = counts_of(run(tmp_path, diagnostics={"pipeline": [{"perception accepted": "1"}, status]}))
    assert counts == {"perception": Counter(accepted=3), "inference": Counter(), "retargeting": Counter(too_old=7)}


def test_a_person_who_rests_is_no_fault_of_the_source(tmp_path: Path) -> None:
    counts = {
        "perception": {"calibrated": 1, "accepted": 317},
        "inference": {"accepted": 400},
        "retargeting": {"accepted": 390},
    }
    bag = tracked(tmp_path / "bag", in_time)
    still = run(bag, commands=commanded(0.1, 0.1))
    assert "the right hand rested all the time" in why_still(still, AZURE, counts, AUTO)[0]
    counts["retargeting"] = {"accepted": 200, "unknown": 190}
    assert "rested" in why_still(still, AZURE, counts, AUTO)[0], "a hand at rest is of no interaction either"
    named = replace(AUTO, interaction="handshake", side="left")
    assert why_still(still, AZURE, counts, named)[1].endswith("if the other one is, add -p side:=right")
    performing = run(bag, commands=commanded(0.1, 0.1), motions=(SimpleNamespace(state="none"),))
    assert "none of the model's" in why_still(performing, AZURE, counts, AUTO)[0]
    assert why_still(run(bag), AZURE, counts, replace(AUTO, enabled=False))[0] == "it was not enabled"


@pytest.mark.parametrize(
    ("perceived", "retargeted", "words", "more"),
    [
        ({}, {"start_too_far": 1, "start_undecided": 1}, "raised too far away", "start_hand_m"),
        ({}, {"start_turned_away": 1}, "does not face the robot", "start_facing_deg"),
        ({}, {"start_at_head": 1}, "own head", "held out"),
        ({}, {"start_aside": 1}, "went aside", "held out"),
        ({}, {"start_undecided": 1}, "no interaction was recognised", "--interaction"),
        ({}, {"refused_keep_out": 80, "refused_speed": 2}, "80 commands were 'refused_keep_out'", "diagnostics.md"),
        ({"no_person": 330}, {}, "330 messages were 'no_person', 317 were accepted", "stay in view"),
        ({"no_person": 300}, {}, "the right hand rested", "-p side:=left"),
    ],
)
def test_a_hand_that_is_raised_in_vain_is_none_that_rests(
    tmp_path: Path, perceived: dict[str, int], retargeted: dict[str, int], words: str, more: str
) -> None:
    counts = {
        "perception": {"calibrated": 1, "accepted": 317, **perceived},
        "inference": {"accepted": 400},
        "retargeting": {"accepted": 390, **retargeted},
    }
    still = run(tracked(tmp_path / "bag", in_time), commands=commanded(0.1, 0.1))
    why, remedy = why_still(still, AZURE, counts, AUTO)
    assert words in why
    assert more in remedy
    # What a remedy names can be set.
    for name in re.findall(r"start_\w+|robot_from_camera", remedy):
        assert hasattr(AUTO, name)


def test_evidence_that_was_set_too_high_is_what_to_lower(tmp_path: Path) -> None:
    counts = {
        "perception": {"calibrated": 1, "accepted": 317},
        "inference": {"accepted": 400},
        "retargeting": {"accepted": 390, "start_undecided": 1},
    }
    still = run(tracked(tmp_path / "bag", in_time), commands=commanded(0.1, 0.1))
    for parameters in (replace(AUTO, start_evidence=0.9), replace(AUTO, interaction="handshake")):
        assert why_still(still, AZURE, counts, parameters)[1] == "lower start_evidence"


def write_markers(bag: Path, *ids: int) -> Path:
    with create_bag(bag) as writer:
        for index in range(10):
            data = encode(MarkerArray(markers=[Marker(id=number) for number in ids]))
            writer.write("/people", MARKERS, START_NS + index * 10**7, data)
    return bag


def write_transforms(bag: Path) -> Path:
    with create_bag(bag) as writer:
        data = encode(Transforms(transforms=[transform("camera", "hand_1")]))
        writer.write("/tf", "tf2_msgs/msg/TFMessage", START_NS, data)
    return bag


def write_no_rotations(bag: Path) -> Path:
    """A good static transform, and people whose joints are none."""
    with create_bag(bag) as writer:
        good = Transforms(transforms=[transform("map", "camera")])
        writer.write("/tf_static", "tf2_msgs/msg/TFMessage", START_NS, encode(good))
        wrong = [transform("camera", name, q=(0.0, 0.0, 0.0, 0.0)) for name in ("hand_1", "hips_1")]
        writer.write("/tf", "tf2_msgs/msg/TFMessage", START_NS + 1, encode(Transforms(transforms=wrong)))
    return bag


@pytest.mark.parametrize(
    ("write", "source", "words"),
    [
        (
            lambda bag: write_markers(bag, *range(100, 132)),
            NUITRACK,
            "nuitrack has 0 to 26.*set source to azure_kinect",
        ),
        (lambda bag: write_markers(bag, *range(100, 132)), SOURCES["zed"], "is it /people. Then set source to azure_k"),
        (write_transforms, HAND, "/tf has no hips_{}, but hand_1.*name the frames in joint_places"),
        (write_no_rotations, HAND, "not_a_transform.*length 0, not 1.*record it again, once what publishes them"),
    ],
    ids=["numbers", "type", "frames", "rotations"],
)
def test_the_advice_is_that_of_the_live_check(
    tmp_path: Path, write: Callable[[Path], Path], source: SkeletonSource, words: str
) -> None:
    with pytest.raises(BagError, match=words) as caught:
        read_run(write(tmp_path / "bag"), source)
    followed = re.search("set source to ([a-z_]+)", str(caught.value))
    if followed:
        with open_bag(tmp_path / "bag") as bag:
            assert source_fault(bag, SOURCES[followed[1]]) == ("", "")


def test_a_bag_of_another_source_is_refused_before_anything_is_replayed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_markers(tmp_path / "bag", *range(100, 132))
    with pytest.raises(SystemExit, match="2"):
        main(["replay", str(bag), "--source", "nuitrack", "--out", str(tmp_path / "out")])
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("set source to azure_kinect")


def test_the_last_line_says_why_the_robot_never_moved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = save_random_model(tmp_path / "random")
    bag = tracked(tmp_path / "bag", in_time)
    with pytest.raises(SystemExit, match="2"):
        main(["replay", str(bag), "--model", str(model), "--out", str(tmp_path / "out")])
    out, err = capsys.readouterr()
    assert err.splitlines()[-1].startswith("mild: replay: the robot never moved: the person was never calibrated: ")
    assert "unknown" in out
    assert "no command" not in out, "commands were sent, and their age is unknown in this process"


@pytest.mark.parametrize(("seen", "lost", "unrecorded"), [(275, 68, 0), (347, 0, 4), (343, 0, 0)])
def test_no_count_is_negative(tmp_path: Path, seen: int, lost: int, unrecorded: int) -> None:
    outcomes = tuple(Handled("pipeline", 0, "accepted", index) for index in range(seen))
    report = make_report(run(tmp_path, outcomes=outcomes), YUMI)
    assert (report.dropped, report.unrecorded) == (lost, unrecorded)
    assert (("seen, but not recorded", "4") in _lines(report)) is (unrecorded > 0)
