# SPDX-License-Identifier: Apache-2.0
"""`mild demo`: the main job, from tracker messages to a robot that moves, and results to look at."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from mild_core.errors import SetupError, unknown_name
from mild_ros.command_line.console import Console

SCENES = ("hand_wave", "handshake", "parachute", "rocket")
"""Bags that were generated for the live default model."""


def demo(
    scene: Annotated[str, typer.Option(help="One of the bags that we ship.")] = "handshake",
    model: Annotated[str, typer.Option(metavar="NAME|FOLDER", help="The model.")] = "yumi_buetepage_ahead",
    interaction: Annotated[str, typer.Option(help="An interaction of the model, or auto to recognise it.")] = "auto",
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where the results go.")] = Path("out/demo"),
) -> None:
    """The main job on a bag we ship: tracker messages in, a simulated robot moves, results to look at.

    Starts four programs that talk over DDS in a ROS 2 domain of their own: `replay` sends the scene as a live tracker
    would, `pipeline` sees, recognises and commands, `simulation` moves a YuMi in PyBullet, `record` writes all of it
    down. Then reads the recording and prints the latency of commands, the outcome of every frame, whether
    every limit was kept, and where the files are: the bag, a filmstrip, plots, and a page that plays in any browser.

        mild demo

        mild demo --scene hand_wave
    """
    import_module("rclpy")  # where ROS is missing, that is said before the rest is loaded
    from mild_core.resources import share_folder
    from mild_ros.assembly.arguments import check_parameters
    from mild_ros.assembly.perception import skeleton_source
    from mild_ros.assembly.settings import PipelineParameters
    from mild_ros.bag.camera import keep_camera, with_camera
    from mild_ros.viewing.stillness import counts_of, has_moved, why_still

    if scene not in SCENES:
        raise unknown_name("scene", scene, SCENES)
    bag, console = share_folder("bags") / scene, Console()
    parameters = with_camera(PipelineParameters(model=model, interaction=interaction), bag)
    check_parameters(parameters)
    out.mkdir(parents=True, exist_ok=True)
    from mild_ros.command_line.results import leave, print_summary, run_with_progress
    from mild_ros.replay.demo import RunOptions

    options = RunOptions(parameters)
    title = f"{scene.replace('_', ' ').capitalize()}: a person and a simulated YuMi"
    recorded = run_with_progress(bag, out, options, console)
    keep_camera(recorded, options.pipeline)
    shown = leave(recorded, out, options, title, console)
    print_summary(shown, title, console)
    if shown.report.limits is None:
        raise SetupError("demo", "the robot was sent no command", f"see {out / 'log'}")
    if not shown.report.limits.kept:
        raise SetupError("demo", "a command broke a limit", "please report it with the recorded bag")
    if not has_moved(shown.run.commands):
        why, remedy = why_still(shown.run, skeleton_source(options.pipeline), counts_of(shown.run), options.pipeline)
        raise SetupError("demo", f"the robot never moved: {why}", remedy)
