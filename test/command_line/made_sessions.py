# SPDX-License-Identifier: Apache-2.0
"""Synthetic bags of demonstrations: a kinematic person repeats our scenes, a robot or a partner answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from std_msgs.msg import String

from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.robots import ROBOTS
from mild_core.shapes import FloatArray
from mild_core.signals import JointMeasurement, SkeletonFrame
from mild_ros.bag.encoding import encode, type_name_of
from mild_ros.bag.writer import BagWriter, create_bag
from mild_ros.messages.joint_state import joint_measurement_to_msg
from mild_ros.messages.pose_array import person_to_pose_array
from mild_ros.simulation.person import BODY_JOINTS, Camera, bodies, skeleton_frames
from tools.scenes import SCENES, ArmPose, Scene, arm_track

JOINTS = ("right_shoulder", "right_elbow", "right_hand", "left_shoulder", "pelvis", "head")
"""In the order of the tracker's poses."""

TRACKER = {"source": "pose_array", "joint_names": JOINTS, "source_axes": "optical"}
START_NS = 1_700_000_000_000_000_000
NAMED = {scene.name: scene for scene in SCENES}
ROBOT = ROBOTS["yumi"]


@dataclass(frozen=True, eq=False)
class Session:
    """What a session shows.

    Attributes:
        track: (T, 3, 3) the person's arm, bones of unit length.
        rate_hz: Of the track.
        shown: Each interaction and the time when it is announced [s].
    """

    track: FloatArray
    rate_hz: float
    shown: tuple[tuple[float, str], ...]


def varied(scene: Scene, rng: np.random.Generator) -> Scene:
    """The same done by another person: higher or lower, faster or slower."""

    def vary(pose: ArmPose, largest: float) -> ArmPose:
        lift = tuple(pose.upper + np.array([0.0, 0.0, largest]))
        return replace(pose, after_s=pose.after_s * speed, upper=lift, fore=tuple(pose.fore + spread))

    lift, speed, spread = rng.uniform(-0.3, 0.3), rng.uniform(0.85, 1.15), rng.uniform(-0.15, 0.15, 3)
    return replace(scene, poses=(*(vary(pose, lift) for pose in scene.poses[:-1]), scene.poses[-1]))


def session(names: Sequence[str], seed: int, rate_hz: float = 15.0) -> Session:
    """A session in which these interactions follow each other, each from rest to rest."""
    rng, parts, shown, frames = np.random.default_rng(seed), [], [], 0
    for name in names:
        shown.append((frames / rate_hz + 0.5, name))
        parts.append(arm_track(varied(NAMED[name], rng), rate_hz))
        frames += len(parts[-1])
    return Session(np.concatenate(parts), rate_hz, tuple(shown))


def answer(track: FloatArray, lag: int) -> FloatArray:
    """(T, 7) [rad] what the robot does: it goes where the hand is, as far as the hand does, a little later."""
    moved = track[:, 2] - track[:, 0] - (track[0, 2] - track[0, 0])
    moved = np.concatenate([np.repeat(moved[:1], lag, axis=0), moved[: len(moved) - lag]])
    mixing = np.random.default_rng(1).uniform(-0.3, 0.3, (3, len(ROBOT.joint_names)))
    return ROBOT.home_rad + moved @ mixing


def person_frames(made: Session, camera: Camera | None = None, person_id: int = 1) -> list[SkeletonFrame]:
    """The person as a tracker sees them from `START_NS` on: the joints of `JOINTS`."""
    places = [BODY_JOINTS.index(name) for name in JOINTS]
    seen = skeleton_frames(bodies(made.track), made.rate_hz, START_NS, camera, person_id)
    return [
        replace(one, joint_names=JOINTS, positions_m=one.positions_m[places], confidence=one.confidence[places])
        for one in seen
    ]


def write_people(
    bag: BagWriter, topic: str, frames: Sequence[SkeletonFrame], clock_ns: int = 0, late_ns: int = 0
) -> None:
    """Poses of a tracker whose clock is off by `clock_ns` and whose messages come `late_ns` after they were true."""
    source = SOURCES["pose_array"].with_joints(JOINTS, "optical")
    for frame in frames:
        message = person_to_pose_array(replace(frame, stamp_ns=frame.stamp_ns + clock_ns), source)
        bag.write(topic, type_name_of(message), frame.stamp_ns + late_ns, encode(message))


def write_robot(bag: BagWriter, made: Session, rate_hz: float = 25.0, lag_s: float = 0.2) -> None:
    """The robot's joint_states: in another order, in two messages, with a gripper that knows nothing."""
    times = np.arange(0.0, len(made.track) / made.rate_hz, 1.0 / rate_hz)
    positions = answer(made.track, round(lag_s * made.rate_hz))
    names, order = ROBOT.joint_names, [3, 0, 6, 1]
    rest = [place for place in range(len(names)) if place not in order]
    own_times = np.arange(len(positions)) / made.rate_hz
    even = np.stack([np.interp(times, own_times, column) for column in positions.T], axis=1)
    for time_s, row in zip(times, even, strict=True):
        stamp_ns = START_NS + round(time_s * 1e9)
        for places, extra in ((order, ()), (rest, ("gripper",))):
            positions = np.concatenate([row[places], [np.nan] * len(extra)])
            measured = JointMeasurement(stamp_ns, (*(names[place] for place in places), *extra), positions)
            message = joint_measurement_to_msg(measured)
            bag.write("/joint_states", type_name_of(message), stamp_ns, encode(message))


def write_labels(bag: BagWriter, made: Session, said: Sequence[tuple[float, str]] = ()) -> None:
    """What an operator says comes next."""
    for time_s, word in said or made.shown:
        bag.write("/label", "std_msgs/msg/String", START_NS + round(time_s * 1e9), encode(String(data=word)))


def write_session(folder: Path, made: Session) -> Path:
    """A bag of a person and a robot, labelled on a topic."""
    with create_bag(folder) as bag:
        write_people(bag, "/people", person_frames(made))
        write_robot(bag, made)
        write_labels(bag, made)
    return folder
