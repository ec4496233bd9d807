# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that take bags."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Config = Annotated[
    str,
    typer.Option("--config", metavar="NAME|FILE", help="Parameters of the pipeline, as `ros2 launch` takes them."),
]
Given = Annotated[
    list[str] | None,
    typer.Option("-p", metavar="NAME:=VALUE", help="One parameter of the pipeline, as for `ros2 run`; repeat it."),
]
Model = Annotated[str | None, typer.Option(metavar="NAME|FOLDER", help="The model [default: yumi_buetepage_ahead].")]
Source = Annotated[str | None, typer.Option(help="Tracker convention of the skeletons [default: azure_kinect].")]
Interaction = Annotated[
    str | None, typer.Option(help="An interaction of the model [default: auto, which recognises it].")
]
Salvage = Annotated[bool, typer.Option("--salvage", help="Read what is readable of a broken bag.")]
Bag = Annotated[Path | None, typer.Argument(metavar="[BAG]", help="Any bag with a tracker's messages.")]
Topic = Annotated[str, typer.Option(help="Topic of the skeletons [default: found by its type].")]
Dataset = Annotated[str, typer.Option(help="A dataset instead of a bag.")]
Trial = Annotated[int, typer.Option(min=0, help="With --dataset: which of its training trials.")]
Data = Annotated[
    Path | None, typer.Option(metavar="FILE", help="The dataset's file [default: `$MILD_DATA/<its file>`].")
]
Dds = Annotated[bool, typer.Option("--dds", help="Run the real nodes and the simulation.")]
LockStep = Annotated[bool, typer.Option("--lock-step", help="With nodes: as fast as each message is handled.")]
Start = Annotated[float, typer.Option(metavar="S", min=0.0, help="Skip so many seconds of the bag.")]
Rate = Annotated[float, typer.Option(metavar="X", min=0.05, max=20.0, help="With --dds: so many times as fast.")]
Loop = Annotated[bool, typer.Option("--loop", help="With nodes: over and over, until control-C.")]
Paused = Annotated[bool, typer.Option("--paused", help="With nodes: start them, then wait for Enter.")]
Out = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Where the results go [default: in out, by the bag's name].")
]
