# SPDX-License-Identifier: Apache-2.0
"""Why a robot never moved in a run: one line that names the stage at which the person was lost, and what to do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from mild_core.perception.skeletons import SkeletonSource
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.bag.people import source_fault
from mild_ros.bag.reader import open_bag
from mild_ros.replay.recorded import JointTrack, RecordedRun

STILL_RAD = 0.005
"""A robot of which no joint was ever commanded further than this from the first command has not moved."""

USED = ("accepted", "windows", "filled", "calibrated", "calibrating", "bystanders", "missed", "reacquired")
"""What perception counts that explains nothing."""

REMEDIES = {
    "undecodable": "the bag's types are not those of its bytes: record it again with their definitions, in mcap",
    "no_person": "choose a bag with a person in it",
    "calibrating": "it is too short: the person has to stand still for a second before they move",
    "moving": "the person has to stand still for a second before they move",
    "too_old": "the tracker's stamps are older than max_age_s when they come: raise it with -p max_age_s:=VALUE",
    "from_future": "the tracker's stamps lie in the future: compare its clock with the recorder's",
}
"""By the outcome that is in the way; others say themselves what to do."""

NOT_STARTED = {
    "start_turned_away": (
        "a hand was raised by a person who does not face the robot",
        "measure robot_from_camera, or raise start_facing_deg",
    ),
    "start_too_far": (
        "a hand was raised too far away from the robot",
        "measure robot_from_camera, or raise start_hand_m and start_trunk_m",
    ),
    "start_at_head": (
        "the hand that was raised went to the person's own head",
        "choose a bag in which it is held out to the robot",
    ),
    "start_aside": ("the hand that was raised went aside", "choose a bag in which it is held out to the robot"),
    "start_undecided": (
        "a hand was raised, and no interaction was recognised for long enough",
        "name it with --interaction",
    ),
}
"""Why retargeting answered no raised hand, and a remedy; the first that was counted is printed."""

EXPLAINED = "docs/diagnostics.md says what that means"


def has_moved(commands: JointTrack | None) -> bool:
    """Whether a robot was commanded to anywhere but where it was."""
    if commands is None or not len(commands.positions_rad):
        return False
    return bool(np.abs(commands.positions_rad - commands.positions_rad[0]).max() > STILL_RAD)


def counts_of(run: RecordedRun) -> dict[str, Counter[str]]:
    """The events that nodes counted in a recorded run, by stage, by their newest diagnostics."""
    found: dict[str, Counter[str]] = {stage: Counter() for stage in ("perception", "inference", "retargeting")}
    for reports in run.diagnostics.values():
        for key, value in (reports[-1] if reports else {}).items():
            stage, _, reason = key.partition(" ")
            if stage in found and value.isdecimal() and " " not in reason:
                found[stage][reason] += int(value)
    return found


def why_still(
    run: RecordedRun,
    source: SkeletonSource,
    counts: Mapping[str, Mapping[str, int]],
    parameters: PipelineParameters,
    detail: str = "",
) -> tuple[str, str]:
    """What was in the way, and a remedy.

    Args:
        run: Without a movement.
        source: Tracker convention that it was replayed with.
        counts: Events by reason, of each stage, and of `messages` those that could not be read.
        parameters: That it was replayed with.
        detail: What perception said of the newest message that it could not use.
    """
    with open_bag(run.path) as bag:
        fault, remedy = source_fault(bag, source, looked_at=None)
    if fault:
        return fault, remedy
    unread, perceived = Counter(counts.get("messages", {})), Counter(counts.get("perception", {}))
    retargeted, motions = Counter(counts.get("retargeting", {})), Counter(counts.get("inference", {}))
    shown = {reason: count for reason, count in perceived.items() if reason not in USED}
    if not perceived.get("calibrated") and not perceived.get("accepted"):
        reasons = Counter({**shown, **unread})
        reason, count = reasons.most_common(1)[0] if reasons else ("calibrating", perceived.get("calibrating", 0))
        words = f"the person was never calibrated: {count} messages were '{reason}'"
        return words + (f" ({detail})" if detail else ""), REMEDIES.get(reason, EXPLAINED)
    if not motions.get("accepted"):
        return "the person was seen, but too shortly for a prediction", "choose a longer bag, or a smaller --start"
    late = {reason: retargeted[reason] for reason in ("too_old", "from_future") if retargeted[reason]}
    if late and sum(late.values()) >= retargeted["accepted"]:
        reason = max(late, key=lambda name: late[name])
        return f"{late[reason]} predictions were '{reason}'", REMEDIES[reason]
    if not parameters.enabled:
        return "it was not enabled", "leave out enabled:=false, or, in a live system, ./mild enable"
    if run.commands is None:
        return "no command was sent: the robot published no joint states", "check joint_states, and robot_joint_names"
    for reason, explained in NOT_STARTED.items():
        if retargeted[reason]:
            words, remedy = explained
            strict = parameters.interaction != "auto" or parameters.start_evidence > PipelineParameters().start_evidence
            return words, "lower start_evidence" if reason == "start_undecided" and strict else remedy
    refused = Counter({reason: n for reason, n in retargeted.items() if reason.startswith("refused_")})
    if refused:
        reason, count = refused.most_common(1)[0]
        return f"{count} commands were '{reason}'", EXPLAINED
    performed = any(motion.state == "none" for motion in run.motions)
    if performed and retargeted["unknown"] > retargeted["accepted"] // 2:
        words = "what the person does was recognised as none of the model's interactions"
        return words, "name it with --interaction, or take a model that knows it"
    lost, count = Counter(shown).most_common(1)[0] if shown else ("", 0)
    if count > perceived["accepted"]:
        words = f"the person was lost: {count} messages were '{lost}', {perceived['accepted']} were accepted"
        return words, "they have to stay in view" if lost == "no_person" else REMEDIES.get(lost, EXPLAINED)
    other = "left" if parameters.side == "right" else "right"
    remedy = f"choose a bag in which it is raised, or, if the other one is, add -p side:={other}"
    return f"the {parameters.side} hand rested all the time, or did nothing that this robot answers", remedy
