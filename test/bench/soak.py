# SPDX-License-Identifier: Apache-2.0
"""A soak: random people and interactions, one after the other, and random faults of their tracker and of the robot.

`./mild measure soak --minutes 30` lets the time of the pipeline run as fast as it can; with `--real-minutes 10`
the real nodes suffer random faults in real time, over DDS. Both report what broke a limit and how the memory has grown.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mild_core.pipeline import Pipeline, PipelineState
from mild_core.retargeting.robots import ROBOTS
from mild_core.signals import JointMeasurement, SkeletonFrame
from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.simulation.person import ArmLengths, bodies, skeleton_frames, with_neutral_second
from test.faults import people
from test.faults.judge import Command, problems
from test.faults.table import FAULTS, Fault
from tools.scenes import RATE_HZ, SCENES, arm_track

ROBOT = ROBOTS["yumi"]
START_NS, TICK_NS, REPORT_NS = 1_700_000_000_000_000_000, 10_000_000, 20_000_000
NO_FAULT = Fault("none", "All is well.", ())
POSSIBLE = tuple(fault for fault in FAULTS.values() if not fault.processes and fault.rate_hz <= 100.0)
"""Faults that a pipeline without processes can suffer; a flood only costs time."""

PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass
class Soaked:
    """What became of a soak.

    Attributes:
        acts: Interactions that were played.
        followed: Those in which the robot followed for a second at least.
        faults: How often each fault happened.
        commands: How many were judged.
        broken: Every limit that was broken, with the act; empty when all were kept.
        grown_mb: What the memory grew by after the first fifth, in which all that is used for the first time is.
        cpu_s: What it took.
    """

    acts: int = 0
    followed: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    commands: int = 0
    broken: list[str] = field(default_factory=list)
    grown_mb: float = 0.0
    cpu_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Act:
    """One person who comes, interacts and goes; and a fault at some time of it."""

    frames: tuple[SkeletonFrame, ...]
    fault: Fault
    begins_ns: int

    @staticmethod
    def any(rng: np.random.Generator, start_ns: int, person_id: int) -> Act:
        """Of an adult of any size who stands near the usual place; in two of three acts something goes wrong."""
        scene = SCENES[rng.integers(len(SCENES))]
        lengths = ArmLengths(*(np.array([0.29, 0.335]) * rng.uniform(0.9, 1.1)))
        track = with_neutral_second(arm_track(scene), RATE_HZ, rng.uniform(0.5, 1.5))
        body = bodies(track, lengths) + rng.normal(0.0, 0.03, 3) + rng.normal(0.0, 0.003, (len(track), 32, 3))
        frames = tuple(skeleton_frames(body, RATE_HZ, start_ns, person_id=person_id))
        wrong = rng.random() < 2 / 3
        fault = POSSIBLE[rng.integers(len(POSSIBLE))] if wrong else NO_FAULT
        return Act(frames, fault, start_ns + round(rng.uniform(1.0, len(track) / RATE_HZ - 2.0) * 1e9))

    def suffers(self, now_ns: int) -> float | None:
        """For how long [s] all has been wrong; None when it is not."""
        since_s = (now_ns - self.begins_ns) * 1e-9
        return since_s if 0.0 <= since_s < self.fault.lasts_s else None

    def messages(self, now_ns: int) -> Iterator[people.People]:
        """What the tracker says from one tick to the next."""
        place = round((now_ns - self.frames[0].stamp_ns) * 1e-9 * RATE_HZ)
        if place >= len(self.frames) or not 0 <= self.frames[place].stamp_ns - now_ns < TICK_NS:
            return
        since_s = self.suffers(now_ns)
        if since_s is None:
            yield (self.frames[place],)
        elif place % round(RATE_HZ / self.fault.rate_hz) == 0:
            yield from self.fault.tracker(self.frames[place], since_s)


def _memory_mb() -> float:
    """Resident memory of this process."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES / 1e6


