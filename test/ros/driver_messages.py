# SPDX-License-Identifier: Apache-2.0
"""What each tracker's driver publishes of one person: message types, ids, frames, units and order as in its source."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseStamped
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Float32MultiArray, Header
from visualization_msgs.msg import Marker, MarkerArray

from mild_core.perception.skeletons import SOURCES, SkeletonSource
from mild_core.shapes import FloatArray
from mild_core.signals import SkeletonFrame
from mild_ros.messages.marker_array import people_to_marker_array
from mild_ros.messages.pose_array import person_to_pose_array
from mild_ros.messages.stamps import time_to_msg
from mild_ros.simulation.person import BODY_JOINTS
from test.ros.foreign_messages import foreign, header, received

Sent = Iterator[tuple[str, Any]]
"""Topic and message, in order."""

ROOM_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""REP-103: x forward, y left, z up of a camera that looks ahead, from x right, y down, z forward."""

ARMS = tuple(f"{side}_{part}" for side in ("right", "left") for part in ("shoulder", "elbow", "hand"))


@dataclass(frozen=True)
class Driver:
    """A tracker as a test plays it.

    Attributes:
        source: As parameters would make it.
        messages: What it publishes of a person before a camera, whose frame has optical axes.
        tolerance_m: What its messages lose.
    """

    source: SkeletonSource
    messages: Callable[[SkeletonFrame], Sent]
    tolerance_m: float = 1e-9


FLOAT32_M = 3e-6
"""float32 of positions up to 3 m away is off by 1.2e-7 m; the rotation into the arm frame and bones of a tenth of a
metre that are brought to another length make it an order more."""


def azure_kinect(person: SkeletonFrame) -> Sent:
    yield "skeleton", people_to_marker_array([person], SOURCES["azure_kinect"])


def nuitrack(person: SkeletonFrame) -> Sent:
    """Spheres of 14 joints, then 13 lines whose ends are in `points` and whose pose is left at zero."""
    stamped = Header(stamp=time_to_msg(person.stamp_ns), frame_id="camera_color_optical_frame")
    message = MarkerArray()
    for number, name in SOURCES["nuitrack"].joint_ids.items():
        x, y, z = person.positions_m[person.joint_names.index(name)].tolist()
        pose = Pose(position=Point(x=x, y=y, z=z))
        marker = Marker(header=stamped, ns="nuitrack_skeleton", id=number, type=Marker.SPHERE, pose=pose)
        message.markers.append(marker)
    for number in range(14, 27):
        ends = [Point(x=1.0), Point(y=1.0)]
        line = Marker(header=stamped, ns="nuitrack_skeleton", id=number, type=Marker.LINE_STRIP, points=ends)
        message.markers.append(line)
    yield "skeleton", message


NAMED = SOURCES["pose_array"].with_joints(BODY_JOINTS, "optical")


def pose_array(person: SkeletonFrame) -> Sent:
    yield "skeleton", person_to_pose_array(person, NAMED)


def point_cloud(person: SkeletonFrame) -> Sent:
    """Two rows: the person, and another one two metres behind; float32 with a confidence and four bytes of padding."""
    names = ("x", "y", "z", "confidence")
    fields = [PointField(name=name, offset=4 * at, datatype=7, count=1) for at, name in enumerate(names)]
    points = np.zeros((2, len(BODY_JOINTS), 5), np.float32)
    points[..., :3] = person.positions_m[[person.joint_names.index(name) for name in BODY_JOINTS]]
    points[1, :, 2] += 2.0
    points[..., 3] = 0.9
    yield (
        "skeleton",
        PointCloud2(
            header=Header(stamp=time_to_msg(person.stamp_ns), frame_id="camera_optical"),
            height=2,
            width=len(BODY_JOINTS),
            fields=fields,
            point_step=20,
            row_step=20 * len(BODY_JOINTS),
            data=points.tobytes(),
        ),
    )


