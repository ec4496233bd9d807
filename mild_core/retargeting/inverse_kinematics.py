# SPDX-License-Identifier: Apache-2.0
"""From where links shall be to where the joints have to be: differential inverse kinematics, one warm step at a time.

The only file that knows the libraries: Pink (S. Caron et al., tasks and limits as one quadratic program) on Pinocchio
(rigid bodies), solved by DAQP, which keeps the limits exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mild_core.errors import SetupError
from mild_core.retargeting.kinematics import read_tree
from mild_core.retargeting.robot import RobotModel
from mild_core.shapes import FloatArray

INSIDE_RAD = 1e-4
"""Joints start at least this far inside their limits: a solver that starts on a limit may find no step."""

POSTURE_COST = 0.02
"""Metres that a radian away from the wanted posture is worth: what is left over for the posture decides where the
elbow goes, and 10 degrees of it are paid with less than a millimetre at the hand."""

DAMPING = 1e-6
"""Of a step, relative to the error: keeps it small where the arm is stretched and no step leads to the target."""


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

    Raises:
        SetupError: Pink is not installed, the description has no such link, or a joint that turns without end.
    """

    def __init__(self, robot: RobotModel, links: Sequence[str], margin_rad: float = INSIDE_RAD) -> None:
        try:
            import pink  # type: ignore[import-untyped]
            import pinocchio  # type: ignore[import-untyped]
        except ImportError as error:
            raise SetupError(
                "inverse kinematics", f"a library is missing ({error})", "install pin-pink and daqp"
            ) from error
        tree = read_tree(robot.urdf_path)
        for link in links:
            tree.chain(link, robot.base_link)  # says in one line what is wrong
        self._base = tree.pose(robot.base_link, dict(robot.rest))
        self._order, model = _reduced(pinocchio, robot)
        lower, upper = (np.empty(len(self._order)) for _ in range(2))
        lower[self._order], upper[self._order] = robot.lower_rad + margin_rad, robot.upper_rad - margin_rad
        model.lowerPositionLimit, model.upperPositionLimit = lower - INSIDE_RAD, upper + INSIDE_RAD
        self._lower, self._upper = lower, upper
        self._solve_ik = pink.solve_ik
        self._configuration: Any = pink.Configuration(model, model.createData(), (lower + upper) / 2.0)
        self._limits = [pink.limits.ConfigurationLimit(model, config_limit_gain=1.0)]
        self._posture = pink.tasks.PostureTask(cost=POSTURE_COST)
        self._tasks = {link: pink.tasks.FrameTask(link, 1.0, 0.0, lm_damping=DAMPING) for link in links}
        self._place = pinocchio.SE3.Identity()

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
        at, wanted = np.empty(len(self._order)), np.empty(len(self._order))
        at[self._order], wanted[self._order] = start_rad, posture_rad
        at = np.minimum(np.maximum(at, self._lower), self._upper)
        self._posture.set_target(wanted)
        tasks = [self._posture]
        for reach in reaches:
            task = self._tasks[reach.link]
            task.set_position_cost(reach.weight)
            self._place.translation = self._base[:3, :3] @ reach.point_m + self._base[:3, 3]
            task.set_target(self._place)
            tasks.append(task)
        for _ in range(steps):
            self._configuration.update(at)
            moved = self._solve_ik(
                self._configuration, tasks, 1.0, solver="daqp", limits=self._limits, safety_break=False
            )
            at = np.minimum(np.maximum(at + moved, self._lower), self._upper)
        result: FloatArray = at[self._order]
        return result


def _reduced(pinocchio: Any, robot: RobotModel) -> tuple[list[int], Any]:
    """Where each controlled joint is in Pinocchio's order, and its model of the robot with all others at rest.

    Raises:
        SetupError: A controlled joint is missing or turns without end.
    """
    whole = pinocchio.buildModelFromUrdf(str(robot.urdf_path))
    at, rest = pinocchio.neutral(whole), dict(robot.rest)
    held = []
    for number, name in enumerate(whole.names):
        if number == 0 or name in robot.joint_names:
            continue
        held.append(number)
        if name in rest:
            at[whole.joints[number].idx_q] = rest[name]
    model = pinocchio.buildReducedModel(whole, held, at)
    names = list(model.names)
    for name in robot.joint_names:
        if name not in names or model.joints[names.index(name)].nq != 1:
            problem = f"'{name}' is no joint with one position that is a plain number"
            raise SetupError(str(robot.urdf_path), problem, f"give a description of {robot.name}")
    return [model.joints[names.index(name)].idx_q for name in robot.joint_names], model
