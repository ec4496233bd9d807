# SPDX-License-Identifier: Apache-2.0
"""All is compiled before the first message: a compilation while the robot moves would stop its commands."""

import subprocess
import sys

import pytest

from mild_core.retargeting.robots.pepper import PEPPER
from mild_core.retargeting.robots.yumi import YUMI
from test.conftest import ROOT
from tools.scenes import MODELS

SCRIPT = """
import gc, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.robots import ROBOTS
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.bag.camera import with_camera
from mild_ros.replay.in_process import Inputs, replay_in_process
from mild_ros.assembly.settings import PipelineParameters

def compiled():
    return {one.py_func.__qualname__: len(one.signatures) for one in gc.get_objects() if isinstance(one, Dispatcher)}

robot, model, bags = sys.argv[1], sys.argv[2], sys.argv[3:]
for bag in map(Path, bags):
    pipeline = make_pipeline(with_camera(PipelineParameters(model=model, robot=robot), bag), load(model))
    before = compiled()
    summary = replay_in_process(bag, pipeline, Inputs(SOURCES["azure_kinect"], ROBOTS[robot]))
    assert summary.commands > 500, summary
    for name, count in compiled().items():
        if count != before.get(name, 0):
            print(bag.name, name)
"""


@pytest.mark.parametrize(("robot", "bags"), [(YUMI.name, ("handshake", "hand_wave")), (PEPPER.name, ("handshake",))])
def test_nothing_is_compiled_while_the_robot_moves(robot: str, bags: tuple[str, ...]) -> None:
    words = [robot, MODELS[robot], *(str(ROOT / "bags" / bag) for bag in bags)]
    done = subprocess.run([sys.executable, "-P", "-c", SCRIPT, *words], capture_output=True, text=True, timeout=240)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
