# SPDX-License-Identifier: Apache-2.0
"""The judge's own robot: its shapes in PyBullet and its kinematics in pinocchio, nothing of the package's solvers."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio

from mild_core.retargeting.contact import shoulder_and_reach_m
from mild_core.retargeting.guard import Guard
from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robot_model.rigid_bodies import rigid_bodies
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_ros.benchmark.bodies import Array, Capsule, Person, capsules_of
from mild_ros.simulation.bullet import load_pybullet
from mild_ros.simulation.quiet import quiet_terminal

WITHIN_M, KEPT_M, RESTARTS, STEPS = 0.02, 0.05, 30, 60
"""A hand is reachable where a pose brings the tool within the first of it and keeps the second from head and trunk,
found in one of so many random starts with so many steps each."""

DAMPING, LONGEST_STEP_RAD = 1e-3, 0.4
LOOKED_AT_M = 0.35


class Nearest(NamedTuple):
    """What of the robot is nearest to a body.

    Attributes:
        apart_m: Distance; negative where they overlap.
        speed_m_s: Of the robot there.
    """

    apart_m: float
    speed_m_s: float


class Judge:
    """One robot to measure distances of and to ask what it can reach."""

    def __init__(self, robot: RobotModel) -> None:
        self.robot = robot
        text = rigid_bodies(robot)
        self._bullet: Any = load_pybullet()
        self._client = self._bullet.connect(self._bullet.DIRECT)
        with tempfile.TemporaryDirectory() as folder, quiet_terminal():
            path = Path(folder, "judged.urdf")
            path.write_text(text)
            self._body = self._bullet.loadURDF(str(path), useFixedBase=True, physicsClientId=self._client)
            self._model = pinocchio.buildModelFromUrdf(str(path))
        self._data = self._model.createData()
        self._tool = self._frame(robot)
        numbers = {
            self._bullet.getJointInfo(self._body, k, physicsClientId=self._client)[1].decode(): k
            for k in range(self._bullet.getNumJoints(self._body, physicsClientId=self._client))
        }
        self._joints = [numbers[name] for name in robot.joint_names]
        self._places = [self._model.joints[self._model.getJointId(name)].idx_q for name in robot.joint_names]
        self._columns = [self._model.joints[self._model.getJointId(name)].idx_v for name in robot.joint_names]
        self._guard = Guard(robot, RetargetingSettings())
        shoulder, self.reach_m = shoulder_and_reach_m(robot)
        x, y, z = shoulder.tolist()
        self.shoulder_m = (x, y, z)
        # What the first joint turns on the spot, and what does not move, can give way to no one.
        self._still = {-1, self._joints[0]}
        self._shapes: dict[tuple[float, float], int] = {}

    def _frame(self, robot: RobotModel) -> tuple[int, Any]:
        """The joint that carries the tool, and where on it the tool is."""
        last = self._model.getJointId(robot.joint_names[-1])
        pinocchio.forwardKinematics(self._model, self._data, pinocchio.neutral(self._model))
        at = np.zeros(len(robot.joint_names))
        tool = np.append(chain_of(robot).tool(at), 1.0)
        return last, (np.linalg.inv(self._data.oMi[last].homogeneous) @ tool)[:3]

    def tool_m(self, positions_rad: Array) -> Array:
        """(3,) the tool in the robot's base frame."""
        pinocchio.forwardKinematics(self._model, self._data, self._spread(positions_rad))
        joint, offset = self._tool
        placed: Array = self._data.oMi[joint].act(offset)
        return placed

    def _spread(self, positions_rad: Array) -> Array:
        full: Array = pinocchio.neutral(self._model)
        full[self._places] = positions_rad
        return full

    def put(self, positions_rad: Array, velocities_rad_s: Array) -> None:
        """Pose the robot."""
        for number, place, rate in zip(self._joints, positions_rad.tolist(), velocities_rad_s.tolist(), strict=True):
            self._bullet.resetJointState(self._body, number, place, rate, physicsClientId=self._client)

    def nearest(self, capsules: Sequence[Capsule], points: dict[str, Array], moment: int) -> list[Nearest]:
        """What of the robot is nearest to each capsule; after `put`."""
        found = []
        for capsule in capsules:
            start, end = points[capsule.start][moment], points[capsule.end][moment]
            body = self._capsule(capsule.radius_m, float(np.linalg.norm(end - start)))
            along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
            half = np.array([-along[1], along[0], 0.0, 1.0 + along[2]])
            turn = half / np.linalg.norm(half) if along[2] > -0.999999 else np.array([1.0, 0.0, 0.0, 0.0])
            where = {"physicsClientId": self._client}
            self._bullet.resetBasePositionAndOrientation(body, ((start + end) / 2).tolist(), turn.tolist(), **where)
            near = self._bullet.getClosestPoints(self._body, body, LOOKED_AT_M, **where)
            near = [one for one in near if one[3] not in self._still]
            if not near:
                found.append(Nearest(math.inf, 0.0))
                continue
            speeds = [self._speed(one[3], one[5]) for one in near if one[8] < 0.3]
            found.append(Nearest(min(one[8] for one in near), max(speeds, default=0.0)))
        return found

    def _speed(self, link: int, point: tuple[float, float, float]) -> float:
        state = self._bullet.getLinkState(
            self._body, link, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=self._client
        )
        return float(np.linalg.norm(np.add(state[6], np.cross(state[7], np.subtract(point, state[0])))))

    def _capsule(self, radius_m: float, length_m: float) -> int:
        key = (round(radius_m, 3), round(length_m, 2))
        if key not in self._shapes:
            shape = self._bullet.createCollisionShape(
                self._bullet.GEOM_CAPSULE, radius=key[0], height=key[1], physicsClientId=self._client
            )
            self._shapes[key] = self._bullet.createMultiBody(0.0, shape, physicsClientId=self._client)
        return self._shapes[key]

    def collides(self, positions_rad: Array) -> bool:
        """Whether the robot meets itself."""
        return bool(self._guard.own_clearance_m(positions_rad[None])[0] < -0.02)

    def reaches(self, place_m: Array, person: Person, time_s: float, seed: int) -> bool:
        """Whether a pose meets a hand at a place, inside limits, clear of itself and of head and trunk.

        Damped least squares from random starts. Source: Nakamura and Hanafusa 1986.
        """
        rng, robot = np.random.default_rng(seed), self.robot
        kept = [one for one in capsules_of(person.sizes) if one.group in ("head", "trunk")]
        points = person.points(np.array([time_s]))
        margin = 0.01
        lower, upper = robot.lower_rad + margin, robot.upper_rad - margin
        for start in range(RESTARTS):
            at = np.clip(robot.home_rad, lower, upper) if start == 0 else rng.uniform(lower, upper)
            for _ in range(STEPS):
                off = place_m - self.tool_m(at)
                if np.linalg.norm(off) < 0.5 * WITHIN_M:
                    break
                jacobian = self._jacobian(at)
                step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(3), off)
                at = np.clip(at + np.clip(step, -LONGEST_STEP_RAD, LONGEST_STEP_RAD), lower, upper)
            if np.linalg.norm(place_m - self.tool_m(at)) > WITHIN_M or self.collides(at):
                continue
            self.put(at, np.zeros(len(at)))
            if all(one.apart_m > KEPT_M for one in self.nearest(kept, points, 0)):
                return True
        return False

    def _jacobian(self, at: Array) -> Array:
        """(3, J) of the tool; after `tool_m` of the same pose."""
        joint, offset = self._tool
        pinocchio.computeJointJacobians(self._model, self._data, self._spread(at))
        full = pinocchio.getJointJacobian(self._model, self._data, joint, pinocchio.LOCAL_WORLD_ALIGNED)
        lever = self._data.oMi[joint].rotation @ offset
        moved = full[:3] - np.cross(lever, full[3:].T).T * 1.0
        velocity: Array = moved[
            :, [self._model.joints[self._model.getJointId(n)].idx_v for n in self.robot.joint_names]
        ]
        return velocity

    def close(self) -> None:
        """Give everything back."""
        self._bullet.disconnect(physicsClientId=self._client)
