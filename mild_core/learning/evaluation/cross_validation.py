# SPDX-License-Identifier: Apache-2.0
"""Every method on trials it has not learned from: folds times seeds, spread over the machine's cores."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from mild_core.errors import unknown_name
from mild_core.learning.data.baseline import GIVEN, UNKNOWN
from mild_core.learning.data.folds import FOLDS, folds_of
from mild_core.learning.data.recording import Demonstrations
from mild_core.learning.data.windows import protocol_named
from mild_core.learning.datasets import recording_named
from mild_core.learning.evaluation.errors import TrialErrors, errors_of_trial
from mild_core.learning.evaluation.methods import METHODS, method_for
from mild_core.learning.evaluation.run_time import HeldOut, label_kinds, run_trial, watch
from mild_core.learning.training.configuration import Configuration
from mild_core.learning.training.model_predictor import ModelPredictor

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Each worker is one thread: the cores are used by the workers, and figures do not depend on how many there are."""


@dataclass(frozen=True)
class Job:
    """One method learned once: on all folds but one, from one seed; ours as `configuration` says, if any."""

    recording: str
    path: Path
    protocol: str
    method: str
    fold: int
    seed: int
    configuration: Configuration | None = None


@dataclass(frozen=True, eq=False)
class Result:
    """What came of a job.

    Attributes:
        job: What was done.
        errors: Errors of the held-out trials by the labels the method was given: under "given", and under "recognised"
            too by one that can find the interaction out; under "unknown" alone by one that never looks at it; under
            "given, start pose" too by a model with a start pose correction.
        seconds: How long learning took.
        held_out: What the run-time stage did with the held-out trials; empty for a method that it does not run.
    """

    job: Job
    errors: Mapping[str, tuple[TrialErrors, ...]]
    seconds: float
    held_out: tuple[HeldOut, ...] = ()


def jobs_of(
    recording: str,
    path: Path,
    protocol: str,
    methods: Sequence[str],
    seeds: int,
    configuration: Configuration | None = None,
) -> tuple[Job, ...]:
    """Every fold and seed of the methods; one seed where a seed changes nothing.

    Raises:
        SetupError: There is no such recording, protocol or method.
    """
    known = recording_named(recording).protocols
    for method in methods:
        if method not in METHODS:
            raise unknown_name("method", method, METHODS)
    return tuple(
        Job(recording, path, protocol_named(protocol, known).name, method, fold, seed, configuration)
        for method in methods
        for seed in range(seeds if METHODS[method].seeded else 1)
        for fold in range(FOLDS)
    )


@lru_cache(maxsize=4)
def _read(recording: str, path: Path) -> Demonstrations:
    return recording_named(recording).read(path)


def run_job(job: Job) -> Result:
    """Learn and predict; the same function serves one process and many.

    Raises:
        DatasetError: The recording cannot be read.
    """
    protocol = recording_named(job.recording).protocols[job.protocol]
    fold = folds_of(_read(job.recording, job.path).train)[job.fold]
    method = method_for(job.method, job.configuration)
    begin = time.perf_counter()
    predictor = method.fit(fold.learned, protocol, job.seed)
    seconds = time.perf_counter() - begin
    trials, held_out = fold.held_out, list[HeldOut]()
    if isinstance(predictor, ModelPredictor):
        runs = [run_trial(predictor, trial) for trial in trials]
        held_out = [watch(predictor, trial, run, job.fold) for trial, run in zip(trials, runs, strict=True)]
        predicted = {labels: [run[labels].predicted for run in runs] for labels in label_kinds(predictor)}
    else:
        predicted = {GIVEN if method.uses_label else UNKNOWN: [predictor.predict(trial) for trial in trials]}
    errors = {
        labels: tuple(errors_of_trial(trial, protocol, one) for trial, one in zip(trials, answers, strict=True))
        for labels, answers in predicted.items()
    }
    return Result(job, errors, seconds, tuple(held_out))


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started inside use one thread; what the environment said before is put back."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            os.environ.update({} if value is None else {name: value})


def _quiet_interrupt() -> None:
    """A worker ends at once on ctrl-C: the parent says the one line."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def run_jobs(jobs: Sequence[Job], workers: int | None = None) -> Iterator[Result]:
    """Do all jobs, the long ones first as given, and hand out each result as it comes.

    Args:
        jobs: What to do.
        workers: Processes; by default one per core that this process may use.
    """
    workers = min(workers or len(os.sched_getaffinity(0)), max(len(jobs), 1))
    others = set(multiprocessing.active_children())
    with _one_thread_each():
        pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _quiet_interrupt)
        unfinished = True
        try:
            for future in as_completed([pool.submit(run_job, job) for job in jobs]):
                yield future.result()
            unfinished = False
        finally:
            if unfinished:
                for worker in set(multiprocessing.active_children()) - others:
                    worker.terminate()
            pool.shutdown(cancel_futures=True)
