# SPDX-License-Identifier: Apache-2.0
"""Pictures of robot and person by PyBullet's software renderer: no window, no graphics card."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from PIL import Image

from mild_core.retargeting.robot_model.capsules import TABLE_AT_M, TABLE_M, table_of
from mild_core.retargeting.robot_model.kinematics import read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import FIXED
from mild_core.shapes import FloatArray
from mild_ros.simulation.bullet import load_pybullet
from mild_ros.simulation.quiet import quiet_terminal
from mild_ros.simulation.trial_load import survivable
from mild_ros.viewing.body import BodyPart, Places

OVERSAMPLING = 2
"""Each pixel is the mean of so many squared: the renderer itself draws hard edges."""

BACKGROUND, FLOOR, FLOOR_RADIUS_M = (248, 249, 251), (222, 226, 232), 1.9
MOST_JOINTS = 120
"""PyBullet has room for a few more; of a robot with more joints, only the arm moves in pictures."""

TABLE_TOP, TABLE_FOOT = (0.36, 0.39, 0.44, 1.0), (0.58, 0.61, 0.66, 1.0)


@dataclass(frozen=True)
class Viewpoint:
    """Where the camera is: it looks at `target_m` from `distance_m`, turned and raised by degrees."""

    target_m: tuple[float, float, float]
    distance_m: float
    turned_deg: float
    raised_deg: float
    opening_deg: float = 30.0


class Renderer:
    """A stage with one robot on a table and at most one person; made by `open_renderer`."""

    def __init__(self, bullet: ModuleType, client: int, robot: RobotModel, floor_m: float) -> None:
        self._bullet, self._client = bullet, client
        self._tree = read_tree(robot.urdf_path)
        movable = [joint.name for joint in self._tree.by_child.values() if joint.kind not in FIXED]
        shown = survivable(robot, movable if len(movable) <= MOST_JOINTS else ())
        self._robot = bullet.loadURDF(str(shown), useFixedBase=True, physicsClientId=client)
        self._joints = {
            bullet.getJointInfo(self._robot, index, physicsClientId=client)[1].decode(): index
            for index in range(bullet.getNumJoints(self._robot, physicsClientId=client))
        }
        boxes = [bullet.getAABB(self._robot, link, physicsClientId=client) for link in (-1, *self._joints.values())]
        self.top_m = max(high[2] for _, high in boxes)
        self._parts: list[tuple[BodyPart, int]] = []
        self._furniture(floor_m, robot)
        self.place(robot.at_home, None)

    def add_person(self, parts: Sequence[BodyPart]) -> None:
        """Bring a person on stage; `place` moves them."""
        for part in parts:
            surface = part.surface
            visual = self._bullet.createVisualShape(
                self._bullet.GEOM_MESH,
                vertices=surface.vertices_m.tolist(),
                normals=surface.normals.tolist(),
                indices=surface.faces.ravel().tolist(),
                rgbaColor=[*part.colour, 1.0],
                specularColor=[0.05, 0.05, 0.05],
                physicsClientId=self._client,
            )
            body = self._bullet.createMultiBody(0, -1, visual, physicsClientId=self._client)
            self._parts.append((part, body))

    def place(self, joints: Mapping[str, float], person: Places | None) -> None:
        """Put the robot's joints [rad] and the person's [m, robot's base frame] where they belong."""
        for joint in self._tree.by_child.values():
            leader, ratio, offset = self._tree.followed(joint)
            if joint.name in self._joints and leader in joints:
                position_rad = ratio * joints[leader] + offset
                self._bullet.resetJointState(
                    self._robot, self._joints[joint.name], position_rad, physicsClientId=self._client
                )
        for part, body in self._parts:
            if person is not None:
                rotation, position = part.pose(person)
                self._bullet.resetBasePositionAndOrientation(
                    body, position.tolist(), quaternion(rotation).tolist(), physicsClientId=self._client
                )
        if person is not None:
            feet = [0.5 * (person[f"{side}_ankle"] + person[f"{side}_foot"]) for side in ("left", "right")]
            self._stands[1:] = [(float(x), float(y), 0.13) for x, y, _ in feet]

    def picture(self, view: Viewpoint, width: int, height: int) -> Image.Image:
        """What the camera sees, `width` by `height` pixels."""
        wide, high = width * OVERSAMPLING, height * OVERSAMPLING
        eye = self._bullet.computeViewMatrixFromYawPitchRoll(
            view.target_m, view.distance_m, view.turned_deg, -view.raised_deg, 0.0, 2
        )
        lens = self._bullet.computeProjectionMatrixFOV(view.opening_deg, wide / high, 0.1, 20.0)
        _, _, colours, depth, objects = self._bullet.getCameraImage(
            wide,
            high,
            eye,
            lens,
            lightDirection=_beside_camera(view),
            lightAmbientCoeff=0.70,
            lightDiffuseCoeff=0.42,
            lightSpecularCoeff=0.06,
            shadow=0,
            renderer=self._bullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        pixels = np.array(colours, dtype=np.float64).reshape(high, wide, 4)[..., :3]
        seen = np.array(objects).reshape(high, wide)
        floor = seen == self._floor
        places = _unprojected(np.array(depth).reshape(high, wide)[floor], floor, eye, lens)
        pixels[floor] = self._floor_colour(places)
        pixels[seen < 0] = BACKGROUND
        picture = Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))
        return picture.resize((width, height), Image.Resampling.LANCZOS)

    def pixel(
        self, view: Viewpoint, width: int, height: int, point_m: Sequence[float] | FloatArray
    ) -> tuple[float, float]:
        """Where a point of the robot's base frame is in such a picture: columns from the left, rows from the top."""
        eye = self._bullet.computeViewMatrixFromYawPitchRoll(
            view.target_m, view.distance_m, view.turned_deg, -view.raised_deg, 0.0, 2
        )
        lens = self._bullet.computeProjectionMatrixFOV(view.opening_deg, width / height, 0.1, 20.0)
        seen = np.reshape(lens, (4, 4)).T @ np.reshape(eye, (4, 4)).T @ np.array([*point_m, 1.0])
        return float((seen[0] / seen[3] + 1.0) / 2.0 * width), float((1.0 - seen[1] / seen[3]) / 2.0 * height)

    def _floor_colour(self, places_m: FloatArray) -> FloatArray:
        """Soft shadows under whatever stands there, fading into the background: the renderer's own are jagged."""
        shade = np.zeros(len(places_m))
        for x, y, reach in self._stands:
            distance = np.hypot(places_m[:, 0] - x, places_m[:, 1] - y)
            shade = np.maximum(shade, np.exp(-0.5 * (distance / reach) ** 2))
        fade = np.clip(np.hypot(places_m[:, 0] - 0.35, places_m[:, 1]) / FLOOR_RADIUS_M, 0.0, 1.0)[:, None] ** 3
        colour = np.array(FLOOR) * (1.0 - 0.38 * shade[:, None])
        mixed: FloatArray = (1.0 - fade) * colour + fade * np.array(BACKGROUND)
        return mixed

    def _furniture(self, floor_m: float, robot: RobotModel) -> None:
        if robot.on_table:
            (x, y), half, top_m = TABLE_AT_M, (TABLE_M[0] / 2.0, TABLE_M[1] / 2.0), table_of(robot).top_m
            self._box((*half, 0.02), (x, y, top_m - 0.02), TABLE_TOP)
            foot = max(0.5 * (top_m - 0.04 - floor_m), 0.01)
            self._box((half[0] - 0.1, half[1] - 0.1, foot), (x - 0.02, y, floor_m + foot), TABLE_FOOT)
        self._stands = [(TABLE_AT_M[0], TABLE_AT_M[1], 0.34) if robot.on_table else (0.0, 0.0, 0.28)]
        self._floor = self._box((4.0, 4.0, 0.01), (0.0, 0.0, floor_m - 0.01), (0.8, 0.8, 0.8, 1.0))

    def _box(self, half_m: Sequence[float], centre_m: Sequence[float], colour: Sequence[float]) -> int:
        visual = self._bullet.createVisualShape(
            self._bullet.GEOM_BOX, halfExtents=list(half_m), rgbaColor=list(colour), physicsClientId=self._client
        )
        return int(self._bullet.createMultiBody(0, -1, visual, list(centre_m), physicsClientId=self._client))


