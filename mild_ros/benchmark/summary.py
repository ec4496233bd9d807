# SPDX-License-Identifier: Apache-2.0
"""What counts as success, why an encounter failed, and shares with their intervals."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mild_ros.benchmark.encounters import TOUCHING, Encounter
from mild_ros.benchmark.run import HOME_M, MET_M, TICK_S, Trace

LATEST_S = 1.5
"""A hand that waits is met no later than this after it has come to rest."""

LET_GO_S, LET_GO_M = 0.2, 0.03
"""The robot parts from a hand that goes back no later than this after the hand itself has gone so far."""

KEPT_M, SPEED_M_S, SPEED_TOLERANCE_M_S = 0.05, 0.8, 0.03
"""Distance from heads and trunks, speed near a person who stands still, and what motors overshoot by."""

STARTED_M, FOLLOWED_S, FOLLOWED_M = 0.02, 0.4, 0.05
"""A robot's hand that has moved so far has started; so long after a feint it goes no further out, but for so much."""

Z95 = 1.959964


@dataclass(frozen=True)
class Judgement:
    """One encounter.

    Attributes:
        seed: Its.
        kind: Of `encounters.SHARES`.
        interaction: What the person did.
        reachable: Whether an independent solver reaches the offered hand; None where none is offered.
        success: All that is asked of this kind.
        causes: Why not; the first is the gravest.
        met_after_s: From when the hand rested until hands met; None if they did not.
        apart_m: Median distance of the hands from when they met, or over the last half second of waiting.
        violations: Promises of safety that were broken.
        false_start: Whether the robot moved for a passer-by.
        said: What the robot said of hands that did not meet.
    """

    seed: int
    kind: str
    interaction: str
    reachable: bool | None
    success: bool
    causes: tuple[str, ...]
    met_after_s: float | None
    apart_m: float | None
    violations: tuple[str, ...]
    false_start: bool
    said: str

    def as_mapping(self) -> dict[str, Any]:
        """For a file."""
        return asdict(self)


def judge(encounter: Encounter, trace: Trace, reachable: bool | None, given: bool) -> Judgement:
    """What an encounter was like.

    Args:
        encounter: What was to happen.
        trace: What happened.
        reachable: Whether the offered hand can be reached; None where none is offered.
        given: Whether the robot knew the interaction.
    """
    timeline, violations, causes = trace.timeline, _violations(trace), []
    away = np.linalg.norm(trace.tool_m - trace.tool_m[0], axis=1)
    apart = np.linalg.norm(trace.tool_m - trace.hand_m, axis=1)
    started = bool(away.max() > STARTED_M)
    passing = encounter.kind == "passer_by"
    false_start = passing and started
    met_after_s = None if trace.met_s is None else max(trace.met_s - timeline.offered_s, 0.0)
    apart_m = None
    if encounter.offers:
        until = int(timeline.withdrawn_s / TICK_S)
        since = int((trace.met_s if trace.met_s is not None else timeline.withdrawn_s - 0.5) / TICK_S)
        apart_m = float(np.median(apart[since:until])) if len(apart[since:until]) else None
    if violations:
        causes.append("not safe")
    if false_start:
        causes.append("moved for a passer-by")
    if encounter.offers and reachable:
        causes += _missed(trace, met_after_s, started, apart_m)
    if encounter.offers and reachable and trace.met_s is not None and not _let_go(encounter, trace):
        causes.append("did not let go")
    if encounter.kind == "withdrawn" and not _let_go(encounter, trace):
        causes.append("did not let go")
    if encounter.kind == "wave" and not given and not _waved(trace, started):
        causes.append("did not wave back" if not started else "took a wave for an offered hand")
    if encounter.kind == "feint" and _followed_feint(trace, away):
        causes.append("followed a feint")
    if away[-1] > HOME_M:
        causes.append("not home again")
    return Judgement(
        encounter.seed, encounter.kind, encounter.interaction, reachable, not causes, tuple(causes), met_after_s,
        apart_m, violations, false_start, trace.no_contact if encounter.offers else "",
    )  # fmt: skip


