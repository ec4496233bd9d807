# SPDX-License-Identifier: Apache-2.0
"""The robot in PyBullet: real dynamics at 240 Hz under position control, and pictures without a display.

Works with `pybullet` (Python 3.10, 3.11) and its maintained fork `pybullet-arm64` (3.12), whose camera gives
tuples instead of arrays.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Collection
from dataclasses import dataclass
from types import ModuleType, TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mild_core.errors import SetupError
from mild_core.printable import printable_lines
from mild_core.retargeting.robot_model.capsules import TABLE_AT_M, TABLE_M, table_of
from mild_core.retargeting.robot_model.kinematics import KinematicTree, read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import FIXED
from mild_core.signals import JointCommand, JointMeasurement
from mild_ros.simulation.backend import RenderCamera, SimulatedScene
from mild_ros.simulation.quiet import quiet_terminal
from mild_ros.simulation.trial_load import survivable, try_window

PHYSICS_RATE_HZ = 240
"""PyBullet's own default; its motors are tuned for it."""

POSITION_GAIN = 0.3
"""The best of those tried: 0.15 degrees tracking error."""

SOFTEST, BEARING = 0.25, 1.3
"""Share of its motors' force that the arm keeps in any case, and how much more than its own weight it bears then."""

RESERVE = 1.5
"""Motors of unknown force have this much more than they need."""

TRIED, SEED = 100, 7
"""Random poses in which that is computed."""

WOOD, METAL, FLOOR = (0.82, 0.76, 0.68, 1.0), (0.45, 0.46, 0.48, 1.0), (0.93, 0.93, 0.94, 1.0)

BACKGROUND = (250, 226)
"""Grey of a picture where nothing is, top and bottom."""


def load_pybullet() -> ModuleType:
    """The module, imported without its greeting.

    Raises:
        SetupError: It is not installed.
    """
    try:
        with quiet_terminal():
            import pybullet
    except ImportError as error:
        remedy = "install pybullet (Python 3.11) or pybullet-arm64 (3.12)"
        raise SetupError("simulation", f"PyBullet cannot be imported ({error})", remedy) from error
    module: ModuleType = pybullet
    return module


@dataclass(frozen=True)
class _Motor:
    """What drives a joint.

    Attributes:
        number: PyBullet's, of the joint.
        leader: The commanded joint whose position it has ...
        ratio: ... so often ...
        offset: ... and so much more [rad].
        force: Its largest torque [N m].
        bearing: With so much it bears the arm.
    """

    number: int
    leader: str
    ratio: float
    offset: float
    force: float
    bearing: float

    def place(self, leader_rad: float) -> float:
        """Where the joint is when its leader is there."""
        return self.ratio * leader_rad + self.offset


def _standing(robot: RobotModel, tree: KinematicTree, moving: Collection[str]) -> dict[str, float]:
    """Where the joints that nothing commands stand for good, by name."""
    places = {}
    for joint in tree.by_child.values():
        if joint.kind not in FIXED and joint.name not in moving:
            leader, ratio, offset = tree.followed(joint)
            places[joint.name] = ratio * robot.at_home.get(leader, 0.0) + offset
    return places


