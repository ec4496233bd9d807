# SPDX-License-Identifier: Apache-2.0
"""Strangeness adds up over time: who stays near one interaction is known, who hops between them or leaves is not."""

from dataclasses import replace

import numpy as np
import pytest

from mild_core.errors import ModelError
from mild_core.inference.model import build_model
from mild_core.inference.novelty_detector import NoveltyDetector
from mild_core.inference.stage import Inference
from mild_core.signals import FeatureWindow
from test.core.inference.random_model import INTERACTIONS, manifest, paper_member, random_arrays

LINE = NoveltyDetector(
    weight=np.ones((2, 1)),
    bias=np.zeros(1),
    centres=np.array([[0.0], [1.0], [10.0]]),
    owners=np.array([0.0, 0.0, 1.0]),
    reach=2.0,
    kept=0.5,
)
"""Windows of one frame with two values, whose sum is the coordinate: one interaction at 0 and 1, another at 10."""


def followed(places):
    novelty = LINE.init()
    for place in places:
        novelty = LINE.follow(novelty, np.array([[place, 0.0]]))
    return novelty


def test_the_mean_of_squared_distances_fades_and_each_interaction_has_its_own():
    # Half of what is new counts and half of what was is kept, in units of the reach squared, which is 4.
    np.testing.assert_allclose(followed([1.0]), np.array([0.0, 9.0**2]) / 2 / 4)
    np.testing.assert_allclose(followed([0.5]), np.array([0.5**2, 9.5**2]) / 2 / 4)
    np.testing.assert_allclose(followed([1.5, 1.0]), np.array([0.5**2 / 2, 8.5**2 / 2 + 9.0**2]) / 2 / 4)


def test_who_stays_with_one_interaction_is_known_and_who_hops_or_leaves_is_not():
    assert LINE.score(followed([0, 1, 0, 1, 1])) == 0.0
    assert LINE.score(followed([10] * 9)) < 1.0
    assert LINE.score(followed([0, 10, 0, 10, 0, 10])) > 1.0
    assert LINE.score(followed([0, 5])) > 1.0


@pytest.fixture(scope="module")
def made():
    described = manifest((paper_member(),), components=3)
    rng = np.random.default_rng(0)
    count, values = len(INTERACTIONS), described.window * described.frame_values
    territory = NoveltyDetector(
        rng.normal(size=(values, 4)) / values,
        np.zeros(4),
        np.zeros((2 * count, 4)),
        np.repeat(np.arange(float(count)), 2),
        1.0,
        0.9,
    )
    return described, {**random_arrays(described), **territory.to_arrays()}


def test_garbage_is_unknown_at_once_and_forgotten_little_by_little(made):
    model = build_model(*made)
    stage = Inference(replace(model, members=(replace(model.members[0], latent_radius=np.full(4, 1e9)),)))
    rng = np.random.default_rng(1)

    def scores(state, start, size, count):
        found = []
        for index in range(start, start + count):
            features = size * rng.normal(size=(model.manifest.window, model.manifest.frame_values))
            window = FeatureWindow(index * 25_000_000, "arm", model.manifest.observed.joint_names, features)
            state, (motion,) = stage.step(state, window, window.stamp_ns)
            found.append(motion.out_of_distribution)
        return state, found

    state, known = scores(stage.init(), 0, 0.1, 5)
    state, strange = scores(state, 5, 300.0, 1)
    state, after = scores(state, 6, 0.1, 60)
    assert max(known) < 1.0 < strange[0]
    assert strange[0] > after[0] > 1.0
    assert after[-1] < 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("owners", np.array([0.0, 2.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0])),
        ("owners", np.zeros(8)),
        ("scale", np.array([0.0, 0.5])),
        ("scale", np.array([1.0, 1.0])),
        ("bias", np.zeros(3)),
        ("centres", np.full((8, 4), np.nan)),
    ],
)
def test_a_broken_territory_is_refused_by_name(made, name, value):
    described, arrays = made
    with pytest.raises(ModelError, match=f"territory.{name}"):
        build_model(described, {**arrays, f"territory.{name}": value})


def test_the_scale_of_the_covariance_follows_the_interaction(made):
    described, arrays = made
    scale = np.array([1.0, 4.0, 1.0, 1.0])
    plain, scaled = build_model(described, arrays), build_model(described, {**arrays, "covariance_scale": scale})
    rng = np.random.default_rng(2)
    features = rng.normal(size=(described.window, described.frame_values))
    window = FeatureWindow(0, "arm", described.observed.joint_names, features)
    for interaction, factor in ((INTERACTIONS[0], 1.0), (INTERACTIONS[1], 4.0)):
        answers = []
        for model in (plain, scaled):
            stage = Inference(model, interaction)
            answers.append(stage.step(stage.init(), window, 0)[1][0].covariance)
        np.testing.assert_allclose(answers[1], factor * answers[0])
    with pytest.raises(ModelError, match="covariance_scale"):
        build_model(described, {**arrays, "covariance_scale": -scale})


def test_both_radii_of_the_interaction_are_published(made):
    described, arrays = made
    radii = np.array([[2.0, 3.0], [1.0, 4.0], [2.0, 3.0], [2.0, 3.0]])
    model = build_model(described, {**arrays, "radii": radii})
    features = np.random.default_rng(2).normal(size=(described.window, described.frame_values))
    window = FeatureWindow(0, "arm", described.observed.joint_names, features)
    for interaction, wanted in zip(INTERACTIONS[:2], radii, strict=False):
        stage = Inference(model, interaction)
        assert stage.step(stage.init(), window, 0)[1][0].radii == pytest.approx(tuple(wanted))
    with pytest.raises(ModelError, match="radii"):
        build_model(described, {**arrays, "radii": radii[:, ::-1]})
