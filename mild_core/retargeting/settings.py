# SPDX-License-Identifier: Apache-2.0
"""What may be set of retargeting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mild_core.parameters import check, parameter

Mix = Literal["off", "blend", "only"]
MIXES: tuple[Mix, ...] = ("off", "blend", "only")
"""The learned motion alone, with the hands brought together, or no learned motion at all."""


@dataclass(frozen=True, kw_only=True)
class RetargetingSettings:
    """How retargeting follows, holds and returns.

    Sources: `near_speed_m_s` is in the spirit of ISO/TS 15066, Annex A: a short impact on the chest (2 x 140 N at
    25 N/mm, 40 kg) by an arm of 5 kg is borne up to 0.84 m/s; and of 5.5.4 there with ISO 13855: speed and separation
    monitoring. `look_ahead_s` follows recorded motions best: 0.29 degrees, 0.87 without it; the faster a motion, the
    more it lags: 20 to 75 ms.

    Raises:
        SetupError: A value is outside its range.
    """

    enabled: bool = parameter(True, "Follow from the start, without a call of `~/enable`.")
    look_ahead_s: float = parameter(
        0.045,
        "Look-ahead into the motion that compensates the lag of the limits.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    stale_after_s: float = parameter(
        0.5, "Hold when no motion arrived for longer.", unit="s", minimum=0.05, maximum=10.0
    )
    max_age_s: float = parameter(
        1.0, "Hold when the stamp of the newest motion is older.", unit="s", minimum=0.05, maximum=10.0
    )
    max_future_s: float = parameter(
        0.2,
        "A motion stamped further ahead of now is refused: two clocks disagree.",
        unit="s",
        minimum=0.01,
        maximum=10.0,
        offered=False,
    )
    unknown_after_s: float = parameter(
        0.2,
        "Hold when what the person does has been unknown to the model for longer.",
        unit="s",
        minimum=0.0,
        maximum=10.0,
        offered=False,
    )
    known_below: float = parameter(
        0.8,
        "While not following, start again only below this out-of-distribution score (unknown is 1).",
        minimum=0.01,
        maximum=1.0,
        offered=False,
    )
    home_after_s: float = parameter(2.0, "Go home after holding for this long.", unit="s", minimum=0.0, maximum=3600.0)
    home_velocity_rad_s: float = parameter(
        0.5, "Largest speed of a joint on the way home.", unit="rad/s", minimum=0.01, maximum=3.0
    )
    home_timeout_s: float = parameter(
        30.0,
        "Longest time on the way home; then the robot holds, and tries again.",
        unit="s",
        minimum=1.0,
        maximum=3600.0,
        offered=False,
    )
    ramp_velocity_rad_s: float = parameter(
        1.0,
        "Largest speed that the ramp-in from the robot's pose onto a motion adds.",
        unit="rad/s",
        minimum=0.01,
        maximum=10.0,
    )
    position_margin_rad: float = parameter(
        0.01, "Distance kept from the position limits.", unit="rad", minimum=0.0, maximum=1.0, offered=False
    )
    command_gap_s: float = parameter(
        0.3,
        "After a longer time without a command the robot is taken to stand at its last command.",
        unit="s",
        minimum=0.01,
        maximum=10.0,
        offered=False,
    )
    displaced_rad: float = parameter(
        0.35,
        "A measured joint further from its command than this is displaced: moved by hand, blocked or switched off ...",
        unit="rad",
        minimum=0.01,
        maximum=10.0,
        offered=False,
    )
    displaced_after_s: float = parameter(
        0.3, "... when it is so for longer than this.", unit="s", minimum=0.0, maximum=10.0, offered=False
    )
    ik: Mix = parameter(
        "blend",
        "Inverse kinematics: `blend` brings the hands together where they are meant to touch, `off` follows the "
        "learned motion alone, `only` reaches for the person's hand without it.",
        choices=MIXES,
    )
    keep_out_m: float = parameter(
        0.05,
        "Distance kept from everyone in view, except the hand and forearm that are offered.",
        unit="m",
        minimum=0.0,
        maximum=1.0,
    )
    near_m: float = parameter(
        0.3,
        "Within this distance of a person speed is limited.",
        unit="m",
        minimum=0.0,
        maximum=10.0,
        offered=False,
    )
    near_speed_m_s: float = parameter(
        0.8,
        "Largest speed of any part of the arm within 0.3 m of a person; towards a person, minus their approach.",
        unit="m/s",
        minimum=0.05,
        maximum=2.0,
    )
    allow_unmeasured_contact: bool = parameter(
        False, "Let hands touch although the place of people is only assumed (`robot_from_camera` is empty)."
    )
    placement_uncertainty_m: float = parameter(
        0.25,
        "Uncertainty of the assumed place of people, added to distances without a measured camera.",
        unit="m",
        minimum=0.0,
        maximum=1.0,
    )
    start_facing_deg: float = parameter(
        60.0,
        "A motion starts only for a person who faces the robot within this angle, if their place is measured.",
        unit="deg",
        minimum=5.0,
        maximum=180.0,
    )
    start_hand_m: float = parameter(
        1.3,
        "A motion starts only for a hand within this distance of the robot's shoulder, if its place is measured.",
        unit="m",
        minimum=0.1,
        maximum=10.0,
    )
    start_trunk_m: float = parameter(
        2.0,
        "A motion starts only for a trunk within this distance of the robot's shoulder, if its place is measured.",
        unit="m",
        minimum=0.1,
        maximum=10.0,
    )
    start_watch_s: float = parameter(
        0.25,
        "A motion starts only for a hand raised for this long, neither to the person's own head nor aside.",
        unit="s",
        minimum=0.0,
        maximum=2.0,
    )
    start_reach_m: float = parameter(
        0.3,
        "A hand that went there must be held out this far before it counts again.",
        unit="m",
        minimum=0.0,
        maximum=1.0,
    )
    start_evidence: float = parameter(
        0.4,
        "A motion starts only at this mean probability of a recognised interaction over `start_evidence_s`.",
        minimum=0.0,
        maximum=1.0,
    )
    start_evidence_s: float = parameter(0.3, "Averaging time of `start_evidence`.", unit="s", minimum=0.0, maximum=2.0)
    still_after_s: float = parameter(
        3.0,
        "A raised hand that stays where it is for so long, far from the robot's, is at rest there.",
        unit="s",
        minimum=0.1,
        maximum=60.0,
        offered=False,
    )
    interaction_s: float = parameter(
        60.0, "Longest interaction; then the robot goes home.", unit="s", minimum=0.1, maximum=3600.0
    )
    execution_delay_s: float = parameter(
        0.0,
        "Time from a command to its execution, for a controller that plays a promised trajectory.",
        unit="s",
        minimum=0.0,
        maximum=5.0,
        offered=False,
    )

    def __post_init__(self) -> None:
        check(self)

    @property
    def ahead_s(self) -> float:
        """How far ahead of now a motion is read: a command is for the time at which it is executed."""
        return self.look_ahead_s + self.execution_delay_s
