# SPDX-License-Identifier: Apache-2.0
"""Faults of what is doubted: the robot's joints, who is who, repeated messages, the first motion, time-outs, errors."""

from __future__ import annotations

from test.mutations.fault import Fault

MEASURED = "mild_core/joint_measurements.py"
IDENTITY = "mild_core/perception/person_tracker.py"
REPETITION = "mild_core/perception/repetition.py"
GATE = "mild_core/retargeting/start_gate.py"
WATCHDOG = "mild_core/retargeting/timeouts.py"
LIFE = "mild_core/retargeting/mode_inputs.py"
PURSUIT = "mild_core/retargeting/target.py"
EVALUATION = "mild_core/learning/evaluation/errors.py"
JOINTS = ("test/core/test_joint_measurements.py",)
WHO = ("test/core/perception/test_person_tracker.py",)
REPEATED = ("test/core/perception/test_repetition.py",)
STARTS = (
    "test/core/retargeting/test_start_gate.py",
    *(
        f"test/core/retargeting/test_people.py::{name}"
        for name in (
            "test_a_person_who_does_not_face_the_robot_or_is_far_away_starts_nothing",
            "test_a_greeting_starts_a_quarter_of_a_second_after_the_hand_is_raised",
        )
    ),
)
UNNAMED = (
    "test/core/retargeting/test_people.py::"
    "test_a_hand_without_a_name_starts_nothing_of_people_who_are_not_seen_to_stand_facing_the_robot",
)
TIMES = ("test/core/retargeting/test_life.py", "test/core/retargeting/test_stage.py")
ERRORS = ("test/core/learning/test_evaluation.py",)
STOPPING = ("test/core/learning/test_epoch_search.py",)

