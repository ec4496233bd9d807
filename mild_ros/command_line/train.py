# SPDX-License-Identifier: Apache-2.0
"""`mild train`: from demonstrations to a model folder."""

from __future__ import annotations

import math
import shlex
import subprocess
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mild_core.budgets import TABLE_BYTES, parse_json, read_file
from mild_core.errors import SetupError
from mild_core.resources import model_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from mild_core.inference.manifest import HumanPlacement
    from mild_core.learning.data.demonstration import Demonstration
    from mild_core.learning.data.recording import Recording
    from mild_core.learning.training.algorithm import EpochReport
    from mild_core.learning.training.checkpoint import Checkpoint
    from mild_core.learning.training.configuration import Configuration
    from mild_core.learning.training.settings import TrainingSettings
    from mild_core.learning.training.snapshot import Snapshot
    from mild_core.learning.training.trained import TrainedModel

EXIT_INTERRUPTED = 130

LIVE = "yumi_buetepage_ahead"
"""The configuration of the shipped model that moves a robot live."""

METHOD = "mild"
"""Row of a cross-validation that a trained model is."""

LEAST_TRIALS = 2

PEOPLE = ("all", "own")
"""Whose arms the recogniser of gestures learns from."""


def train(
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="The model folder to write.")],
    config: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE",
            help=f"How to train, and on what: a shipped one, or yours [default: {LIVE}, or as fits --dataset].",
        ),
    ] = "",
    dataset: Annotated[
        str, typer.Option(metavar="NAME|FOLDER", help="Another recording, or a folder of `mild demonstrations`.")
    ] = "",
    data: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The recording [default: $MILD_DATA/<dataset's file>].")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Another seed of all draws [default: the configuration's].")] = None,
    epochs: Annotated[int, typer.Option(min=0, help="Another number of epochs; 0: the configuration's.")] = 0,
    members: Annotated[int, typer.Option(min=0, help="Another number of networks; 0: the configuration's.")] = 0,
    doublings: Annotated[
        int, typer.Option(min=0, help="Halve the epochs so often, double while that helps; 0: the configuration's.")
    ] = 0,
    people: Annotated[
        str,
        typer.Option(
            metavar="all|own",
            help="Whose arms the recogniser of gestures learns from: also all recordings here, or the trials' alone.",
        ),
    ] = "all",
    errors: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="`cross_validation_<protocol>.json` of `mild evaluate --cv`, for the card."),
    ] = None,
) -> None:
    """Learns a model from demonstrations.

    The shipped live model again, from all training trials:

        mild train --config yumi_buetepage_ahead --out models/yumi_buetepage_ahead

    With measured errors and uncertainty in its manifest and card, as it is shipped:

        mild evaluate --cv --config yumi_buetepage_ahead

        mild train --config yumi_buetepage_ahead --errors out/cross_validation_buetepage_hr_ahead.json --out my_model

    Your own: copy a configuration (`mild_core/learning/configurations`), change it, give its path. It names the
    recording, the protocol, a preset of settings and what differs from it, the seed, and a model whose hidden layers
    are the start; the model card repeats it. A quick look whether everything works, in a minute:

        mild train --config yumi_buetepage_same --epochs 20 --members 1 --out out/quick

    From bags that you recorded (`mild demonstrations --help`):

        mild train --dataset my_trials --out my_model

    The recogniser of gestures, which carries over to strangers, learns from the people in your trials beside those of
    all recordings that are here; three trials of each interaction already help. With --people own it learns from yours
    alone, so that the model stands under no other licence.

    How many epochs are enough: with --doublings 3 (`doublings` of a configuration) a network learns from three folds
    of four for an eighth of the epochs and is asked about the fourth, then another for twice as many, and so on, until
    twice as many make the error less than a hundredth smaller: it has levelled off. The model then learns from all
    trials for as many epochs as were enough; its card says how many.

    The folder then works wherever a model is named: `mild run pipeline -p model:=my_model`. Without
    --errors the uncertainty is measured on the training trials themselves and so too small; the card says so.

    What is interrupted, by Control-C or by force, goes on from its last whole epoch when the same command is given
    again, and comes to the same model as if nothing had happened.
    """
    from mild_core.learning.datasets import recording_named

    if people not in PEOPLE:
        raise SetupError("--people", f"is '{people}'", f"give one of {', '.join(PEOPLE)}")
    asked = _asked(config, dataset, seed, {"epochs": epochs, "members": members, "doublings": doublings})
    settings, recording = asked.settings, recording_named(asked.dataset, data)
    measured = _measured(errors, asked, recording)
    trials = _trials(recording, data or recording.default_path(), asked)
    out.mkdir(parents=True, exist_ok=True)  # a folder that cannot be written is said before an hour of training
    trained, checkpoint = _learned(trials, asked, recording, out)
    named: dict[str, object] = {"config": config or ("" if dataset else LIVE), "dataset": dataset, "data": data or ""}
    named |= {"seed": asked.seed, "epochs": settings.epochs, "members": settings.members, "doublings": doublings or ""}
    named |= {"out": out, "errors": errors or "", "people": "" if people == "all" else people}
    words = [word for name, value in named.items() if value != "" for word in (f"--{name}", str(value))]
    command = shlex.join(["mild", "train", *words])
    _write(out, trained, trials, (asked, recording), measured, command, people)
    checkpoint.remove()


