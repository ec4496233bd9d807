# SPDX-License-Identifier: Apache-2.0
"""A run as curves: predicted, commanded and true joints with the model's uncertainty, what it believed, and when."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mild_core.shapes import FloatArray
from mild_core.signals import MotionWindow
from mild_ros.replay.recorded import JointTrack, RecordedRun
from mild_ros.viewing.report import Report

BLUE, ORANGE, GREEN, VERMILION, SKY, PURPLE, YELLOW, BLACK = (
    *("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#F0E442", "#000000"),
)
"""Distinguishable with any colour vision. Source: Okabe and Ito, "Color Universal Design", 2008."""

INK, GREY = "#222831", "#8a929c"
TRUTH_WIDTH, LINE_WIDTH = 2.6, 1.3


def draw_plots(run: RecordedRun, report: Report, joint_names: tuple[str, ...], path: Path, title: str) -> None:
    """Write the plots of a run as a PNG: joints on the left, beliefs and times on the right."""
    figure = Figure(figsize=(15.0, 1.55 * len(joint_names) + 0.9), dpi=130, layout="constrained", facecolor="white")
    figure.suptitle(title, x=0.012, ha="left", fontweight="bold", color=INK)
    parts: Any = figure.subfigures(1, 2, width_ratios=(1.25, 1.0))  # an array, which its type does not show
    left, right = parts
    joints = left.subplots(len(joint_names), 1, sharex=True)
    for axes, name in zip(joints, joint_names, strict=True):
        _joint(axes, run, name)
    handles, labels = joints[0].get_legend_handles_labels()
    left.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False, fontsize=9)
    joints[-1].set_xlabel("time since the first skeleton [s]")
    recognised, belief, phase, age = right.subplots(4, 1, sharex=False)
    _recognition(recognised, run)
    _belief(belief, run, right)
    _phase(phase, run)
    _age(age, report)
    limits = (0.0, float(run.seconds(run.people[-1].stamp_ns)))
    for axes in (*joints, recognised, belief, phase):
        axes.set_xlim(*limits)
    for axes in (*joints, recognised, phase, age):
        _clean(axes)
    figure.savefig(path)


def predicted(motions: tuple[MotionWindow, ...], joint: str, lead_ns: int = 0) -> tuple[FloatArray, ...]:
    """What each motion says of a joint at its own stamp plus `lead_ns`: stamps [ns], value [rad], deviation [rad].

    Outside of the window its nearest row is used.
    """
    stamps, values, deviations = [], [], []
    for motion in motions:
        if joint not in motion.joint_names or motion.positions.ndim != 2:
            continue
        column = motion.joint_names.index(joint)
        rows_ns = motion.lead_ns + motion.period_ns * np.arange(len(motion.positions))
        at_ns = float(np.clip(lead_ns, rows_ns[0], rows_ns[-1]))
        stamps.append(motion.stamp_ns + at_ns)
        values.append(float(np.interp(at_ns, rows_ns, motion.positions[:, column])))
        deviations.append(float(np.sqrt(max(motion.covariance[column, column], 0.0))))
    return np.array(stamps), np.array(values), np.array(deviations)


def _joint(axes: Axes, run: RecordedRun, name: str) -> None:
    stamps, values, deviations = predicted(run.motions, name)
    if len(stamps):
        times, middle, spread = run.seconds(stamps), np.degrees(values), 2.0 * np.degrees(deviations)
        axes.fill_between(times, middle - spread, middle + spread, color=SKY, alpha=0.25, lw=0, label="± 2 deviations")
        axes.plot(times, middle, color=BLUE, lw=LINE_WIDTH, label="predicted")
    _track(axes, run, run.truth, name, color=GREEN, lw=TRUTH_WIDTH, alpha=0.55, label="true")
    _track(axes, run, run.commands, name, color=VERMILION, lw=LINE_WIDTH, label="commanded")
    _track(axes, run, run.measured, name, color=BLACK, lw=LINE_WIDTH, ls=(0, (2, 2)), label="simulated robot")
    axes.set_ylabel(f"{name.removeprefix('yumi_')} [°]", fontsize=8)


def _track(axes: Axes, run: RecordedRun, track: JointTrack | None, name: str, **style: object) -> None:
    if track is not None and len(track.stamps_ns) > 1 and name in track.joint_names:
        values = np.degrees(track.positions_rad[:, track.joint_names.index(name)])
        axes.plot(run.seconds(track.stamps_ns), values, **style)  # type: ignore[arg-type]


def _recognition(axes: Axes, run: RecordedRun) -> None:
    """Probability of whatever was recognised, in that interaction's colour; grey where it was unknown."""
    colours = (BLUE, ORANGE, GREEN, PURPLE, VERMILION, SKY)
    times = run.seconds([motion.stamp_ns for motion in run.motions])
    names = sorted({motion.interaction for motion in run.motions})
    for name, colour in zip([name for name in names if name], colours, strict=False):
        chosen = [motion.probability if motion.interaction == name else np.nan for motion in run.motions]
        axes.plot(times, chosen, color=colour, lw=2.2, label=name.replace("_", " "))
    strange = np.array([motion.out_of_distribution > 1.0 or not motion.interaction for motion in run.motions])
    if strange.any():
        axes.fill_between(times, 0.0, 1.0, where=strange.tolist(), color=GREY, alpha=0.25, lw=0, label="unknown motion")
    axes.set_ylim(0.0, 1.04)
    axes.set_ylabel("probability")
    axes.set_title("recognised interaction", loc="left", fontsize=10, color=INK)
    if run.motions:
        axes.legend(frameon=False, fontsize=8, loc="lower right", ncols=3)


