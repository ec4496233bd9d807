# SPDX-License-Identifier: Apache-2.0
"""Folds, seeds and methods: every one is run, none learns from what it is scored on, and the table adds up."""

import os
from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import SetupError
from mild_core.learning.evaluation.comparison import compare
from mild_core.learning.evaluation.cross_validation import ONE_THREAD, Job, Result, jobs_of, run_job, run_jobs
from mild_core.learning.evaluation.errors import TrialErrors
from test.core.learning.test_buetepage_hr import one_hot, track, write


def made_file(folder):
    tracks = [track(index, 100) for index in range(16)]
    return write(folder / "a.npz", tracks, [one_hot(index // 4, 100) for index in range(16)])


def test_seedless_methods_run_once_and_seeded_ones_with_every_seed(tmp_path):
    jobs = jobs_of("buetepage_hr", tmp_path, "same", ("gru", "ridge"), seeds=3)
    assert len(jobs) == 3 * 4 + 4
    assert {(job.method, job.fold, job.seed) for job in jobs if job.method == "ridge"} == {
        ("ridge", fold, 0) for fold in range(4)
    }


@pytest.mark.parametrize(
    ("recording", "protocol", "method"),
    [("x", "same", "ridge"), ("buetepage_hr", "x", "ridge"), ("buetepage_hr", "same", "x")],
)
def test_unknown_names_are_refused(recording, protocol, method):
    with pytest.raises(SetupError, match="'x' is unknown"):
        jobs_of(recording, Path("a.npz"), protocol, (method,), 1)


def test_many_processes_and_one_give_the_same_errors_over_all_trials(tmp_path):
    path = made_file(tmp_path)
    jobs = jobs_of("buetepage_hr", path, "same", ("action_mean", "time_indexed_mean"), seeds=2)
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    together = {result.job: result for result in run_jobs(jobs, workers=2)}
    assert {name: os.environ.get(name) for name in ONE_THREAD} == before
    assert set(together) == set(jobs)
    for job in jobs:
        for one, other in zip(run_job(job).errors["given"], together[job].errors["given"], strict=True):
            np.testing.assert_array_equal(one.squared, other.squared)
    held_out = [e.trial for r in together.values() if r.job.method == "action_mean" for e in r.errors["given"]]
    assert sorted(held_out) == list(range(16))


def test_a_broken_recording_is_reported_from_the_workers_in_one_line(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"broken")
    jobs = jobs_of("buetepage_hr", tmp_path / "a.npz", "same", ("action_mean",), 1)
    with pytest.raises(SetupError, match="cannot be read"):
        list(run_jobs(jobs, workers=1))


def result(method, seed, by_trial, labels="given"):
    flat = np.ones(10)
    errors = tuple(
        TrialErrors(trial, name, value * flat, value * flat, value * np.eye(2)) for trial, name, value in by_trial
    )
    return Result(Job("buetepage_hr", Path("a"), "same", method, 0, seed), {labels: errors}, 1.0)


def test_the_table_averages_over_seeds_and_compares_trial_by_trial():
    bar = [(0, "a", 1.0), (1, "a", 2.0), (2, "b", 3.0), (3, "b", 5.0)]
    better = [(trial, name, 0.75 * value) for trial, name, value in bar]
    worse = [(trial, name, 0.85 * value) for trial, name, value in bar]
    rows = compare([result("kernel_ridge", 0, bar), result("gru", 0, better), result("gru", 1, worse)], ("a", "b"))
    assert [row.method for row in rows] == ["gru", "kernel_ridge"]
    gru, kernel_ridge = rows
    assert gru.macro_mean == pytest.approx(0.8 * 2.75)
    assert gru.macro_std == pytest.approx(0.1 * 2.75 / np.sqrt(2))
    assert kernel_ridge.macro_std is None
    assert gru.relative["kernel_ridge"].change == pytest.approx(-0.2)
    # Each trial is better by the same fifth, so whichever trials are drawn the change is the same.
    assert gru.relative["kernel_ridge"].interval == pytest.approx((-0.2, -0.2))
    # Four trials out of four on one side: 2 of the 16 ways that chance could have put them.
    assert gru.relative["kernel_ridge"].p_value == pytest.approx(2 / 16)
    assert list(kernel_ridge.relative) == ["gru"]
    tied = compare([result("kernel_ridge", 0, bar), result("gru", 0, bar)], ("a", "b"))
    assert [relative.p_value for row in tied for relative in row.relative.values()] == [1.0, 1.0]
    assert gru.errors.windows == kernel_ridge.errors.windows == 40


def test_each_interaction_is_tested_against_buetepage_by_its_own_trials():
    """Source of the p value: all of n differences of one sign occur in 2 of 2^n ways."""
    bar = [(trial, "a" if trial < 8 else "b", 1.0 + 0.01 * trial) for trial in range(16)]
    better_at_a = [(trial, name, value - (0.1 if name == "a" else 0.001 * (-1) ** trial)) for trial, name, value in bar]
    rows = {
        row.method: row for row in compare([result("buetepage", 0, bar), result("gru", 0, better_at_a)], ("a", "b"))
    }
    assert rows["buetepage"].p_against_buetepage == {}
    assert rows["gru"].p_against_buetepage["a"] == pytest.approx(2 / 2**8)
    assert rows["gru"].p_against_buetepage["b"] > 0.5
