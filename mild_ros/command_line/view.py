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
        Path | None, typer.Option(metavar="FOLDER", help="Where the files go [default: out/view/<bag>].")
    ] = None,
    salvage: Salvage = False,
    browser: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """A recorded run in a 3-D page, as a filmstrip and as plots.

        mild view out/demo/recorded --open

    The page is one HTML file with a play bar. It needs no network and no server. Skeletons that are read with
    parameters, or a robot other than YuMi, are told as to `mild replay`: `--config pepper`, `-p frame_id:=world`.
    """
    from mild_ros.bag_camera import with_camera
    from mild_ros.command_line.results import PAGE, leave, tell, tell_lost
    from mild_ros.demo import RunOptions
    from mild_ros.parameter_files import read_parameters
    from mild_ros.settings import PipelineParameters

    folder = out or Path("out/view") / bag.resolve().stem
    folder.mkdir(parents=True, exist_ok=True)
    parameters = read_parameters(PipelineParameters, "pipeline", config, given or (), model=model, source=source)
    parameters = with_camera(parameters, bag, given or ())
    options, console = RunOptions(parameters, salvage=salvage), Console()
    tell_lost(bag, options, console)
    tell(leave(bag, folder, options, bag.resolve().name, console), str(bag), console)
    if browser:
        typer.launch((folder / PAGE).resolve().as_uri())