def _belief(axes: Axes, run: RecordedRun, figure: object) -> None:
    """Belief over the components of the recognised interaction, as an image: one row per component."""
    axes.set_title("belief over the components of that interaction", loc="left", fontsize=10, color=INK)
    axes.set_ylabel("component")
    if not run.motions:
        return
    size = max(motion.belief.size for motion in run.motions)
    image = np.zeros((size, len(run.motions)))
    for column, motion in enumerate(run.motions):
        image[: motion.belief.size, column] = motion.belief
    times = run.seconds([motion.stamp_ns for motion in run.motions])
    edges = np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])
    axes.pcolormesh(edges, np.arange(size + 1) + 0.5, image, cmap="cividis", vmin=0.0, vmax=1.0, rasterized=True)
    axes.set_yticks(range(1, size + 1))


def _phase(axes: Axes, run: RecordedRun) -> None:
    times = run.seconds([motion.stamp_ns for motion in run.motions])
    axes.plot(times, [motion.phase for motion in run.motions], color=BLUE, lw=LINE_WIDTH, label="phase")
    ood_score = [min(motion.out_of_distribution, 2.0) for motion in run.motions]
    axes.plot(times, ood_score, color=ORANGE, lw=LINE_WIDTH, label="out of distribution (above 1: unknown)")
    axes.axhline(1.0, color=GREY, lw=0.8)
    axes.set_ylim(0.0, 2.05)
    axes.set_title("phase of the interaction, and how strange the motion is", loc="left", fontsize=10, color=INK)
    axes.set_xlabel("time since the first skeleton [s]")
    axes.legend(frameon=False, fontsize=8, loc="upper right")


def _age(axes: Axes, report: Report) -> None:
    """Age of the newest skeleton behind each response and each command at the command's arrival [ms]."""
    axes.set_title("age of what a command is based on, when it arrives", loc="left", fontsize=10, color=INK)
    for ages, colour, label in (
        (report.answer_ages_ms, BLUE, "first command after a skeleton"),
        (report.command_ages_ms, ORANGE, "every command"),
    ):
        if len(ages):
            ordered = np.sort(ages)
            share = np.arange(1, len(ordered) + 1) / len(ordered)
            axes.plot(ordered, share, color=colour, lw=2.0, label=f"{label}: median {np.median(ages):.1f} ms")
    axes.set_ylim(0.0, 1.02)
    axes.set_xlabel("age [ms]")
    axes.set_ylabel("share of commands")
    if len(report.command_ages_ms):
        axes.set_xlim(0.0, 1.05 * float(np.percentile(report.command_ages_ms, 99.5)))
        axes.legend(frameon=False, fontsize=8, loc="lower right")


def _clean(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#e6e8eb", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
