# SPDX-License-Identifier: Apache-2.0
"""`mild benchmark`: simulated people meet a robot in physics, and success is counted."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from mild_core.errors import SetupError
from mild_ros.command_line.console import Console

if TYPE_CHECKING:
    from mild_ros.benchmark.summary import Judgement

GIVEN = ("auto", "given")
MODELS = {"yumi": "yumi_buetepage_ahead", "pepper": "pepper_nuisi_next"}
ANY_ROBOT = "nuisi_partner_next"
"""Models by robot, and the model of two people for any other."""

MOST = 1_000_000


def benchmark(
    robot: Annotated[str, typer.Option(metavar="NAME|FILE", help="A robot of this package, or a robot file.")] = "yumi",
    model: Annotated[
        str, typer.Option(metavar="NAME|FOLDER", help="The model [default: the robot's own, or one of two people].")
    ] = "",
    interaction: Annotated[str, typer.Option(help="auto, or given: the robot knows what the person does.")] = "auto",
    count: Annotated[int, typer.Option(min=1, max=MOST, help="How many encounters.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first; the others follow it.")] = 0,
    workers: Annotated[int, typer.Option(min=0, help="Processes [default: one per core].")] = 0,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where results and pictures go.")] = Path("out/benchmark"),
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output, nothing else.")] = False,
) -> None:
    """Lets simulated people meet a robot and counts how often hands are met.

    Seeded people of 1.1 to 2.0 m stand 0.5 to 1.2 m from the robot's shoulder and wave, offer a right or left hand to
    be shaken or met in a rocket or parachute, feint, take the hand back early or walk past; some have a second person
    beside them. A tracker of 5 to 60 Hz sees them with 5 to 20 mm of noise through a camera whose pose is off by 1 to
    3 cm. Their motion comes from the kinematics of human arms, never from a model. The robot is simulated with its
    dynamics.

        mild benchmark --count 100

        mild benchmark --robot my_robot.toml --interaction given --count 200 --seed 1000

    An encounter succeeds when the robot answers in kind; meets a hand within 2 cm, beyond the error of the camera's
    pose, for half a second and at most 1.5 s after it has come to rest, where an independent solver reaches it; lets
    go of it; stays 5 cm from heads and trunks, slow near people and inside all limits; does not move for who walks
    past; and goes home again.

    JSON: success, met_reachable, reachable, violations and false_starts as shares with their 95 % intervals;
    median_distance_m; met_after_s; causes of failures by how often; said: what the robot's diagnostics said of hands
    that were not met. The folder also holds every encounter as one line of JSON.
    """
    from mild_ros.benchmark.jobs import EncounterJob, run_jobs, stage_for
    from mild_ros.benchmark.summary import summarise

    if interaction not in GIVEN:
        raise SetupError("--interaction", f"is '{interaction}'", f"give one of {', '.join(GIVEN)}")
    model = model or MODELS.get(robot, ANY_ROBOT)
    stage_for(robot)  # says in one line what is wrong with it
    _check_model(robot, model)
    jobs = [EncounterJob(robot, model, interaction == "given", number) for number in range(seed, seed + count)]
    results: list[Judgement] = []
    columns = (TextColumn("meeting"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("meeting", total=len(jobs))
        for result in run_jobs(jobs, workers):
            results.append(result)
            progress.advance(task)
    results.sort(key=lambda one: one.seed)
    found = {"robot": robot, "model": model, "interaction": interaction, "seed": seed, **summarise(results)}
    out.mkdir(parents=True, exist_ok=True)
    name = f"{Path(robot).stem}_{interaction}"
    lines = [json_text.dumps(one.as_mapping()) for one in results]
    (out / f"{name}.jsonl").write_text("\n".join(lines) + "\n")
    (out / f"{name}.json").write_text(json_text.dumps(found, indent=1) + "\n")
    if json:
        typer.echo(json_text.dumps(found))
        return
    console = Console(highlight=False)
    console.print(_table(found))
    if failed := _worst(results):
        from mild_ros.viewing.figures.encounter import draw_encounters

        path = out / f"{name}.png"
        draw_encounters([EncounterJob(robot, model, interaction == "given", one.seed) for one in failed], failed, path)
        console.print(f"{path}: the first encounter of each cause of failure")
    console.print(f"{out / name}.json, .jsonl: all of it")


def _check_model(robot: str, model: str) -> None:
    """Say in one line why a model cannot move a robot."""
    from mild_ros.assembly.perception import manifest_of
    from mild_ros.assembly.robot import check_fit, make_robot

    check_fit(model, manifest_of(model).controlled, make_robot(robot, ""))


def _worst(results: list[Judgement]) -> list[Judgement]:
    """The first of each cause."""
    first: dict[str, Judgement] = {}
    for one in results:
        if one.causes:
            first.setdefault(one.causes[0], one)
    return list(first.values())


def _table(found: dict[str, Any]) -> Table:
    table = Table("", "", "95 %", "of", box=None)

    def share(name: str, value: dict[str, Any]) -> None:
        if value["count"]:
            between = f"{100 * value['low']:.1f} to {100 * value['high']:.1f}"
            table.add_row(name, f"{100 * value['share']:.1f} %", between, str(value["count"]))

    share("success", found["success"])
    for kind, value in found["by_kind"].items():
        share(f"  {kind.replace('_', ' ')}", value)
    share("offered hands that can be reached", found["reachable"])
    share("of these met", found["met_reachable"])
    if found["met_after_s"]["median"] is not None:
        waits = found["met_after_s"]
        table.add_row("met after, median and 90 %", f"{waits['median']:.2f} s", f"{waits['90 %']:.2f} s", "")
    if found["median_distance_m"] is not None:
        table.add_row("median distance of hands", f"{100 * found['median_distance_m']:.1f} cm", "", "")
    share("not safe", found["violations"])
    share("false starts for passers-by", found["false_starts"])
    for cause, times in found["causes"].items():
        table.add_row(f"failed: {cause}", str(times), "", "")
    for said, times in found["said"].items():
        table.add_row(f"not met, said: {said}", str(times), "", "")
    return table
