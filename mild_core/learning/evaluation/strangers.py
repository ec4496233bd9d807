# SPDX-License-Identifier: Apache-2.0
"""How a model does with the people of a people file: what it recognises, when the robot moves, how near hands come."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from mild_core.inference.gesture_recogniser import SAME
from mild_core.learning.data.people import STANDING_S, PeopleRecording, skeletons
from mild_core.perception.stage import Perception
from mild_core.pipeline import Pipeline
from mild_core.retargeting.contact import shoulder_and_reach_m
from mild_core.retargeting.modes import Mode
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
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

MEETING_M = 0.15
"""Two people's hands meet while they are so near each other."""

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
        hands_m: (M, 3) the robot's tool in its base frame at each frame of the recording; NaN before its first command.
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
    hands_m: FloatArray


def watch(pipeline: Pipeline, recording: PeopleRecording, person: int) -> Watched:
    """Play one person of a recording to a pipeline, the robot at home."""
    names = pipeline.inference.model.manifest.interactions
    state, robot = pipeline.init(), pipeline.retargeting.robot
    positions_rad = np.asarray(robot.home_rad)
    times, outcomes, likeliest = [], [], []
    hands: list[FloatArray] = []
    frames = accepted = starts = made_way = minutes_frames = 0
    still_ticks, now_ns = round(STILL_S * 1e9 / TICK_NS), 0
    stood = still_ticks
    label = SAME.get(recording.label, recording.label)
    for time_s, skeleton in skeletons(recording, person):
        while now_ns + TICK_NS <= skeleton.stamp_ns:  # never beyond it: a clock that goes back resets
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
            hands.append(positions_rad)
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
    tool_m = forward_kinematics(robot, np.array(hands), robot.tool_link)[:, :3, 3]
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
            tool_m,
        )
    )


def meeting(recording: PeopleRecording) -> FloatArray:
    """(T,) whether the hands of two people are near each other; never, where there are not two."""
    if recording.people != 2:
        return np.zeros(len(recording.times_s), dtype=bool)
    one, other = (_hand(recording, person) for person in range(2))
    near: FloatArray = np.linalg.norm(one - other, axis=1) < MEETING_M  # NaN is not
    return near


def in_partners_place(pipeline: Pipeline, recording: PeopleRecording, person: int) -> Pipeline:
    """The pipeline of a robot that stands where the person's partner stood, its camera measured.

    Its shoulder is where the partner's was at first, nearer by as much as the robot's arm is shorter, and it looks at
    the person.
    """
    pose, perception = _partners_place(pipeline, recording, person), pipeline.perception
    robot_from_source: FloatArray = np.linalg.inv(pose).astype(np.float64)
    settings = replace(perception.settings, robot_from_source=robot_from_source)
    return replace(
        pipeline, perception=Perception(settings), retargeting=replace(pipeline.retargeting, camera_measured=True)
    )


def apart(pipeline: Pipeline, recording: PeopleRecording, person: int) -> FloatArray:
    """(M,) distances of the robot's tool from the person's hand [m] while the two people's hands were together.

    Args:
        pipeline: Any of the model; the robot is put in the partner's place.
        recording: Of two people.
        person: Who is watched.
    """
    together = meeting(recording)
    if not together.any():
        return np.zeros(0)
    there = in_partners_place(pipeline, recording, person)
    pose = _partners_place(pipeline, recording, person)
    hands_m = watch(there, recording, person).hands_m @ pose[:3, :3].T + pose[:3, 3]
    distance: FloatArray = np.linalg.norm(hands_m - _hand(recording, person), axis=1)[together]
    return distance


def _partners_place(pipeline: Pipeline, recording: PeopleRecording, person: int) -> FloatArray:
    """(4, 4) pose of the robot's base in the recording's frame."""
    robot, partner = pipeline.retargeting.robot, 1 - person
    arm = [recording.joint(partner, f"right_{name}") for name in ("shoulder", "elbow")] + [_hand(recording, partner)]
    length_m = sum(float(np.nanmedian(np.linalg.norm(b - a, axis=1))) for a, b in pairwise(arm))
    towards = _middle(recording, person) - _middle(recording, partner)
    forward = np.array([*towards[:2], 0.0]) / np.linalg.norm(towards[:2])
    shoulder_m, reach_m = shoulder_and_reach_m(robot)
    pose = np.eye(4)
    pose[:3, :3] = np.array([forward, [-forward[1], forward[0], 0.0], [0.0, 0.0, 1.0]]).T
    place = _first(arm[0]) + max(length_m - reach_m, 0.0) * forward
    pose[:3, 3] = place - pose[:3, :3] @ shoulder_m
    return pose


def _middle(recording: PeopleRecording, person: int) -> FloatArray:
    """(3,) between a person's shoulders at first; the right one, where the left one is not seen."""
    sides = [f"{side}_shoulder" for side in ("right", "left") if f"{side}_shoulder" in recording.joint_names]
    middle: FloatArray = np.nanmean([_first(recording.joint(person, side)) for side in sides], axis=0)
    return middle


def _first(joint_m: FloatArray) -> FloatArray:
    """(3,) a joint where it is first seen; NaN if never."""
    seen = np.isfinite(joint_m).all(axis=1)
    first: FloatArray = joint_m[int(seen.argmax())]
    return first


def _hand(recording: PeopleRecording, person: int) -> FloatArray:
    """(T, 3) a person's right hand; the wrist, where a file has no hands [m]."""
    return recording.joint(person, "right_hand" if "right_hand" in recording.joint_names else "right_wrist")


def _onset_s(recording: PeopleRecording, person: int) -> float:
    """When the right hand is `ONSET_M` from where it was at first, not before the interaction begins; NaN: never."""
    hand = _hand(recording, person) - recording.joint(person, "right_shoulder")
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


def contact_of(distances_m: Iterable[FloatArray]) -> float | None:
    """Median over all frames of how far hands stayed apart [m]; None where no hands were together."""
    every = np.concatenate([np.zeros(0), *distances_m])
    return float(np.median(every)) if len(every) else None


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
