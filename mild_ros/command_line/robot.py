# SPDX-License-Identifier: Apache-2.0
"""`mild robot`: a robot file from a description alone."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from mild_core.errors import SetupError
from mild_core.packages import PACKAGE, package_file
from mild_ros.command_line.console import Console

FOLDER = Path("out/robot")


def robot(
    urdf: Annotated[str, typer.Argument(metavar="URDF", help="A description, or package://PACKAGE/PATH of one.")],
    arm: Annotated[str, typer.Option(metavar="right|left", help="Which arm [default: the right or only one].")] = "",
    tool: Annotated[str, typer.Option(metavar="LINK", help="What meets a hand, where another is found.")] = "",
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The robot file [default: `out/robot/<robot>_<arm>.toml`].")
    ] = None,
) -> None:
    """A robot file from a description alone: base, shoulder, elbow, tool, joints, home and limits of one arm.

        mild robot my_robot.urdf --arm right

    It works as it is written, with a model of two people:

        mild replay bags/handshake -p robot:=out/robot/my_robot_right.toml -p model:=nuisi_partner_next

    A picture beside it shows where everything was found. What no description says, and what was guessed, is listed:
    check it before a real robot moves.
    """
    from mild_core.retargeting.robot_file import read_robot
    from mild_core.retargeting.robot_proposal import propose
    from mild_ros.assembly.robot import make_robot
    from mild_ros.viewing.robot_picture import draw_robot

    if arm not in ("", "right", "left"):
        raise SetupError(f"--arm {arm}", "is no arm", "write right or left")
    if out is not None and out.suffix != ".toml":
        raise SetupError(f"--out {out}", "is no robot file", f"write --out {out.with_suffix('.toml')}")
    path = package_file(urdf) if urdf.startswith(PACKAGE) else Path(urdf).expanduser().resolve()
    if path.is_dir():
        inside = sorted(path.rglob("*.urdf"))
        raise SetupError(urdf, "is a folder", f"give {inside[0]}" if inside else "give the URDF in it")
    console = Console(highlight=False)
    proposal = propose(path, arm, tool)
    named = "_".join(part for part in (proposal.robot.name, proposal.side) if part)
    file = out or FOLDER / f"{named}.toml"
    file.parent.mkdir(parents=True, exist_ok=True)
    description = urdf if urdf.startswith(PACKAGE) else path.name if path.parent == file.resolve().parent else str(path)
    file.write_text(proposal.text(description), encoding="utf-8")
    read_robot(file)
    picture = file.with_suffix(".png")
    draw_robot(make_robot(str(file)), picture)
    found = proposal.robot
    side = f"{proposal.side} arm" if proposal.side else "arm"
    console.print(
        Text(
            f"{found.name}: {side} of {len(found.joint_names)} joints, {found.joint_names[0]} to "
            f"{found.joint_names[-1]}",
            style="bold",
        )
    )
    console.print(Text(f"{file}\n{picture}"))
    console.print("To check:")
    for check in proposal.checks:
        console.print(Text(f"  - {check}"))
    console.print(Text(f"Try it: ./mild replay bags/handshake -p robot:={_quoted(file)} -p model:=nuisi_partner_next"))


def _quoted(file: Path) -> str:
    text = str(file)
    return text if re.fullmatch(r"[\w./-]+", text) else "'" + text.replace("'", "'\\''") + "'"