@contextmanager
def open_renderer(robot: RobotModel, floor_m: float) -> Iterator[Renderer]:
    """A renderer with `robot` at the origin and the floor at `floor_m`.

    Raises:
        SetupError: PyBullet is not installed.
    """
    bullet = load_pybullet()
    with quiet_terminal():
        client = bullet.connect(bullet.DIRECT)
        renderer = Renderer(bullet, client, robot, floor_m)
    try:
        yield renderer
    finally:
        bullet.disconnect(client)


def _beside_camera(view: Viewpoint) -> list[float]:
    """Where light comes from: above the camera's left shoulder."""
    x, y, z = -0.7, -1.4, 2.0
    cosine, sine = np.cos(np.radians(view.turned_deg)), np.sin(np.radians(view.turned_deg))
    return [float(cosine * x - sine * y), float(sine * x + cosine * y), z]


def _unprojected(depth: FloatArray, where: np.ndarray, eye: Sequence[float], lens: Sequence[float]) -> FloatArray:
    """World places (N, 3) of the pixels `where`, from the depth buffer; OpenGL's conventions."""
    high, wide = where.shape
    rows, columns = np.nonzero(where)
    across, up = 2.0 * (columns + 0.5) / wide - 1.0, 1.0 - 2.0 * (rows + 0.5) / high
    clip = np.stack([across, up, 2.0 * depth - 1.0, np.ones(len(rows))])
    # OpenGL's matrices come column by column.
    world = np.linalg.inv(np.reshape(lens, (4, 4)).T @ np.reshape(eye, (4, 4)).T) @ clip
    places_m: FloatArray = (world[:3] / world[3]).T
    return places_m


def quaternion(rotation: FloatArray) -> FloatArray:
    """x y z w of a rotation matrix.

    Source: Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1978: the largest component first.
    """
    squares = np.array([*np.diag(rotation), np.trace(rotation)])
    largest = int(np.argmax(squares))
    if largest == 3:
        w = 1.0 + squares[3]
        x, y, z = rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]
        found = np.array([x, y, z, w])
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        found = np.zeros(4)
        found[i] = 1.0 + rotation[i, i] - rotation[j, j] - rotation[k, k]
        found[j] = rotation[j, i] + rotation[i, j]
        found[k] = rotation[k, i] + rotation[i, k]
        found[3] = rotation[k, j] - rotation[j, k]
    unit: FloatArray = found / np.linalg.norm(found)
    return unit
