# SPDX-License-Identifier: Apache-2.0
"""What retargeting is doing, and the rules by which it goes from one thing to the next.

The life of an interaction: idle until a person is calibrated, then ready; following when the person raises the hand;
returning when the hand is back, or holding first when there is no motion to follow any more; home, and ready again.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Mode(Enum):
    """What retargeting is doing; the value is the word in commands, on the topic `mode` and in diagnostics."""

    WAITING = "waiting"
    """The robot's position is unknown: no command is sent."""
    IDLE = "idle"
    """No person is there, or one is being calibrated: the robot stands where it is."""
    READY = "ready"
    """A person is there, with the hand at rest; the robot waits at home for them to start."""
    FOLLOWING = "following"
    """A person interacts: the robot follows the newest motion window and brings the hands together."""
    HOLDING = "holding"
    """There is no motion to follow: the robot stops smoothly and stays."""
    RETURNING = "returning"
    """The interaction has ended, or nothing came for a while: the robot goes home slowly."""
    SHOWING = "showing"
    """The operator sends the arm somewhere, slowly, to show its hand: no person is followed meanwhile."""
    DISABLED = "disabled"
    """The operator said so: the robot stops smoothly, then no command is sent."""
    HELD = "held"
    """Emergency: the robot stops smoothly at once and stays, whatever comes, until it is released."""


@dataclass(frozen=True)
class Situation:
    """What the next mode depends on.

    Attributes:
        usable: There is a motion, it is fresh and the model knows what it is about.
        present: A calibrated person is seen.
        raised: Their hand has left its rest for the robot, or the place of hands is unknown.
        held: The operator holds the robot.
        displaced: The robot is not where it was commanded to be.
        silent: The robot has ceased to say where it is, or says two things.
        at_home: The robot rests at home.
        patience_over: The robot has held at rest for as long as it should before it goes home.
        too_long: It has been on its way home for longer than it should.
        gave_way: It has left home to give way to a person.
        shows: The operator has sent it somewhere to show its hand.
    """

    usable: bool
    present: bool
    raised: bool
    held: bool
    displaced: bool
    silent: bool
    at_home: bool
    patience_over: bool
    too_long: bool
    gave_way: bool = False
    shows: bool = False


def next_mode(mode: Mode, given: Situation) -> Mode:
    """The mode after `mode`; called once per command."""
    if mode in (Mode.WAITING, Mode.DISABLED):
        return mode
    if given.held:
        return Mode.HELD
    if given.displaced or given.silent or mode is Mode.HELD:
        return Mode.HOLDING
    if given.shows:
        return Mode.SHOWING
    if given.usable and given.raised:
        return Mode.FOLLOWING
    if mode is Mode.FOLLOWING:
        return Mode.RETURNING if given.usable else Mode.HOLDING
    if mode is Mode.HOLDING:
        return Mode.RETURNING if given.patience_over else mode
    if given.at_home or mode is Mode.RETURNING:
        rest = Mode.READY if given.present else Mode.IDLE
        return rest if given.at_home else Mode.HOLDING if given.too_long else mode
    leaves = given.present or given.gave_way or mode is Mode.SHOWING
    return Mode.RETURNING if leaves else Mode.IDLE
