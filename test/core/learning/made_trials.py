# SPDX-License-Identifier: Apache-2.0
"""Small synthetic trials: an arm that reaches out and back while a robot does a function of it."""

import numpy as np

from mild_core.learning.data.demonstration import Demonstration

JOINTS = ("a", "b", "c")
ARM = ("shoulder", "elbow", "hand")


def smooth_track(index, frames):
    """16 columns that move like arms do: slowly, and a little differently in each trial; the first nine are one."""
    rng = np.random.default_rng(index)
    times = np.linspace(0, 2 * np.pi, frames)[:, None]
    moving = 0.2 * np.sin(times + rng.uniform(0, 0.5, 16)) * rng.uniform(0.5, 1.0, 16)
    moving[:, :9] += np.array([0, 0, 0, 0.02, 0, -0.18, 0.05, 0, -0.4])
    return moving


def made_trial(trial, interaction="reach", frames=90, rate_hz=40.0, gain=1.0, seed=0):
    """The hand moves on a bump whose onset is drawn; the robot's joints are `gain` times smooth functions of it."""
    rng = np.random.default_rng([seed, trial])
    middle = 0.5 + 0.1 * rng.uniform(-1, 1)
    bump = np.exp(-(((np.linspace(0, 1, frames) - middle) / 0.15) ** 2))
    shoulder = np.zeros((frames, 3))
    elbow = shoulder + 0.18 * np.stack([np.sin(bump), 0 * bump, -np.cos(bump)], axis=1)
    hand = elbow + 0.23 * np.stack([np.sin(2 * bump), 0 * bump, -np.cos(2 * bump)], axis=1)
    controlled = gain * np.stack([bump, bump**2, 1 - bump], axis=1)
    observed = np.stack([shoulder, elbow, hand], axis=1)
    return Demonstration(trial, interaction, rate_hz, ARM, observed, JOINTS, controlled, np.ones(frames))


def made_trials(each=8, interactions=("reach", "push"), frames=90):
    """`each` trials of every interaction; the robot answers the second with other angles than the first."""
    return tuple(
        made_trial(place * each + index, name, frames + index, gain=1.0 + place)
        for place, name in enumerate(interactions)
        for index in range(each)
    )
