# SPDX-License-Identifier: Apache-2.0
"""What may be set of retargeting."""

from __future__ import annotations

from dataclasses import dataclass, fields

from mild_core.errors import SetupError


@dataclass(frozen=True)
class RetargetingSettings:
    """How retargeting follows, holds and returns.

    Attributes:
        look_ahead_s: How far ahead of now a motion is read: makes up for the lag of the limits. The default follows
            recorded motions best: 0.29 degrees, 0.87 without it. The faster a motion, the more it lags: 20 to 75 ms.
        stale_after_s: Hold when the newest motion came longer ago than this.
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
        start_enabled: Whether to follow before the first request.

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
    start_enabled: bool = True

    def __post_init__(self) -> None:
        may_be_zero = {"look_ahead_s", "unknown_after_s", "home_after_s", "position_margin_rad", "displaced_after_s"}
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name == "start_enabled":
                continue
            if not (0.0 <= value < 1e6) or (value == 0.0 and each.name not in may_be_zero):
                floor = "at least" if each.name in may_be_zero else "above"
                raise SetupError(each.name, f"{value} is outside its range", f"give a number {floor} 0")
        if self.known_below > 1.0:
            raise SetupError("known_below", f"{self.known_below} is above 1", "give a number above 0 and at most 1")
