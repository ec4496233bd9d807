# SPDX-License-Identifier: Apache-2.0
"""`mild run`, `mild launch` and `mild record`: our nodes without the `ros2` command."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from mild_core.errors import unknown_name
from mild_ros.command_line.main import main
from mild_ros.environment.processes import as_yaml
from mild_ros.launching.table import LAUNCHES, read_arguments, run_launch
from mild_ros.node_kit.libraries import check_needed

NODES = {
    "pipeline": "all three stages in one process",
    "perception": "the first stage: a tracker's people in, feature windows out",
    "inference": "the second stage: motion out",
    "retargeting": "the third stage: commands out",
    "simulation": "a robot in PyBullet",
    "camera": "where the camera is, from hands held at the tool",
    "markers": "what RViz and Foxglove show",
    "replay": "a bag in place of a tracker",
    "record": "topics into a bag",
}
"""Our executables, and what each is."""

CONTEXT_SETTINGS = {"run": {"ignore_unknown_options": True, "help_option_names": []}}
"""What follows the node belongs to it, `--help` included."""

Words = Annotated[list[str] | None, typer.Argument(metavar="[ROS ARGUMENT]...", help="As for `ros2 run`.")]


def run(
    context: typer.Context,
    node: Annotated[str, typer.Argument(metavar="NODE", help=f"One of {', '.join(NODES)}.")] = "",
    words: Words = None,
) -> None:
    """Starts a node, as `ros2 run mild_ros NODE` does.

        mild run pipeline --ros-args -p robot:=pepper -r skeleton:=/k4a/body_tracking_data

    `--ros-args` may be left out. The node's parameters:

        mild run pipeline --help
    """
    if node in ("", "--help", "-h"):
        print(context.get_help())
        return
    if node not in NODES:
        raise unknown_name("node", node, NODES)
    given = list(words or ())
    if given and "--ros-args" not in given and not {"--help", "-h"} & set(given):
        given.insert(0, "--ros-args")
    become(node, given)


def launch(
    name: Annotated[str, typer.Argument(metavar="NAME", help=f"One of {', '.join(LAUNCHES)}.")],
    words: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME:=VALUE]...", help="As for `ros2 launch`; without, defaults.")
    ] = None,
    show_args: Annotated[bool, typer.Option("--show-args", help="List what it takes, and stop.")] = False,
) -> None:
    """Starts all nodes of a live, simulated or replayed system, as `ros2 launch mild_ros NAME.launch.py` does.

        mild launch live skeleton:=/k4a/body_tracking_data config:=yumi_abb

        mild launch simulation skeleton:=/k4a/body_tracking_data gui:=true

        mild launch replay bag:=bags/handshake record:=what_happened

    Control-C ends all of them. What each takes:

        mild launch live --show-args
    """
    name = name.removesuffix(".launch.py")
    if name not in LAUNCHES:
        raise unknown_name("launch", name, LAUNCHES)
    wanted = LAUNCHES[name]
    if show_args:
        for argument, (default, text) in wanted.arguments.items():
            print(f"{argument}:={'' if default is None else default}\n    {text}")
        return
    given = read_arguments(wanted, words or ())
    check_needed()
    raise typer.Exit(run_launch(wanted, given))


def record(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="Folder of the new bag.")],
    topics: Annotated[
        list[str] | None, typer.Argument(metavar="[TOPIC]...", help="Only these; all by default.")
    ] = None,
    split_mb: Annotated[float, typer.Option(metavar="MB", min=0.0, help="Start a new file at this size.")] = 0.0,
) -> None:
    """Records topics into a bag until control-C, as `ros2 bag record` does.

        mild record my_bag

        mild record my_bag skeleton joint_states joint_command

    A full disk or a kill costs at most the last second.
    """
    given = {"bag": str(bag), "topics": list(topics or ()), "split_mb": split_mb}
    words = [word for name, value in given.items() for word in ("-p", f"{name}:={as_yaml(value)}")]
    become("record", ["--ros-args", *words])


def script() -> None:
    """Entry point of the scripts that `ros2 run` finds: the node that the script is called after."""
    main(["run", Path(sys.argv[0]).name, *sys.argv[1:]])


def become(node: str, words: list[str]) -> None:
    """Run a node in this process, so that signals and the exit code are its own."""
    module = import_module(f"mild_ros.nodes.{node}_node")  # a library that is missing is one line here
    sys.argv = [f"mild run {node}", *words]
    raise SystemExit(module.main())
