# SPDX-License-Identifier: Apache-2.0
"""`mild demonstrations`: recorded bags cut into trials that a model can be trained on."""

from __future__ import annotations

import shlex
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mild_core.errors import SetupError
from mild_core.printable import printable
from mild_ros.command_line.console import Console

if TYPE_CHECKING:
    from mild_ros.command_line.cutting import CutBag
    from mild_ros.demonstrations.settings import DemonstrationSettings


def demonstrations(
    bags: Annotated[list[Path], typer.Argument(metavar="BAG", help="Any bags: mcap, sqlite3, ROS 1.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="The folder of trials and pictures to write.")],
    robot: Annotated[
        str, typer.Option(metavar="NAME|FILE", help="Whose joint_states answer: yumi, pepper, or a robot file.")
    ] = "",
    partner: Annotated[
        str, typer.Option(metavar="TOPIC|same", help="A second person answers: in which messages they are.")
    ] = "",
    label: Annotated[
        str,
        typer.Option(
            metavar="NAME|topic:NAME", help="What all trials show, or the std_msgs/String topic with the label."
        ),
    ] = "",
    source: Annotated[str, typer.Option(help="Tracker convention of the skeletons [default: azure_kinect].")] = "",
    topic: Annotated[str, typer.Option(help="Topic of the skeletons [default: found by its type].")] = "",
    config: Annotated[Path | None, typer.Option(metavar="FILE", help="A TOML file that says all else.")] = None,
    test_every: Annotated[
        int, typer.Option(min=0, help="Put every so many trials of an interaction aside as test; 0: none.")
    ] = 0,
    salvage: Annotated[bool, typer.Option("--salvage", help="Read what is readable of broken bags.")] = False,
) -> None:
    """Cuts recorded bags into labelled trials, from rest to rest of the person's hand.

    **Record** a bag per interaction, of a person and a robot, or of two people. Everybody stands still for a second at
    first, and lets the arm hang for a second between two trials:

        ros2 run mild_ros record --ros-args -p bag:=handshake_1

    **Cut.** All of these bags show handshakes; or a topic holds the label of what comes next:

        mild demonstrations handshake_1 handshake_2 --robot yumi --label handshake --out my_trials

        mild demonstrations session_* --robot yumi --label topic:/label --out my_trials

        mild demonstrations people --partner same --label topic:/label --out my_trials

    Without labels it draws the pictures and stops: look at them, then say in a file what each numbered movement is.
    The same file names other topics, trackers and limits; all but [labels] may be left out:

        interactions = ["handshake", "hand_wave"]  # others are left out
        touching = ["handshake"]  # hands meet: where did the person stand?
        licence = "CC-BY-4.0"     # for the model card; so is source
        [person]                  # parameters of perception, and topic
        source = "nuitrack"
        [robot]
        robot = "my_robot.toml"
        robot_joint_names = ["joint_a1", "joint_a2"]  # as in the bag
        [cut]                     # slow_m_s, near_m, rest_s, margin_s, ...
        rate_hz = 40.0
        [labels]
        take_1 = "handshake"      # all of the bag take_1
        take_2 = ["handshake", "", "hand_wave"]  # each; "" leaves it out
        take_3 = [{from_s = 3.0, to_s = 40.0, interaction = "hand_wave"}]

    **Check** the pictures. **Train**: the folder is taken wherever a dataset is.

        mild train --dataset my_trials --out my_model

        mild evaluate --cv --dataset my_trials --protocol ahead

    `trials.toml` in the folder lists the trials and may be edited; `trials.npz` holds numbers only, without pickle.
    """
    from mild_ros.command_line.trial_writing import draw, write

    settings = _settings(config, {"robot": robot, "partner": partner, "label": label, "source": source, "topic": topic})
    if (out / "trials.toml").exists():
        raise SetupError(str(out), "holds trials already", "give another folder, or remove that one")
    cut, console = _cut_all(bags, settings, salvage), Console()
    pictures = draw(cut, settings, out)
    summary = _summary(cut)
    for bag, picture in zip(cut, pictures, strict=True):
        console.print(f"{bag.name}: {'; '.join(bag.notes)}", highlight=False, soft_wrap=True)
        console.print(f"  {picture}", highlight=False, soft_wrap=True)
    if not any(not one.fault for bag in cut for one in bag.movements):
        raise SetupError(str(out), summary, "look at the pictures, then label the movements or change [cut]")
    write(cut, settings, out, test_every)
    console.print(summary, highlight=False, soft_wrap=True)
    train = shlex.join(["mild", "train", "--dataset", str(out), "--out", "my_model"])
    console.print(f"written: {out}; next: {train}", highlight=False, soft_wrap=True)


def _settings(config: Path | None, given: dict[str, str]) -> DemonstrationSettings:
    """The settings of the file, under what the options say."""
    from mild_core.parameters import parameters_of
    from mild_ros.demonstrations.settings import RobotParameters, read_settings
    from mild_ros.node_kit.parameters import from_values

    settings = read_settings(config)
    named = {name: given[name] for name in ("source", "topic") if given[name]}
    if named:
        kind = type(settings.person)
        person = {entry.name: getattr(settings.person, entry.name) for entry in parameters_of(kind)} | named
        settings = replace(settings, person=from_values(kind, person))
    if given["robot"]:
        settings = replace(settings, robot=replace(settings.robot or RobotParameters(), robot=given["robot"]))
    if given["partner"]:
        settings = replace(settings, partner=replace(settings.partner or settings.person, topic=given["partner"]))
    if (settings.robot is None) == (settings.partner is None):
        problem = (
            "neither a robot nor a partner responds to the person"
            if settings.robot is None
            else "both a robot and a partner answer"
        )
        raise SetupError("demonstrations", problem, "give --robot or --partner, or one of [robot] and [partner]")
    return replace(settings, label=given["label"] or settings.label)


def _cut_all(paths: list[Path], settings: DemonstrationSettings, salvage: bool) -> list[CutBag]:
    """Every bag, behind a bar that counts messages."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from mild_ros.bag.reader import open_bag
    from mild_ros.command_line.cutting import bag_names, cut_bag
    from mild_ros.demonstrations.streams import Streams, readers

    names, totals = bag_names(paths), []
    # Report a bag that lacks a topic before an hour of reading. Each is closed again, as one that is converted or
    # salvaged lies on the disk once more while it is open.
    for path, name in zip(paths, names, strict=True):
        with open_bag(path, salvage=salvage) as bag:
            totals.append(sum(bag.topics[topic].count for topic in readers(bag, name, settings, Streams())))
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    cut = []
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("reading", total=sum(totals))
        for path, name in zip(paths, names, strict=True):
            progress.update(task, description=printable(f"cutting {name}", 80))
            cut.append(cut_bag(path, name, settings, salvage, lambda: progress.advance(task)))
    return cut


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


def _summary(cut: list[CutBag]) -> str:
    """How many trials of what, and what was left out and why."""
    from mild_ros.command_line.cutting import left_out

    trials = Counter(one.interaction for bag in cut for one in bag.movements if not one.fault)
    summary = ", ".join(f"{count} {name}" for name, count in sorted(trials.items()))
    text = f"{_counted(trials.total(), 'trial')} from {_counted(len(cut), 'bag')}" + (f": {summary}" if summary else "")
    faults = left_out(cut)
    if faults:
        text += f"; {faults.total()} left out: " + ", ".join(f"{count} {why}" for why, count in sorted(faults.items()))
    return text
