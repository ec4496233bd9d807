# SPDX-License-Identifier: Apache-2.0
"""`mild plot`: the figures and tables of a paper, from a model and its recording or from measured errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mild_core.budgets import TABLE_BYTES, parse_json, read_file
from mild_core.errors import SetupError
from mild_ros.command_line.console import Console
from mild_ros.command_line.options import Config, Given, Model, Source

if TYPE_CHECKING:
    from mild_ros.command_line.plot_data import ModelTrials

MODEL = Annotated[str, typer.Option(metavar="NAME|FOLDER", help="A shipped model, or the folder of yours.")]
DATA = Annotated[
    Path | None, typer.Option(metavar="FILE", help="The recording [default: $MILD_DATA/<dataset's file>].")
]
SPLIT = Annotated[
    str, typer.Option(metavar="test|train", help="Trials as published [default: test, where there are some].")
]
FOLD = Annotated[
    int | None, typer.Option(min=0, metavar="N", help="Learn the model without a fold (0 to 3), and show that fold.")
]
FOLDS = Annotated[
    list[int] | None, typer.Option(min=0, metavar="N", help="As --fold of the others; may be given several times.")
]
TRIAL = Annotated[int | None, typer.Option(min=0, help="Number of the trial among those shown.")]
OUT = Annotated[Path, typer.Option(metavar="FILE", help="What to write: .png, .pdf or .svg.")]
TABLES = Annotated[list[Path], typer.Argument(metavar="TABLE…", help="Tables that `mild evaluate --cv` wrote (.json).")]

PAPERS = "yumi_buetepage_same"
"""The shipped model that predicts what the paper's does."""

plot = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown", help=__doc__.split(": ", 1)[1] if __doc__ else "")


@plot.command()
def latent(model: MODEL = PAPERS, data: DATA = None, fold: FOLD = 0, out: OUT = Path("out/latent.png")) -> None:
    """Latent spaces of both agents with the fitted components (Fig. 3 of the paper), of trials held out.

    A row per agent, a column per interaction, in the three directions in which that agent's latents vary most; lines
    are the means of the agent's own posteriors over a trial, ellipsoids one and a half deviations of a component. The
    robot's encoder is no part of a model folder, so the model is learned for this figure, without the fold that it
    shows (a minute or two; the next time it is found in out/folds).

        mild plot latent --model yumi_buetepage_same --fold 1 --out latent.pdf
    """
    from mild_ros.command_line.plot_data import latent_spaces, watched
    from mild_ros.viewing.figures.latent import draw_latent_spaces

    seen = watched(model, data, fold=fold or 0)
    draw_latent_spaces(latent_spaces(seen), out, f"{model}: latent spaces, {seen.which}")
    _written(out)


@plot.command()
def window(
    model: MODEL = PAPERS,
    data: DATA = None,
    split: SPLIT = "",
    fold: FOLDS = None,
    out: OUT = Path("out/window.png"),
) -> None:
    """The error over the predicted window beside Bütepage et al.'s (Fig. 4), by interaction.

    Shown are test trials, where the recording has some, or folds that were held out from both methods, which are then
    learned here:

        mild plot window --model yumi_buetepage_same --fold 0 --fold 1 --fold 2 --fold 3

        mild plot window --model my_model --data traj_data.npz --split test

    With --split train it shows what the model remembers of the trials that it learned from, and says so.
    """
    from mild_ros.command_line.plot_data import errors_over_window, watched
    from mild_ros.viewing.figures.over_window import draw_over_window
    from mild_ros.viewing.style import counted

    seen = [watched(model, data, split, one) for one in fold or (None,)]
    errors, times_s = errors_over_window(seen)
    unit = (seen[0].recording.unit.shown.strip(), seen[0].recording.unit.scale)
    which = f"trials of {counted(len(seen), 'fold')}, held out" if len(seen) > 1 else seen[0].which
    draw_over_window(errors, times_s, unit, out, f"{model}: {which}")
    _written(out)


@plot.command()
def skeletons(
    model: MODEL = PAPERS,
    data: DATA = None,
    split: SPLIT = "",
    fold: FOLD = None,
    trial: TRIAL = None,
    moments: Annotated[int, typer.Option(min=2, max=12, help="How many.")] = 6,
    out: OUT = Path("out/skeletons.png"),
) -> None:
    """Recorded and predicted arms at moments of a trial (Fig. 5 and 8): a row per interaction, at equal times.

    With --trial one trial, from the side and from above.

        mild plot skeletons --model nuisi_partner_same --fold 0

        mild plot skeletons --model nuisi_partner_same --fold 0 --trial 2
    """
    from mild_ros.command_line.plot_data import moments_of, moments_of_each, watched
    from mild_ros.viewing.figures.skeletons import draw_skeletons

    seen = watched(model, data, split, fold)
    rows = moments_of_each(seen, moments) if trial is None else {"": moments_of(seen.only(trial), moments)}
    title = f"{model}: {seen.which}" if trial is None else _title(model, seen, trial)
    draw_skeletons(rows, out, title)
    _written(out)


