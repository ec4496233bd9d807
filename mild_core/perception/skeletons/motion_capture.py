# SPDX-License-Identifier: Apache-2.0
"""Motion capture with a rigid body per joint, each a `geometry_msgs/PoseStamped` on a topic of its own.

As `vrpn_mocap`, `mocap_optitrack` and `vicon_receiver` publish it: best effort, 100 Hz and more, z up in the room's
frame. Joints are put together as `mild_ros.messages.joint_by_joint` says.
"""

from __future__ import annotations

from mild_core.perception.skeletons.source import SkeletonSource

MOTION_CAPTURE = SkeletonSource(
    name="motion_capture",
    message="joint_poses",
    driver="vrpn_mocap, mocap_optitrack, ...",
    start="`-p joint_names:=[right_shoulder, ...] -p joint_places:=[/vrpn_mocap/RShoulder/pose, ...]`;"
    " without places: `skeleton/right_shoulder`, ...",
    tested="messages as its driver makes them, live and from a bag",
)