def _learned(
    trials: tuple[Demonstration, ...], asked: Configuration, recording: Recording, out: Path
) -> tuple[TrainedModel, Checkpoint]:
    """The interactions that the trials show, learned from the beginning or from where it was interrupted."""
    from mild_core.learning.training.algorithm import train as train_model
    from mild_core.learning.training.checkpoint import FOLDER, Checkpoint, identity
    from mild_core.learning.training.epoch_search import lengths
    from mild_core.learning.training.transfer import start_of

    protocol, settings, start = recording.protocols[asked.protocol], asked.settings, start_of(asked)
    checkpoint = Checkpoint(out / FOLDER, identity(trials, protocol, settings, asked.seed, start))
    shown = tuple(name for name in recording.interactions if any(trial.interaction == name for trial in trials))
    resume = checkpoint.read(settings.members + len(lengths(settings.epochs, settings.doublings)))
    epochs = train_model(trials, protocol, settings, asked.seed, shown, start, resume)
    return _finished(epochs, checkpoint), checkpoint


def _trials(recording: Recording, path: Path, asked: Configuration) -> tuple[Demonstration, ...]:
    """Those to learn from."""
    from mild_core.learning.training.algorithm import require_learnable

    trials = recording.read(path).train
    if len(trials) < LEAST_TRIALS:
        raise SetupError(str(path), f"holds {len(trials)} training trials", f"give at least {LEAST_TRIALS}")
    require_learnable(trials, recording.protocols[asked.protocol], asked.settings)
    return trials


def _asked(config: str, dataset: str, seed: int | None, others: dict[str, int]) -> Configuration:
    """The configuration with what the options change of it, and the folder of the model that it starts from.

    Of `others`, settings by name, 0 leaves what is configured.
    """
    from mild_core.learning.training.configuration import configuration_for, configuration_names, read_configuration

    asked = read_configuration(config or LIVE) if config or not dataset else configuration_for(dataset, "ahead")
    if asked is None:
        raise SetupError(f"dataset {dataset}", "is not enough", f"add --config {'|'.join(configuration_names())}")
    asked = replace(asked, dataset=dataset or asked.dataset)
    changes: dict[str, Any] = {name: value for name, value in others.items() if value}
    settings = replace(asked.settings, **changes)
    start_from = str(model_folder(asked.start_from)) if asked.start_from else ""
    return replace(asked, settings=settings, seed=asked.seed if seed is None else seed, start_from=start_from)


