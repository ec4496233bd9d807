# SPDX-License-Identifier: Apache-2.0
"""Encounters by seed, in as many processes as there are cores; each knows nothing of the others."""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from mild_core.inference.manifest import AUTO
from mild_core.pipeline import Pipeline
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.robot import make_robot
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.benchmark.encounters import FLOOR_M, Encounter, Stage, draw
from mild_ros.benchmark.reachable import Judge
from mild_ros.benchmark.run import Trace, camera_for, meet
from mild_ros.benchmark.summary import Judgement, judge
from mild_ros.node_kit.parameters import from_values
from mild_ros.simulation.bullet import BulletRobot

SAME = {"wave": ("hand_wave", "waving", "wave")}
"""What models call what people do, where that has another name."""


@dataclass(frozen=True)
class EncounterJob:
    """One encounter.

    Attributes:
        robot: A name of this package's robots, or the path of a robot file.
        model: A name or the path of a folder.
        given: Whether the robot knows the interaction.
        seed: Of the encounter.
    """

    robot: str
    model: str
    given: bool
    seed: int


@lru_cache(maxsize=2)
def _robot(name: str) -> tuple[RobotModel, Judge]:
    robot = make_robot(name, "")
    return robot, Judge(robot)


@lru_cache(maxsize=16)
def _pipeline(robot: str, model: str, interaction: str, side: str) -> Pipeline:
    given = {"model": model, "robot": robot, "interaction": interaction, "side": side}
    parameters = from_values(PipelineParameters, {**given, "robot_from_camera": "0 0 0 0 0 0"})
    return make_pipeline(parameters, load(model))


def stage_for(name: str) -> Stage:
    """Where a robot's arm is, for people to stand before it.

    Raises:
        SetupError: There is no such robot, or its file is wrong.
    """
    robot, measured = _robot(name)
    floor_m = FLOOR_M if robot.floor_m is None else robot.floor_m
    home_m = math.dist(measured.tool_m(robot.home_rad)[:2], measured.shoulder_m[:2])
    return Stage(measured.shoulder_m, measured.reach_m, floor_m, home_m)


def play(job: EncounterJob) -> tuple[Encounter, Trace]:
    """Let the encounter of a job happen.

    Raises:
        SetupError: Robot or model are unknown, or do not fit.
    """
    robot, measured = _robot(job.robot)
    encounter = draw(job.seed, stage_for(job.robot))
    interaction = AUTO
    if job.given and encounter.interaction:
        known = load(job.model).manifest.interactions
        names = SAME.get(encounter.interaction, (encounter.interaction, f"hand_{encounter.interaction[4:]}"))
        interaction = next((name for name in names if name in known), AUTO)
    pipeline = _pipeline(job.robot, job.model, interaction, encounter.side)
    camera = camera_for(encounter, measured.shoulder_m)
    camera[:3, 3] += encounter.tracking.camera_off_m
    perception = pipeline.perception
    perception = replace(perception, settings=replace(perception.settings, robot_from_source=camera))
    with BulletRobot(robot) as simulated:
        return encounter, meet(encounter, replace(pipeline, perception=perception), simulated, measured)


def run_job(job: EncounterJob) -> Judgement:
    """What came of the encounter of a job."""
    logging.disable(logging.WARNING)
    encounter, trace = play(job)
    _, measured = _robot(job.robot)
    reachable = None
    if encounter.offers:
        person = encounter.performed(encounter.timeline)
        place = np.array(encounter.place_m)
        reachable = measured.reaches(place, person, encounter.timeline.offered_s, job.seed)
    return judge(encounter, trace, reachable, job.given)


def run_jobs(jobs: Sequence[EncounterJob], workers: int = 0) -> Iterator[Judgement]:
    """Results as they come, in any order.

    Args:
        jobs: What to do.
        workers: Processes; 0 for one per core that this process may use.
    """
    workers = min(workers or len(os.sched_getaffinity(0)), max(len(jobs), 1))
    if workers == 1:
        yield from map(run_job, jobs)
        return
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"))
    unfinished = True
    try:
        for future in as_completed([pool.submit(run_job, job) for job in jobs]):
            yield future.result()
        unfinished = False
    finally:
        if unfinished:
            for worker in multiprocessing.active_children():
                worker.terminate()
        pool.shutdown(cancel_futures=True)
