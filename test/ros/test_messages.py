# SPDX-License-Identifier: Apache-2.0
"""Every signal survives its message, and the wire, to the last bit."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header

from mild_core.errors import DataError
from mild_core.signals import (
    BODY_PARTS,
    NO_SEGMENTS,
    BodySegments,
    FeatureWindow,
    JointCommand,
    JointMeasurement,
    MotionWindow,
    PersonPose,
)
from mild_ros.bag.encoding import encode, type_name_of
from mild_ros.bag.reader import jazzy_types
from mild_ros.messages.feature_window import feature_window_from_msg, feature_window_to_msg
from mild_ros.messages.handled import Handled, handled_from_msg, handled_to_msg
from mild_ros.messages.joint_state import (
    joint_command_from_msg,
    joint_command_to_msg,
    joint_measurement_from_msg,
    joint_measurement_to_msg,
)
from mild_ros.messages.motion import belief_to_msg, motion_from_msgs, motion_state_to_msg, motion_to_msg, motion_type
from mild_ros.messages.person import FIELDS, MOST_SEGMENTS, POINTS, person_from_msg, person_to_msg
from mild_ros.messages.point_cloud import array_from_msg, array_to_msg
from mild_ros.messages.stamps import duration_to_msg, ns_from_msg, time_to_msg

STAMP_NS = 1_700_000_000_123_456_789
JOINTS = ("shoulder", "elbow", "hand")
ROBOT_JOINTS = tuple(f"yumi_joint_{axis}_r" for axis in (1, 2, 7, 3, 4, 5, 6))
INTERACTIONS = ("hand_wave", "hand_shake")


def over_dds(message):
    """What a subscriber in another process gets."""
    return deserialize_message(serialize_message(message), type(message))


def out_of_a_bag(message):
    """What rosbags reads."""
    return jazzy_types().deserialize_cdr(encode(message), type_name_of(message))


ROADS = pytest.mark.parametrize("sent", [lambda message: message, over_dds, out_of_a_bag], ids=["as is", "dds", "bag"])


def same(one, other) -> None:
    """Two signals are equal, arrays bit by bit."""
    assert type(one) is type(other)
    for field in dataclasses.fields(one):
        left, right = getattr(one, field.name), getattr(other, field.name)
        if isinstance(left, np.ndarray):
            assert left.shape == right.shape
            assert left.tobytes() == right.tobytes(), field.name
        else:
            assert left == right, field.name


def window_of(quantities: int, frames: int = 40) -> FeatureWindow:
    features = np.random.default_rng(1).normal(size=(frames, quantities * 3 * len(JOINTS)))
    return FeatureWindow(STAMP_NS, "right_arm", JOINTS, features)


def motion_of(frames: int, lead_ns: int, interaction: str = "hand_shake") -> MotionWindow:
    random = np.random.default_rng(2)
    joints = len(ROBOT_JOINTS)
    return MotionWindow(
        stamp_ns=STAMP_NS,
        lead_ns=lead_ns,
        period_ns=25_000_000,
        joint_names=ROBOT_JOINTS,
        positions=random.normal(size=(frames, joints)),
        covariance=random.normal(size=(joints, joints)),
        interaction=interaction,
        probability=0.1 + 0.2,
        belief=random.dirichlet(np.ones(9)),
        phase=1 / 3,
        out_of_distribution=float(np.nextafter(1.0, 2.0)),
        radii=(1 / 7, 3 / 7),
    )


@ROADS
@pytest.mark.parametrize("quantities", [1, 2], ids=["positions", "positions and velocities"])
@pytest.mark.parametrize("frames", [1, 40])
def test_feature_window_survives(sent, quantities, frames):
    window = window_of(quantities, frames)
    same(feature_window_from_msg(sent(feature_window_to_msg(window)), JOINTS), window)


def test_feature_window_shows_joint_by_joint_in_a_viewer():
    message = feature_window_to_msg(window_of(2))
    assert [field.name for field in message.fields] == ["x", "y", "z", "vx", "vy", "vz"]
    assert (message.height, message.width) == (40, 3)
    points = np.frombuffer(message.data).reshape(40, 3, 6)
    features = window_of(2).features
    np.testing.assert_array_equal(points[7, 1], np.r_[features[7, 3:6], features[7, 9 + 3 : 9 + 6]])


@ROADS
@pytest.mark.parametrize("frames", [1, 40])
@pytest.mark.parametrize("lead_ns", [-39 * 25_000_000, 25_000_000], ids=["same", "ahead"])
@pytest.mark.parametrize("interaction", ["hand_shake", "", "never_heard_of"])
def test_motion_survives(sent, frames, lead_ns, interaction):
    motion = motion_of(frames, lead_ns, interaction)
    messages = sent(motion_to_msg(motion)), sent(motion_state_to_msg(motion, INTERACTIONS))
    same(motion_from_msgs(*messages), motion)


def arm_motion_of(frames: int) -> MotionWindow:
    random = np.random.default_rng(3)
    positions, covariance = random.normal(size=(frames, 3, 3)), random.normal(size=(9, 9))
    return dataclasses.replace(
        motion_of(frames, 25_000_000), joint_names=JOINTS, positions=positions, covariance=covariance
    )


@ROADS
@pytest.mark.parametrize("frames", [1, 40])
def test_a_motion_of_a_partner_survives(sent, frames):
    motion = arm_motion_of(frames)
    message = motion_to_msg(motion)
    assert isinstance(message, motion_type("human_arm"))
    assert (message.height, message.width, len(message.fields)) == (frames, 3, 3)
    same(motion_from_msgs(sent(message), sent(motion_state_to_msg(motion, INTERACTIONS))), motion)


@pytest.mark.parametrize("fault", ["empty", "four joints", "state of joints"])
def test_a_partner_that_does_not_fit_is_bad_data(fault):
    motion = arm_motion_of(3)
    message, state = motion_to_msg(motion), motion_state_to_msg(motion, INTERACTIONS)
    if fault == "empty":
        message.height, message.data = 0, []
    elif fault == "four joints":
        message.height, message.width = 1, 9
    else:
        state = motion_state_to_msg(motion_of(3, 0), INTERACTIONS)
    with pytest.raises(DataError) as caught:
        motion_from_msgs(message, state)
    assert caught.value.reason == "wrong_layout"


def test_motion_reads_as_a_plain_trajectory():
    motion = motion_of(40, -39 * 25_000_000)
    message = motion_to_msg(motion)
    assert list(message.joint_names) == list(ROBOT_JOINTS)
    assert ns_from_msg(message.points[0].time_from_start) == -39 * 25_000_000
    assert ns_from_msg(message.points[-1].time_from_start) == 0
    state = motion_state_to_msg(motion, INTERACTIONS)
    values = dict(zip([field.name for field in state.fields], np.frombuffer(state.data), strict=True))
    assert values["interaction"] == 1
    assert values["probability"] == motion.probability
    assert values["belief_8"] == motion.belief[8]
    assert values["covariance_8"] == motion.covariance[1, 1]


@pytest.mark.parametrize("fault", ["stamp", "joints", "row", "fields", "empty"])
def test_a_motion_that_does_not_fit_is_bad_data(fault):
    motion = motion_of(3, 0)
    trajectory, state = motion_to_msg(motion), motion_state_to_msg(motion, INTERACTIONS)
    if fault == "stamp":
        state.header.stamp.nanosec += 1
    elif fault == "joints":
        trajectory.joint_names = trajectory.joint_names[:-1]
    elif fault == "row":
        trajectory.points[1].positions = [0.0]
    elif fault == "fields":
        state.fields = list(reversed(state.fields))
    else:
        trajectory.points = []
    with pytest.raises(DataError) as caught:
        motion_from_msgs(trajectory, state)
    assert caught.value.reason == "wrong_layout"


@pytest.mark.parametrize("fault", ["empty", "short", "joints", "float32", "overlap", "bigendian"])
def test_a_cloud_that_is_no_window_is_bad_data(fault):
    message = over_dds(feature_window_to_msg(window_of(1)))
    names = JOINTS
    if fault == "empty":
        message = PointCloud2()
    elif fault == "short":
        message.data = message.data[:-1]
    elif fault == "joints":
        names = JOINTS[:2]
    elif fault == "float32":
        message.fields[0].datatype = message.fields[0].FLOAT32
    elif fault == "overlap":
        message.fields[1].offset = message.fields[0].offset
    else:
        message.is_bigendian = True
    with pytest.raises(DataError) as caught:
        feature_window_from_msg(message, names)
    assert caught.value.reason == "wrong_layout"


@ROADS
def test_joint_states_survive(sent):
    positions = np.random.default_rng(3).normal(size=7)
    command = JointCommand(STAMP_NS, ROBOT_JOINTS, positions, positions / 3)
    same(joint_command_from_msg(sent(joint_command_to_msg(command))), command)
    measured = JointMeasurement(STAMP_NS, ROBOT_JOINTS, positions)
    same(joint_measurement_from_msg(sent(joint_measurement_to_msg(measured))), measured)


def test_a_command_without_velocities_stands_still():
    command = joint_command_from_msg(JointState(name=["a", "b"], position=[1.0, 2.0]))
    np.testing.assert_array_equal(command.velocities_rad_s, [0.0, 0.0])


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (JointState(), "wrong_layout"),
        (JointState(name=["a", "b"], position=[1.0]), "wrong_layout"),
    ],
)
def test_joint_states_that_say_nothing_are_bad_data(message, reason):
    for read in (joint_measurement_from_msg, joint_command_from_msg):
        with pytest.raises(DataError) as caught:
            read(message)
        assert caught.value.reason == reason


@pytest.mark.parametrize("position", [float("nan"), float("inf")])
def test_only_a_command_has_to_be_finite_in_every_joint(position):
    message = JointState(name=["a"], position=[position])
    np.testing.assert_array_equal(joint_measurement_from_msg(message).positions_rad, [position])
    with pytest.raises(DataError):
        joint_command_from_msg(JointState(name=["a"], position=[0.0], velocity=[position]))
    with pytest.raises(DataError, match="not_finite"):
        joint_command_from_msg(message)


@ROADS
def test_handled_survives(sent):
    handled = Handled("perception", 2, "accepted", STAMP_NS)
    assert handled_from_msg(sent(handled_to_msg(handled))) == handled


@pytest.mark.parametrize("text", ["", "perception", "perception two accepted", "a 1 b c"])
def test_handled_that_is_not_one_is_bad_data(text):
    message = handled_to_msg(Handled("perception", 2, "accepted", STAMP_NS))
    message.frame_id = text
    with pytest.raises(DataError):
        handled_from_msg(message)


@ROADS
def test_belief_is_labelled(sent):
    motion = motion_of(3, 0)
    message = sent(belief_to_msg(motion))
    assert message.layout.dim[0].label == "hand_shake component"
    assert message.layout.dim[0].size == 9
    np.testing.assert_array_equal(message.data, motion.belief)


@pytest.mark.parametrize("stamp_ns", [0, 999_999_999, 1_000_000_000, STAMP_NS])
def test_stamps_are_exact(stamp_ns):
    assert ns_from_msg(time_to_msg(stamp_ns)) == stamp_ns
    assert ns_from_msg(duration_to_msg(-(stamp_ns % 10**18))) == -(stamp_ns % 10**18)


def everyone(rng: np.random.Generator, people: tuple[int, ...] = (0, 7)) -> BodySegments:
    count = len(people) * len(BODY_PARTS)
    return BodySegments(
        tuple(number for number in people for _ in BODY_PARTS),
        BODY_PARTS * len(people),
        rng.normal(size=(count, 2, 3)),
        rng.normal(size=(count, 2, 3)),
        rng.uniform(0.05, 0.5, size=count),
    )


@ROADS
@pytest.mark.parametrize("watched", [True, False])
def test_a_person_arrives_as_sent(sent, watched: bool) -> None:
    rng = np.random.default_rng(5)
    parts = (np.full(3, np.nan), rng.normal(size=3), rng.normal(size=(2, 3)))
    pose = PersonPose(STAMP_NS, "arm", *parts, everyone(rng), np.array([0.0, -0.6, 0.8]), watched)
    arrived = person_from_msg(sent(person_to_msg(pose)))
    same(arrived.segments, pose.segments)
    same(replace(arrived, segments=NO_SEGMENTS), replace(pose, segments=NO_SEGMENTS))


@ROADS
def test_a_pose_without_a_person_arrives_as_sent(sent) -> None:
    unseen = np.full(3, np.nan)
    pose = PersonPose(STAMP_NS, "robot", unseen, unseen, np.full((2, 3), np.nan), watched=False)
    arrived = person_from_msg(sent(person_to_msg(pose)))
    assert arrived.segments.people == ()
    assert not arrived.watched
    assert np.isnan(arrived.facing).all()


@pytest.mark.parametrize(
    ("row", "column", "value"),
    [
        *((POINTS, 0, np.nan), (POINTS, 4, np.inf), (POINTS, 0, 1e6), (POINTS, 3, 1e6), (POINTS, 6, -0.1)),
        *((POINTS, 6, 99.0), (POINTS, 7, -1.0), (POINTS, 7, 0.5), (POINTS, 8, len(BODY_PARTS)), (POINTS, 8, 1.5)),
        *((POINTS + 1, 7, 3.0), (0, 7, 5.0), (4, 0, 3.0), (4, 0, np.nan)),
    ],
)
def test_a_person_with_what_no_pose_holds_is_refused(row: int, column: int, value: float) -> None:
    rng = np.random.default_rng(5)
    parts = (rng.normal(size=3), rng.normal(size=3), rng.normal(size=(2, 3)))
    message = person_to_msg(PersonPose(STAMP_NS, "robot", *parts, everyone(rng), np.array([1.0, 0.0, 0.0])))
    values, names = array_from_msg(message)
    values = values.copy()
    values[0, row, column] = value
    with pytest.raises(DataError, match="wrong_layout"):
        person_from_msg(array_to_msg(values, names, message.header))


@pytest.mark.parametrize("rows", [0, 4, 6, POINTS + 2 * MOST_SEGMENTS + 2])
def test_a_person_of_another_size_is_refused(rows: int) -> None:
    with pytest.raises(DataError, match="wrong_layout"):
        person_from_msg(array_to_msg(np.zeros((1, rows, len(FIELDS))), FIELDS, Header()))


def test_a_cloud_of_something_else_is_no_person() -> None:
    window = FeatureWindow(STAMP_NS, "arm", JOINTS, np.zeros((40, 9)))
    with pytest.raises(DataError, match="wrong_layout"):
        person_from_msg(feature_window_to_msg(window))
