# SPDX-License-Identifier: Apache-2.0
"""`mild camera`: where the camera is, without a ruler."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated

import typer

from mild_core.errors import SetupError
from mild_ros.command_line.options import Config, Given

FOLDER = Path("out/camera")


def camera(
    config: Config = "",
    given: Given = None,
    side: Annotated[str, typer.Option(metavar="right|left", help="The hand that is held [default: right].")] = "",
    places: Annotated[int | None, typer.Option(min=4, max=12, help="At so many places [default: 6].")] = None,
    by_hand: Annotated[bool, typer.Option("--by-hand", help="You move the arm; nothing is commanded.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Parameter file that gets the pose [default: that of --config]."),
    ] = None,
) -> None:
    """Finds where the camera is: the arm shows its tool at some places, and you hold your hand at it for a second.

        mild camera --config my_robot.yaml

    The pose is written into that parameter file as `robot_from_camera`, with how well it fits. One of ours is left as
    it is, and `out/camera/<name>.yaml` gets the pose. The robot's driver and the tracker have to run, the pipeline
    not. An arm that cannot go by itself is moved by hand:

        mild camera -p robot:=my_robot.toml -p source:=zed --by-hand

    `mild hold` stops the arm at once. As a node that waits for the service `/camera/calibrate`: `mild run camera`.
    """
    from mild_ros.assembly.camera import CameraParameters, check_target
    from mild_ros.command_line.run import become
    from mild_ros.environment.processes import as_yaml
    from mild_ros.node_kit.parameter_files import configuration, read_parameters

    read = read_parameters(
        CameraParameters, "pipeline", config, given or (), side=side or None, places=places, by_hand=by_hand or None
    )
    base = configuration(config) if config else None
    ours = base is not None and base.parent == configuration("yumi").parent
    target = out or (base if base is not None and not ours else FOLDER / f"{Path(config or read.robot).stem}.yaml")
    if target.suffix not in (".yaml", ".yml"):
        raise SetupError(f"--out {target}", "is no parameter file", f"write --out {target.with_suffix('.yaml')}")
    target.parent.mkdir(parents=True, exist_ok=True)
    if base is not None and not target.exists():
        target.write_text(base.read_text(encoding="utf-8"), encoding="utf-8")
    check_target(str(target))
    changed = {entry.name: getattr(read, entry.name) for entry in fields(read)}
    changed = {entry.name: changed[entry.name] for entry in fields(read) if changed[entry.name] != entry.default}
    changed |= {"begin": True, "write_to": str(target.resolve())}
    become("camera", ["--ros-args", *(word for k, v in changed.items() for word in ("-p", f"{k}:={as_yaml(v)}"))])