def mediapipe(person: SkeletonFrame) -> Sent:
    """World landmarks: metres from between the hips, with visibility."""
    places = dict(zip(person.joint_names, person.positions_m, strict=True))
    middle = (places["left_hip"] + places["right_hip"]) / 2.0
    rows = np.full((33, 4), 0.5, np.float32)
    for number, name in SOURCES["mediapipe"].joint_ids.items():
        rows[number] = [*(places[name] - middle), 0.99]
    yield "skeleton", Float32MultiArray(data=rows.ravel().tolist())


def in_room(person: SkeletonFrame) -> dict[str, FloatArray]:
    return dict(zip(person.joint_names, person.positions_m @ ROOM_FROM_OPTICAL.T, strict=True))


BODIES = (*ARMS, "pelvis")


def motion_capture(person: SkeletonFrame) -> Sent:
    """A rigid body after the other, all with the time of the camera frame."""
    for name in BODIES:
        x, y, z = in_room(person)[name].tolist()
        stamped = Header(stamp=time_to_msg(person.stamp_ns), frame_id="world")
        yield f"/vrpn_mocap/{name}/pose", PoseStamped(header=stamped, pose=Pose(position=Point(x=x, y=y, z=z)))


def transform(parent: str, child: str, stamp_ns: int, place: FloatArray, rotation: FloatArray | None = None) -> Any:
    x, y, z = map(float, place)
    qx, qy, qz, qw = map(float, (0.0, 0.0, 0.0, 1.0) if rotation is None else rotation)
    return foreign(
        "geometry_msgs/msg/TransformStamped",
        header=header(stamp_ns, parent),
        child_frame_id=child,
        transform=foreign(
            "geometry_msgs/msg/Transform",
            translation=foreign("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            rotation=foreign("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
        ),
    )


def tf(person: SkeletonFrame) -> Sent:
    """`openni_tracker`: a message per joint and user, all below the depth camera's frame, x forward."""
    for name in BODIES:
        moved = transform("openni_depth_frame", f"{name}_2", person.stamp_ns, in_room(person)[name])
        yield "/tf", received(foreign("tf2_msgs/msg/TFMessage", transforms=[moved]))


def quaternion(matrix: FloatArray) -> FloatArray:
    """x y z w of a rotation by less than half a turn."""
    w = np.sqrt(1.0 + np.trace(matrix)) / 2.0
    x, y, z = matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]
    return np.array([x / (4 * w), y / (4 * w), z / (4 * w), w])


