# SPDX-License-Identifier: Apache-2.0
"""Folds hold out every trial once and divide each interaction evenly."""

from mild_core.learning.data.folds import folds_of
from test.core.learning.made_trials import made_trials


def test_a_trial_is_held_out_in_the_fold_of_its_index_within_its_interaction():
    folds = folds_of(made_trials(each=8))
    assert [[trial.trial for trial in fold.held_out] for fold in folds] == [
        [0, 4, 8, 12],
        [1, 5, 9, 13],
        [2, 6, 10, 14],
        [3, 7, 11, 15],
    ]
    for fold in folds:
        assert {t.trial for t in fold.held_out} | {t.trial for t in fold.learned} == set(range(16))
        assert not {t.trial for t in fold.held_out} & {t.trial for t in fold.learned}
