# SPDX-License-Identifier: Apache-2.0
"""The part of `mild evaluate` that learns every method on folds and puts them into one table."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from mild_ros.command_line.error_tables import markdown, print_comparison, rows_as_data

if TYPE_CHECKING:
    from mild_core.learning.cross_validation import Job, Result


def cross_validate(
    dataset: str,
    path: Path,
    protocols: Sequence[str],
    methods: Sequence[str],
    seeds: int,
    workers: int,
    out: Path,
    as_json: bool,
) -> None:
    """Run, print and write one table per protocol.

    Args:
        dataset: Name in `DATASETS`.
        path: Its file.
        protocols: Names.
        methods: Names in `METHODS`; none stands for all.
        seeds: Of each method that draws at random.
        workers: Processes; 0 for one per core.
        out: Folder for `cross_validation_<protocol>.json` and `.md`.
        as_json: Print JSON instead of tables.
    """
    from mild_core.learning.comparison import compare
    from mild_core.learning.cross_validation import jobs_of
    from mild_core.learning.datasets import DATASETS
    from mild_core.learning.methods import METHODS

    recording = DATASETS[dataset]
    recording.read(path)  # a broken file is said before anything else starts
    wanted, tables = tuple(methods) or tuple(METHODS), {}
    for protocol in protocols:
        jobs = jobs_of(dataset, path, protocol, wanted, seeds)
        rows = compare(_run(jobs, workers, protocol), recording.interactions)
        about = {"dataset": dataset, "protocol": protocol, "folds": 4, "seeds": seeds, "date": _today()}
        about |= {"unit": recording.unit.squared}
        tables[protocol] = {**about, "cores": os.cpu_count(), "methods": rows_as_data(rows, recording.unit)}
        out.mkdir(parents=True, exist_ok=True)
        (out / f"cross_validation_{protocol}.json").write_text(json.dumps(tables[protocol], indent=1) + "\n")
        (out / f"cross_validation_{protocol}.md").write_text(markdown(rows, recording.unit))
        if not as_json:
            title = f"{dataset}, protocol {protocol}: 4 folds over the training trials, {seeds} seeds"
            print_comparison(title, rows, recording.unit)
            Console().print(f"written to {out}/cross_validation_{protocol}.json and .md", highlight=False)
    if as_json:
        print(json.dumps(tables if len(tables) > 1 else tables[protocols[0]], indent=1))


def _today() -> str:
    return datetime.now(UTC).date().isoformat()


def _run(jobs: Sequence[Job], workers: int, protocol: str) -> list[Result]:
    """All jobs, with a bar that tells what was learned last."""
    from mild_core.learning.cross_validation import run_jobs

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    results = []
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(protocol, total=len(jobs))
        for result in run_jobs(jobs, workers or None):
            results.append(result)
            job = result.job
            progress.update(task, advance=1, description=f"{protocol}: {job.method} fold {job.fold} seed {job.seed}")
    return results
