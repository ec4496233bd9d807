# SPDX-License-Identifier: Apache-2.0
"""Options that several commands take alike."""

from __future__ import annotations

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
