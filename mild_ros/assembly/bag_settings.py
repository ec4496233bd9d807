# SPDX-License-Identifier: Apache-2.0
"""What may be set of the nodes that write and read bags."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.parameters import parameter
from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_ros.assembly.tracker_settings import TrackerParameters

FIRST_HEARD = "first message on {}"
"""What the recorder logs of a topic, for a process that waits for it."""


@dataclass(frozen=True)
class RecordParameters:
    """Of the record node."""

    bag: str = parameter("", "Folder of the new bag; must not exist yet.")
    topics: tuple[str, ...] = parameter((), "Topics to record, e.g. [skeleton, joint_command]; none means all.")
    report_recorded: bool = parameter(
        False, "Repeat on `recorded` what was written of `handled`, for a replay in lock-step."
    )
    split_mb: float = parameter(
        0.0, "Size at which a new file starts; 0 for never.", unit="MB", minimum=0.0, maximum=1e6
    )


@dataclass(frozen=True)
class ReplayParameters(TrackerParameters):
    """Of the replay node."""

    bag: str = parameter("", "Folder or file of the bag to replay.")
    mode: str = parameter(
        "real_time",
        "`real_time` as recorded, or `lock_step`: each message waits until the one before is handled.",
        choices=("real_time", "lock_step"),
    )
    rate: float = parameter(1.0, "Speed in real time; 2 is twice as fast.", minimum=0.05, maximum=20.0)
    start_s: float = parameter(0.0, "Time to skip at the start.", unit="s", minimum=0.0, maximum=1e10)
    loop: bool = parameter(False, "Start again at the end, until stopped.")
    paused: bool = parameter(False, "Wait before the first message until `~/pause` is called with false.")
    restamp: bool = parameter(
        True, "In real time: stamp messages with the time of publishing, as a live tracker would."
    )
    clock: bool = parameter(
        False,
        "In real time: publish the bag's time on `/clock`, for nodes with `use_sim_time`, and leave stamps alone.",
    )
    skeleton_topic: str = parameter(
        "", "Topic of the skeletons in the bag, for a source with a single one; empty finds it by its type."
    )
    also: tuple[str, ...] = parameter(
        (),
        "Further topics of the bag to publish under their own names; [all] for all. Commands are never published.",
    )
    joint_states: str = parameter(
        "auto",
        "Where the robot's own state comes from: the bag, one message at home, or another publisher (none); auto takes "
        "the bag's in lock-step (home if it has none) and none in real time, where a robot is there.",
        choices=("auto", "bag", "home", "none"),
    )
    robot: str = parameter("yumi", "Robot whose home is used.")
    reporters: int = parameter(
        1,
        "In lock-step: number of nodes that report on `handled`; 1 for pipeline, 3 for the stages.",
        minimum=1,
        maximum=3,
    )
    recorders: int = parameter(
        0, "In lock-step: number of recorders that report on `recorded`.", minimum=0, maximum=100
    )
    subscribers: int = parameter(1, "Number of subscribers of the skeletons to wait for.", minimum=0, maximum=100)
    patience_s: float = parameter(
        20.0, "Longest wait for subscribers, or for the outcome of an input.", unit="s", minimum=0.1, maximum=3600.0
    )
    control_rate_hz: float = parameter(100.0, "Ticks of `/clock` per second.", unit="Hz", minimum=10.0, maximum=500.0)
    salvage: bool = parameter(False, "Read what is readable of a broken bag.")

    def tracker(self) -> SkeletonSource:
        """Whose topics to look for; only where there is one for each joint do joints have to be named here.

        Raises:
            SetupError: Names are given, but wrong ones.
        """
        return self.named_source() if self.joint_names else SOURCES[self.source]
