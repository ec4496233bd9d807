# SPDX-License-Identifier: Apache-2.0
"""The part of `mild evaluate` that learns every method on folds and puts them into one table."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from mild_core.errors import SetupError
from mild_core.resources import model_folder
from mild_ros.command_line.console import Console
from mild_ros.command_line.error_tables import markdown, markdown_table, print_cells, print_comparison, rows_as_data
from mild_ros.command_line.run_time_tables import run_time_as_data, run_time_cells, unknown_as_data, unknown_cells

if TYPE_CHECKING:
    from mild_core.learning.data.demonstration import Demonstration
    from mild_core.learning.data.recording import Recording
    from mild_core.learning.data.units import Unit
    from mild_core.learning.evaluation.comparison import Row
    from mild_core.learning.evaluation.cross_validation import Job, Result
    from mild_core.learning.training.configuration import Configuration

FOLDS = 4
LEAST_INTERACTIONS = 3


@dataclass(frozen=True)
class CrossValidationRequest:
    """What to cross-validate.

    Attributes:
        recording: The recording.
        path: Its file.
        protocols: Names.
        configuration: To train ours by; None: those of the shipped models.
        methods: Names in `METHODS`; none stands for all.
        seeds: Of each method that draws at random.
        workers: Processes; 0 for one per core.
    """

    recording: Recording
    path: Path
    protocols: tuple[str, ...]
    configuration: Configuration | None = None
    methods: tuple[str, ...] = ()
    seeds: int = 3
    workers: int = 0


def request_of(config: str, dataset: str, data: Path | None, protocol: str, every: bool) -> CrossValidationRequest:
    """What is asked for, by a configuration or by names; names win.

    Raises:
        SetupError: There is no such configuration, recording or protocol.
    """
    from mild_core.learning.data.windows import protocol_named
    from mild_core.learning.datasets import recording_named
    from mild_core.learning.training.configuration import read_configuration

    configured = read_configuration(config) if config else None
    recording = recording_named(dataset or (configured.dataset if configured else "buetepage_hr"), data)
    name = protocol or (configured.protocol if configured else "same")
    protocols = tuple(recording.protocols) if every else (protocol_named(name, recording.protocols).name,)
    return CrossValidationRequest(recording, data or recording.default_path(), protocols, configured)


def located(configuration: Configuration | None) -> Configuration | None:
    """The same with the folder of the model that it starts from, if any, in place of its name.

    Raises:
        SetupError: There is no such model.
    """
    if configuration is None or not configuration.start_from:
        return configuration
    return replace(configuration, start_from=str(model_folder(configuration.start_from)))


def cross_validate(request: CrossValidationRequest, out: Path, as_json: bool) -> None:
    """Run, print and write one table per protocol.

    Args:
        request: What to do.
        out: Folder for `cross_validation_<dataset>_<protocol>` as `.json`, `.md` and `.png`, and a `.png` of
            reliability per method that the run-time stage runs.
        as_json: Print JSON instead of tables.
    """
    from mild_core.learning.evaluation.comparison import compare
    from mild_core.learning.evaluation.cross_validation import jobs_of
    from mild_core.learning.evaluation.methods import METHODS
    from mild_core.learning.training.configuration import configuration_for

    recording, seeds = request.recording, request.seeds
    _require_trials(request)  # said before anything else starts
    tables = {}
    for protocol in request.protocols:
        wanted = request.methods or tuple(METHODS)
        configuration = located(request.configuration or configuration_for(recording.known_as, protocol))
        jobs = jobs_of(recording.known_as, request.path, protocol, wanted, seeds, configuration)
        rows = compare(_run(jobs, request.workers, protocol), recording.interactions)
        about = {"dataset": recording.name, "protocol": protocol, "folds": FOLDS, "seeds": seeds, "date": _today()}
        about |= {"unit": recording.unit.squared, "cores": os.cpu_count(), "machine": platform.machine()}
        tables[protocol] = {**about, "methods": rows_as_data(rows, recording.unit), "run_time": run_time_as_data(rows)}
        _leave(tables[protocol], rows, recording.unit, out, as_json)
    if as_json:
        print(json.dumps(tables if len(tables) > 1 else tables[request.protocols[0]], indent=1))


def _require_trials(request: CrossValidationRequest) -> tuple[Demonstration, ...]:
    """The training trials, once they can be divided and cut.

    Raises:
        DatasetError: They cannot.
    """
    from mild_core.learning.data.folds import require_folds
    from mild_core.learning.data.trial_validity import require_valid
    from mild_core.learning.data.windows import require_windows

    trials = request.recording.read(request.path).train
    require_folds(trials, request.recording.interactions)
    for protocol in request.protocols:
        require_windows(trials, request.recording.protocols[protocol])
    require_valid(trials)
    return trials


def _leave(table: Mapping[str, Any], rows: Sequence[Row], unit: Unit, out: Path, as_json: bool) -> None:
    """Write the files of one protocol's table, and print it unless JSON will be."""
    from mild_ros.viewing.figures.comparison import draw_comparison, draw_reliability
    from mild_ros.viewing.style import counted

    cells = run_time_cells(table["run_time"], {row.method: row.title for row in rows})
    out.mkdir(parents=True, exist_ok=True)
    stem = out / f"cross_validation_{table['dataset']}_{table['protocol']}"
    stem.with_suffix(".json").write_text(json.dumps(table, indent=1) + "\n")
    stem.with_suffix(".md").write_text(f"{markdown(rows, unit)}\n{markdown_table(cells, 1)}")
    draw_comparison(table, stem.with_suffix(".png"))
    about = f"{table['dataset']}, protocol {table['protocol']}"
    for method, found in table["run_time"].items():
        title = f"{about}, {method}: regions of the published covariance"
        draw_reliability(found, out / f"{stem.name}_{method}_reliability.png", title)
    if not as_json:
        print_comparison(
            f"{about}: {FOLDS} folds over the training trials, {counted(table['seeds'], 'seed')}", rows, unit
        )
        print_cells("at run time", cells, 1)
        Console().print(f"written to {stem}.json, .md and .png", highlight=False, soft_wrap=True)


