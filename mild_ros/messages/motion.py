# SPDX-License-Identifier: Apache-2.0
"""`MotionWindow` as two messages with the same stamp: what to do, and how sure the model is of it.

`motion` of a robot's joints is a `trajectory_msgs/JointTrajectory` that any ROS tool can read; the time of each point
counts from the stamp and is negative for frames that lie before it. `motion` of a partner's arm is an organised
`sensor_msgs/PointCloud2`: one row per frame; shoulder, elbow and hand in the partner's arm frame [m].
`motion_state` is a `sensor_msgs/PointCloud2` with one point: interaction (its place in the model's list, -1 when
unknown), probability, phase, out_of_distribution, lead and period [ns], state (its place among
`signals.RECOGNITION_STATES`), may_start (1 or 0), radius_50 and radius_90 (Mahalanobis distances in the covariance
within which half and nine tenths of the true values lie), belief_0 ..., covariance_0 ... row by row. The
interaction's name is its frame_id.
"""

from __future__ import annotations

import array
from typing import Any

import numpy as np

from mild_core.errors import DataError
from mild_core.shapes import FloatArray
from mild_core.signals import ARM_FRAME, ARM_JOINTS, RECOGNITION_STATES, MotionWindow
from mild_ros.messages.feature_window import POSITION_FIELDS
from mild_ros.messages.point_cloud import array_from_msg, array_to_msg
from mild_ros.messages.stamps import duration_to_msg, ns_from_msg, time_to_msg
from mild_ros.messages.standard import (
    Float64MultiArray,
    Header,
    JointTrajectory,
    JointTrajectoryPoint,
    MultiArrayDimension,
    MultiArrayLayout,
    PointCloud2,
)

SCALARS = ("interaction", "probability", "phase", "out_of_distribution", "lead_ns", "period_ns", "state", "may_start")
RADII = ("radius_50", "radius_90")

LONGEST_NS = 100e9
"""No motion lies further away than this, or has rows so far apart."""


def motion_type(controlled_kind: str) -> Any:
    """The type of the messages on `motion`, by the kind of agent that a model moves."""
    return PointCloud2 if controlled_kind == "human_arm" else JointTrajectory


def motion_to_msg(motion: MotionWindow) -> JointTrajectory | PointCloud2:
    """The joint angles [rad], or the partner's arm [m]."""
    if motion.positions.ndim == 3:
        header = Header(stamp=time_to_msg(motion.stamp_ns), frame_id=ARM_FRAME)
        return array_to_msg(motion.positions, POSITION_FIELDS, header)
    message = JointTrajectory(header=Header(stamp=time_to_msg(motion.stamp_ns)))
    message.joint_names = list(motion.joint_names)
    message.points = [
        JointTrajectoryPoint(
            positions=array.array("d", row.tobytes()),
            time_from_start=duration_to_msg(motion.lead_ns + index * motion.period_ns),
        )
        for index, row in enumerate(motion.positions)
    ]
    return message


def motion_state_to_msg(motion: MotionWindow, interactions: tuple[str, ...]) -> PointCloud2:
    """All the rest of a motion; `interactions` are the model's, in its order."""
    known = motion.interaction in interactions
    scalars = [interactions.index(motion.interaction) if known else -1, motion.probability, motion.phase]
    scalars += [motion.out_of_distribution, motion.lead_ns, motion.period_ns]
    scalars += [RECOGNITION_STATES.index(motion.state), float(motion.may_start)]
    scalars += motion.radii
    values = np.concatenate([np.array(scalars, dtype=np.float64), motion.belief, motion.covariance.ravel()])
    names = SCALARS + RADII + _numbered("belief", motion.belief.size) + _numbered("covariance", motion.covariance.size)
    header = Header(stamp=time_to_msg(motion.stamp_ns), frame_id=motion.interaction)
    return array_to_msg(values[None, None, :], names, header)


def motion_from_msgs(motion: Any, state: Any) -> MotionWindow:
    """The motion in a pair of messages with equal stamps.

    Raises:
        DataError: `wrong_layout` when they are not such a pair, or rows differ in length.
    """
    joint_names, positions = _positions(motion)
    stamp_ns = ns_from_msg(motion.header.stamp)
    values, names = array_from_msg(state)
    beliefs, size = sum(name.startswith("belief_") for name in names), positions[0].size
    expected = SCALARS + RADII + _numbered("belief", beliefs) + _numbered("covariance", size**2)
    if values.shape[:2] != (1, 1) or names != expected or ns_from_msg(state.header.stamp) != stamp_ns:
        raise DataError("wrong_layout", f"motion of {size} values with a state of {len(names)} fields")
    _, probability, phase, out_of_distribution, lead, period, place, may_start = values[0, 0, : len(SCALARS)].tolist()
    lead_ns, period_ns = _times(lead, period)
    if place not in range(len(RECOGNITION_STATES)):
        raise DataError("wrong_layout", f"a motion in state {place:g} of {len(RECOGNITION_STATES)}")
    radii, belief, covariance = np.split(values[0, 0, len(SCALARS) :], [len(RADII), len(RADII) + beliefs])
    return MotionWindow(
        stamp_ns=stamp_ns,
        lead_ns=lead_ns,
        period_ns=period_ns,
        joint_names=joint_names,
        positions=positions,
        covariance=covariance.reshape(size, size),
        interaction=str(state.header.frame_id),
        probability=probability,
        belief=belief,
        phase=phase,
        out_of_distribution=out_of_distribution,
        state=RECOGNITION_STATES[int(place)],
        radii=(float(radii[0]), float(radii[1])),
        may_start=may_start == 1.0,
    )


def _times(lead: float, period: float) -> tuple[int, int]:
    """Lead and period [ns].

    Raises:
        DataError: No motion has such times.
    """
    if not (abs(lead) <= LONGEST_NS and 1.0 <= period <= LONGEST_NS):
        raise DataError("wrong_layout", f"a motion with a lead of {lead:g} ns and a period of {period:g} ns")
    return int(lead), int(period)


def _positions(message: Any) -> tuple[tuple[str, ...], FloatArray]:
    """Joint names and positions in either message; W is at least 1."""
    if hasattr(message, "points"):
        joint_names = tuple(str(name) for name in message.joint_names)
        rows = [np.asarray(point.positions, dtype=np.float64) for point in message.points]
        if not rows or any(row.size != len(joint_names) for row in rows):
            problem = f"a trajectory without a position for each of its {len(joint_names)} joints"
            raise DataError("wrong_layout", problem)
        return joint_names, np.stack(rows)
    positions, names = array_from_msg(message)
    if names != POSITION_FIELDS or positions.shape[1] != len(ARM_JOINTS) or not len(positions):
        raise DataError("wrong_layout", f"a cloud of {positions.shape} with {names}, expected shoulder, elbow, hand")
    return ARM_JOINTS, positions


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}_{index}" for index in range(count))


def belief_to_msg(motion: MotionWindow) -> Float64MultiArray:
    """The belief (K,) over the components of the interaction, whose name is the label of the one dimension."""
    size = motion.belief.size
    dimension = MultiArrayDimension(label=f"{motion.interaction or 'unknown'} component", size=size, stride=size)
    return Float64MultiArray(
        layout=MultiArrayLayout(dim=[dimension], data_offset=0), data=array.array("d", motion.belief.tobytes())
    )
