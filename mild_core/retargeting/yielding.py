# SPDX-License-Identifier: Apache-2.0
"""How the arm gives way to a person who comes too close: away from them, and into no other person.

Each place of the arm close to a person gets a least speed away from them, which grows as they come faster and nearer
(a velocity damper). The joints' velocities are the smallest that fulfil all of these, as far as speed and position
limits let them: a quadratic program. The limiter then takes the joints there inside acceleration and jerk.

Sources: B. Faverjon, P. Tournassoud, "A local based approach for path planning of manipulators with a high number of
degrees of freedom", ICRA 1987; O. Kanoun et al., T-RO 2011, for inequalities as constraints of such a program.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mild_core.retargeting.evasion import Evasion, Refuge
from mild_core.retargeting.guard import PACE, SLOWING_S, Guard, PoseEvaluation
from mild_core.retargeting.limiter import Joints
from mild_core.retargeting.obstacles import Obstacles
from mild_core.retargeting.robot_model.inverse_kinematics import VelocityProgram
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.settings import RetargetingSettings
from mild_core.shapes import FloatArray

DAMPER_S = 0.3
"""A person who would be too close after this time makes the arm move; one who already is, is left at the rate of their
depth over this time. A joint needs a third of it to come up to speed, and a tracker's message is 0.05 s old."""

LEAST_M_S = 0.02
"""A slower retreat is none: it would follow a tracker's noise."""

FASTEST_M_S = 1.5
"""The arm gives way no faster than this, since no part of it may be faster near people."""

HEEDED_M = 0.4
"""Places further from every person than this, beyond the kept distance, are left out of the program [m]."""

LEAST_LEVER_M = 0.08
"""A place that joints move by less per radian is not moved: the rest of the arm would swing for it."""

ARRIVING_S = 0.2
"""The end of the way to a refuge takes at least so long."""

AT_LIMIT_S = 0.25
"""A joint may move so fast that it would need this long to its limit."""


@dataclass(frozen=True, eq=False)
class Yielding:
    """Velocities away from people, for one robot.

    Attributes:
        robot: Whose arm.
        settings: What is kept, and how fast it may be near people.
        guard: Which knows its shape.
        evasion: Which knows where to go from who walks.
    """

    robot: RobotModel
    settings: RetargetingSettings
    guard: Guard
    evasion: Evasion = field(init=False, repr=False)
    _program: VelocityProgram = field(default_factory=VelocityProgram, init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "evasion", Evasion(self.robot, self.settings, self.guard))

    def retreat(
        self,
        position_rad: Joints,
        resting_rad: Joints,
        goal_rad: Joints,
        here: PoseEvaluation,
        among: Obstacles,
        before: Refuge | None,
        meets_watched: bool,
    ) -> tuple[Joints | None, Refuge | None]:
        """J velocities [rad/s] with which the arm gives way, and where to; None when it need not.

        Args:
            position_rad: Where the joints are.
            resting_rad: Where they would come to rest.
            goal_rad: Where they are on their way to.
            here: What is seen of where they are.
            among: Everyone.
            before: Where the arm gave way to at the command before.
            meets_watched: Whether it is on its way to meet the watched person.
        """
        at, goal, walking = np.array(position_rad), np.array(goal_rad), self.evasion.walking(among)
        pressed = self._is_pressed(here, among)
        # Who is met comes close: for them no more way is made than it takes.
        unsure = meets_watched or not pressed
        if walking is not None and unsure and not self.evasion.threatens(at, goal, walking, meets_watched):
            walking = None
        if walking is None and not pressed:
            return None, None
        rows, clear, coming, which = self.guard.rows_away(at, among, self._widest(among) + HEEDED_M)
        places = which.astype(int)
        least = np.maximum(self._speeds(clear, coming, among, places), -self._allowed(clear, coming, among, places))
        heeded = np.linalg.norm(rows, axis=1) > LEAST_LEVER_M
        rows, least = rows[heeded], least[heeded]
        if walking is None and (not len(least) or least.max() < LEAST_M_S):
            return None, None
        refuge, wanted = None, np.zeros(len(at))
        if walking is not None:
            refuge = self.evasion.refuge(at, walking, before)
            wanted = self._towards(at, np.array(refuge.posture_rad))
        resting, robot = np.array(resting_rad), self.robot
        margin = self.settings.position_margin_rad
        upper = np.clip((robot.upper_rad - margin - resting) / AT_LIMIT_S, 0.0, robot.velocity_rad_s)
        lower = np.clip((robot.lower_rad + margin - resting) / AT_LIMIT_S, -robot.velocity_rad_s, 0.0)
        velocity = self._program.solve(rows, least, lower, upper, wanted)
        if velocity is None:
            return None, None
        most = PACE * self.settings.near_speed_m_s
        share = min(1.0, most / max(self.guard.arm_speed(at, velocity, among), 1e-9))
        return tuple((share * velocity).tolist()), refuge

    def _towards(self, at_rad: FloatArray, refuge_rad: FloatArray) -> FloatArray:
        """(J,) velocities [rad/s] of the way to a refuge, slower as it ends."""
        way: FloatArray = refuge_rad - at_rad
        return way / max(self.evasion.duration_s(at_rad, refuge_rad), ARRIVING_S)

    def _is_pressed(self, here: PoseEvaluation, among: Obstacles) -> bool:
        """Whether a person is so close, or comes so fast, that the arm may have to give way."""
        if not len(among.people):
            return False
        speeds = self._speeds(here.clear_m[0], here.approach_m_s[0], among, np.arange(len(among.people)))
        return bool(speeds.max() >= LEAST_M_S)

    def _speeds(
        self, clear_m: FloatArray, coming_m_s: FloatArray, among: Obstacles, places: NDArray[np.integer]
    ) -> FloatArray:
        """Least speeds away from segments at these places; negative where one may still go nearer."""
        keep = np.minimum(among.keep_m, self.settings.keep_out_m)[places]
        # A hand that is on its way to be taken must not push the robot's away; only one that is too near does.
        coming = np.where(places == among.offered, 0.0, np.maximum(coming_m_s, 0.0))
        speeds: FloatArray = np.minimum(coming - (clear_m - keep) / DAMPER_S, FASTEST_M_S)
        return np.where(np.isfinite(keep), speeds, -FASTEST_M_S)

    def _allowed(
        self, clear_m: FloatArray, coming_m_s: FloatArray, among: Obstacles, places: NDArray[np.integer]
    ) -> FloatArray:
        """Greatest speeds towards segments at these places that the guard allows near people."""
        beyond_m = np.maximum(clear_m - among.zones_m[places], 0.0)
        near_m_s = PACE * self.settings.near_speed_m_s
        allowed: FloatArray = np.maximum(near_m_s - np.maximum(coming_m_s, 0.0), 0.0) + beyond_m / SLOWING_S
        return allowed

    def _widest(self, among: Obstacles) -> float:
        finite = among.keep_m[np.isfinite(among.keep_m)]
        return float(finite.max(initial=0.0))
