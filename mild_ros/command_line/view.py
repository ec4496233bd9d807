# SPDX-License-Identifier: Apache-2.0
"""`mild view`: a bag to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mild_ros.command_line.console import Console
from mild_ros.command_line.options import Config, Given, Model, Salvage, Source


def view(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="A recorded run, or a tracker's own bag.")],
    model: Model = None,
    source: Source = None,
    config: Config = "",
    given: Given = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Where the files go [default: `out/view/<bag>`].")
    ] = None,
    salvage: Salvage = False,
    browser: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """A recorded run in a 3-D page, as a filmstrip and as plots.

        mild view out/demo/recorded --open

    The page is one HTML file with a play bar. It needs no network and no server. Skeletons that are read with
    parameters, or a robot other than YuMi, are given as to `mild replay`: `--config pepper`, `-p frame_id:=world`.
    """
    from mild_ros.assembly.perception import manifest_of, skeleton_source
    from mild_ros.assembly.robot import make_robot_to_draw
    from mild_ros.assembly.settings import PipelineParameters
    from mild_ros.bag.camera import with_camera
    from mild_ros.command_line.lost import check_source, report_lost
    from mild_ros.command_line.result_folders import folder_of
    from mild_ros.node_kit.parameter_files import read_parameters

    parameters = read_parameters(PipelineParameters, "pipeline", config, given or (), model=model, source=source)
    parameters = with_camera(parameters, bag, given or ())
    make_robot_to_draw(parameters.robot, parameters.robot_description), manifest_of(parameters.model)
    console = Console()
    report_lost(bag, salvage, console)
    check_source(bag, salvage, skeleton_source(parameters))
    folder = out or folder_of(Path("out/view"), bag)
    folder.mkdir(parents=True, exist_ok=True)
    # Only now, as it takes its time to load: what draws.
    from mild_ros.command_line.results import PAGE, leave, print_summary
    from mild_ros.replay.demo import RunOptions

    options = RunOptions(parameters, salvage=salvage)
    print_summary(leave(bag, folder, options, bag.resolve().name, console), str(bag), console)
    if browser:
        typer.launch((folder / PAGE).resolve().as_uri())
