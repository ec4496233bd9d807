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
from mild_ros.command_line.options import Config, Given, Model, Source

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
    start: Annotated[float, typer.Option(metavar="S", min=0.0, help="Skip so many seconds of the bag.")] = 0.0,
    rate: Annotated[
        float, typer.Option(metavar="X", min=0.05, max=20.0, help="With --dds: so many times as fast.")
    ] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="With nodes: over and over, until control-C.")] = False,
    paused: Annotated[bool, typer.Option("--paused", help="With nodes: start them, then wait for Enter.")] = False,
    model: Model = None,
    interaction: Annotated[
        str | None, typer.Option(help="An interaction of the model [default: auto, which recognises it].")
    ] = None,
    source: Source = None,
    topic: Annotated[str, typer.Option(help="Topic of the skeletons [default: found by its type].")] = "",
    config: Config = "",
    given: Given = None,
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

    From the twelfth second on, at half the speed, over and over until control-C, beginning at Enter:

        mild replay old.bag --dds --start 12 --rate 0.5 --loop --paused

    **Another tracker or robot** is told as to the nodes, with a parameter file, with single parameters, or both:

        mild replay old.bag --config pepper -p side:=left

        mild replay mocap.bag --source motion_capture -p source_axes:=rep103
        -p 'joint_names:=[right_shoulder, right_elbow, right_hand, left_shoulder, pelvis]'
        -p 'joint_places:=[/vrpn/rs/pose, /vrpn/re/pose, /vrpn/rh/pose, /vrpn/ls/pose, /vrpn/hip/pose]'

    **A recorded trial**: a kinematic person makes a tracker's messages of it, the nodes answer, and what they command
    is compared with what the recorded robot did.

        mild replay --dataset buetepage_hr --trial 8
    """
    from mild_ros.command_line.results import leave, run_with_progress, tell, tell_lost
    from mild_ros.demo import RunOptions
    from mild_ros.parameter_files import read_parameters
    from mild_ros.settings import PipelineParameters

    if (bag is None) == (not dataset):
        raise SetupError("replay", "nothing to do" if bag is None else "both a bag and a dataset", "give one of them")
    nodes = dds or lock_step or bool(dataset)
    real_time = (("--rate", rate != 1.0, not lock_step), ("--loop", loop, True), ("--paused", paused, True))
    for name, is_asked, is_possible in real_time:
        if is_asked and not (nodes and is_possible):
            raise SetupError(name, "needs nodes in real time: without, a bag goes as fast as it can", "add --dds")
    named = {"model": model, "interaction": interaction, "source": source}
    parameters = read_parameters(PipelineParameters, "pipeline", config, given or (), **named)
    options, console = RunOptions(parameters, topic, lock_step, salvage, start, rate, loop), Console()
    folder = out or Path("out/replay") / (bag.resolve().stem if bag else f"{dataset}_{trial}")
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="mild_trial_") as scratch:
        title = bag.resolve().name if bag else f"{dataset}, trial {trial}"
        if bag is None:
            bag = Path(scratch, "trial")
            title += f": {_write_trial(dataset, data, trial, bag)}"
        tell_lost(bag, salvage, console)
        if nodes:
            recorded = run_with_progress(bag, folder, options, console, paused=paused)
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

    parameters = options.pipeline
    robot = find_robot(parameters.robot)
    inputs = Inputs(skeleton_source(parameters), robot, options.skeleton_topic, start_s=options.start_s)
    recorded = folder / RECORDED
    shutil.rmtree(recorded, ignore_errors=True)
    with console.status("replaying in process"):
        pipeline = make_pipeline(parameters, load(parameters.model))
        summary = replay_in_process(
            bag, pipeline, inputs, recorded, rate_hz=parameters.control_rate_hz, salvage=options.salvage
        )
    for stage, counts in summary.counts.items():
        told = ", ".join(f"{count} {reason}" for reason, count in counts.items()) or "none unreadable"
        console.print(f"{stage}: {told}", highlight=False, soft_wrap=True)
    console.print(f"{summary.commands} commands, SHA-256 {summary.digest}", highlight=False, soft_wrap=True)
    return recorded