class BulletRobot:
    """One robot on a fixed base, which takes commands and says where it is.

    Args:
        robot: What is simulated.
        gui: Whether to open a window.
        scene: What stands around the robot; None for nothing.
        start_rad: (J,) where the commanded joints start; None for home.

    Raises:
        SetupError: PyBullet is not installed, there is no display, or the description cannot be loaded.
    """

    def __init__(
        self,
        robot: RobotModel,
        *,
        gui: bool = False,
        scene: SimulatedScene | None = None,
        start_rad: ArrayLike | None = None,
    ) -> None:
        self.robot = robot
        self._bullet: Any = load_pybullet()
        if gui:
            try_window()
        with quiet_terminal():
            self._client: int = self._bullet.connect(self._bullet.GUI if gui else self._bullet.DIRECT)
        if self._client < 0:
            raise SetupError("simulation", "PyBullet cannot be started", "run without gui, or on a desktop")
        self._owed_s = 0.0
        self._stiffness = 1.0
        try:
            self._bullet.setTimeStep(1.0 / PHYSICS_RATE_HZ, physicsClientId=self._client)
            self._bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
            tree = read_tree(robot.urdf_path)
            self._body, self._joints = self._load(tree)
            self._standing = _standing(robot, tree, self._joints)
            if scene is not None:
                self._furnish(scene)
            self._rest(robot.home_rad if start_rad is None else np.asarray(start_rad, dtype=np.float64))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> BulletRobot:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _load(self, tree: KinematicTree) -> tuple[int, dict[str, _Motor]]:
        """The body, and the motor of each joint that moves, commanded ones first."""
        bullet, robot = self._bullet, self.robot
        joints = {joint.name: joint for joint in tree.by_child.values()}
        missing = [name for name in robot.joint_names if name not in joints]
        if missing:
            remedy = f"give a description of {robot.name}"
            raise SetupError(robot.source, f"it has no joint {', '.join(missing)}", remedy)
        path = survivable(robot)
        try:
            with quiet_terminal():
                flags = bullet.URDF_USE_INERTIA_FROM_FILE
                body: int = bullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=self._client)
        except bullet.error as error:
            raise SetupError(robot.source, f"PyBullet cannot load it ({error})", "give a valid URDF file") from error
        found = [
            bullet.getJointInfo(body, number, physicsClientId=self._client)[1].decode()
            for number in range(bullet.getNumJoints(body, physicsClientId=self._client))
        ]
        follows = [tree.followed(joints[name]) for name in found]
        force, bearing = self._forces(body, found, follows, np.array([joints[name].effort for name in found]))
        motors = {
            name: _Motor(number, *follows[number], float(force[number]), float(bearing[number]))
            for number, name in enumerate(found)
        }
        copies = [name for name in found if name not in robot.joint_names]
        return body, {name: motors[name] for name in (*robot.joint_names, *copies) if name in motors}

    def _forces(
        self, body: int, names: list[str], follows: list[tuple[str, float, float]], efforts: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(N,) and (N,) torques [N m] that each joint's motor has, and with which it bears the arm anywhere.

        Descriptions often know no effort, or less than the arm weighs; no robot is built so. Such motors get what they
        need for the robot's own limits.
        """
        bullet, robot, client = self._bullet, self.robot, {"physicsClientId": self._client}
        columns = [robot.joint_names.index(leader) for leader, _, _ in follows]
        ratios, offsets = (np.array([each[place] for each in follows]) for place in (1, 2))
        still = [0.0] * len(names)
        weight, swing = np.zeros(len(names)), np.zeros(len(names))
        acceleration = np.abs(ratios) * robot.acceleration_rad_s2[columns]
        for pose in np.random.default_rng(SEED).uniform(robot.lower_rad, robot.upper_rad, (TRIED, len(robot.home_rad))):
            at = (ratios * pose[columns] + offsets).tolist()
            weight = np.maximum(weight, np.abs(bullet.calculateInverseDynamics(body, at, still, still, **client)))
            mass = np.abs(bullet.calculateMassMatrix(body, at, **client))
            swing = np.maximum(swing, mass @ acceleration)
        damping = np.array([bullet.getJointInfo(body, number, **client)[6] for number in range(len(names))])
        need = RESERVE * (weight + swing) + damping * np.abs(ratios) * robot.velocity_rad_s[columns]
        unknown, weak = efforts <= 0.0, (efforts > 0.0) & (efforts < weight)
        for which, what in ((unknown, "say no effort"), (weak, "have less effort than their arm weighs")):
            if which.any():
                shown = ", ".join(f"{names[i]} {need[i]:.3g}" for i in np.flatnonzero(which))
                note = f"{robot.source}: joints {what}; they are simulated with what it takes [N m]: {shown}"
                logging.getLogger(__name__).warning("%s", printable_lines(note))
        return np.where(unknown | weak, need, efforts), BEARING * weight

    def _rest(self, start_rad: NDArray[np.float64]) -> None:
        """Put every joint where it starts."""
        for motor in self._joints.values():
            position = motor.place(start_rad[self.robot.joint_names.index(motor.leader)])
            self._bullet.resetJointState(self._body, motor.number, position, 0.0, physicsClientId=self._client)
        names = list(self.robot.joint_names)
        self._drive(names, start_rad.tolist(), [0.0] * len(names))

    def _drive(self, names: list[str], positions: list[float], velocities: list[float]) -> None:
        """Send joints, and those that copy them, on their way."""
        wanted = {name: each for name, *each in zip(names, positions, velocities, strict=True)}
        motors = [motor for motor in self._joints.values() if motor.leader in wanted]
        self._bullet.setJointMotorControlArray(
            self._body,
            [motor.number for motor in motors],
            self._bullet.POSITION_CONTROL,
            targetPositions=[motor.place(wanted[motor.leader][0]) for motor in motors],
            targetVelocities=[motor.ratio * wanted[motor.leader][1] for motor in motors],
            positionGains=[POSITION_GAIN] * len(motors),
            velocityGains=[1.0] * len(motors),
            forces=[max(motor.force * self._stiffness, min(motor.force, motor.bearing)) for motor in motors],
            physicsClientId=self._client,
        )

    def stiffen(self, stiffness: float) -> None:
        """Scale the motors' forces from the next command on: 1 for all they have, never below `SOFTEST`."""
        self._stiffness = min(max(stiffness, SOFTEST), 1.0) if math.isfinite(stiffness) else 1.0

    def step(self, command: JointCommand | None, duration_s: float) -> None:
        """Let `duration_s` pass under `command`; None keeps the command before.

        Time less than one step of the physics is owed to the next call. Commands for joints that the robot does
        not have, and non-finite ones, are not carried out.
        """
        if command is not None:
            known = [place for place, name in enumerate(command.joint_names) if name in self._joints]
            numbers = np.stack([command.positions_rad, command.velocities_rad_s])[:, known]
            if known and np.isfinite(numbers).all():
                self._drive([command.joint_names[place] for place in known], *numbers.tolist())
        self._owed_s += duration_s
        # A millionth of a step more, so that rounding does not lose a step of 1/240 s given as such.
        steps = int(self._owed_s * PHYSICS_RATE_HZ + 1e-6)
        self._owed_s -= steps / PHYSICS_RATE_HZ
        for _ in range(steps):
            self._bullet.stepSimulation(physicsClientId=self._client)

    def measure(self, stamp_ns: int) -> JointMeasurement:
        """Where all movable joints are, the commanded ones first."""
        numbers = [motor.number for motor in self._joints.values()]
        states = self._bullet.getJointStates(self._body, numbers, physicsClientId=self._client)
        positions = [*(state[0] for state in states), *self._standing.values()]
        return JointMeasurement(stamp_ns, (*self._joints, *self._standing), np.array(positions))

    def _furnish(self, scene: SimulatedScene) -> None:
        if scene.table:
            (x, y), half, thick = TABLE_AT_M, (TABLE_M[0] / 2.0, TABLE_M[1] / 2.0), 0.02
            top_m = table_of(self.robot).top_m
            legs = max((top_m - 2 * thick - scene.floor_m) / 2.0, 0.01)
            self._block((half[0], half[1], thick), (x, y, top_m - thick), WOOD)
            for sx, sy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
                foot = (x + sx * (half[0] - 0.05), y + sy * (half[1] - 0.05), scene.floor_m + legs)
                self._block((0.025, 0.025, legs), foot, METAL)
        self._block((8.0, 8.0, 0.01), (0.0, 0.0, scene.floor_m - 0.01), FLOOR)

    def _block(self, half: tuple[float, ...], centre: tuple[float, ...], rgba: tuple[float, ...]) -> None:
        bullet, where = self._bullet, {"physicsClientId": self._client}
        shape = bullet.createVisualShape(bullet.GEOM_BOX, halfExtents=half, rgbaColor=rgba, **where)
        bullet.createMultiBody(0.0, -1, shape, basePosition=centre, **where)

    def render(self, camera: RenderCamera) -> NDArray[np.uint8]:
        """A picture: (height, width, 3), red, green and blue."""
        bullet, scale = self._bullet, camera.smoothing
        width, height = camera.width * scale, camera.height * scale
        view = bullet.computeViewMatrix(camera.eye_m, camera.target_m, (0.0, 0.0, 1.0))
        lens = bullet.computeProjectionMatrixFOV(camera.field_of_view_deg, width / height, 0.05, 20.0)
        pixels = bullet.getCameraImage(
            width,
            height,
            view,
            lens,
            lightDirection=(1.5, -2.0, 4.0),
            shadow=int(camera.shadow),
            lightAmbientCoeff=0.6,
            lightDiffuseCoeff=0.45,
            lightSpecularCoeff=0.05,
            renderer=bullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        image = np.array(pixels[2], dtype=np.uint8).reshape(height, width, 4)[..., :3]
        nothing = np.asarray(pixels[4]).reshape(height, width) < 0
        # A soft grey that darkens downwards lets a white robot stand out.
        image = np.where(nothing[..., None], np.linspace(*BACKGROUND, height)[:, None, None], image)
        squares = image.reshape(camera.height, scale, camera.width, scale, 3)
        averaged: NDArray[np.uint8] = squares.mean(axis=(1, 3)).round().astype(np.uint8)
        return averaged

    def close(self) -> None:
        """Give everything back. Calling it twice is allowed."""
        if self._client >= 0:
            self._bullet.disconnect(physicsClientId=self._client)
            self._client = -1
