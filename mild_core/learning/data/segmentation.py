# SPDX-License-Identifier: Apache-2.0
"""A long recording cut into trials: from rest to rest of the person's hand.

The hand rests where it is slow for longest: hanging, as a rule. Being slow elsewhere is no rest, or a handshake would
end as soon as the hands stop shaking.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from mild_core.shapes import FloatArray, require_shape

Mask = NDArray[np.bool_]

SMOOTHING_S = 0.2
"""Positions are averaged over this span before speeds are taken: trackers tremble by millimetres."""

REST_SAMPLES = 400
"""The place of rest is sought among so many slow frames, evenly spread."""

TRAILING_S = 2.0
"""The other agent may go on for so long after the person is at rest; it still belongs to the trial."""

TOO_SHORT, TWITCH, CUT_OFF, GAP = "too short", "twitch", "cut off", "gap"
OTHER_UNSEEN, OTHER_STILL = "other not recorded", "other stood still"
"""Why a movement is no trial; a twitch is one that stays near the place of rest."""


@dataclass(frozen=True)
class RestToRest:
    """When a hand rests, and what a trial is.

    Attributes:
        slow_m_s: A hand below this speed is slow.
        near_m: And it rests when it is this near to its place of rest too.
        rest_s: Shorter rests are part of the movement.
        margin_s: Rest before and after the movement that belongs to the trial: a model has to know rest as well.
        least_s: Shortest movement.
        still_rad_s: A robot whose joints are all slower than this stands still; a partner's hand stands by `slow_m_s`.
    """

    slow_m_s: float = 0.15
    near_m: float = 0.15
    rest_s: float = 0.5
    margin_s: float = 1.0
    least_s: float = 1.0
    still_rad_s: float = 0.1


@dataclass(frozen=True)
class Segment:
    """One movement: frames `begin` to `end` (excluded) with its rests, of which `onset` to `back` move.

    Attributes:
        begin: First frame.
        onset: First frame of movement.
        back: First frame of rest after it.
        end: One after the last frame.
        fault: Why it is no trial; "" when it is one.
    """

    begin: int
    onset: int
    back: int
    end: int
    fault: str = ""


@dataclass(frozen=True, eq=False)
class Cut:
    """How a recording was cut.

    Attributes:
        segments: In order of time.
        speed_m_s: (T,) of the hand; NaN where unknown.
        away_m: (T,) how far it is from its place of rest.
        found_rest: Whether it rests at all.
    """

    segments: tuple[Segment, ...]
    speed_m_s: FloatArray
    away_m: FloatArray
    found_rest: bool


def speeds(places: FloatArray, times_s: FloatArray) -> FloatArray:
    """(T,) largest rate of change of the rows of `places` (T, N, D) over time, smoothed; by Euclid's norm over D.

    Args:
        places: Even in time, without a gap; around one that is NaN the speed is too.
        times_s: (T,) stamps.
    """
    if len(places) < 3:
        return np.full(len(places), np.nan)
    width = max(1, round(SMOOTHING_S / float(np.median(np.diff(times_s)))))
    padded = np.pad(places, ((width // 2, width - 1 - width // 2), (0, 0), (0, 0)), mode="edge")
    rates = np.gradient(sliding_window_view(padded, width, axis=0).mean(axis=-1), times_s, axis=0)
    fastest: FloatArray = np.linalg.norm(rates, axis=2).max(axis=1)
    return fastest


def cut_at_rest(arm_m: FloatArray, others: FloatArray, times_s: FloatArray, settings: RestToRest) -> Cut:
    """Find the movements of a recording.

    Args:
        arm_m: (T, J, 3) shoulder first, hand last [m].
        others: (T, J) joint angles of the robot [rad], or (T, J, 3) the partner's arm [m]; NaN where not recorded.
        times_s: (T,) of the frames: even but for gaps.
        settings: When a hand rests.
    """
    require_shape("others", others, (len(arm_m), *others.shape[1:]))
    hand = (arm_m[:, -1] - arm_m[:, 0])[:, None]
    runs = _runs(times_s)
    speed = np.concatenate([np.zeros(0), *(speeds(hand[run], times_s[run]) for run in runs)])
    slow = speed < settings.slow_m_s
    if not slow.any():
        return Cut((), speed, np.full(len(speed), np.nan), False)
    away = np.linalg.norm(hand[:, 0] - _place_of_rest(hand[slow, 0], settings.near_m), axis=1)
    rate_hz = 1.0 / float(np.median(np.diff(times_s)))
    resting = _long_enough(slow & (away < settings.near_m), runs, settings.rest_s * rate_hz)
    moves = _other_moves(others, times_s, runs, settings)
    found = [
        _judged(movement, run, (run is runs[0], run is runs[-1]), away, settings, rate_hz)
        for run in runs
        for movement in _stretches(~resting, run)
    ]
    segments = _trailed(found, moves, resting, round(TRAILING_S * rate_hz))
    segments = _with_margins(segments, runs, round(settings.margin_s * rate_hz))
    return Cut(tuple(_answered(one, others, moves) for one in segments), speed, away, bool(resting.any()))


def _runs(times_s: FloatArray) -> list[slice]:
    """Frames without a gap between them."""
    steps = np.diff(times_s)
    breaks = (np.flatnonzero(steps > 1.5 * np.median(steps)) + 1).tolist() if len(steps) else []
    return [slice(a, b) for a, b in pairwise([0, *breaks, len(times_s)])]


def _place_of_rest(slow_m: FloatArray, near_m: float) -> FloatArray:
    """(3,) the slow place with the most slow ones around it."""
    among = slow_m[:: max(1, len(slow_m) // REST_SAMPLES)]
    near = np.linalg.norm(among[:, None] - among[None], axis=2) < near_m / 2.0
    place: FloatArray = among[near[near.sum(axis=1).argmax()]].mean(axis=0)
    return place


def _stretches(mask: Mask, run: slice) -> list[tuple[int, int]]:
    """Where `mask` holds within a run: first frames and those after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask[run], [False]]).astype(int))) + run.start
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _long_enough(resting: Mask, runs: Sequence[slice], least: float) -> Mask:
    """`resting` without its short stretches."""
    kept = np.zeros_like(resting)
    for run in runs:
        for first, after in _stretches(resting, run):
            kept[first:after] = after - first >= least
    return kept


