# SPDX-License-Identifier: Apache-2.0
"""What retargeting is doing, and the rules by which it goes from one thing to the next.

From waiting to idle when the robot has said where it is; to following on a usable motion, from anywhere; to holding
when that motion ceases; to returning after a while, and home to idle. Disabling leaves all of this, enabling leads
back to idle.
"""

from __future__ import annotations

from enum import Enum


class Mode(Enum):
    """What retargeting is doing; the value is the word in commands and diagnostics."""

    WAITING = "waiting"
    """Nobody has said yet where the robot is: no command is sent."""
    IDLE = "idle"
    """The robot stands where it is, ready for a motion."""
    FOLLOWING = "following"
    """The robot follows the newest motion window."""
    HOLDING = "holding"
    """There is no motion to follow: the robot stops smoothly and stays."""
    RETURNING = "returning"
    """Nothing came for a while: the robot goes home slowly."""
    DISABLED = "disabled"
    """The operator said so: the robot stops smoothly, then no command is sent."""


def next_mode(mode: Mode, *, usable: bool, displaced: bool, patience_over: bool, at_home: bool) -> Mode:
    """The mode after `mode`; called once per command.

    Args:
        mode: The mode of the command before.
        usable: There is a motion, it is fresh and the model knows what it is about.
        displaced: The robot is not where it was told to be.
        patience_over: The robot has held at rest for as long as it should before it goes home.
        at_home: The robot rests at home.
    """
    if mode in (Mode.WAITING, Mode.DISABLED):
        return mode
    if displaced:
        return Mode.HOLDING
    if usable:
        return Mode.FOLLOWING
    if mode is Mode.FOLLOWING:
        return Mode.HOLDING
    if mode is Mode.HOLDING and patience_over:
        return Mode.RETURNING
    if mode is Mode.RETURNING and at_home:
        return Mode.IDLE
    return mode
