# SPDX-License-Identifier: Apache-2.0
"""`mild evaluate`: how wrong a model is, and how wrong every method is on trials it has not seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mild_core.errors import SetupError, unknown_name

if TYPE_CHECKING:
    from mild_core.inference.model import MildModel
    from mild_core.learning.data.demonstration import Demonstration
    from mild_core.learning.data.windows import Protocol
    from mild_core.learning.evaluation.errors import TrialErrors

RECOGNISED, STARTED, LIVE = "recognised", "started", "live"
LABELS = ("given", RECOGNISED, STARTED, LIVE)
STANDING_S = 3.0
"""With labels `live` people also stand still for so long before each trial, as they do before a robot."""

TEST = "test"


DATA = Annotated[
    Path | None, typer.Option(metavar="FILE", help="The recording [default: $MILD_DATA/<dataset's file>].")
]
DATASET = Annotated[
    str,
    typer.Option(
        metavar="NAME|FOLDER", help="Which recording, or folder of trials [default: of model or configuration]."
    ),
]
LABELS_OPTION = Annotated[
    str,
    typer.Option(
        help="given: the interaction is known; recognised: it is not; started: it is known, and where the robot stood "
        "before, as by joint_states; live: what the robot runs: recognised, where it stood is known, and once more "
        "after 3 s of standing."
    ),
]


def evaluate(
    model: Annotated[str, typer.Option(metavar="NAME|FOLDER", help="A shipped model, or the folder of yours.")] = "",
    data: DATA = None,
    dataset: DATASET = "",
    protocol: Annotated[
        str, typer.Option(help="same, ahead or next: what is predicted [default: the model's; of --cv: same].")
    ] = "",
    config: Annotated[str, typer.Option(metavar="NAME|FILE", help="With --cv: how ours is trained, and on what.")] = "",
    split: Annotated[str, typer.Option(help="train or test trials, as published.")] = "train",
    labels: LABELS_OPTION = "given",
    cv: Annotated[bool, typer.Option("--cv", help="Cross-validate all methods over the training trials.")] = False,
    unknown: Annotated[
        bool, typer.Option("--unknown", help="Leave each interaction out: is it detected as unknown? Takes seconds.")
    ] = False,
    every: Annotated[
        bool, typer.Option("--all", help="With --cv or --unknown: all three protocols of the recording.")
    ] = False,
    strangers: Annotated[
        bool, typer.Option("--strangers", help="Leave whole data sets out: are their people recognised? Takes minutes.")
    ] = False,
    people: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A people file: how the model does with these people.")
    ] = None,
    interaction: Annotated[str, typer.Option(help="With --people: auto, or given: it is what the file says.")] = "auto",
    cautious: Annotated[bool, typer.Option("--cautious", help="With --people: with the parameter `cautious`.")] = False,
    seeds: Annotated[int, typer.Option(min=1, help="With --cv: runs of each method that draws at random.")] = 3,
    method: Annotated[list[str] | None, typer.Option(help="With --cv: only this one; may be repeated.")] = None,
    workers: Annotated[int, typer.Option(min=0, help="With --cv: processes [default: one per core].")] = 0,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="With --cv: where the tables are written.")] = Path("out"),
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output, nothing else.")] = False,
) -> None:
    """A model's error per interaction, or a cross-validation of all methods.

    **One model**, run exactly as it runs on the robot, over all windows of the published trials:

        mild evaluate --model yumi_buetepage_same

        mild evaluate --model models/yumi_buetepage_ahead --protocol ahead --labels recognised --json

    A model knows one protocol; another one is refused, because such figures would not compare. Training trials are
    those that a shipped model learned from, so what they show is memory: the honest figure is that of --cv. Where the
    publishers' test trials are not in the file, --split test says so, shows 0 windows and null errors, and exits 0.

    **All methods**, each learned four times on three quarters of the training trials, scored on the rest:

        mild evaluate --cv --all --seeds 3

        mild evaluate --cv --dataset nuisi --protocol next --method kernel_ridge --method nearest_neighbours

        mild evaluate --cv --config my_model.toml --method mild --method kernel_ridge

        mild evaluate --cv --dataset my_trials --protocol ahead

    It leaves a table as text, JSON and picture: mean ± deviation over seeds, 95 % intervals from drawing trials, and
    the change against each bar with the p-value of a paired test over trials (Wilcoxon's signed-rank). Of models that
    run on the robot, also how they did there without a given interaction: trials in which they acted upon none
    or another one 1 s and 5 s after its onset (hand 5 cm from rest); share of frames that they called unknown; by how
    much the error grew until a second after the onset, and later; how many true values lay within the 90 % region of
    the published covariance, all of a frame at once / each by itself, with its scale learned on the other folds; and a
    picture of the same for all regions.

    **What was never shown**: each interaction left out in turn, the share of its frames detected as unknown from 1 s
    after onset, where 5 % of the frames of the known ones are, beside a nearest neighbour's distance. It asks the score
    of distance alone, without networks, so it takes 10 s of processor time for 32 trials and four interactions:

        mild evaluate --unknown --protocol ahead

    **Whole data sets left out**: the recogniser of gestures, which every model shares, is learned on all recordings
    here but one and meets the people of that one, for each in turn and with `--seeds` seeds:

        mild evaluate --strangers --seeds 1

    JSON: by data set `active_likeliest` (share of active frames in which the likeliest gesture is the right one, with
    its `interval`), what is `right` and `wrong` at 0.5, 1, 2 and 3 s after the onset, `started_at_rest`,
    `started_in_time` (within 2.6 s), and for each foreign motion the `area` under the curve and the `share` detected
    unknown at 5 % false alarms. Under `motion`, for each shipped model of a robot, the people of the other recordings
    and each interaction in which hands meet: `mean_m` and `median_m` over arms of the distance between tool and hand,
    while the hand is within 5 % of its farthest from rest. They stand where the model's people stood, with arms of its
    bones; the interaction is given; no camera and no inverse kinematics help.

    **People it never met**: whole bodies of several people in one frame with z up, each watched in turn through the
    real perception, after 1.5 s of standing, with the model's robot standing by:

        mild evaluate --people people.npz --model yumi_buetepage_ahead --json

    A people file holds `joint_names` (J,), `labels` (N,) the interaction or "", `active_s` (N, 2) when it is performed,
    and of each recording `NAME_positions_mm` (T, P, J, 3) int16, -32768 where not seen, and `NAME_times_ms` (T,).
    JSON: `recognised` at 0.5, 1, 2 and 3 s after the onset (hand 6 cm from rest) and `active`: shares of predictions
    that are `right`, `wrong`, `offered`, `none` or `resting`, and how often the `likeliest` interaction is the right
    one; `named_at_rest`: share of people for whom something was named before; `starts_per_minute`: how often the robot
    begins to answer, and `made_way_per_minute`: how often it moves otherwise, away from people;
    `accepted_frames`: below 0.9 the figures are not `valid`. Of two people also `contact.given` and `contact.auto`: the
    robot stands where the partner stood, with the camera measured, and this far [m] is its hand from the person's, the
    median over the frames in which the two people's hands were within 15 cm.

    Errors are squared differences of joint angles averaged over joints and window [rad²]; of two people squared
    distances of the partner's joints [m²]; "macro" is the mean over the interactions. JSON: `macro.mse`,
    `interactions.<name>.mse`, `.mse_std`, `.windows`, `rmse_deg` or `rmse_cm`, `mean_absolute_deg` or `_cm`.
    """
    asked = cv + unknown + strangers + bool(model)
    if asked != 1:
        problem = "nothing to do" if not asked else "--cv, --unknown and --strangers learn their own, one at a time"
        raise SetupError("evaluate", problem, "give --model, --cv, --unknown or --strangers")
    if strangers:
        from mild_ros.command_line.people import evaluate_strangers

        evaluate_strangers(seeds, json)
        return
    if people is not None:
        if not model:
            raise SetupError("--people", "measures a model", "give --model NAME too")
        from mild_ros.command_line.people import evaluate_people

        evaluate_people(people, model, interaction, json, cautious)
        return
    if model:
        _evaluate_model(model, dataset, data, protocol, split, labels, json)
        return
    from mild_ros.command_line.cross_validate import cross_validate, detect_unknown, request_of

    request = request_of(config, dataset, data, protocol, every)
    request = replace(request, methods=tuple(method or ()), seeds=seeds, workers=workers)
    (cross_validate if cv else detect_unknown)(request, out, json)


def _evaluate_model(
    name: str, dataset: str, data: Path | None, protocol_name: str, split: str, labels: str, json: bool
) -> None:
    """Print the errors of one model."""
    from mild_core.inference.model import load_model
    from mild_core.learning.data.windows import protocol_named
    from mild_core.learning.datasets import recording_named
    from mild_core.learning.evaluation.errors import summarise
    from mild_core.learning.training.model_predictor import require_fit
    from mild_core.resources import model_folder
    from mild_ros.command_line.error_tables import errors_as_data, print_json, print_model

    if labels not in LABELS:
        raise unknown_name("labels", labels, LABELS)
    model = load_model(model_folder(name))
    recording = recording_named(dataset or str(model.manifest.training.get("dataset", "buetepage_hr")), data)
    protocol = protocol_named(protocol_name or model.manifest.protocol, recording.protocols)
    require_fit(model.manifest, protocol, ())
    path = data or recording.default_path()
    trials = recording.read(path).split(split)
    require_fit(model.manifest, protocol, trials)
    head: dict[str, Any] = {"model": model.manifest.name, "dataset": recording.name, "protocol": protocol.name}
    head |= {"split": split, "labels": labels, "note": _note(split, path, len(trials))}
    errors, right = _measure(model, protocol, trials, labels, 0.0)
    summary = summarise(errors, recording.interactions)
    if labels != LIVE:
        (print_json if json else print_model)(head | {"recognised_share": right}, summary, recording.unit)
        return
    errors, right_later = _measure(model, protocol, trials, labels, STANDING_S)
    later = summarise(errors, recording.interactions)
    if json:
        standing = {"seconds": STANDING_S, "recognised_share": right_later, **errors_as_data(later, recording.unit)}
        print_json(head | {"recognised_share": right, "after_standing": standing}, summary, recording.unit)
        return
    print_model(head | {"recognised_share": right}, summary, recording.unit)
    head["labels"] = f"{LIVE}, after {STANDING_S:g} s of standing"
    print_model(head | {"recognised_share": right_later}, later, recording.unit)


def _note(split: str, path: Path, trials: int) -> str:
    if not trials:
        return f"the {split} split of {path} is empty: nothing was measured"
    return "" if split == TEST else "training trials: a shipped model has learned from them; see --cv for unseen ones"


def _measure(
    model: MildModel, protocol: Protocol, trials: tuple[Demonstration, ...], labels: str, standing_s: float
) -> tuple[list[TrialErrors], float | None]:
    """Errors of each trial, and the share of windows in which inference acted upon the right interaction."""
    from rich.progress import track

    from mild_core.learning.evaluation.errors import errors_of_trial
    from mild_core.learning.training.model_predictor import AUTO, ModelPredictor
    from mild_ros.command_line.console import Console

    predictor, right, windows = ModelPredictor(model, protocol), 0, 0
    errors: list[TrialErrors] = []
    for trial in track(trials, "measuring", console=Console(stderr=True), transient=True, disable=not trials):
        interaction = AUTO if labels in (RECOGNISED, LIVE) else trial.interaction
        started = labels == STARTED or (labels == LIVE and model.manifest.controlled.kind != "human_arm")
        answers = predictor.answers(trial, interaction, started=started, standing_s=standing_s)
        errors.append(errors_of_trial(trial, protocol, answers.predicted))
        right += sum(name == trial.interaction for name in answers.interactions)
        windows += len(answers.interactions)
    return errors, right / windows if windows and labels in (RECOGNISED, LIVE) else None