FAULTS = (
    Fault(
        "joints as fast as their motors",
        "A joint that a person moves by hand is doubted.",
        MEASURED,
        "HAND_FACTOR * self.velocity_rad_s[place]",
        "self.velocity_rad_s[place]",
        JOINTS,
    ),
    Fault(
        "joints leap backwards",
        "A step that no joint can make is believed in one direction.",
        MEASURED,
        "return abs(heard.position_rad - before.position_rad) <= reach",
        "return heard.position_rad - before.position_rad <= reach",
        JOINTS,
    ),
    Fault(
        "impossible steps believed at once",
        "What is doubted is believed as soon as it has been said often enough.",
        MEASURED,
        "if (now_ns - doubt.since_ns) * 1e-9 < BELIEVE_AFTER_S:",
        "if (now_ns - doubt.since_ns) * 1e-9 < 0.0:",
        JOINTS,
    ),
    Fault(
        "one message convinces",
        "A single confirmation of an impossible step is enough.",
        MEASURED,
        "doubt.times >= BELIEVE_TIMES",
        "doubt.times >= 1",
        JOINTS,
    ),
    Fault(
        "disagreement without an end",
        "Three doubted messages hold the robot for good.",
        MEASURED,
        "(now_ns - doubted[0]) * 1e-9 <= DISAGREE_WITHIN_S",
        "(now_ns - doubted[0]) * 1e-9 >= 0.0",
        JOINTS,
    ),
    Fault(
        "limits of another side",
        "A joint below its lower limit is believed.",
        MEASURED,
        "not self.lower_rad[place] <= position <= self.upper_rad[place]",
        "not position <= self.upper_rad[place]",
        JOINTS,
    ),
    Fault(
        "joints known for good",
        "A joint that is not heard any more counts as known.",
        MEASURED,
        "heard is None or now_ns - heard.received_ns > longest_ns",
        "heard is None",
        JOINTS,
    ),
    Fault(
        "late joints are new ones",
        "A message that comes late moves the robot back to where it was.",
        MEASURED,
        "0 < old.stamp_ns - new.stamp_ns <= LATE_S * 1e9",
        "0 < new.stamp_ns - old.stamp_ns <= 0.0 * LATE_S",
        JOINTS,
    ),
    Fault(
        "the person who is farthest away",
        "Without a tracked person the one who is farthest from the camera is chosen.",
        IDENTITY,
        "return min(everyone, key=_distance_from_origin, default=None)",
        "return max(everyone, key=_distance_from_origin, default=None)",
        WHO,
    ),
    Fault(
        "a right number counts against a body",
        "Of two bodies in one place the one with another number is taken.",
        IDENTITY,
        "score = distance - same * SAME_NUMBER_BONUS_M",
        "score = distance + same * SAME_NUMBER_BONUS_M",
        WHO,
    ),
    Fault(
        "everyone may have run",
        "A body with another number is the watched one however far away it is, once time has passed.",
        IDENTITY,
        "if distance is None or distance > reach_m + same * RUNNING_M_S * hidden_s:",
        "if distance is None or distance > reach_m + RUNNING_M_S * hidden_s:",
        WHO,
    ),
    Fault(
        "trunks apart by their worst joint",
        "One joint that a tracker throws away makes one person another person.",
        IDENTITY,
        "return distances[half] if len(distances) % 2 else",
        "return distances[-1] if len(distances) % 2 else",
        WHO,
    ),
    Fault(
        "repeated since the newest message",
        "A tracker that repeats itself is never found out.",
        REPETITION,
        "Run(joints, self.since_ns if same else stamp_ns, stamp_ns)",
        "Run(joints, stamp_ns, stamp_ns)",
        REPEATED,
    ),
    Fault(
        "different joints go on with a run",
        "A living person is taken for a frozen one.",
        REPETITION,
        "same = joints == self.joints and stamp_ns",
        "same = stamp_ns",
        REPEATED,
    ),
    Fault(
        "a person turned away starts the robot",
        "A person who looks elsewhere and greets another person is followed.",
        GATE,
        "if float(facing @ to_robot) < math.cos(math.radians(settings.start_facing_deg)):",
        "if float(facing @ to_robot) < -math.cos(math.radians(settings.start_facing_deg)):",
        STARTS,
    ),
    Fault(
        "any distance starts the robot",
        "A person across the room is followed.",
        GATE,
        "if away_m > settings.start_trunk_m or",
        "if away_m < 0.0 or",
        STARTS,
    ),
    Fault(
        "started without a look",
        "The first motion does not wait until a hand has been raised for a while.",
        GATE,
        "(now_ns - sight.raised_ns) * 1e-9 < settings.start_watch_s",
        "(now_ns - sight.raised_ns) * 1e-9 < 0.0",
        STARTS,
    ),
    Fault(
        "a hand without a name starts the robot for people who walk",
        "The arms of people who walk by swing: that is no greeting.",
        GATE,
        "float(np.linalg.norm(trunks[0].mean(axis=0))) < WALKS_M_S",
        "True",
        UNNAMED,
    ),
    Fault(
        "a hand without a name starts the robot where facing is not judged",
        "Without a camera that is measured it is unknown for whom a hand is raised.",
        GATE,
        "if sight.frame_id != ROBOT_FRAME or crowd is None or not np.isfinite(crowd.facing).all():",
        "if crowd is None:",
        UNNAMED,
    ),
    Fault(
        "motions that came lately are fresh",
        "Old motions that a stalled network delivers now are followed.",
        WATCHDOG,
        "        and (now_ns - plan.stamp_ns) * 1e-9 <= settings.max_age_s\n",
        "",
        TIMES,
    ),
    Fault(
        "motions that are young are fresh",
        "A publisher that died is noticed too late.",
        WATCHDOG,
        "        and (now_ns - plan.received_ns) * 1e-9 <= settings.stale_after_s\n",
        "",
        TIMES,
    ),
    Fault(
        "a silent robot is heard",
        "A robot that no longer says where it is is commanded on.",
        WATCHDOG,
        "if (now_ns - state.measured_ns) * 1e-9 <= settings.stale_after_s:",
        "if (now_ns - state.measured_ns) * 1e-9 >= 0.0:",
        TIMES,
    ),
    Fault(
        "speed outlives a gap",
        "After a gap a robot that has come to rest is commanded with the speed of before.",
        WATCHDOG,
        "motion=JointMotion.at_rest(motion.position_rad)).counted",
        "motion=motion).counted",
        ("test/core/retargeting/test_interference.py",),
    ),
    Fault(
        "unknown motions are followed",
        "A motion that no person performs is followed without an end.",
        WATCHDOG,
        "since_ns is None or (now_ns - since_ns) * 1e-9 <= settings.unknown_after_s",
        "since_ns is None or (now_ns - since_ns) * 1e-9 >= 0.0",
        TIMES,
    ),
    Fault(
        "interactions without an end",
        "A hand that stays up keeps the robot for ever.",
        LIFE,
        "if (now_ns - state.since_ns) * 1e-9 > settings.interaction_s:",
        "if (now_ns - state.since_ns) * 1e-9 < 0.0:",
        TIMES,
    ),
    Fault(
        "a still hand near the robot's ends it",
        "An interaction ends while hands touch, and goes on while they are far apart.",
        LIFE,
        "state.near_m > settings.near_m:",
        "state.near_m < settings.near_m:",
        TIMES,
    ),
    Fault(
        "ways onto a plan lead away",
        "A robot that ramps in moves away from its plan.",
        PURSUIT,
        "return replace(self, speed_rad_s=speed), aimed_rad + left * behind",
        "return replace(self, speed_rad_s=speed), aimed_rad - left * behind",
        ("test/core/retargeting/test_plan.py", *TIMES),
    ),
    Fault(
        "errors as a sum over interactions",
        "The macro error is larger the more interactions there are.",
        EVALUATION,
        "counts[drawn].sum(axis=1) / len(groups)",
        "counts[drawn].sum(axis=1)",
        ERRORS,
    ),
    Fault(
        "the macro error is the pooled one",
        "Interactions with more windows count more.",
        EVALUATION,
        "macro_mse=float(np.mean([np.concatenate(parts).mean() for parts in groups]))",
        "macro_mse=float(squared.mean())",
        ERRORS,
    ),
    Fault(
        "too many trials are drawn",
        "Intervals are those of independent windows, and far too narrow.",
        EVALUATION,
        "size=(BOOTSTRAP_DRAWS, len(parts)))",
        "size=(BOOTSTRAP_DRAWS, 50 * len(parts)))",
        ERRORS,
    ),
    Fault(
        "any gain is a gain",
        "Training goes on for as long as an error falls by chance.",
        "mild_core/learning/training/epoch_search.py",
        "errors[-2] * (1.0 - LEAST_GAIN)",
        "errors[-2]",
        STOPPING,
    ),
)
