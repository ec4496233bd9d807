# SPDX-License-Identifier: Apache-2.0
"""Faults of what carries over to people never met: gestures, novelty, caution, licences; and of held-out figures."""

from __future__ import annotations

from test.mutations.fault import Fault

RECOGNISER = "mild_core/inference/gesture_recogniser.py"
STAGE = "mild_core/inference/stage.py"
LICENCES = "mild_core/learning/training/licences.py"
TESTS = ("test/core/inference/test_gesture_recogniser.py",)
LICENCE_TESTS = ("test/core/learning/test_card.py", "test/core/learning/test_kinematic_people.py")
PLOT_TESTS = ("test/command_line/test_plot.py",)

FAULTS = (
    Fault(
        "a hand that is held out waves",
        "A hand that is held out still is named a wave, and not met.",
        STAGE,
        "if gestures.held and not self._waves.all():",
        "if gestures.held and self._waves.all():",
        TESTS,
    ),
    Fault(
        "a hand is held out in vain",
        "A hand that is held out for longer than two seconds without a name is given up.",
        STAGE,
        "return OFFERED if gestures.active_s <= UNDECIDED_S or started or gestures.held else NONE",
        "return OFFERED if gestures.active_s <= UNDECIDED_S or started else NONE",
        TESTS,
    ),
    Fault(
        "a slow wave is held out",
        "A hand that waves is taken to be held out.",
        RECOGNISER,
        "distance > ONSET_DISTANCE and strays < HELD**2 else 0.0",
        "distance > ONSET_DISTANCE else 0.0",
        TESTS,
    ),
    Fault(
        "caution asks for no more evidence",
        "A cautious robot starts as soon as any other.",
        RECOGNISER,
        "(start + CAUTIOUS_LOG_ODDS, CAUTIOUS_S) if cautious else (start, 0.0)",
        "(start, 0.0)",
        TESTS,
    ),
    Fault(
        "caution starts at an offered hand",
        "A cautious robot starts before the interaction has a name.",
        STAGE,
        "return name == NAMED or not self.cautious",
        "return True",
        TESTS,
    ),
    Fault(
        "a walking person starts an interaction",
        "Who walks past with a raised hand is greeted.",
        RECOGNISER,
        "started = allowed_s > hold_s and walking < WALKING",
        "started = allowed_s > hold_s",
        TESTS,
    ),
    Fault(
        "permission from the readout without a background",
        "Walking and reaching, which only the other readout knows, start the robot.",
        RECOGNISER,
        "allowed = log_softmax(seen @ self.permission_weight + self.permission_bias)",
        "allowed = log_softmax(np.append(seen @ self.weight + self.bias, -30.0))",
        TESTS,
    ),
    Fault(
        "an unfamiliar motion goes on",
        "A foreign motion that has started is followed to its end.",
        RECOGNISER,
        "started=started and not (active_s > UNDECIDED_S and familiar < bound),",
        "started=started,",
        TESTS,
    ),
    Fault(
        "familiarity by probability",
        "A fist bump, as surely a handshake as a handshake is, counts as known.",
        RECOGNISER,
        "outstanding = max(float(known[:-1].max() - known.mean()), 0.0)",
        "outstanding = 5.0 * float(np.exp(known[:-1].max()))",
        TESTS,
    ),
    Fault(
        "the rest is forgotten at a gap",
        "After a gap a raised hand counts as one at rest.",
        RECOGNISER,
        "memory[0], memory[22:25] = REST_KNOWN, state.memory[22:25]",
        "pass",
        TESTS,
    ),
    Fault(
        "samples of the recogniser are not interpolated",
        "A slow tracker's hand moves in steps, and its speeds are wrong.",
        RECOGNISER,
        "frames.append(state.arm + share * (arm - state.arm))",
        "frames.append(arm)",
        TESTS,
    ),
    Fault(
        "licences of some sources",
        "A model of many recordings names the licence of the first one only.",
        LICENCES,
        'return " AND ".join(dict.fromkeys(parts)) or NOASSERTION',
        'return " AND ".join(list(dict.fromkeys(parts))[:1]) or NOASSERTION',
        LICENCE_TESTS,
    ),
    Fault(
        "an unknown licence is no licence",
        "A recording without a stated licence is left out of a model's.",
        LICENCES,
        '(one or NOASSERTION).split(" AND ")',
        '(one or "").split(" AND ")',
        LICENCE_TESTS,
    ),
    Fault(
        "figures of trials that were learned from",
        "What is shown as held out was learned.",
        "mild_ros/command_line/held_out.py",
        "train(learned, protocol,",
        "train(learned + held_out, protocol,",
        PLOT_TESTS,
    ),
    Fault(
        "another training is found again",
        "A changed configuration shows the figure of the one before.",
        "mild_ros/command_line/held_out.py",
        "if _identity_in(folder) != wanted:",
        "if not _identity_in(folder):",
        PLOT_TESTS,
    ),
    Fault(
        "stars by all trials",
        "An interaction is tested by the trials of all.",
        "mild_core/learning/evaluation/comparison.py",
        "[one for one in errors if one.interaction == name], bar",
        "errors, bar",
        ("test/core/learning/test_cross_validation.py",),
    ),
)
