# SPDX-License-Identifier: Apache-2.0
"""What may be set of retargeting."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

from mild_core.errors import SetupError, unknown_name

Mix = Literal["off", "blend", "only"]
MIXES: tuple[Mix, ...] = ("off", "blend", "only")
"""The learned motion alone, with the hands brought together, or no learned motion at all."""


@dataclass(frozen=True)
class RetargetingSettings:
    """How retargeting follows, holds and returns.

    Attributes:
        look_ahead_s: How far ahead of now a motion is read: makes up for the lag of the limits. The default follows
            recorded motions best: 0.29 degrees, 0.87 without it. The faster a motion, the more it lags: 20 to 75 ms.
        stale_after_s: Hold when the newest motion, or the robot's word on where it is, came longer ago than this.
        max_age_s: Hold when the newest motion's stamp is older than this; such a motion is refused on arrival.
        max_future_s: A motion stamped further ahead of now than this is refused: two clocks disagree.
        unknown_after_s: Hold when what the person does has been unknown to the model for longer than this.
        known_below: While not following, start again only below this out-of-distribution score (unknown is 1).
        home_after_s: Go home after holding for so long.
        home_velocity_rad_s: Largest speed of a joint on the way home.
        ramp_velocity_rad_s: Largest speed that getting from the robot's pose onto a motion may add.
        position_margin_rad: Distance kept from the position limits.
        max_gap_s: After a longer time without a command the robot is taken to stand at its last command.
        displaced_rad: A measured joint further from its command than this is displaced ...
        displaced_after_s: ... when it is so for longer than this: moved by hand, blocked or switched off.
        ik: Whether inverse kinematics brings the hands together: `off` follows the learned motion alone, `blend`
            gives way to the person's hand where hands touch, `only` uses no learned motion.
        keep_out_m: Distance kept from everyone, but for the hand and forearm that are offered to be touched.
        near_m: While any part of the arm is nearer than this to anyone ...
        near_speed_m_s: ... no part of it moves faster, nor towards them faster than this less their own approach.
            Sources: in the spirit of ISO/TS 15066, Annex A: a short impact on the chest (2 x 140 N at 25 N/mm, 40 kg)
            by an arm of 5 kg is borne up to 0.84 m/s; and 5.5.4 there with ISO 13855: speed and separation monitoring.
        allow_unmeasured_contact: Whether hands may touch where people are only assumed to stand, as the camera's pose
            is not measured.
        placement_uncertainty_m: How far such people may be from where they are assumed: added to `keep_out_m` and
            `near_m`.
        start_facing_deg: The first motion needs a person who faces the robot within this angle, ...
        start_hand_m: ... whose hand is nearer than this to the robot's shoulder ...
        start_trunk_m: ... and whose trunk is nearer than this to it; all three only where their place is measured.
        start_watch_s: It needs a hand that has been raised for so long, and has not gone to the person's own head or
            aside meanwhile; one that has must come this far towards the robot from the shoulder ...
        start_reach_m: ... before it counts.
        start_evidence: It needs a recognised interaction of this probability at least, as a mean ...
        start_evidence_s: ... over about this time; motions unknown to the model count as 0.
        still_after_s: A raised hand that stays where it is for so long, far from the robot's, is at rest there.
        interaction_s: Longest time to follow one interaction; then the robot goes home.
        home_timeout_s: Longest time on the way home; then the robot holds, and tries again.
        start_enabled: Whether to follow before the first request.
        execution_delay_s: Time from a command to its execution, for a controller that plays a promised trajectory; see
            `trajectory_stream.py`. `look_ahead_s` has to contain it.

    Raises:
        SetupError: A value is outside its range.
    """

    look_ahead_s: float = 0.045
    stale_after_s: float = 0.5
    max_age_s: float = 1.0
    max_future_s: float = 0.2
    unknown_after_s: float = 0.2
    known_below: float = 0.8
    home_after_s: float = 2.0
    home_velocity_rad_s: float = 0.5
    ramp_velocity_rad_s: float = 1.0
    position_margin_rad: float = 0.01
    max_gap_s: float = 0.3
    displaced_rad: float = 0.35
    displaced_after_s: float = 0.3
    ik: Mix = "blend"
    keep_out_m: float = 0.05
    near_m: float = 0.3
    near_speed_m_s: float = 0.8
    allow_unmeasured_contact: bool = False
    placement_uncertainty_m: float = 0.25
    start_facing_deg: float = 60.0
    start_hand_m: float = 1.3
    start_trunk_m: float = 2.0
    start_watch_s: float = 0.25
    start_reach_m: float = 0.3
    start_evidence: float = 0.4
    start_evidence_s: float = 0.3
    still_after_s: float = 3.0
    interaction_s: float = 60.0
    home_timeout_s: float = 30.0
    start_enabled: bool = True
    execution_delay_s: float = 0.0

    def __post_init__(self) -> None:
        if self.ik not in MIXES:
            raise unknown_name("ik", self.ik, MIXES)
        may_be_zero = {"look_ahead_s", "unknown_after_s", "home_after_s", "position_margin_rad", "displaced_after_s"}
        may_be_zero |= {"keep_out_m", "near_m", "execution_delay_s", "placement_uncertainty_m"}
        may_be_zero |= {"start_watch_s", "start_reach_m", "start_evidence", "start_evidence_s"}
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name in ("start_enabled", "ik", "allow_unmeasured_contact"):
                continue
            if not (0.0 <= value < 1e6) or (value == 0.0 and each.name not in may_be_zero):
                floor = "at least" if each.name in may_be_zero else "above"
                raise SetupError(each.name, f"{value} is outside its range", f"give a number {floor} 0")
        if self.known_below > 1.0:
            raise SetupError("known_below", f"{self.known_below} is above 1", "give a number above 0 and at most 1")