def _measured(path: Path | None, asked: Configuration, recording: Recording) -> dict[str, Any]:
    """The table of a cross-validation; empty without one."""
    if path is None:
        return {}
    try:
        table: dict[str, Any] = parse_json(read_file(path, TABLE_BYTES))
        found = {row["labels"] for row in table["methods"] if row["method"] == METHOD and table["unit"]}
        of = (table["dataset"], table["protocol"])
    except (ValueError, KeyError, TypeError) as error:
        raise SetupError(str(path), f"is no table of a cross-validation ({error})", "run mild evaluate --cv") from None
    if of != (recording.name, asked.protocol) or "given" not in found:
        problem = f"holds {of[0]}, protocol '{of[1]}', methods {sorted({r['method'] for r in table['methods']})}"
        raise SetupError(str(path), problem, f"run mild evaluate --cv --method {METHOD} on the same")
    return table


def _finished(epochs: Generator[EpochReport, None, TrainedModel], checkpoint: Checkpoint) -> TrainedModel:
    """Run the training to its end, or leave what it can go on from."""
    try:
        return with_progress(epochs, checkpoint.write)
    except KeyboardInterrupt:
        with suppress(OSError):  # only a folder that was made for this is empty
            checkpoint.folder.parent.rmdir()
        what = "nothing was written" if not checkpoint.folder.exists() else "the same command goes on from there"
        typer.echo(f"mild: interrupted while training: {what} ({checkpoint.folder.parent})", err=True)
        raise typer.Exit(EXIT_INTERRUPTED) from None
    except (KeyError, ValueError, RuntimeError) as error:
        if not checkpoint.folder.exists():
            raise
        problem = f"does not fit what is trained ({str(error).splitlines()[0]})"
        raise SetupError(str(checkpoint.folder), problem, "delete it to start over") from None


