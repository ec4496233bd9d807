# SPDX-License-Identifier: Apache-2.0
"""How a model does with the people of a people file: what it recognises, and how often the robot moves for nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mild_core.inference.gesture_recogniser import SAME
from mild_core.learning.people import STANDING_S, PeopleRecording, skeletons
from mild_core.pipeline import Pipeline
from mild_core.retargeting.modes import Mode
from mild_core.shapes import FloatArray
from mild_core.signals import NAMED, NONE, OFFERED, RESTING, JointMeasurement

MOMENTS_S = (0.5, 1.0, 2.0, 3.0)
"""After the onset, when it is asked what is recognised."""

ONSET_M = 0.06
"""Distance of the hand from its rest at the onset of a motion."""

STILL_RAD_S, STILL_S = 0.02, 0.5
"""A robot slower than this for so long stands; what it does next is another motion."""

SETTLED_S = 0.5
"""The first so many seconds of a recording do not count as false starts."""

TICK_NS = 10_000_000
LEAST_ACCEPTED = 0.9
"""Share of accepted frames below which figures say more about perception than about recognition."""

OUTCOMES = ("right", "wrong", OFFERED, NONE, RESTING)


@dataclass(frozen=True, eq=False)
class Watched:
    """One person of a recording, as the pipeline saw them.

    Attributes:
        label: What they did; "" for nothing that the model knows.
        onset_s: When their hand left its rest; NaN where it never did.
        times_s: (N,) of the predictions.
        outcomes: (N,) of `OUTCOMES`; "wrong" for a label of "".
        likeliest: (N,) whether the likeliest interaction is the right one.
        frames: Of the recording.
        accepted: Of them, by perception.
        starts: Times that the robot began to answer after the first half second.
        made_way: Times that it moved otherwise: away from people, or home.
        minutes: Of accepted frames after it.
    """

    label: str
    onset_s: float
    times_s: FloatArray
    outcomes: tuple[str, ...]
    likeliest: tuple[bool, ...]
    frames: int
    accepted: int
    starts: int
    made_way: int
    minutes: float


def watch(pipeline: Pipeline, recording: PeopleRecording, person: int) -> Watched:
    """Play one person of a recording to a pipeline, the robot at home."""
    names = pipeline.inference.model.manifest.interactions
    state, robot = pipeline.init(), pipeline.retargeting.robot
    positions_rad = np.asarray(robot.home_rad)
    times, outcomes, likeliest = [], [], []
    frames = accepted = starts = made_way = minutes_frames = 0
    still_ticks, now_ns = round(STILL_S * 1e9 / TICK_NS), 0
    stood = still_ticks
    label = SAME.get(recording.label, recording.label)
    for time_s, skeleton in skeletons(recording, person):
        while now_ns < skeleton.stamp_ns:
            now_ns += TICK_NS
            measured = JointMeasurement(now_ns, robot.joint_names, positions_rad)
            state, _ = pipeline.step(state, measured, now_ns)
            state, output = pipeline.step(state, None, now_ns)
            for command in output.commands:
                positions_rad = command.positions_rad
                moves = float(np.abs(command.velocities_rad_s).max()) > STILL_RAD_S
                if moves and stood >= still_ticks and time_s > SETTLED_S:
                    answers = command.mode == Mode.FOLLOWING.value
                    starts, made_way = starts + answers, made_way + (not answers)
                stood = 0 if moves else stood + 1
        state, output = pipeline.step(state, (skeleton,), skeleton.stamp_ns)
        if time_s >= 0.0:
            used = state.perception.outcome == "accepted"
            frames, accepted = frames + 1, accepted + used
            minutes_frames += used and time_s > SETTLED_S
        for motion in output.motions:
            named = SAME.get(motion.interaction, motion.interaction)
            right = "right" if named == label else "wrong"
            published = state.inference.published
            times.append(motion.stamp_ns * 1e-9 - 2.0 * STANDING_S)
            outcomes.append(right if motion.state == NAMED else motion.state)
            best = names[published.likeliest] if published is not None else ""
            likeliest.append(SAME.get(best, best) == label)
    minutes = minutes_frames * float(np.median(np.diff(recording.times_s))) / 60.0
    onset_s = _onset_s(recording, person)
    return Watched(
        *(
            label,
            onset_s,
            np.array(times),
            tuple(outcomes),
            tuple(likeliest),
            frames,
            accepted,
            starts,
            made_way,
            minutes,
        )
    )


def _onset_s(recording: PeopleRecording, person: int) -> float:
    """When the right hand is `ONSET_M` from where it was at first, not before the interaction begins; NaN: never."""
    name = "right_hand" if "right_hand" in recording.joint_names else "right_wrist"
    hand = recording.joint(person, name) - recording.joint(person, "right_shoulder")
    away = np.linalg.norm(hand - hand[0], axis=1) > ONSET_M
    begin_s = recording.active_s[0] if np.isfinite(recording.active_s[0]) else 0.0
    found = np.flatnonzero(away & (recording.times_s >= begin_s))
    return float(recording.times_s[found[0]]) if len(found) else float("nan")


def summarise(watched: Iterable[Watched]) -> dict[str, Any]:
    """The figures of `mild evaluate --people`."""
    everyone = list(watched)
    known = [one for one in everyone if one.label and np.isfinite(one.onset_s) and len(one.times_s)]
    frames, accepted = sum(one.frames for one in everyone), sum(one.accepted for one in everyone)
    minutes = sum(one.minutes for one in everyone)
    share = accepted / frames if frames else 0.0
    before = [
        any(o in ("right", "wrong") for o, t in zip(one.outcomes, one.times_s, strict=True) if t < one.onset_s)
        for one in known
    ]
    return {
        "people": len(everyone),
        "recognised": {
            f"{after_s:g}" if after_s % 1 else f"{after_s:.1f}": _shares(known, _at(after_s)) for after_s in MOMENTS_S
        },
        "active": _shares(known, lambda one: np.flatnonzero(one.times_s >= one.onset_s)),
        "named_at_rest": float(np.mean(before)) if before else None,
        "starts_per_minute": sum(one.starts for one in everyone) / minutes if minutes else None,
        "made_way_per_minute": sum(one.made_way for one in everyone) / minutes if minutes else None,
        "accepted_frames": share,
        "valid": share >= LEAST_ACCEPTED,
    }


def _at(after_s: float) -> Callable[[Watched], Any]:
    """The last prediction that was made by so long after the onset."""
    return lambda one: np.flatnonzero(one.times_s <= one.onset_s + after_s)[-1:]


def _shares(known: list[Watched], chosen: Callable[[Watched], Any]) -> dict[str, float] | None:
    """Mean over people of the shares of outcomes among their chosen predictions, and of the likeliest being right."""
    rows = []
    for one in known:
        places = chosen(one)
        if len(places):
            outcomes = [one.outcomes[place] for place in places]
            rows.append(
                [outcomes.count(name) / len(places) for name in OUTCOMES]
                + [np.mean([one.likeliest[place] for place in places])]
            )
    if not rows:
        return None
    return dict(zip((*OUTCOMES, "likeliest"), np.mean(rows, axis=0).tolist(), strict=True))
