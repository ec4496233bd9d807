# SPDX-License-Identifier: Apache-2.0
"""What perception makes of real recordings: `./mild measure perception_figures`.

The table is the one in `docs/trackers.md`, and a test holds it to that.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from mild_core.errors import SetupError
from mild_core.perception.skeletons import SOURCES
from mild_core.perception.stage import Perception, PerceptionSettings
from mild_core.signals import SkeletonFrame
from mild_ros.bag.reader import open_bag
from mild_ros.messages.skeletons import people_from_msg
from test.core.perception import nuitrack_raw

SETTINGS = PerceptionSettings(
    joint_names=("shoulder", "elbow", "hand"), bone_lengths_m=(0.18, 0.234), rate_hz=40.0, window=40
)
HEADING = (
    "| Recording | Messages | Calibrating | Used | Not used, by reason | Windows at 40 Hz | of these filled | Gaps |\n"
    "|---|---:|---:|---:|---|---:|---:|---:|\n"
)
_CALIBRATING = ("calibrating", "moving", "interrupted")
_EVENTS = {
    *("windows", "filled", "missed", "gap_reset", "time_reset", "calibrated"),
    *("reacquired", "forgotten", "bystanders"),
}

Messages = Iterable[tuple[int, tuple[SkeletonFrame, ...]]]


def counts(messages: Messages, **settings: Any) -> Mapping[str, int]:
    """Outcomes and events of perception over a recording."""
    perception = Perception(replace(SETTINGS, **settings))
    state = perception.init()
    for now_ns, people in messages:
        state, _ = perception.step(state, people, now_ns)
    return state.counts


def azure_kinect(bags: Path) -> Messages:
    """Of the real bag."""
    source = SOURCES["azure_kinect"]
    with open_bag(bags / "azure_kinect_body_tracking") as bag:
        for raw in bag.messages(["/kinect2/body_tracking_data"]):
            yield raw.time_ns, people_from_msg(bag.decode(raw), source, raw.time_ns)


def row(name: str, counted: Mapping[str, int]) -> str:
    """A line of the table."""
    outcomes = {reason: number for reason, number in counted.items() if reason not in _EVENTS}
    calibrating = sum(outcomes.pop(reason, 0) for reason in _CALIBRATING)
    used, total = outcomes.pop("accepted", 0), sum(outcomes.values())
    refused = ", ".join(f"{number} {reason.replace('_', ' ')}" for reason, number in sorted(outcomes.items())) or "none"
    windows, filled, gaps = (counted.get(event, 0) for event in ("windows", "filled", "gap_reset"))
    cells = (name, total + used + calibrating, calibrating, used, refused, windows, filled, gaps)
    return "| " + " | ".join(map(str, cells)) + " |\n"


def table(data: Path, bags: Path) -> str:
    """The whole table."""
    rows = [row("Azure Kinect, at work", counts(azure_kinect(bags), source_axes="optical"))]
    for number in (1, 2):
        recorded = nuitrack_raw.read(data / "nuisi_raw" / f"Rocket_p{number}.txt")
        for side in ("right", "left"):
            found = counts(recorded, source_axes="rep103", side=side)
            rows.append(row(f"Nuitrack SDK, person {number}, {side} arm", found))
        published = counts(nuitrack_raw.as_published(recorded), source_axes="optical")
        rows.append(row(f"the same by its node, person {number}, right arm", published))
    return HEADING + "".join(rows)


def main() -> None:
    """Print the table."""
    shared = Path(__file__).resolve().parents[3] / "shared"
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    data, bags = (Path(os.environ.get(f"MILD_{kind.upper()}", shared / kind)) for kind in ("data", "bags"))
    parser.add_argument("--data", type=Path, default=data, help="recordings, with nuisi_raw")
    parser.add_argument("--bags", type=Path, default=bags, help="real bags, with azure_kinect_body_tracking")
    given = parser.parse_args()
    for folder in (given.data, given.bags):
        if not folder.is_dir():
            raise SetupError(str(folder), "no such folder", "name the recordings by --data and the bags by --bags")
    print(table(given.data, given.bags))


if __name__ == "__main__":
    main()
