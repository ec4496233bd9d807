# SPDX-License-Identifier: Apache-2.0
"""Recordings of an ordinary day in a lab: a model that runs, or one line that rejects them before training."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import DatasetError
from mild_core.inference.model import build_model
from mild_core.inference.priors import PRIORS
from mild_core.learning.data.trial_validity import require_valid
from mild_core.learning.data.windows import PROTOCOLS
from mild_core.learning.evaluation.errors import errors_of_trial
from mild_core.learning.training.algorithm import require_learnable, train
from mild_core.learning.training.export import ModelFacts, export
from mild_core.learning.training.model_predictor import ModelPredictor
from test.core.inference.oracles import initial_belief, update
from test.core.learning.made_trials import ARM, made_trials
from test.core.learning.small_settings import SMALL, TWO

FRAME, JOINT = 60, 1
SHORT = replace(SMALL, epochs=2, stride=4, gradient_stride=4)


def everywhere(trial):
    return True


def in_one(trial):
    return trial.trial == 2


def in_push(trial):
    return trial.interaction == "push"


def changed(where, robot=None, human=None, each=3):
    """Made trials, some of which show something else: functions of the robot's angles and of the person's arm."""
    trials = []
    for trial in made_trials(each, TWO):
        if where(trial):
            angles, arm = np.array(trial.controlled), np.array(trial.observed_m)
            trial = replace(
                trial, controlled=robot(angles) if robot else angles, observed_m=human(arm) if human else arm
            )
        trials.append(trial)
    return tuple(trials)


def stands(values):
    return np.repeat(values[:1], len(values), axis=0)


def put(place, value):
    """A function that sets `place` of an array to a value, or adds to it what is `+`."""

    def of(values):
        values[place] = value(values[place]) if callable(value) else value
        return values

    return of


LEARNED = {
    "as they are": changed(in_one),
    "the robot stands in one trial": changed(in_one, stands),
    "the robot stands in one interaction": changed(in_push, stands),
    "the person stands in one trial": changed(in_one, human=stands),
    "the person stands in one interaction": changed(in_push, human=stands),
    "a dead joint": changed(everywhere, put((slice(None), JOINT), 0.2)),
    "a joint that is dead in one interaction": changed(in_push, put((slice(None), JOINT), 0.2)),
    "all joints dead but one": changed(everywhere, put((slice(None), slice(1, None)), 0.2)),
    "a frame off by half a radian": changed(in_one, put((FRAME, JOINT), lambda angle: angle + 0.5)),
    "one trial of each interaction": changed(in_one, each=1),
    "the same motion in every trial": tuple(
        replace(made_trials(1, TWO)[0], trial=trial.trial, interaction=trial.interaction)
        for trial in made_trials(2, TWO)
    ),
}


REJECTED = {
    "the robot never moves": (changed(everywhere, stands), "the robot never moves by more than 0.000 rad"),
    "but for noise": (
        changed(everywhere, lambda angles: 1e-4 * np.random.default_rng(0).standard_normal(angles.shape)),
        "never moves by more than 0.001 rad in any of its 6 trials; record its joint_states while it moves",
    ),
    "the person never moves": (changed(everywhere, human=stands), "the person's hand never moves"),
    "a glitch": (changed(in_one, put((FRAME, JOINT), 1e3)), "frame 60 joint 'b' is beyond 25 rad: a glitch, or"),
    "a small glitch": (changed(in_one, put((FRAME, JOINT), -4.0)), "frame 59 joint 'b' leaps by more than half a turn"),
    "a wrapped angle": (
        changed(in_one, put((slice(FRAME, None), JOINT), lambda angles: angles - 2 * np.pi)),
        "frame 59 joint 'b' leaps",
    ),
    "a turn more in one trial": (
        changed(in_one, put((slice(None), JOINT), lambda angles: angles + 2 * np.pi)),
        "joint 'b' lies a whole turn from where it lies in trial 0",
    ),
    "degrees": (changed(everywhere, np.degrees), "trial 0 (reach): in frame 0 joint 'c' is beyond 25 rad"),
    "the person's glitch": (changed(in_one, human=put((FRAME, 2), 1e3)), "frame 60 the person's hand is beyond 50 m"),
    "an arm too long": (
        changed(in_one, human=put((FRAME, 2, 0), 1.2)),
        "bone from elbow to hand is longer than 0.80 m",
    ),
    "a joint that the tracker lost": (
        changed(in_one, human=put((FRAME, 1), 0.0)),
        "trial 2 (reach): in frame 60 the person's elbow is at exactly zero",
    ),
    "no arm at all": (
        changed(in_one, human=put((slice(None), 2), lambda hand: 0.1 * hand + [0.0, 0.0, -0.165])),
        "trial 2 (reach): the person's bone from elbow to hand is mostly shorter than 0.05 m",
    ),
    "a frame of another person": (
        changed(in_one, human=put(FRAME, lambda arm: arm + np.array([2.5, 0.0, 0.0]))),
        "frame 59 the person's shoulder leaps by more than 2 m to the next",
    ),
    "millimetres": (changed(everywhere, human=lambda arm: 1e3 * arm), "a glitch, or millimetres?"),
}


@pytest.mark.parametrize(("trials", "message"), REJECTED.values(), ids=REJECTED)
def test_what_cannot_be_is_one_line_that_names_it_before_anything_is_learned(trials, message):
    for judge in (require_valid, lambda given: next(train(given, PROTOCOLS["ahead"], SMALL, 0))):
        with pytest.raises(DatasetError) as refused:
            judge(trials)
        assert message in str(refused.value)
        assert "\n" not in str(refused.value)


def test_a_partners_arm_is_judged_as_the_persons():
    def partner(hand):
        return tuple(
            replace(trial, controlled=hand(np.array(trial.observed_m)), controlled_names=ARM)
            for trial in made_trials(2, TWO)
        )

    require_valid(partner(lambda arm: arm))
    for hand, message in ((put((FRAME, 2), 1e3), "the partner's hand is beyond"), (stands, "the partner's hand never")):
        with pytest.raises(DatasetError, match=message):
            require_valid(partner(hand))


def test_a_trial_of_three_frames_is_named():
    short = replace(
        (trial := made_trials(1, TWO)[0]),
        observed_m=trial.observed_m[40:43],
        controlled=trial.controlled[40:43],
        active=trial.active[:3],
    )
    with pytest.raises(DatasetError, match=r"trial 0 \(reach\): its 3 frames give 0 steps"):
        require_learnable((*made_trials(2, TWO), short), PROTOCOLS["same"], SMALL)


@pytest.mark.parametrize("constant", [[2], [2, 3], [0, 1, 2, 3]])
def test_latents_of_an_agent_who_stands_still_leave_a_prior_that_can_be_used(constant):
    latents = [np.random.default_rng(trial).normal(size=(30, 4)) for trial in range(3)]
    for latent in latents:
        latent[:, constant] = 0.5
    fit = PRIORS["hsmm"].from_demonstrations(latents, 3, 2).fit(latents)
    assert np.isfinite(fit.log_likelihoods).all()
    belief = update(fit.prior, initial_belief(fit.prior), latents[0][0, :2], 0.01 * np.eye(2))
    assert np.isfinite(belief.weights).all()
    assert belief.known


@pytest.mark.parametrize("trials", LEARNED.values(), ids=LEARNED)
def test_what_is_odd_and_can_be_is_learned_into_a_model_that_runs(trials):
    protocol, epochs = PROTOCOLS["ahead"], train(trials, PROTOCOLS["ahead"], SHORT, 0)
    while True:
        try:
            assert np.isfinite(next(epochs).prediction)
        except StopIteration as end:
            trained = end.value
            break
    model = build_model(*export(trained, trials, 0.01 * np.eye(3), ModelFacts("made")))
    for trial in (trials[0], trials[-1]):
        predicted = ModelPredictor(model, protocol).predict(trial)
        assert errors_of_trial(trial, protocol, predicted).squared.mean() < 4.0, "no silent nonsense"
