# SPDX-License-Identifier: Apache-2.0
"""From where links shall be to where the joints have to be: differential inverse kinematics, one warm step at a time.

A step is the least-squares motion towards the targets that stays inside the limits: a quadratic program of as many
variables as there are joints. The only file that knows the libraries: Pinocchio (rigid bodies: where links are and how
they move) and DAQP (dual active-set solver, which keeps the limits exactly). Libraries that put such programs together
in Python take four times as long for it.

Source: O. Kanoun et al., "Kinematic Control of Redundant Manipulators: Generalizing the Task-Priority Framework to
Inequality Tasks", T-RO 2011, with weights in place of priorities; damping by T. Sugihara, T-RO 2011.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.chain import chain_of, mount_of
from mild_core.retargeting.robot_model.kinematics import read_tree
from mild_core.retargeting.robot_model.rigid_bodies import rigid_bodies
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray, read_only

POSTURE_COST = 0.015
"""Metres that a radian away from the wanted posture is worth: what is left over for the posture decides where the
elbow goes, and 10 degrees of it are paid with less than a millimetre at the hand."""

DAMPING = 0.5
"""Of a step, times the square of the error: a target out of reach is neared without swinging from side to side."""

CONTORTED_M = 0.1
"""An arm whose hand is further away than this is on its way, not contorted: its posture is worth no more for it."""

HALVINGS = 3
"""Times that a step is halved that would come no nearer; without it one in six targets is circled for ever."""

SOLVED = 1
"""What DAQP says of a program that it has solved."""


@dataclass(frozen=True, eq=False)
class Reach:
    """Where a link shall be.

    Attributes:
        link: Its name; one of those the solver was made for.
        point_m: (3,) for the link's origin, in the robot's base frame.
        weight: How much it matters beside the others.
    """

    link: str
    point_m: FloatArray
    weight: float = 1.0


class InverseKinematics:
    """Steps towards postures in which links are where they shall be.

    It keeps nothing from call to call: equal arguments give equal results.

    Args:
        robot: Its joints that nothing commands stay at rest.
        links: Those that may be placed.
        margin_rad: Distance kept from the position limits.
        relent: How much more the posture is worth where a link does not come to its place, times the square of how far
            it is from it: an arm that cannot reach shall not contort itself for the last centimetres.

    Raises:
        SetupError: A library is not installed, or the description has no such link.
    """

    def __init__(self, robot: RobotModel, links: Sequence[str], margin_rad: float = 0.0, relent: float = 0.0) -> None:
        try:
            import daqp  # type: ignore[import-not-found]
            import pinocchio
        except ImportError as error:
            raise SetupError("inverse kinematics", f"a library is missing ({error})", "install pin and daqp") from error
        tree, chain = read_tree(robot.urdf_path), chain_of(robot)
        for link in links:
            tree.chain(link)  # says in one line what is wrong
        self._model = pinocchio.buildModelFromXML(rigid_bodies(robot, shapes=False))
        self._spread, self._shift = _spread(self._model, robot)
        self._lower, self._upper = robot.lower_rad + margin_rad, robot.upper_rad - margin_rad
        self._frames = {}
        for link in links:
            mount = mount_of(robot, tree, link)
            joint = self._model.getJointId(chain.names[mount.frame - 1]) if mount.frame else 0
            frame = pinocchio.Frame(f"{link}, placed", joint, pinocchio.SE3(mount.pose), pinocchio.OP_FRAME)
            self._frames[link] = self._model.addFrame(frame)
        self._data = self._model.createData()
        self._bodies, self._solve, self._relent = pinocchio, daqp.solve, relent
        self._no_rows = np.zeros((0, len(robot.joint_names)))  # of constraints: there are bounds alone

    def step(
        self, start_rad: FloatArray, reaches: Sequence[Reach], posture_rad: FloatArray, steps: int = 1
    ) -> FloatArray:
        """(J,) joints a few steps from `start_rad` towards the targets, inside the limits.

        Args:
            start_rad: (J,) where to begin: the result for the time before, if there is one.
            reaches: What shall be where. What they leave free is used to come near `posture_rad`.
            posture_rad: (J,) where the joints would be if it were not for the targets.
            steps: How many; one is enough from a start that is some centimetres away.
        """
        at: FloatArray = np.minimum(np.maximum(start_rad, self._lower), self._upper)
        for _ in range(steps):
            hessian, gradient, pull, cost = self._program(at, reaches, posture_rad)
            moved, _, found, _ = self._solve(hessian, gradient, self._no_rows, self._upper - at, self._lower - at)
            if found != SOLVED:
                break
            for _ in range(HALVINGS):
                there: FloatArray = np.minimum(np.maximum(at + moved, self._lower), self._upper)
                if self._cost(there, reaches, posture_rad, pull) <= cost:
                    at = there
                    break
                moved = 0.5 * moved
        return at

    def _cost(self, at: FloatArray, reaches: Sequence[Reach], posture: FloatArray, pull: float) -> float:
        """What a step makes less: squares of what is left of every error."""
        bodies, model, data = self._bodies, self._model, self._data
        bodies.forwardKinematics(model, data, self._spread @ at + self._shift)
        behind = at - posture
        cost = pull * float(behind @ behind)
        for reach in reaches:
            placed = bodies.updateFramePlacement(model, data, self._frames[reach.link]).translation
            left = reach.weight * (reach.point_m - placed)
            cost += float(left @ left)
        return cost

    def _program(
        self, at: FloatArray, reaches: Sequence[Reach], posture: FloatArray
    ) -> tuple[FloatArray, FloatArray, float, float]:
        """(J, J) and (J,) of the quadratic program for the step from `at`, what the posture is worth, and the cost."""
        bodies, model, data = self._bodies, self._model, self._data
        bodies.computeJointJacobians(model, data, self._spread @ at + self._shift)
        rows, left = [], []
        for reach in reaches:
            frame = self._frames[reach.link]
            left.append(reach.weight * (reach.point_m - bodies.updateFramePlacement(model, data, frame).translation))
            rows.append(reach.weight * bodies.getFrameJacobian(model, data, frame, bodies.LOCAL_WORLD_ALIGNED)[:3])
        jacobian, left_m = np.concatenate(rows) @ self._spread, np.concatenate(left)
        square = float(left_m @ left_m)
        pull = POSTURE_COST**2 + self._relent * min(square, CONTORTED_M**2)
        hessian = jacobian.T @ jacobian + (pull + DAMPING * square) * np.eye(len(at))
        behind = at - posture
        return hessian, pull * behind - left_m @ jacobian, pull, square + pull * float(behind @ behind)


SOFT = 8
"""What DAQP calls a constraint that may be violated if it must."""

SOLVED_SOFTLY = 2
"""What DAQP says of a program that it has solved by violating such constraints."""


class VelocityProgram:
    """The velocities of joints nearest to wanted ones with which some places move as they must.

    Raises:
        SetupError: A library is not installed.
    """

    def __init__(self) -> None:
        try:
            import daqp
        except ImportError as error:
            raise SetupError("retargeting", f"a library is missing ({error})", "install daqp") from error
        self._solve = daqp.solve

    def solve(
        self,
        rows: FloatArray,
        least: FloatArray,
        lower_rad_s: FloatArray,
        upper_rad_s: FloatArray,
        wanted_rad_s: FloatArray,
    ) -> FloatArray | None:
        """(J,) velocities [rad/s] between the bounds; None if there is no solution.

        Args:
            rows: (R, J) how fast each place moves when a joint turns at 1 rad/s [m].
            least: (R,) how fast each has to move at least [m/s]; as nearly so as the bounds let it.
            lower_rad_s: (J,) least velocities ...
            upper_rad_s: (J,) ... and greatest.
            wanted_rad_s: (J,) what they would be if no place had to move.
        """
        joints, count = len(lower_rad_s), len(least)
        velocity, _, found, _ = self._solve(
            np.eye(joints),
            -wanted_rad_s,
            np.ascontiguousarray(rows),
            np.concatenate([upper_rad_s, np.full(count, 1e30)]),
            np.concatenate([lower_rad_s, least]),
            np.concatenate([np.zeros(joints, np.int32), np.full(count, SOFT, np.int32)]),
        )
        if found not in (SOLVED, SOLVED_SOFTLY) or not np.isfinite(velocity).all():
            return None
        solved: FloatArray = np.minimum(np.maximum(velocity, lower_rad_s), upper_rad_s)
        return solved


def _spread(model: Any, robot: RobotModel) -> tuple[FloatArray, FloatArray]:
    """(Q, J) and (Q,) with which J commanded joints become the Q of Pinocchio's model, copies among them."""
    joints = {joint.name: joint for joint in read_tree(robot.urdf_path).by_child.values()}
    spread, shift = np.zeros((model.nq, len(robot.joint_names))), np.zeros(model.nq)
    for number, name in enumerate(model.names):
        if number:  # the first is the world
            leader, ratio, offset = read_tree(robot.urdf_path).followed(joints[name])
            row = model.joints[number].idx_q
            spread[row, robot.joint_names.index(leader)], shift[row] = ratio, offset
    return read_only(spread), read_only(shift)
