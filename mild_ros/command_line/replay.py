# SPDX-License-Identifier: Apache-2.0
"""`mild replay`: a bag, or a trial of a dataset, through the system."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from mild_core.errors import SetupError
from mild_ros.command_line import options
from mild_ros.command_line.console import Console

if TYPE_CHECKING:
    from mild_ros.assembly.settings import PipelineParameters
    from mild_ros.replay.demo import RunOptions


def replay(
    bag: options.Bag = None,
    dataset: options.Dataset = "",
    trial: options.Trial = 0,
    data: options.Data = None,
    dds: options.Dds = False,
    lock_step: options.LockStep = False,
    start: options.Start = 0.0,
    rate: options.Rate = 1.0,
    loop: options.Loop = False,
    paused: options.Paused = False,
    model: options.Model = None,
    interaction: options.Interaction = None,
    source: options.Source = None,
    topic: options.Topic = "",
    config: options.Config = "",
    given: options.Given = None,
    out: options.Out = None,
    salvage: options.Salvage = False,
) -> None:
    """A bag, or a trial of a dataset, through the real nodes.

    **A bag**, in this process and without DDS: the same bag gives the same bytes of commands, every time.

        mild replay bags/handshake

    The same through the real nodes over DDS, with a simulated robot, in real time:

        mild replay bags/handshake --dds

    From the twelfth second on, at half the speed, over and over until control-C, beginning at Enter:

        mild replay old.bag --dds --start 12 --rate 0.5 --loop --paused

    **Another tracker or robot** is set as for the nodes, with a parameter file, with single parameters, or both:

        mild replay old.bag --config pepper -p side:=left

        mild replay mocap.bag --source motion_capture -p source_axes:=rep103
        -p 'joint_names:=[right_shoulder, right_elbow, right_hand, left_shoulder, pelvis]'
        -p 'joint_places:=[/vrpn/rs/pose, /vrpn/re/pose, /vrpn/rh/pose, /vrpn/ls/pose, /vrpn/hip/pose]'

    **Where the camera stood** is in the bag's folder for those that we ship (`camera.toml`), or given by
    `-p robot_from_camera:='x y z roll pitch yaw'`.

    **A recorded trial**: a kinematic person makes a tracker's messages of it, the nodes answer, and what they command
    is compared with what the recorded robot did.

        mild replay --dataset buetepage_hr --trial 8

    In a trial of two people the robot answers in the place of the second one; there is nothing to compare it with:

        mild replay --dataset nuisi --trial 0 --model nuisi_partner_next -p robot:=pepper
    """
    from mild_ros.assembly.arguments import check_parameters
    from mild_ros.assembly.perception import skeleton_source
    from mild_ros.assembly.settings import PipelineParameters
    from mild_ros.bag.camera import keep_camera, with_camera
    from mild_ros.command_line.lost import check_source, report_lost
    from mild_ros.command_line.result_folders import folder_of
    from mild_ros.node_kit.parameter_files import read_parameters
    from mild_ros.viewing.stillness import counts_of, has_moved, why_still

    if (bag is None) == (not dataset):
        raise SetupError("replay", "nothing to do" if bag is None else "both a bag and a dataset", "give one of them")
    nodes = dds or lock_step or bool(dataset)
    _check_possible(rate=rate != 1.0 and (lock_step or not nodes), loop=loop and not nodes, paused=paused and not nodes)
    named = {"model": model, "interaction": interaction, "source": source}
    if nodes:
        import_module("rclpy")  # where ROS is missing, that is said before the rest is loaded
    parameters = read_parameters(PipelineParameters, "pipeline", config, given or (), **named)
    check_parameters(parameters)
    console = Console()
    if bag:
        report_lost(bag, salvage, console)
    # Only now, as it takes its time to load: what draws and simulates.
    from mild_ros.command_line.results import leave, print_summary, run_with_progress
    from mild_ros.replay.demo import RunOptions

    with tempfile.TemporaryDirectory(prefix="mild_trial_") as scratch:
        title = bag.resolve().name if bag else _write_trial(dataset, data, trial, Path(scratch, "trial"), parameters)
        bag = bag or Path(scratch, "trial")
        parameters = with_camera(parameters, bag, given or ())
        asked = RunOptions(parameters, topic, lock_step, salvage, start, rate, loop)
        check_source(bag, salvage, skeleton_source(parameters), topic)
        counts: Mapping[str, Mapping[str, int]] = {}
        detail = ""
        folder = out or folder_of(Path("out/replay"), Path(f"{dataset}_{trial}") if dataset else bag)
        if nodes:
            recorded = run_with_progress(bag, folder, asked, console, paused=paused)
        else:
            recorded, counts, detail = _in_process(bag, folder, asked, console)
    keep_camera(recorded, parameters)
    shown = leave(recorded, folder, asked, title, console)
    print_summary(shown, title, console)
    if not has_moved(shown.run.commands):
        counts = counts or counts_of(shown.run)
        why, remedy = why_still(shown.run, skeleton_source(parameters), counts, parameters, detail)
        raise SetupError("replay", f"the robot never moved: {why}", remedy)


def _check_possible(**refused: bool) -> None:
    """Raise a SetupError for the first option that was asked for and cannot work."""
    for name, is_refused in refused.items():
        if is_refused:
            raise SetupError(f"--{name}", "needs nodes in real time: without, all goes as fast as it can", "add --dds")


def _write_trial(dataset: str, data: Path | None, trial: int, folder: Path, parameters: PipelineParameters) -> str:
    """Write the bag of a trial, its person where the model's recordings put people; returns what to call it."""
    from mild_core.learning.datasets import recording_named
    from mild_core.retargeting.robot_file import find_robot
    from mild_ros.assembly.perception import manifest_of
    from mild_ros.bag.camera import camera_text, facing_camera, write_camera
    from mild_ros.replay.trial_bag import write_trial
    from mild_ros.simulation.person import Camera

    recording = recording_named(dataset, data)
    trials = recording.read(data or recording.default_path()).train
    if trial >= len(trials):
        raise SetupError(
            f"trial {trial}", f"{dataset} has {len(trials)} training trials", f"give at most {len(trials) - 1}"
        )
    found = trials[trial]
    robot = find_robot(recording.robot) if recording.robot else None
    write_trial(folder, found.observed_m, robot, found.controlled, found.rate_hz)
    there = manifest_of(parameters.model).robot_from_human
    camera = facing_camera(there, found.interaction, Camera().arm_from_camera)
    write_camera(folder, {parameters.robot: camera_text(camera)})
    return f"{dataset}, trial {trial}: {found.interaction.replace('_', ' ')}"


