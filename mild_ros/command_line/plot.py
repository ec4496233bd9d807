# SPDX-License-Identifier: Apache-2.0
"""`mild plot`: the figures and tables of a paper, from a model and its recording or from measured errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from mild_core.budgets import TABLE_BYTES, parse_json, read_file
from mild_core.errors import SetupError
from mild_ros.command_line.console import Console
from mild_ros.command_line.options import Config, Given, Model, Source

MODEL = Annotated[str, typer.Option(metavar="NAME|FOLDER", help="A shipped model, or the folder of yours.")]
DATA = Annotated[
    Path | None, typer.Option(metavar="FILE", help="The recording [default: $MILD_DATA/<dataset's file>].")
]
SPLIT = Annotated[str, typer.Option(help="train or test trials, as published.")]
TRIAL = Annotated[int, typer.Option(min=0, help="Number of the trial in its split.")]
OUT = Annotated[Path, typer.Option(metavar="FILE", help="What to write: .png, .pdf or .svg.")]
TABLES = Annotated[list[Path], typer.Argument(metavar="TABLE…", help="Tables that `mild evaluate --cv` wrote (.json).")]

DEFAULT = "yumi_buetepage_ahead"

plot = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown", help=__doc__.split(": ", 1)[1] if __doc__ else "")


@plot.command()
def latent(
    model: MODEL = DEFAULT, data: DATA = None, split: SPLIT = "train", out: OUT = Path("out/latent.png")
) -> None:
    """Latent spaces of both agents with the fitted components (Fig. 3 of the paper).

    A row per agent, a column per interaction; lines are trials, ellipses two deviations of a component. The person's
    latents are what the encoder says, the other's what the prior expects given the person.

        mild plot latent --model yumi_buetepage_same --out latent.pdf
    """
    from mild_ros.command_line.plot_data import latent_spaces, watched
    from mild_ros.viewing.figures.latent import draw_latent_spaces

    seen = watched(model, data, split)
    draw_latent_spaces(latent_spaces(seen), out, f"{seen.model.manifest.name}: latent spaces")
    _written(out)


@plot.command()
def window(
    model: MODEL = DEFAULT, data: DATA = None, split: SPLIT = "train", out: OUT = Path("out/window.png")
) -> None:
    """The error over the predicted window (Fig. 4): how it grows with the time ahead.

    Over the training trials of a model it shows memory; give a file with test trials and --split test.

        mild plot window --model my_model --data traj_data.npz --split test
    """
    from mild_ros.command_line.plot_data import errors_over_window, watched
    from mild_ros.viewing.figures.comparison import draw_over_window

    seen = watched(model, data, split)
    errors, times_s = errors_over_window(seen)
    unit = (seen.recording.unit.shown.strip(), seen.recording.unit.scale)
    draw_over_window(errors, times_s, unit, out, f"{seen.model.manifest.name}, {split} trials")
    _written(out)


@plot.command()
def skeletons(
    model: MODEL = DEFAULT,
    data: DATA = None,
    split: SPLIT = "train",
    trial: TRIAL = 0,
    moments: Annotated[int, typer.Option(min=2, max=12, help="How many.")] = 6,
    out: OUT = Path("out/skeletons.png"),
) -> None:
    """Recorded and predicted arms at moments of a trial, from the side and from above (Fig. 5 and 8).

    mild plot skeletons --model nuisi_partner_same --trial 12
    """
    from mild_ros.command_line.plot_data import moments_of, watched
    from mild_ros.viewing.figures.skeletons import draw_skeletons

    seen = watched(model, data, split, trial)
    draw_skeletons(moments_of(seen, moments), out, _title(seen, trial))
    _written(out)


@plot.command()
def joints(
    model: MODEL = DEFAULT,
    data: DATA = None,
    split: SPLIT = "train",
    trial: TRIAL = 0,
    out: OUT = Path("out/joints.png"),
) -> None:
    """Each joint over a trial as recorded and as predicted, with its 90 % region (Fig. 7).

    Shown is the last frame of each predicted window, at the time that it is for.

        mild plot joints --model yumi_buetepage_ahead --trial 9
    """
    from mild_ros.command_line.plot_data import motion_of, watched
    from mild_ros.viewing.figures.joints import draw_joints

    seen = watched(model, data, split, trial)
    draw_joints(motion_of(seen), out, _title(seen, trial))
    _written(out)


@plot.command()
def filmstrip(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A bag that `mild demo`, `replay` or a recorder wrote.")],
    model: Model = None,
    robot: Annotated[str | None, typer.Option(metavar="NAME|FILE", help="That was moved [default: yumi].")] = None,
    source: Source = None,
    config: Config = "",
    given: Given = None,
    title: Annotated[str, typer.Option(help="Above the pictures [default: robot and interaction].")] = "",
    out: OUT = Path("out/filmstrip.png"),
) -> None:
    """Person and robot at moments of a recorded run, from rest to contact to rest (Fig. 6 and 9).

        mild replay bags/handshake --lock-step --out out/handshake

        mild plot filmstrip out/handshake/recorded --out handshake.pdf

    A rocket with Pepper, by the model of its own joints; the person kneels, as before a child:

        mild replay bags/rocket_kneeling --config pepper --source azure_kinect --interaction rocket --out out/pepper

        mild plot filmstrip out/pepper/recorded --config pepper --source azure_kinect

    The person is drawn where the camera of the recording saw them (its `camera.toml`, or -p robot_from_camera:='…'),
    and without one where the model takes them to stand.
    """
    from mild_core.retargeting.robot_file import find_robot
    from mild_ros.assembly.perception import make_perception, manifest_of, skeleton_source
    from mild_ros.assembly.settings import PipelineParameters
    from mild_ros.bag.camera import with_camera
    from mild_ros.node_kit.parameter_files import read_parameters
    from mild_ros.replay.recorded import read_run
    from mild_ros.viewing.filmstrip import draw_filmstrip
    from mild_ros.viewing.placing import main_interaction
    from mild_ros.viewing.staging import stage

    named = {"model": model, "robot": robot, "source": source}
    parameters = read_parameters(PipelineParameters, "pipeline", config, given or (), **named)
    parameters = with_camera(parameters, run, given or ())
    found, manifest = find_robot(parameters.robot), manifest_of(parameters.model)
    recorded = read_run(run, skeleton_source(parameters))
    staged = stage(recorded, make_perception(parameters, manifest), manifest, found)
    spoken = main_interaction(recorded.motions).replace("_", " ") or "nothing recognised"
    out.parent.mkdir(parents=True, exist_ok=True)
    draw_filmstrip(staged, found, out, title or f"{found.name}: {spoken}")
    time_s, gap_m = staged.nearest()
    _say(f"hands at their nearest: {100 * gap_m:.1f} cm apart at {time_s:.1f} s")
    _written(out)


@plot.command()
def comparison(tables: TABLES, out: Annotated[Path, typer.Option(metavar="FOLDER")] = Path("out")) -> None:
    """All methods of a cross-validation side by side, with intervals.

    mild plot comparison out/cross_validation_buetepage_hr_same.json
    """
    from mild_ros.viewing.figures.comparison import draw_comparison

    for path in tables:
        draw_comparison(_table(path), out / f"{path.stem}.png")
        _written(out / f"{path.stem}.png")


@plot.command()
def table(
    tables: TABLES, out: Annotated[Path, typer.Option(metavar="FILE", help=".tex or .md")] = Path("out/table.tex")
) -> None:
    """Errors by interaction and method as the paper's Tables II and III, in LaTeX (booktabs) or Markdown.

    Table I is of two people in motion capture suits whose recordings are no longer published. With their folder
    `hh` makes it too: `mild evaluate --cv --dataset buetepage_hh --data hh --protocol same`.

        mild plot table out/cross_validation_nuisi_v1_same.json --out table_3.tex
    """
    from mild_ros.viewing.figures.tables import LAYOUTS

    if out.suffix not in LAYOUTS:
        raise SetupError(str(out), f"ends in '{out.suffix}'", f"let it end in {' or '.join(LAYOUTS)}")
    text = "\n".join(LAYOUTS[out.suffix](_table(path)) for path in tables)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(text)
    _written(out)


def _table(path: Path) -> dict[str, Any]:
    """One table of a cross-validation."""
    try:
        found: dict[str, Any] = parse_json(read_file(path, TABLE_BYTES))
        if not all(key in row for row in found["methods"] for key in ("title", "labels", "macro_mean", "interactions")):
            raise KeyError("methods")
        return {**found, "unit": found["unit"]}
    except (ValueError, KeyError, TypeError) as error:
        raise SetupError(str(path), f"is no table of a cross-validation ({error})", "run mild evaluate --cv") from None


def _title(seen: Any, trial: int) -> str:
    interaction = seen.trials[0].interaction.replace("_", " ")
    return f"{seen.model.manifest.name}: {interaction} (trial {trial})"


def _written(path: Path) -> None:
    _say(f"written: {path}")


def _say(text: str) -> None:
    Console().print(text, highlight=False, soft_wrap=True)