def soaked(pipeline: Pipeline, seconds: float, seed: int) -> Soaked:
    """Let acts follow each other for so many seconds of simulated time."""
    rng, result, started_s = np.random.default_rng(seed), Soaked(), time.process_time()
    home = JointMeasurement(START_NS, ROBOT.joint_names, ROBOT.home_rad)
    state, _ = pipeline.step(pipeline.init(), home, START_NS)
    last: list[Command] = []
    now_ns, memory_mb = START_NS, None
    while (now_ns - START_NS) * 1e-9 < seconds:
        if memory_mb is None and (now_ns - START_NS) * 1e-9 > seconds / 5:
            memory_mb = _memory_mb()
        act = Act.any(rng, now_ns, result.acts)
        state, heard, followed_s = _played(pipeline, state, act)
        broken = problems(ROBOT, [*last, *heard])
        result.broken += [f"act {result.acts} ({act.fault.name}): {what}" for what in broken]
        result.acts += 1
        result.followed += followed_s > 1.0
        result.faults[act.fault.name] += 1
        result.commands += len(heard)
        now_ns, last = act.frames[-1].stamp_ns + TICK_NS, heard[-3:]
        now_ns += -(now_ns - START_NS) % TICK_NS
    result.grown_mb = _memory_mb() - (memory_mb or 0.0)
    result.cpu_s = time.process_time() - started_s
    return result


def _played(pipeline: Pipeline, state: PipelineState, act: Act) -> tuple[PipelineState, list[Command], float]:
    """The state after an act, the commands in it, and for how long the robot followed."""
    heard: list[Command] = []
    followed_s, first = 0.0, None
    begin_ns = act.frames[0].stamp_ns
    for now_ns in range(begin_ns, act.frames[-1].stamp_ns + TICK_NS, TICK_NS):
        since_s = act.suffers(now_ns)
        if heard and (now_ns - begin_ns) % REPORT_NS == 0:
            said = JointMeasurement(now_ns, ROBOT.joint_names, np.array(heard[-1].positions_rad))
            first = said if since_s is None or first is None else first
            reported = said if since_s is None else act.fault.robot(said, first, since_s)
            if reported is not None:
                state, _ = pipeline.step(state, replace(reported, stamp_ns=now_ns), now_ns)
        given = [*act.messages(now_ns), None]
        for each in given:
            state, output = pipeline.step(state, each, now_ns)
            for command in output.commands:
                followed_s += (command.mode == "following") * TICK_NS * 1e-9
                spoken = (tuple(command.positions_rad.tolist()), tuple(command.velocities_rad_s.tolist()))
                heard.append(Command(command.stamp_ns, *spoken))
    return state, heard, followed_s


def _really_soaked(minutes: float, seed: int) -> int:
    """Random faults happen to real nodes in real time; what was wrong is printed, its number is returned."""
    from mild_ros.environment.processes import private_domain
    from test.faults.trial import running_room, tried

    rng, wrong, end_s = np.random.default_rng(seed), 0, time.monotonic() + 60.0 * minutes
    with private_domain() as domain, running_room(True, Path(tempfile.mkdtemp()), domain) as room:
        memory: dict[str, list[float]] = {}
        while time.monotonic() < end_s:
            fault = list(FAULTS.values())[rng.integers(len(FAULTS))]
            if fault.clock_s:
                continue
            outcome = tried(room, fault)
            wrong += len(outcome.broken)
            for name, size_mb in _memory_of_children():
                memory.setdefault(name, []).append(size_mb)
            print(f"{fault.name}: {outcome.commands} commands, " + ("; ".join(outcome.wrong) or "survived"), flush=True)
    for name, sizes in sorted(memory.items()):
        print(f"{name}: {sizes[len(sizes) // 5]:.1f} MB after a fifth, {sizes[-1]:.1f} MB at the end")
    return wrong


def _memory_of_children() -> Iterator[tuple[str, float]]:
    """Name and resident memory [MB] of every process that this one has started."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == os.getpid():
                pages = int((folder / "statm").read_text().split()[1])
                yield f"{folder.name} {(folder / 'comm').read_text().strip()}", pages * PAGE_BYTES / 1e6
        except OSError:  # it ended meanwhile
            continue


def main() -> int:
    """Soak, and say what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0, help="of simulated time")
    parser.add_argument("--real-minutes", type=float, default=0.0, help="of real time, in real processes")
    parser.add_argument("--seed", type=int, default=7)
    given = parser.parse_args()
    wrong = 0
    if given.minutes > 0.0:
        result = soaked(
            make_pipeline(PipelineParameters(), load(PipelineParameters().model)), 60.0 * given.minutes, given.seed
        )
        print(f"{given.minutes:g} minutes, {result.acts} interactions, followed in {result.followed}")
        print(f"{sum(result.faults.values()) - result.faults['none']} faults: {dict(result.faults.most_common())}")
        print(f"{result.commands} commands, {len(result.broken)} limits broken: {result.broken[:5]}")
        print(f"memory grew by {result.grown_mb:.1f} MB; {result.cpu_s:.0f} s of CPU")
        wrong += len(result.broken)
    if given.real_minutes > 0.0:
        wrong += _really_soaked(given.real_minutes, given.seed)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
