# SPDX-License-Identifier: Apache-2.0
"""`mild view`: a bag to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console


def view(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="A recorded run, or a tracker's own bag.")],
    model: Annotated[
        str, typer.Option(metavar="NAME|FOLDER", help="Says where the person stands before the robot.")
    ] = "yumi_buetepage_ahead",
    source: Annotated[str, typer.Option(help="Tracker convention of its skeletons.")] = "azure_kinect",
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Where the files go [default: out/view/<bag>].")
    ] = None,
    salvage: Annotated[bool, typer.Option("--salvage", help="Show what is readable of a broken bag.")] = False,
    browser: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """A recorded run in a 3-D page, as a filmstrip and as plots.

        mild view out/demo/recorded --open

    The page is one HTML file with a play bar. It needs no network and no server.
    """
    from mild_ros.command_line.results import PAGE, leave, tell, tell_lost
    from mild_ros.demo import RunOptions

    folder = out or Path("out/view") / bag.resolve().stem
    folder.mkdir(parents=True, exist_ok=True)
    options, console = RunOptions(model=model, source=source, salvage=salvage), Console()
    tell_lost(bag, salvage, console)
    tell(leave(bag, folder, options, bag.resolve().name, console), str(bag), console)
    if browser:
        typer.launch((folder / PAGE).resolve().as_uri())
