# SPDX-License-Identifier: Apache-2.0
"""Which mode follows which, as a table: every rule by itself, and which of two rules goes first."""

from __future__ import annotations

import itertools
from dataclasses import fields

import pytest

from mild_core.retargeting.modes import Mode, Situation, next_mode


def after(mode: Mode, *holds: str) -> Mode:
    """The mode after `mode` where these hold and nothing else does."""
    return next_mode(mode, Situation(**{field.name: field.name in holds for field in fields(Situation)}))


LIVE = [mode for mode in Mode if mode not in (Mode.WAITING, Mode.DISABLED)]
EVERYTHING = tuple(field.name for field in fields(Situation))


@pytest.mark.parametrize("mode", [Mode.WAITING, Mode.DISABLED])
def test_nothing_but_a_measurement_or_the_operator_ends_waiting_and_disabled(mode: Mode) -> None:
    for count in (0, 1, len(EVERYTHING)):
        for holds in itertools.combinations(EVERYTHING, count):
            assert after(mode, *holds) is mode


@pytest.mark.parametrize("mode", LIVE)
def test_a_hold_comes_before_everything_and_ends_in_a_stop(mode: Mode) -> None:
    assert after(mode, *EVERYTHING) is Mode.HELD
    assert after(mode, "held") is Mode.HELD
    for holds in ((), ("usable", "raised", "present"), ("present", "at_home")):
        assert after(Mode.HELD, *holds) is Mode.HOLDING


@pytest.mark.parametrize("mode", LIVE)
@pytest.mark.parametrize("trouble", ["displaced", "silent"])
def test_a_robot_that_is_elsewhere_or_says_nothing_follows_nothing(mode: Mode, trouble: str) -> None:
    assert after(mode, trouble, "usable", "raised", "present", "at_home", "patience_over") is Mode.HOLDING


@pytest.mark.parametrize("mode", [mode for mode in LIVE if mode is not Mode.HELD])
def test_a_raised_hand_with_a_usable_motion_is_followed_from_everywhere(mode: Mode) -> None:
    assert after(mode, "usable", "raised", "present") is Mode.FOLLOWING
    assert after(mode, "usable", "present") is not Mode.FOLLOWING
    assert after(mode, "raised", "present") is not Mode.FOLLOWING


@pytest.mark.parametrize(
    ("mode", "holds", "wanted"),
    [
        (Mode.FOLLOWING, ("usable", "present"), Mode.RETURNING),  # the hand is back
        (Mode.FOLLOWING, ("raised", "present"), Mode.HOLDING),  # there is no motion any more
        (Mode.FOLLOWING, (), Mode.HOLDING),
        (Mode.HOLDING, ("present",), Mode.HOLDING),
        (Mode.HOLDING, ("patience_over",), Mode.RETURNING),
        (Mode.HOLDING, ("patience_over", "at_home", "present"), Mode.RETURNING),
        (Mode.RETURNING, ("present",), Mode.RETURNING),
        (Mode.RETURNING, (), Mode.RETURNING),
        (Mode.RETURNING, ("at_home", "present"), Mode.READY),
        (Mode.RETURNING, ("at_home",), Mode.IDLE),
        (Mode.RETURNING, ("too_long", "present"), Mode.HOLDING),
        (Mode.RETURNING, ("too_long", "at_home"), Mode.IDLE),
        (Mode.IDLE, ("present", "at_home"), Mode.READY),
        (Mode.IDLE, ("present",), Mode.RETURNING),  # it waits for people at home
        (Mode.IDLE, (), Mode.IDLE),
        (Mode.READY, ("present", "at_home"), Mode.READY),
        (Mode.READY, ("at_home",), Mode.IDLE),
        (Mode.READY, (), Mode.IDLE),
        (Mode.READY, ("too_long", "present", "at_home"), Mode.READY),
    ],
)
def test_one_mode_follows_another(mode: Mode, holds: tuple[str, ...], wanted: Mode) -> None:
    assert after(mode, *holds) is wanted


@pytest.mark.parametrize("mode", [mode for mode in LIVE if mode is not Mode.HELD])
def test_an_arm_that_is_sent_to_show_its_hand_follows_no_person_and_comes_home_afterwards(mode: Mode) -> None:
    assert after(mode, "shows", "usable", "raised", "present") is Mode.SHOWING
    assert after(mode, "shows", "held") is Mode.HELD
    assert after(mode, "shows", "displaced") is Mode.HOLDING
    assert after(Mode.SHOWING) is Mode.RETURNING
    assert after(Mode.SHOWING, "at_home") is Mode.IDLE
