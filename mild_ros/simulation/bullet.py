# SPDX-License-Identifier: Apache-2.0
"""The robot in PyBullet: real dynamics at 240 Hz under position control, and pictures without a display.

Works with `pybullet` (Python 3.10, 3.11) and its maintained fork `pybullet-arm64` (3.12), whose camera gives
tuples instead of arrays.
"""

from __future__ import annotations

import math
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mild_core.errors import SetupError
from mild_core.retargeting.robot import RobotModel
from mild_core.signals import JointCommand, JointMeasurement
from mild_ros.assembly.trial_load import try_load
from mild_ros.simulation.backend import Camera, Scene
from mild_ros.simulation.quiet import quiet_terminal

PHYSICS_RATE_HZ = 240
"""PyBullet's own default; its motors are tuned for it."""

POSITION_GAIN = 0.3
"""The best of those tried: 0.15 degrees tracking error."""

TABLE_TOP_M = -0.104
"""Height of what the robot stands on: the underside of its base."""

SOFTEST = 0.25
"""Share of its motors' force that the arm keeps in any case: enough to bear its own weight."""

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


class BulletRobot:
    """One robot on a fixed base, as `SimulatedRobot`.

    Args:
        robot: What is simulated.
        gui: Whether to open a window.
        scene: What stands around the robot; None for nothing.
        start_rad: (J,) where the commanded joints start; None for home.

    Raises:
        SetupError: PyBullet is not installed, or the description lacks a joint or cannot be loaded.
    """

    def __init__(
        self,
        robot: RobotModel,
        *,
        gui: bool = False,
        scene: Scene | None = None,
        start_rad: ArrayLike | None = None,
    ) -> None:
        self.robot = robot
        self._bullet: Any = load_pybullet()
        with quiet_terminal():
            self._client: int = self._bullet.connect(self._bullet.GUI if gui else self._bullet.DIRECT)
        if self._client < 0:
            raise SetupError("simulation", "PyBullet opens no window", "run without --gui or on a desktop")
        self._owed_s = 0.0
        self._stiffness = 1.0
        try:
            self._bullet.setTimeStep(1.0 / PHYSICS_RATE_HZ, physicsClientId=self._client)
            self._bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
            self._body, self._joints = self._load(robot.urdf_path)
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

    def _load(self, path: Path) -> tuple[int, dict[str, tuple[int, float]]]:
        """The body, and of each movable joint, commanded ones first, its number and largest force."""
        bullet = self._bullet
        try_load(path, "pybullet")
        try:
            with quiet_terminal():
                flags = bullet.URDF_USE_INERTIA_FROM_FILE
                body: int = bullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=self._client)
        except bullet.error as error:
            raise SetupError(str(path), f"PyBullet cannot load it ({error})", "give a valid URDF file") from error
        found: dict[str, tuple[int, float]] = {}
        for number in range(bullet.getNumJoints(body, physicsClientId=self._client)):
            info = bullet.getJointInfo(body, number, physicsClientId=self._client)
            self._lighten(body, number)
            if info[2] in (bullet.JOINT_REVOLUTE, bullet.JOINT_PRISMATIC):
                found[info[1].decode()] = (number, float(info[10]))
        missing = [name for name in self.robot.joint_names if name not in found]
        if missing:
            remedy = f"give a description of {self.robot.name}"
            raise SetupError(str(path), f"it has no joint {', '.join(missing)}", remedy)
        others = [name for name in found if name not in self.robot.joint_names]
        return body, {name: found[name] for name in (*self.robot.joint_names, *others)}

    def _lighten(self, body: int, link: int) -> None:
        """Take the kilogram and the kilogram square metre from a mere frame that PyBullet gives to it."""
        mass, _, inertia = self._bullet.getDynamicsInfo(body, link, physicsClientId=self._client)[:3]
        if mass == 1.0 and inertia == (1.0, 1.0, 1.0):
            light = {"mass": 1e-3, "localInertiaDiagonal": (1e-6, 1e-6, 1e-6)}
            self._bullet.changeDynamics(body, link, **light, physicsClientId=self._client)

    def _rest(self, start_rad: NDArray[np.float64]) -> None:
        """Put every joint where it starts, and hold the others there for good."""
        starts = dict(self.robot.rest) | dict(zip(self.robot.joint_names, start_rad.tolist(), strict=True))
        for name, (number, _) in self._joints.items():
            position = starts.get(name, 0.0)
            self._bullet.resetJointState(self._body, number, position, 0.0, physicsClientId=self._client)
            self._drive([name], [position], [0.0])

    def _drive(self, names: list[str], positions: list[float], velocities: list[float]) -> None:
        numbers, forces = zip(*(self._joints[name] for name in names), strict=True)
        self._bullet.setJointMotorControlArray(
            self._body,
            numbers,
            self._bullet.POSITION_CONTROL,
            targetPositions=positions,
            targetVelocities=velocities,
            positionGains=[POSITION_GAIN] * len(names),
            velocityGains=[1.0] * len(names),
            forces=[force * self._stiffness for force in forces],
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
        numbers = [number for number, _ in self._joints.values()]
        states = self._bullet.getJointStates(self._body, numbers, physicsClientId=self._client)
        return JointMeasurement(stamp_ns, tuple(self._joints), np.array([state[0] for state in states]))

    def _furnish(self, scene: Scene) -> None:
        if scene.table:
            x, y, half, thick = 0.0, 0.0, (0.42, 0.55), 0.02
            legs = (TABLE_TOP_M - 2 * thick - scene.floor_m) / 2.0
            self._block((half[0], half[1], thick), (x, y, TABLE_TOP_M - thick), WOOD)
            for sx, sy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
                foot = (x + sx * (half[0] - 0.05), y + sy * (half[1] - 0.05), scene.floor_m + legs)
                self._block((0.025, 0.025, legs), foot, METAL)
        self._block((8.0, 8.0, 0.01), (0.0, 0.0, scene.floor_m - 0.01), FLOOR)

    def _block(self, half: tuple[float, ...], centre: tuple[float, ...], rgba: tuple[float, ...]) -> None:
        bullet, where = self._bullet, {"physicsClientId": self._client}
        shape = bullet.createVisualShape(bullet.GEOM_BOX, halfExtents=half, rgbaColor=rgba, **where)
        bullet.createMultiBody(0.0, -1, shape, basePosition=centre, **where)

    def render(self, camera: Camera) -> NDArray[np.uint8]:
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
