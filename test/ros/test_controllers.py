# SPDX-License-Identifier: Apache-2.0
"""What is sent to controllers is what they accept, and stays inside every limit also when nothing more comes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from mild_core.errors import SetupError
from mild_core.retargeting.limiter import Limiter
from mild_core.retargeting.robots import ROBOTS
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.retargeting.stage import Retargeting, RetargetingState
from mild_core.retargeting.trajectory_stream import (
    STAND_S,
    Trajectory,
    TrajectoryState,
    execution_delay_s,
    limits_between_points,
)
from mild_core.signals import JointCommand, JointMeasurement, MotionWindow
from mild_ros.assembly.perception import manifest_of
from mild_ros.assembly.retargeting import make_retargeting
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.commands.controller_messages import ControllerMessages, delay_of
from mild_ros.commands.controller_settings import ControllerParameters
from mild_ros.commands.joint_naming import joint_naming
from mild_ros.controllers import OUTPUTS
from mild_ros.controllers.output import Outgoing
from mild_ros.messages.stamps import ns_from_msg
from mild_ros.node_kit.parameter_files import read_parameters
from test.habits.tree import ROOT

YUMI = ROBOTS["yumi"]
ABB_NAMES = tuple(f"yumi_robr_joint_{number}" for number in range(1, 8))
START_NS, TICK_NS = 10**18, 10_000_000
STANDS_NS = round(STAND_S * 1e9)
"""So long a stream of trajectories stands still before it moves."""
DELAY_S = execution_delay_s(ControllerParameters().max_expected_latency_s)
JTC_PARAMETERS = {
    *("joints", "command_joints", "command_interfaces", "state_interfaces", "speed_scaling", "gains", "constraints"),
    *("allow_partial_joints_goal", "open_loop_control", "interpolate_from_desired_state", "action_monitor_rate"),
    *("allow_integration_in_goal_trajectories", "set_last_command_interface_value_as_state_on_activation"),
    *("interpolation_method", "allow_nonzero_velocity_at_trajectory_end", "cmd_timeout"),
}
"""Source: joint_trajectory_controller_parameters.yaml of ros2_controllers (Jazzy)."""
STAGE = Retargeting(YUMI, RetargetingSettings(execution_delay_s=DELAY_S))


@dataclass(frozen=True)
class Moved:
    """The stage after a motion, its newest command, and the newest trajectory of a stream that began before."""

    state: RetargetingState
    command: JointCommand
    trajectory: Trajectory | None
    promised: TrajectoryState


def after_motion(target: np.ndarray, ticks: int) -> Moved:
    """What stands there so many ticks after the stage, at rest until then, was given a motion to `target`."""
    since_ns, stream = START_NS - STANDS_NS, STAGE.trajectory_stream()
    state, _ = STAGE.step(STAGE.init(), JointMeasurement(since_ns, YUMI.joint_names, YUMI.home_rad), since_ns)
    motion = MotionWindow(
        stamp_ns=START_NS,
        lead_ns=25_000_000,
        period_ns=25_000_000,
        joint_names=YUMI.joint_names,
        positions=np.tile(target, (40, 1)),
        covariance=np.eye(7) * 1e-4,
        interaction="hand_shake",
        probability=0.9,
        belief=np.array([1.0]),
        phase=0.5,
        out_of_distribution=0.1,
    )
    promised, trajectory, commands = stream.init(), None, ()
    for now_ns in range(since_ns + TICK_NS, START_NS + ticks * TICK_NS + 1, TICK_NS):
        if now_ns == START_NS:
            state, _ = STAGE.step(state, motion, START_NS)
        state, made = STAGE.step(state, None, now_ns)
        assert state.motion is not None
        promised, sent = stream.step(promised, state.motion, now_ns)
        commands, trajectory = made or commands, sent or trajectory
    return Moved(state, commands[-1], trajectory, promised)


def outgoing(moved: Moved, order: tuple[str, ...] = ()) -> Outgoing:
    named = joint_naming(YUMI.joint_names, ABB_NAMES).renamed(moved.command)
    return Outgoing(named, YUMI, order or ABB_NAMES, trajectory=moved.trajectory)


def rejections(message: Any, joints: tuple[str, ...], now_ns: int) -> Iterator[str]:
    """Why JointTrajectoryController with its default parameters would reject a message.

    Source: `validate_trajectory_msg`, ros2_controllers, joint_trajectory_controller.cpp (Jazzy).
    """
    if len(message.joint_names) != len(joints):
        yield "joints on incoming trajectory don't match the controller joints"
    if not message.joint_names:
        yield "empty joint names"
    if not message.points:
        yield "empty trajectory"
        return
    if set(message.joint_names) - set(joints):
        yield "incoming joint doesn't match the controller's joints"
    if any(abs(speed) > np.finfo(np.float32).eps for speed in message.points[-1].velocities):
        yield "velocity of last trajectory point is not zero"
    stamp_ns, times = ns_from_msg(message.header.stamp), [_ns(point.time_from_start) for point in message.points]
    if stamp_ns and stamp_ns + times[-1] < now_ns:
        yield "ends in the past"
    if np.any(np.diff(times) <= 0):
        yield "time between points is not strictly increasing"
    for point in message.points:
        if len(point.positions) != len(message.joint_names):
            yield "mismatch between joint_names and positions"
        if any(
            values and len(values) != len(message.joint_names) for values in (point.velocities, point.accelerations)
        ):
            yield "mismatch between joint_names and velocities or accelerations"
        if len(point.effort):
            yield "trajectories with effort fields"


def _ns(duration: Any) -> int:
    return int(duration.sec * 10**9 + duration.nanosec)


def splined(message: Any, times_s: np.ndarray) -> np.ndarray:
    """Positions between the points as JointTrajectoryController interpolates them: cubic with positions and speeds."""
    at = np.array([_ns(point.time_from_start) * 1e-9 for point in message.points])
    where = np.array([list(point.positions) for point in message.points])
    speed = np.array([list(point.velocities) for point in message.points])
    index = np.clip(np.searchsorted(at, times_s, side="right") - 1, 0, len(at) - 2)
    length = np.diff(at)[index][:, None]
    u = ((times_s - at[index]) / length[:, 0])[:, None]
    return (
        (2 * u**3 - 3 * u**2 + 1) * where[index]
        + (u**3 - 2 * u**2 + u) * length * speed[index]
        + (3 * u**2 - 2 * u**3) * where[index + 1]
        + (u**3 - u**2) * length * speed[index + 1]
    )


@settings(deadline=None, max_examples=40, derandomize=True)  # the first example compiles
@given(
    away=st.lists(st.floats(-1.5, 1.5), min_size=7, max_size=7),
    ticks=st.integers(0, 60),
)
def test_a_trajectory_is_accepted_and_keeps_every_limit(away: list[float], ticks: int) -> None:
    moved = after_motion(YUMI.home_rad + np.array(away), ticks)
    command, message = moved.command, OUTPUTS["joint_trajectory"].message(JointTrajectory, outgoing(moved))
    assert list(rejections(message, ABB_NAMES, command.stamp_ns)) == []
    times = np.arange(
        _ns(message.points[0].time_from_start) * 1e-9, _ns(message.points[-1].time_from_start) * 1e-9, 0.004
    )
    positions = splined(message, times)
    assert np.all(positions >= YUMI.lower_rad - 1e-9)
    assert np.all(positions <= YUMI.upper_rad + 1e-9)
    assert np.all(np.abs(np.diff(positions, axis=0)) / 0.004 <= 1.02 * YUMI.velocity_rad_s)


def test_a_trajectory_holds_what_was_commanded() -> None:
    """The promised points are the commands, so much later; after them comes the stop that the guard has examined."""
    stream, moved = STAGE.trajectory_stream(), after_motion(YUMI.home_rad + 0.5, 0)
    promised, trajectory, state, commands = moved.promised, None, *after_first(moved.state, 20)
    for tick, command in enumerate(commands):
        assert command.motion is not None
        promised, made = stream.step(promised, command.motion, START_NS + (tick + 1) * TICK_NS)
        trajectory = made or trajectory
    assert trajectory is not None
    times = trajectory.stamp_ns + np.array(trajectory.offsets_ns) - round(DELAY_S * 1e9)
    for tick, command in enumerate(commands):
        (index,) = np.flatnonzero(times == START_NS + (tick + 1) * TICK_NS)
        assert command.motion is not None
        np.testing.assert_array_equal(trajectory.positions_rad[index], command.motion.position_rad)
        np.testing.assert_array_equal(trajectory.velocities_rad_s[index], command.motion.velocity_rad_s)
    stop = Limiter(YUMI.velocity_rad_s, *limits_between_points(YUMI.acceleration_rad_s2, YUMI.jerk_rad_s3))
    assert state.motion is not None
    np.testing.assert_allclose(trajectory.positions_rad[-1], stop.resting_place(state.motion), atol=1e-9)
    assert np.ptp(trajectory.positions_rad[-4:], axis=0).max() > 1e-4, "it has been moving"


def after_first(state: RetargetingState, ticks: int) -> tuple[RetargetingState, list[RetargetingState]]:
    """The stage after so many ticks of a motion, and after each of them."""
    states = []
    for tick in range(1, ticks + 1):
        state, _ = STAGE.step(state, None, START_NS + tick * TICK_NS)
        states.append(state)
    return state, states


def _harmed(message: Any, harm: Callable[[Any], None]) -> Any:
    harm(message)
    return message


@pytest.mark.parametrize(
    ("harm", "why"),
    [
        (lambda m: m.joint_names.pop(), "don't match"),
        (lambda m: m.joint_names.__setitem__(0, "other"), "doesn't match"),
        (lambda m: m.points.clear(), "empty trajectory"),
        (lambda m: setattr(m.points[-1], "velocities", [0.1] * 7), "is not zero"),
        (lambda m: setattr(m.points[1], "time_from_start", m.points[0].time_from_start), "strictly increasing"),
        (lambda m: setattr(m.points[0], "effort", [0.0] * 7), "effort"),
        (lambda m: setattr(m.header.stamp, "sec", 1), "in the past"),
    ],
)
def test_the_rules_reject_what_the_controller_rejects(harm: Callable[[Any], None], why: str) -> None:
    moved = after_motion(YUMI.home_rad + 0.5, 20)
    message = OUTPUTS["joint_trajectory"].message(JointTrajectory, outgoing(moved))
    found = list(rejections(_harmed(message, harm), ABB_NAMES, moved.command.stamp_ns))
    assert any(why in reason for reason in found)


def test_positions_come_in_the_stated_order() -> None:
    moved = after_motion(YUMI.home_rad + 0.5, 20)
    order = ABB_NAMES[::-1]
    message = OUTPUTS["position_command"].message(Float64MultiArray, outgoing(moved, order))
    assert list(message.data) == moved.command.positions_rad.tolist()[::-1]


def test_pepper_gets_angles_and_a_speed() -> None:
    definition = "std_msgs/Header header\nstring[] joint_names\nfloat32[] joint_angles\nfloat32 speed\nuint8 relative"
    types = get_typestore(Stores.ROS2_JAZZY)
    types.register(get_types_from_msg(definition, "naoqi_bridge_msgs/msg/JointAnglesWithSpeed"))
    header, time = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]

    def kind(**fields: Any) -> Any:
        of_naoqi = types.types["naoqi_bridge_msgs/msg/JointAnglesWithSpeed"]
        fields["joint_angles"] = np.array(fields["joint_angles"], dtype=np.float32)
        return of_naoqi(header(time(0, 0), ""), **fields)

    moved = after_motion(YUMI.home_rad + 0.5, 20)
    command, message = moved.command, OUTPUTS["joint_angles"].message(kind, outgoing(moved))
    data = types.serialize_cdr(message, "naoqi_bridge_msgs/msg/JointAnglesWithSpeed")
    read = types.deserialize_cdr(data, "naoqi_bridge_msgs/msg/JointAnglesWithSpeed")
    assert tuple(read.joint_names) == ABB_NAMES
    np.testing.assert_allclose(read.joint_angles, command.positions_rad, rtol=1e-6)
    assert read.speed == pytest.approx(np.max(np.abs(command.velocities_rad_s) / YUMI.velocity_rad_s), rel=1e-6)
    assert 0.05 <= read.speed <= 1.0
    # A robot that comes to rest still has its way since the message before to go.
    still = replace(command, velocities_rad_s=np.zeros(7))
    before = replace(still, stamp_ns=still.stamp_ns - 40_000_000, positions_rad=still.positions_rad - 0.02)
    braking = OUTPUTS["joint_angles"].message(kind, replace(outgoing(replace(moved, command=still)), previous=before))
    assert braking.speed == pytest.approx(0.02 / 0.04 / YUMI.velocity_rad_s.min())
    assert OUTPUTS["joint_angles"].message(kind, outgoing(replace(moved, command=still))).speed == 0.05


def test_the_robots_own_names_are_understood() -> None:
    naming = joint_naming(YUMI.joint_names, ABB_NAMES)
    measured = JointMeasurement(1, ("gripper", *ABB_NAMES[::-1]), np.arange(8.0))
    assert naming.understood(measured).joint_names == ("gripper", *YUMI.joint_names[::-1])
    with pytest.raises(SetupError, match="one for each of yumi_joint_1_r"):
        joint_naming(YUMI.joint_names, ABB_NAMES[:6])
    with pytest.raises(SetupError, match="has 6 different names"):
        joint_naming(YUMI.joint_names, (*ABB_NAMES[:6], ABB_NAMES[0]))


def test_a_command_is_made_ahead_only_where_trajectories_are_played() -> None:
    assert delay_of(ControllerParameters(), 100.0) == 0.0
    assert delay_of(ControllerParameters(outputs=("position_command", "joint_angles")), 10.0) == 0.0
    playing = ControllerParameters(outputs=("joint_trajectory",))
    assert delay_of(playing, 100.0) == pytest.approx(0.16)
    assert delay_of(replace(playing, max_expected_latency_s=0.025), 100.0) == pytest.approx(0.16), "trajectory_s"
    assert delay_of(replace(playing, max_expected_latency_s=0.025, trajectory_s=0.02), 100.0) == pytest.approx(0.09)
    with pytest.raises(SetupError, match="50 Hz is too little for joint_trajectory"):
        delay_of(playing, 50.0)
    with pytest.raises(SetupError, match="joint_trajektory"):
        delay_of(replace(playing, outputs=("joint_trajektory",)), 100.0)


def test_retargeting_made_from_parameters_knows_of_the_delay() -> None:
    parameters = PipelineParameters(outputs=("joint_trajectory",), max_expected_latency_s=0.2)
    stage = make_retargeting(parameters, manifest_of(parameters.model))
    assert stage.settings.execution_delay_s == pytest.approx(0.26)
    assert stage.settings.ahead_s == pytest.approx(parameters.look_ahead_s + 0.26), "the person where they will be"
    plain = make_retargeting(PipelineParameters(), manifest_of(parameters.model))
    assert plain.settings.execution_delay_s == 0.0
    assert plain.settings.ahead_s == parameters.look_ahead_s


def test_bare_positions_and_angles_come_as_often_as_their_controllers_take_them() -> None:
    """Ticks of a live clock come a little early or late; no message is left out for that."""
    parameters = ControllerParameters(outputs=("position_command", "joint_trajectory"))
    messages = ControllerMessages(parameters, STAGE, joint_naming(YUMI.joint_names, ()))
    state = after_motion(YUMI.home_rad + 0.5, 20).state
    random, counts = np.random.default_rng(0), {"position_command": 0, "joint_trajectory": 0}
    for tick in range(21, 321):
        state, commands = STAGE.step(state, None, START_NS + tick * TICK_NS + int(random.integers(0, 1_000_000)))
        for due in messages.after(commands, state):
            counts[due.topic] += 1
    assert counts == {"position_command": 300, "joint_trajectory": 300}


def test_the_sample_for_ros2_control_fits_the_robot() -> None:
    read = yaml.safe_load((ROOT / "mild_ros/config/ros2_control/controllers.yaml").read_text())
    started = read["controller_manager"]["ros__parameters"]
    ours = read_parameters(PipelineParameters, "pipeline", "yumi_abb")
    joint_naming(ROBOTS[ours.robot].joint_names, ours.robot_joint_names)
    for name in ("right_arm_controller", "right_arm_positions"):
        assert started[name]["type"].split("/")[0] in ("joint_trajectory_controller", "forward_command_controller")
        assert tuple(read[name]["ros__parameters"]["joints"]) == ours.robot_joint_names
    given = read["right_arm_controller"]["ros__parameters"]
    assert set(given) <= JTC_PARAMETERS, "the controller refuses what it does not know"
    named = (ROOT / "docs/robot.md").read_text()
    for name in set(given) - {"constraints", "open_loop_control", "allow_partial_joints_goal"}:
        assert f"`{name}`" in named, f"docs/robot.md names {name}"
    for field in fields(ControllerParameters):
        assert f"`{field.name}`" in named, f"docs/robot.md names {field.name}"