def detect_unknown(request: CrossValidationRequest, out: Path, as_json: bool) -> None:
    """Leave each interaction out, print and write how well it is detected as unknown, per protocol."""
    from mild_core.learning.evaluation.unknown import leave_one_out

    recording, trials = request.recording, _require_trials(request)
    shown = tuple(name for name in recording.interactions if any(trial.interaction == name for trial in trials))
    if len(shown) < LEAST_INTERACTIONS:
        raise SetupError(
            str(request.path), f"shows only {', '.join(shown)}", f"leaving one out takes {LEAST_INTERACTIONS}"
        )
    tables = {}
    for protocol in request.protocols:
        found = leave_one_out(trials, recording.protocols[protocol], shown)
        about = {"dataset": recording.name, "protocol": protocol, "folds": FOLDS, "date": _today()}
        tables[protocol] = {**about, **unknown_as_data(found)}
        out.mkdir(parents=True, exist_ok=True)
        stem, cells = out / f"unknown_{recording.name}_{protocol}", unknown_cells(found)
        stem.with_suffix(".json").write_text(json.dumps(tables[protocol], indent=1) + "\n")
        stem.with_suffix(".md").write_text(markdown_table(cells, 1))
        if not as_json:
            print_cells(f"{recording.name}, protocol {protocol}: each interaction left out", cells, 1)
            Console().print(f"written to {stem}.json and .md", highlight=False, soft_wrap=True)
    if as_json:
        print(json.dumps(tables if len(tables) > 1 else tables[request.protocols[0]], indent=1))


def _today() -> str:
    return datetime.now(UTC).date().isoformat()


def _run(jobs: Sequence[Job], workers: int, protocol: str) -> list[Result]:
    """All jobs, with a bar that shows what was learned last."""
    from mild_core.learning.evaluation.cross_validation import run_jobs

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    results = []
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(protocol, total=len(jobs))
        for result in run_jobs(jobs, workers or None):
            results.append(result)
            job = result.job
            progress.update(task, advance=1, description=f"{protocol}: {job.method} fold {job.fold} seed {job.seed}")
    return results