@plot.command()
def joints(
    model: MODEL = PAPERS,
    data: DATA = None,
    split: SPLIT = "",
    fold: FOLD = None,
    trial: TRIAL = 0,
    out: OUT = Path("out/joints.png"),
) -> None:
    """Each joint over a trial as recorded and as predicted, with its 90 % region (Fig. 7).

    Shown is the last frame of each predicted window, at the time that it is for.

        mild plot joints --model yumi_buetepage_ahead --fold 0 --trial 3
    """
    from mild_ros.command_line.plot_data import motion_of, watched
    from mild_ros.viewing.figures.joints import draw_joints

    seen = watched(model, data, split, fold)
    draw_joints(motion_of(seen.only(trial or 0)), out, _title(model, seen, trial or 0))
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
    from mild_ros.assembly.perception import make_perception, manifest_of, skeleton_source
    from mild_ros.assembly.robot import make_robot_to_draw
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
    found = make_robot_to_draw(parameters.robot, parameters.robot_description)
    manifest = manifest_of(parameters.model)
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
    """Errors by interaction and method as the paper's Tables I to III, in LaTeX (booktabs) or Markdown.

    Mean ± deviation over windows; of two people also in the paper's unit; a star marks p < .05 against Bütepage et
    al. by a paired test over the interaction's trials. The JSON that this reads holds the same numbers.

    Table I is of two people in motion capture suits (`mild data buetepage_hh`):
    `mild evaluate --cv --dataset buetepage_hh --protocol same`.

        mild plot table out/cross_validation_nuisi_v1_same.json --out table_3.tex
    """
    from mild_ros.viewing.figures.tables import LAYOUTS

    if out.suffix not in LAYOUTS:
        raise SetupError(str(out), f"ends in '{out.suffix}'", f"let it end in {' or '.join(LAYOUTS)}")
    text = "\n".join(LAYOUTS[out.suffix](_table(path)) for path in tables)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(text)
    _written(out)


FIGURES_OF = {
    "buetepage_hh": ("buetepage_partner_same", ("3", "4", "5")),
    "buetepage_hr": ("yumi_buetepage_same", ("3", "4", "7")),
    "nuisi_v1": ("nuisi_v1_partner_same", ("3", "4", "8")),
}
"""By recording: the configuration that the paper's figures are made with here, and which figures."""

RUNS = {"6": ("handshake", "", None, None), "9": ("rocket_kneeling", "pepper", "azure_kinect", "rocket")}
"""By figure: bag, configuration, source and given interaction of the run that is shown."""

TABLES_OF = {"1": "buetepage_hh_same", "2": "buetepage_hr_same", "3": "nuisi_v1_same"}
"""By table: the cross-validation that it is of."""


@plot.command()
def paper(
    fold: FOLD = 0,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="What to write into.")] = Path("out/paper"),
    ending: Annotated[str, typer.Option(metavar="png|pdf|svg", help="Format of the figures.")] = "png",
) -> None:
    """All figures and tables of the paper, of trials that were held out.

    Figures 3 to 5, 7 and 8 are of models that are learned here without the fold that they show, once (some ten
    minutes); 6 and 9 of runs of our own bags. Tables I to III are made of the cross-validations that are in out/
    (`mild evaluate --cv`, see docs/paper.md). A recording that is not here is said, and its figures left out.

        mild plot paper
    """
    from mild_core.learning.datasets import DATASETS

    for dataset, (model, figures) in FIGURES_OF.items():
        recording = DATASETS[dataset]
        if not recording.default_path().exists():
            _say(f"figures {', '.join(figures)} of {dataset}: the recording is not here (mild data {dataset})")
            continue
        for number in figures:
            file = out / f"figure_{number}_{dataset}.{ending}"
            match number:
                case "3":
                    latent(model, fold=fold, out=file)
                case "4":
                    window(model, fold=[fold or 0], out=file)
                case "7":
                    joints(model, fold=fold, trial=2, out=file)
                case _:
                    skeletons(model, fold=fold, out=file)
    for number, (bag, config, source, interaction) in RUNS.items():
        run = _replayed(bag, config, source, interaction, out / f"run_{number}")
        filmstrip(run, config=config, source=source, out=out / f"figure_{number}_{bag}.{ending}")
    for number, name in TABLES_OF.items():
        made = Path("out", f"cross_validation_{name}.json")
        if made.exists():
            table([made], out / f"table_{number}.tex")
        else:
            dataset = name.removesuffix("_same")
            _say(f"table {number}: no {made} (mild evaluate --cv --dataset {dataset} --protocol same)")


def _replayed(bag: str, config: str, source: str | None, interaction: str | None, out: Path) -> Path:
    """A run of one of our bags in this process."""
    from mild_core.resources import share_folder
    from mild_ros.command_line.replay import replay
    from mild_ros.replay.demo import RECORDED

    replay(share_folder("bags") / bag, config=config, source=source, interaction=interaction, out=out)
    return out / RECORDED


def _table(path: Path) -> dict[str, Any]:
    """One table of a cross-validation."""
    try:
        found: dict[str, Any] = parse_json(read_file(path, TABLE_BYTES))
        if not all(key in row for row in found["methods"] for key in ("title", "labels", "macro_mean", "interactions")):
            raise KeyError("methods")
        return {**found, "unit": found["unit"]}
    except (ValueError, KeyError, TypeError) as error:
        raise SetupError(str(path), f"is no table of a cross-validation ({error})", "run mild evaluate --cv") from None


def _title(model: str, seen: ModelTrials, trial: int) -> str:
    interaction = seen.trials[trial].interaction.replace("_", " ")
    return f"{model}: {interaction} (trial {trial} of the {seen.which})"


def _written(path: Path) -> None:
    _say(f"written: {path}")


def _say(text: str) -> None:
    Console().print(text, highlight=False, soft_wrap=True)