def turned_to(x: FloatArray) -> FloatArray:
    """A rotation matrix whose first column points along `x`."""
    x = x / np.linalg.norm(x)
    y = np.cross([0.3, 0.9, 0.3], x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def hri(person: SkeletonFrame) -> Sent:
    """A chain of frames as `robot_state_publisher` makes it of the human's URDF: the wrist is fixed to the elbow."""
    places, stamp_ns, of = in_room(person), person.stamp_ns, "_kdfqx"
    turned = turned_to(np.array([-0.4, 0.2, 0.1]))
    body = transform("camera_link", f"body{of}", stamp_ns, places["pelvis"], quaternion(turned))
    chain, fixed = [], []
    for side in ("left", "right"):
        shoulder, elbow, wrist = (places[f"{side}_{part}"] for part in ("shoulder", "elbow", "wrist"))
        hand = turned_to(turned.T @ (wrist - elbow))
        short = side[0]
        chain.append(
            transform(f"body{of}", f"{short}_shoulder{of}", stamp_ns, turned.T @ (shoulder - places["pelvis"]))
        )
        chain.append(
            transform(
                f"{short}_shoulder{of}",
                f"{short}_elbow{of}",
                stamp_ns,
                turned.T @ (elbow - shoulder),
                quaternion(hand),
            )
        )
        length = np.array([np.linalg.norm(wrist - elbow), 0.0, 0.0])
        fixed.append(transform(f"{short}_elbow{of}", f"{short}_wrist{of}", 0, length))
    yield (
        "/humans/bodies/tracked",
        received(foreign("hri_msgs/msg/IdsList", header=header(stamp_ns, ""), ids=[of.strip("_")])),
    )
    for topic, transforms in (("/tf_static", fixed), ("/tf", [body]), ("/tf", chain)):
        yield topic, received(foreign("tf2_msgs/msg/TFMessage", transforms=transforms))


def zed(body_format: int) -> Callable[[SkeletonFrame], Sent]:
    """A body of this format; joints that were not seen are NaN, places behind the last one zero."""
    joint_ids = SOURCES["zed"].formats[body_format]

    def messages(person: SkeletonFrame) -> Sent:
        places = in_room(person)
        keypoints = [foreign("zed_msgs/msg/Keypoint3D") for _ in range(70)]
        for number in range((18, 34, 38)[body_format]):
            place = places.get(joint_ids.get(number, ""), np.full(3, np.nan))
            keypoints[number].kp[:] = place
        body = foreign(
            "zed_msgs/msg/Object",
            label=f"Body_{person.person_id}",
            label_id=person.person_id,
            confidence=86.0,
            tracking_available=True,
            tracking_state=1,
            skeleton_available=True,
            body_format=body_format,
            skeleton_3d=foreign("zed_msgs/msg/Skeleton3D", keypoints=keypoints),
        )
        stamped = header(person.stamp_ns, "zed_left_camera_frame")
        yield "skeleton", received(foreign("zed_msgs/msg/ObjectsStamped", header=stamped, objects=[body]))

    return messages


def yolo(person: SkeletonFrame) -> Sent:
    """A person and a chair; the ears are below the threshold and left out, so places in the list shift."""
    points = [
        foreign(
            "yolo_msgs/msg/KeyPoint3D",
            id=number,
            point=foreign(
                "geometry_msgs/msg/Point", **dict(zip("xyz", map(float, in_room(person)[name]), strict=True))
            ),
            score=0.8,
        )
        for number, name in SOURCES["yolo"].joint_ids.items()
        if "ear" not in name
    ]
    seen = foreign(
        "yolo_msgs/msg/Detection",
        class_name="person",
        score=0.9,
        id=str(person.person_id),
        keypoints3d=foreign("yolo_msgs/msg/KeyPoint3DArray", data=points, frame_id="base_link"),
    )
    chair = foreign("yolo_msgs/msg/Detection", class_name="chair", score=0.7, id="11")
    stamped = header(person.stamp_ns, "camera_color_optical_frame")
    yield "skeleton", received(foreign("yolo_msgs/msg/DetectionArray", header=stamped, detections=[chair, seen]))


DRIVERS = {
    "azure_kinect": Driver(SOURCES["azure_kinect"], azure_kinect),
    "nuitrack": Driver(SOURCES["nuitrack"], nuitrack),
    "pose_array": Driver(NAMED, pose_array),
    "point_cloud": Driver(SOURCES["point_cloud"].with_joints(BODY_JOINTS, "optical"), point_cloud, FLOAT32_M),
    "mediapipe": Driver(SOURCES["mediapipe"], mediapipe, FLOAT32_M),
    "motion_capture": Driver(
        SOURCES["motion_capture"].with_joints(BODIES, "rep103", tuple(f"/vrpn_mocap/{name}/pose" for name in BODIES)),
        motion_capture,
    ),
    "tf": Driver(SOURCES["tf"].with_joints(BODIES, "rep103", tuple(f"{name}_{{}}" for name in BODIES)), tf),
    "hri": Driver(replace(SOURCES["hri"], axes="rep103"), hri),
    "zed": Driver(SOURCES["zed"], zed(2), FLOAT32_M),
    "zed BODY_18": Driver(SOURCES["zed"], zed(0), FLOAT32_M),
    "zed BODY_34": Driver(SOURCES["zed"], zed(1), FLOAT32_M),
    "yolo": Driver(SOURCES["yolo"], yolo),
}
"""By source, and what follows a blank."""
