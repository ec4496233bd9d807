# SPDX-License-Identifier: Apache-2.0
"""`mild replay`: a bag, or a trial of a dataset, through the system."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from mild_core.errors import SetupError, unknown_name

if TYPE_CHECKING:
    from mild_ros.demo import RunOptions


def replay(
    bag: Annotated[Path | None, typer.Argument(metavar="[BAG]", help="Any rosbag2 with a tracker's messages.")] = None,
    dataset: Annotated[str, typer.Option(help="A dataset instead of a bag.")] = "",
    trial: Annotated[int, typer.Option(min=0, help="With --dataset: which of its training trials.")] = 0,
    data: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The dataset's file [default: $MILD_DATA/<its name>].")
    ] = None,
    dds: Annotated[bool, typer.Option("--dds", help="Run the real nodes and the simulation.")] = False,
    lock_step: Annotated[
        bool, typer.Option("--lock-step", help="With nodes: as fast as each message is handled.")
    ] = False,
    model: Annotated[str, typer.Option(metavar="NAME|FOLDER", help="The model.")] = "yumi_buetepage_ahead",
    interaction: Annotated[str, typer.Option(help="An interaction of the model, or auto to recognise it.")] = "auto",
    source: Annotated[str, typer.Option(help="Tracker convention of the bag.")] = "azure_kinect",
    topic: Annotated[str, typer.Option(help="Topic of the skeletons [default: found by its type].")] = "",
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Where the results go [default: out/replay/<bag>].")
    ] = None,
    salvage: Annotated[bool, typer.Option("--salvage", help="Read what is readable of a broken bag.")] = False,
) -> None:
    """A bag, or a trial of a dataset, through the real nodes.

    **A bag**, in this process and without DDS: the same bag gives the same bytes of commands, every time.

        mild replay bags/handshake

    The same through the real nodes over DDS, with a simulated robot, in real time:

        mild replay bags/handshake --dds

    **A recorded trial**: a kinematic person makes a tracker's messages of it, the nodes answer, and what they command
    is compared with what the recorded robot did.

        mild replay --dataset buetepage_hr --trial 8
    """
    from mild_ros.command_line.results import leave, run_with_progress, tell, tell_lost
    from mild_ros.demo import RunOptions

    if (bag is None) == (not dataset):
        raise SetupError("replay", "nothing to do" if bag is None else "both a bag and a dataset", "give one of them")
    options, console = RunOptions(model, interaction, source, "yumi", topic, lock_step, salvage), Console()
    folder = out or Path("out/replay") / (bag.resolve().stem if bag else f"{dataset}_{trial}")
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="mild_trial_") as scratch:
        title = bag.resolve().name if bag else f"{dataset}, trial {trial}"
        if bag is None:
            bag = Path(scratch, "trial")
            title += f": {_write_trial(dataset, data, trial, bag)}"
        tell_lost(bag, salvage, console)
        if dds or lock_step or dataset:
            recorded = run_with_progress(bag, folder, options, console)
        else:
            recorded = _in_process(bag, folder, options, console)
    tell(leave(recorded, folder, options, title, console), title, console)


def _write_trial(dataset: str, data: Path | None, trial: int, folder: Path) -> str:
    """Write the bag of a trial; returns its interaction."""
    from mild_core.learning.datasets import DATASETS
    from mild_core.retargeting.robots import ROBOTS
    from mild_ros.trial_bag import write_trial

    if dataset not in DATASETS:
        raise unknown_name("dataset", dataset, DATASETS)
    recording = DATASETS[dataset]
    trials = recording.read(data or recording.default_path()).train
    if trial >= len(trials):
        raise SetupError(
            f"trial {trial}", f"{dataset} has {len(trials)} training trials", f"give at most {len(trials) - 1}"
        )
    found = trials[trial]
    write_trial(folder, found.observed_m, ROBOTS[recording.robot], found.controlled, found.rate_hz)
    return found.interaction.replace("_", " ")


def _in_process(bag: Path, folder: Path, options: RunOptions, console: Console) -> Path:
    """Replay without DDS; returns the bag that it writes."""
    from mild_core.retargeting.robot_file import find_robot
    from mild_ros.assembly.inference import load
    from mild_ros.assembly.perception import skeleton_source
    from mild_ros.assembly.pipeline import make_pipeline
    from mild_ros.demo import RECORDED
    from mild_ros.replay import Inputs, replay_in_process
    from mild_ros.settings import PipelineParameters

    parameters = PipelineParameters(model=options.model, interaction=options.interaction, source=options.source)
    inputs = Inputs(skeleton_source(parameters), find_robot(options.robot), options.skeleton_topic)
    recorded = folder / RECORDED
    shutil.rmtree(recorded, ignore_errors=True)
    with console.status("replaying in process"):
        pipeline = make_pipeline(parameters, load(options.model))
        summary = replay_in_process(bag, pipeline, inputs, recorded, salvage=options.salvage)
    for stage, counts in summary.counts.items():
        told = ", ".join(f"{count} {reason}" for reason, count in counts.items()) or "none unreadable"
        console.print(f"{stage}: {told}", highlight=False, soft_wrap=True)
    console.print(f"{summary.commands} commands, SHA-256 {summary.digest}", highlight=False, soft_wrap=True)
    return recorded