def with_progress(
    epochs: Generator[EpochReport, None, TrainedModel], keep: Callable[[int, Snapshot], None] | None = None
) -> TrainedModel:
    """Run a training and keep each epoch; a bar shows epoch and losses."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from mild_ros.command_line.console import Console

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("training", total=None)
        while True:
            try:
                report = next(epochs)
            except StopIteration as end:
                trained: TrainedModel = end.value
                return trained
            if keep is not None:
                keep(report.member, report.snapshot)
            losses = f"prediction {report.prediction:.4f} human {report.observed:.4f} robot {report.controlled:.4f}"
            if not math.isnan(report.validation):
                progress.console.print(f"{report.epochs} epochs: error on held-out trials {report.validation:.4f}")
            text = f"network {report.member + 1}/{report.members} epoch {report.epoch + 1}: {losses}"
            done, total = report.member * report.epochs + report.epoch + 1, report.members * report.epochs
            progress.update(task, completed=done, total=total, description=f"{text} KL {report.divergence:.2f}")


def _write(
    out: Path,
    trained: TrainedModel,
    trials: tuple[Demonstration, ...],
    how: tuple[Configuration, Recording],
    measured: dict[str, Any],
    command: str,
    people: str,
) -> None:
    """The model folder with its card."""
    import numpy as np

    from mild_core.inference.model import save_model
    from mild_core.learning.evaluation.errors import errors_of_trial, summarise
    from mild_core.learning.training.card import cross_validation_entry, model_card
    from mild_core.learning.training.export import ModelFacts, export
    from mild_core.learning.training.licences import both

    asked, recording = how
    if measured:
        row = next(r for r in measured["methods"] if (r["method"], r["labels"]) == (METHOD, "given"))
        residual, source = np.array(row["residual_covariance"]), "cross-validation"
        run_time = measured.get("run_time", {}).get(METHOD, {})
        regions = {name: run_time.get(name, {}) for name in ("covariance_scale", "radii")}
        errors = cross_validation_entry(measured, METHOD)
    else:
        own = [errors_of_trial(trial, trained.protocol, trained.predict(trial)) for trial in trials]
        covariance = summarise(own, recording.interactions).covariance
        assert covariance is not None  # there is at least one trial
        residual, source, errors, regions = covariance, "training trials: too small", {}, {}
    training = {**_about(trained, asked, recording, len(trials)), "residual_covariance": source}
    gestures, sources = _gestures(trained.interactions, recording, trials, people)
    training |= {"gestures": "; ".join(f"{one.name} ({one.licence})" for one in sources) or "none"}
    of_all = {one.name: one for one in (recording, *sources)}
    training["sources"] = {name: one.spdx for name, one in of_all.items()}
    facts = ModelFacts(out.resolve().name, recording.robot, recording.observed_side, _placement(recording, trials))
    facts = replace(facts, training=training, licence=both(training["sources"].values()), errors=errors)
    manifest, arrays = export(trained, trials, residual, facts, **regions)
    save_model(out, manifest, arrays | gestures, model_card(manifest, recording, command))
    typer.echo(f"written: {out} ({sum(file.stat().st_size for file in out.iterdir()) / 1e6:.1f} MB)")


def _gestures(
    interactions: tuple[str, ...], recording: Recording, trials: tuple[Demonstration, ...], people: str
) -> tuple[dict[str, Any], list[Recording]]:
    """Arrays of the recogniser that carries over to strangers, and what it learned from; none for other interactions.

    Args:
        interactions: That the model knows.
        recording: What it learns from: its people count too, if they do some of these.
        trials: Of that.
        people: One of `PEOPLE`.
    """
    from mild_core.inference.gesture_recogniser import gesture_classes
    from mild_core.learning.training.gestures import (
        RECORDINGS,
        GestureSettings,
        arms_at_hand,
        arms_of,
        background_arms,
        train_gestures,
    )

    try:
        gesture_classes(interactions)
    except ValueError:
        return {}, []
    arms, sources = arms_at_hand() if people == "all" else ([], [])
    if people == "own" or recording.known_as not in (*RECORDINGS, "pepper_nuisi"):
        arms, sources = [*arms, *arms_of(recording.name, trials)], [*sources, recording]
    settings = GestureSettings()
    try:
        recogniser = train_gestures(arms, background_arms(settings.background, settings.seed), settings)
    except ValueError:  # an interaction without a trial
        return {}, []
    return recogniser.to_arrays(), sources


def _stopped(epochs: int, asked: TrainingSettings) -> str:
    """Why each network learned for so many epochs."""
    if not asked.doublings:
        return "as configured"
    return f"levelled off, of at most {asked.epochs}" if epochs < asked.epochs else "the most allowed: not levelled off"


def _start(trained: TrainedModel, asked: Configuration) -> str:
    """Which layers training started with from which model; "" where it started from none."""
    layers = sorted({layer for member in trained.members for layer in member.carried})
    return f"{Path(asked.start_from).name} ({', '.join(layers)})" if layers else ""


def _about(trained: TrainedModel, asked: Configuration, recording: Recording, trials: int) -> dict[str, Any]:
    """What the manifest says of a training, for people."""
    return {
        "dataset": recording.name,
        "licence": recording.licence,
        "split": "train",
        "trials": trials,
        "seeds": [trained.seed],
        "epochs": trained.settings.epochs,
        "reservoir_units": 0 if trained.reservoir is None else len(trained.reservoir.leak),
        "stopped": _stopped(trained.settings.epochs, asked.settings),
        "start_from": _start(trained, asked),
        "git_revision": _revision(),
        "configuration": asked.text,
    }


def _placement(recording: Recording, trials: tuple[Demonstration, ...]) -> HumanPlacement:
    """Where the person stood: as the recording says, or fitted to where hands meet; else the default."""
    from mild_core.learning.training.export import ORIGIN
    from mild_core.learning.training.place_fit import fit_contact
    from mild_core.retargeting.robots import ROBOTS

    shown = {trial.interaction for trial in trials}
    touching = tuple(name for name in recording.touching if name in shown)
    if recording.placement is not None or not touching:
        return recording.placement or ORIGIN
    return fit_contact(trials, ROBOTS[recording.robot], touching).placement()


def _revision() -> str:
    """The commit of the checkout that this runs from; "unknown" elsewhere."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
