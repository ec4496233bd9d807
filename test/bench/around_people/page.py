# SPDX-License-Identifier: Apache-2.0
"""The measured part of docs/safety.md: each claim with its figure, then every scene.

It stands between `<!-- measured: people -->` and `<!-- end -->`; the rest of the page is written by hand.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mild_core.errors import SetupError
from test.bench.around_people.judge import BANDS_M, FALSE_START_M, SPEED_M_S
from test.bench.around_people.scenes import SCENES
from test.bench.people import Result, nearest_m, table, verdicts

PLACE = re.compile(r"(<!-- measured: people -->\n)(.*?)(<!-- end -->)", re.DOTALL)

STANDING = (
    *("bystander_staying", "bystander_beside", "two_bystanders", "arm_resting_in_the_way", "knees_near"),
    *("numbers_swapped", "two_greeting", "pepper_bystander", "bystander_near_fast_motion"),
)
WATCHED = (
    *("handshake", "rocket", "parachute", "hand_wave", "pepper_handshake", "left_arm", "child", "seated"),
    *("near_fast_motion", "walk_off", "hand_jerked_back"),
)
COMING = (
    *("bystander_crossing", "head_into_hand", "trunk_into_arm", "child_beside", "arm_reaching_in"),
    *("bend", "walks_in", "approach_going_home"),
)
UNSEEN = ("head_unseen", "hips_unseen", "shoulders_only", "bystander_half_seen")
WORSE = ("noise_and_loss", "tracker_5_hz", "tracker_10_hz", "tracker_60_hz", "drop_outs", "pose_jumps")
GREETINGS = ("handshake", "rocket", "parachute", "hand_wave", "left_arm", "pepper_handshake")
IDLE = ("turned_away", "scratching", "pointing")
FAST = ("lunge",)


@dataclass(frozen=True)
class Claim:
    """One promise.

    Attributes:
        text: What is promised.
        promise: Of `people.Verdict`.
        scenes: Where; empty for all.
    """

    text: str
    promise: str
    scenes: tuple[str, ...] = ()


CLAIMS = (
    Claim("The arm keeps 5 cm from head, trunk and limbs of bystanders who stand in its way.", "distance", STANDING),
    Claim("It keeps 5 cm from all of the watched person but the forearm and hand they offer.", "distance", WATCHED),
    Claim("It makes way for a body part that comes towards it at up to 0.6 m/s.", "distance", COMING),
    Claim("A head or hips that the tracker does not see are kept away from too.", "distance", UNSEEN),
    Claim("Without a measured camera the arm touches no person.", "distance", ("place_unmeasured",)),
    Claim("All of this holds with a worse tracker.", "distance", WORSE),
    Claim(f"No point of the arm is faster than {SPEED_M_S:g} m/s within 0.3 m of a body that stands still.", "speed"),
    Claim(
        f"Towards a body that moves, no point within 0.3 m is faster than {SPEED_M_S:g} m/s less its approach, or the "
        "arm brakes at its limits.",
        "towards",
    ),
    Claim("A person who greets another person, scratches or points does not start the arm.", "start", IDLE),
    Claim("A greeting starts the arm, at most 0.3 s later than without asking for evidence.", "start", GREETINGS),
    Claim("Hands that are meant to touch do.", "contact", GREETINGS + WORSE),
    Claim("Commands keep the limits of position, velocity, acceleration and jerk.", "limits"),
)


def figure(claim: Claim, results: Sequence[Result]) -> str:
    """What was measured of a claim."""
    own = [each for each in results if not claim.scenes or each.scene in claim.scenes]
    if not own:
        return "not measured"
    judged = [each.judgement for each in own]
    if claim.promise == "distance":
        asked = [each for each in own if each.expectation.keep_m is not None]
        kept = sum(_least(each) >= (each.expectation.keep_m or 0.0) for each in asked)
        parts = ", ".join(f"{part} {_cm(nearest_m(asked, part))}" for part in ("head", "trunk", "limbs"))
        return f"{kept} of {len(asked)} runs; least: {parts}"
    if claim.promise == "speed":
        speeds = np.max([each.still_m_s for each in judged], axis=0)
        bands = ", ".join(f"{speed:.2f} below {band:g} m" for speed, band in zip(speeds, BANDS_M, strict=True))
        over = sum(each.still_over for each in judged)
        return f"{bands}; {over} of {sum(each.near for each in judged)} commands near people above"
    if claim.promise == "towards":
        over, near = sum(each.towards_over for each in judged), sum(each.near for each in judged)
        braking = sum(each.towards_braking for each in judged)
        peak = max(each.towards_m_s for each in judged)
        share = f"{100 * over / max(near, 1):.3f} % of {near} commands near people above"
        return f"{share}, by {peak:.2f} m/s at most; {braking} braking"
    if claim.promise == "start" and claim.scenes == IDLE:
        counts = []
        for name in IDLE:
            runs = [each for each in own if each.scene == name]
            starts = sum(each.judgement.moved_m > FALSE_START_M for each in runs)
            counts.append(f"{name.replace('_', ' ')} {starts} of {len(runs)}")
        return ", ".join(counts)
    if claim.promise == "start":
        delays = [each.start_s for each in judged if each.start_s is not None]
        late = f"{np.median(delays):.2f} s, at most {max(delays):.2f} s" if delays else "never"
        return f"{len(delays)} of {len(own)} start; median {late} after the hand has left its rest"
    if claim.promise == "contact":
        apart = [each.contact_m for each in judged if each.contact_m is not None]
        return f"median {_cm(float(np.median(apart)))} between the middles of the hands" if apart else "not measured"
    broken = sum(bool(each.limits) for each in judged)
    return f"{sum(each.commands for each in judged):,} commands of {len(own)} runs; limits broken in {broken} runs"


def kept(claim: Claim, results: Sequence[Result]) -> bool:
    """Whether a claim holds in every scene."""
    names = {each.scene for each in results if not claim.scenes or each.scene in claim.scenes}
    judged = [verdicts([each for each in results if each.scene == name]) for name in names]
    found = [each for own in judged for each in own if each.promise == claim.promise]
    return bool(found) and all(each.kept for each in found)


def measured_part(results: Sequence[Result]) -> str:
    """The claims and the scenes as Markdown."""
    lines = ["| Claim | Holds | Measured |", "|---|---|---|"]
    for claim in CLAIMS:
        measured = any(not claim.scenes or each.scene in claim.scenes for each in results)
        holds = "" if not measured else "yes" if kept(claim, results) else "**no**"
        lines.append(f"| {claim.text} | {holds} | {figure(claim, results)} |")
    runs, names = len(results), {each.scene for each in results}
    lines += [
        "",
        f"{runs} runs of {len(names)} scenes. Least distances in cm (empty: none within 30 cm), largest speeds",
    ]
    lines += ["in m/s in bands of distance, near bodies that stand still / that move:", ""]
    head, *rows = table(results)
    lines += ["| Scene | Runs | Head | Trunk | Limbs | " + " | ".join(f"< {band:g} m" for band in BANDS_M)]
    lines[-1] += " | Not kept |"
    lines.append("|---|" + "--:|" * (4 + len(BANDS_M)) + "---|")
    for row in rows:
        cells = dict(zip(head, row, strict=True))
        bands = [head[5 + place : 6 + place] + head[9 + place : 10 + place] for place in range(len(BANDS_M))]
        speeds = [
            " / ".join(cells[name] or "-" for name in pair) if any(cells[n] for n in pair) else "" for pair in bands
        ]
        what = SCENES[cells["scene"]].what if cells["scene"] in SCENES else cells["scene"]
        broken = "" if cells["broken"] == "-" else f"**{cells['broken']}**"
        lines.append(
            f"| {what} | {cells['runs']} | {cells['head']} | {cells['trunk']} | {cells['limbs']} | "
            + " | ".join(speeds)
            + f" | {broken} |"
        )
    return "\n".join(lines) + "\n"


def page(text: str, results: Sequence[Result]) -> str:
    """A document with its measured part brought up to date.

    Raises:
        SetupError: It has no place for it.
    """
    part = measured_part(results)
    filled, number = PLACE.subn(lambda found: f"{found[1]}{part}{found[3]}", text)
    if number != 1:
        remedy = "put `<!-- measured: people -->` and `<!-- end -->` into it"
        raise SetupError("people", f"the document has {number} places for what is measured", remedy)
    return filled


def _least(result: Result) -> float:
    return min(result.judgement.clearance_m.values(), default=np.inf)


def _cm(metres: float) -> str:
    return f"{100 * metres:.1f} cm" if np.isfinite(metres) else "above 30 cm"