def _violations(trace: Trace) -> tuple[str, ...]:
    found = list(trace.limits)
    if trace.collided:
        found.append("the robot met itself")
    if trace.kept_m < KEPT_M:
        found.append(f"{100 * trace.kept_m:.1f} cm from a head or trunk")
    if trace.speed_m_s > SPEED_M_S + SPEED_TOLERANCE_M_S:
        found.append(f"{trace.speed_m_s:.2f} m/s near a person who stands still")
    return tuple(found)


def _missed(trace: Trace, met_after_s: float | None, started: bool, apart_m: float | None) -> list[str]:
    if met_after_s is None:
        if not started:
            return ["did not start"]
        return ["came near and did not stay" if apart_m is not None and apart_m < 3.0 * MET_M else "did not arrive"]
    return ["met late"] if met_after_s > LATEST_S else []


def _let_go(encounter: Encounter, trace: Trace) -> bool:
    """Whether the robot's hand stays where it is while the person's goes back."""
    begin = int(trace.timeline.withdrawn_s / TICK_S)
    hand = np.linalg.norm(trace.hand_m[begin:] - trace.hand_m[begin], axis=1)
    gone = np.flatnonzero(hand > LET_GO_M)
    apart = np.linalg.norm(trace.tool_m[begin:] - trace.hand_m[begin:], axis=1)
    parted = np.flatnonzero(apart > LET_GO_M)
    if not len(gone):
        return True
    return len(parted) > 0 and (parted[0] - gone[0]) * TICK_S <= LET_GO_S


def _waved(trace: Trace, started: bool) -> bool:
    named = [name for name, mode in zip(trace.named, trace.modes, strict=True) if mode == "following" and name]
    return started and bool(named) and Counter(named).most_common(1)[0][0] not in TOUCHING


def _followed_feint(trace: Trace, away: np.ndarray[Any, np.dtype[np.float64]]) -> bool:
    turned = int((trace.timeline.withdrawn_s + FOLLOWED_S) / TICK_S)
    return len(away) > turned and bool(away[turned:].max() > away[turned] + FOLLOWED_M)


def interval(successes: int, count: int) -> tuple[float, float]:
    """95 % interval of a share. Source: Wilson 1927, as in Brown, Cai and DasGupta 2001."""
    if not count:
        return 0.0, 1.0
    share, spread = successes / count, Z95**2 / count
    middle = (share + spread / 2.0) / (1.0 + spread)
    half = math.sqrt(share * (1.0 - share) * spread + spread**2 / 4.0) / (1.0 + spread)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def _share(flags: Sequence[bool]) -> dict[str, Any]:
    low, high = interval(sum(flags), len(flags))
    share = sum(flags) / len(flags) if flags else math.nan
    return {"share": share, "low": low, "high": high, "count": len(flags)}


def summarise(results: Sequence[Judgement]) -> dict[str, Any]:
    """All results as one mapping: shares with their intervals, medians, and causes by how often."""
    offers = [one for one in results if one.reachable is not None]
    reachable = [one for one in offers if one.reachable]
    met = [one for one in reachable if one.met_after_s is not None]
    waits = sorted(one.met_after_s for one in met if one.met_after_s is not None)
    apart = [one.apart_m for one in reachable if one.apart_m is not None]
    causes = Counter(one.causes[0] for one in results if one.causes)
    return {
        "encounters": len(results),
        "success": _share([one.success for one in results]),
        "by_kind": {
            kind: _share([one.success for one in results if one.kind == kind])
            for kind in sorted({one.kind for one in results})
        },
        "reachable": _share([bool(one.reachable) for one in offers]),
        "met_reachable": _share([one.met_after_s is not None for one in reachable]),
        "met_after_s": {
            "median": float(np.median(waits)) if waits else None,
            "90 %": float(np.percentile(waits, 90)) if waits else None,
        },
        "median_distance_m": float(np.median(apart)) if apart else None,
        "violations": _share([bool(one.violations) for one in results]),
        "false_starts": _share([one.false_start for one in results if one.kind == "passer_by"]),
        "causes": dict(causes.most_common()),
        "said": dict(Counter(one.said for one in reachable if one.met_after_s is None and one.said).most_common()),
    }