def _judged(
    movement: tuple[int, int],
    run: slice,
    at_ends: tuple[bool, bool],
    away: FloatArray,
    settings: RestToRest,
    rate_hz: float,
) -> Segment:
    """A movement and what the person's hand says against it."""
    onset, back = movement
    fault = ""
    if onset == run.start:
        fault = CUT_OFF if at_ends[0] else GAP
    elif back == run.stop:
        fault = CUT_OFF if at_ends[1] else GAP
    elif away[onset:back].max() < settings.near_m:
        fault = TWITCH
    elif back - onset < settings.least_s * rate_hz:
        fault = TOO_SHORT
    return Segment(onset, onset, back, back, fault)


def _other_moves(others: FloatArray, times_s: FloatArray, runs: Sequence[slice], settings: RestToRest) -> Mask:
    """(T,) whether the other agent moves; not where it was not recorded."""
    partner = others.ndim == 3
    places = (others[:, -1] - others[:, 0])[:, None] if partner else others[:, :, None]
    speed = np.concatenate([np.zeros(0), *(speeds(places[run], times_s[run]) for run in runs)])
    moves: Mask = speed > (settings.slow_m_s if partner else settings.still_rad_s)
    return moves


def _trailed(found: Sequence[Segment], moves: Mask, resting: Mask, most: int) -> list[Segment]:
    """Movements go on until the other agent stands too, for a while and not into the next one."""
    trailed = []
    for segment in found:
        back = segment.back
        while back < min(len(moves), segment.back + most) and moves[back] and resting[back]:
            back += 1
        trailed.append(replace(segment, back=back))
    return trailed


def _with_margins(segments: Sequence[Segment], runs: Sequence[slice], margin: int) -> list[Segment]:
    """Movements with the rest around them; neighbours share the rest between them."""
    padded = []
    for index, one in enumerate(segments):
        run = next(run for run in runs if run.start <= one.onset < run.stop)
        low, high = run.start, run.stop
        if index and segments[index - 1].back >= low:
            low = (segments[index - 1].back + one.onset) // 2
        if index + 1 < len(segments) and segments[index + 1].onset < high:
            high = (one.back + segments[index + 1].onset) // 2
        padded.append(replace(one, begin=max(low, one.onset - margin), end=min(high, one.back + margin)))
    return padded


def _answered(segment: Segment, others: FloatArray, moves: Mask) -> Segment:
    """The movement and what the other agent says against it; rests in which it was not recorded are left out."""
    if segment.fault:
        return segment
    unseen = np.flatnonzero(~np.isfinite(others.reshape(len(others), -1)).all(axis=1))
    if ((unseen >= segment.onset) & (unseen < segment.back)).any():
        return replace(segment, fault=OTHER_UNSEEN)
    begin = max([segment.begin, *(unseen[unseen < segment.onset] + 1).tolist()])
    end = min([segment.end, *unseen[unseen >= segment.back].tolist()])
    return replace(segment, begin=begin, end=end, fault="" if moves[begin:end].any() else OTHER_STILL)
