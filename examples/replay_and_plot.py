# SPDX-License-Identifier: Apache-2.0
"""Replay a bag (first argument) without DDS and plot the commands into a picture (second argument)."""

import sys
from pathlib import Path

from matplotlib.figure import Figure

from mild_core.retargeting.robot_file import find_robot
from mild_ros.assembly.inference import load
from mild_ros.assembly.perception import skeleton_source
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.bag.camera import with_camera
from mild_ros.bag.reader import open_bag
from mild_ros.replay.in_process import Inputs, fold


def main(bag: Path, picture: Path) -> None:
    """Plot the commanded joints [rad] and the probability of the recognised interaction over time."""
    parameters = with_camera(PipelineParameters(), bag)
    pipeline = make_pipeline(parameters, load(parameters.model))
    inputs = Inputs(skeleton_source(parameters), find_robot(parameters.robot))
    with open_bag(bag) as opened:
        steps = list(fold(opened, pipeline, inputs))
    start_ns = steps[0].event.time_ns
    commands = [command for step in steps for command in step.output.commands]
    motions = [motion for step in steps for motion in step.output.motions]
    figure = Figure()
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot([(c.stamp_ns - start_ns) * 1e-9 for c in commands], [c.positions_rad for c in commands])
    below.plot([(m.stamp_ns - start_ns) * 1e-9 for m in motions], [m.probability for m in motions])
    above.set_ylabel("commanded [rad]")
    below.set(ylabel="probability", xlabel="time [s]")
    figure.savefig(picture)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