def _in_process(
    bag: Path, folder: Path, asked: RunOptions, console: Console
) -> tuple[Path, Mapping[str, Mapping[str, int]], str]:
    """Replay without DDS; returns the bag that it writes, what was counted, and what was complained of."""
    from mild_core.retargeting.robot_file import find_robot
    from mild_ros.assembly.inference import load
    from mild_ros.assembly.perception import skeleton_source
    from mild_ros.assembly.pipeline import make_pipeline
    from mild_ros.commands.controller_messages import ControllerMessages
    from mild_ros.replay.demo import RECORDED
    from mild_ros.replay.in_process import Inputs, Step, replay_in_process

    parameters = asked.pipeline
    robot = find_robot(parameters.robot)
    inputs = Inputs(
        *(skeleton_source(parameters), robot, asked.skeleton_topic),
        start_s=asked.start_s,
        joint_names=parameters.robot_joint_names,
    )
    folder.mkdir(parents=True, exist_ok=True)
    recorded = folder / RECORDED
    shutil.rmtree(recorded, ignore_errors=True)
    complaints, unread = [""], [""]

    def look(step: Step) -> None:
        complaints[0] = step.state.perception.detail or complaints[0]
        unread[0] = unread[0] or (step.unreadable and f"{step.unreadable}: {step.detail}")

    with console.status("replaying in process"):
        pipeline = make_pipeline(parameters, load(parameters.model))
        summary = replay_in_process(
            *(bag, pipeline, inputs, recorded),
            rate_hz=parameters.control_rate_hz,
            salvage=asked.salvage,
            controllers=ControllerMessages(parameters, pipeline.retargeting, inputs.naming),
            on_step=look,
        )
    if summary.note:
        console.print(f"{bag}: {summary.note}", style="yellow", highlight=False, soft_wrap=True)
    for stage, counts in summary.counts.items():
        listed = ", ".join(f"{count} {reason}" for reason, count in counts.items()) or "none unreadable"
        console.print(f"{stage}: {listed}", highlight=False, soft_wrap=True)
    console.print(f"{summary.commands} commands, SHA-256 {summary.digest}", highlight=False, soft_wrap=True)
    return recorded, summary.counts, "; ".join(filter(None, (*complaints, *unread)))
