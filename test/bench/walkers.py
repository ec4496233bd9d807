# SPDX-License-Identifier: Apache-2.0
"""How many of the people who walk through a greeting at random are touched, by the judge of the people bench.

    python -m test.bench.walkers [--first 0] [--count 48] [--fast] [--json FILE]

Three of four walk before YuMi, the fourth before Pepper: from the left, from the right, or from the front up to the
arm, at 0.2 to 1.2 m/s, while another person greets the robot. With `--fast` all walk before YuMi, from either side, at
0.7 to 1.2 m/s, while hands are about to meet or do: what the look ahead is chosen on.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mild_ros.benchmark.bodies import Person, path
from test.bench.around_people.judge import Judgement, judge
from test.bench.around_people.run import Expectation, Setting, play
from test.bench.around_people.scenes import PEPPER, PEPPER_SHOULDER_M, at_work, bystander, gesture, standing

SIDES = ("left", "right", "front")


def walker(seed: int, fast: bool) -> tuple[str, float, Setting]:
    """Where one comes from, how fast [m/s], and the scene."""
    rng = np.random.default_rng([seed, 77])
    before_pepper = seed % 4 == 3 and not fast
    side = SIDES[seed % 2] if fast else SIDES[seed % 3]
    speed = float(rng.uniform(0.2, 1.2))
    if fast:
        speed = 0.6 + 0.5 * speed
    if before_pepper:
        arm, _ = gesture("handshake", rng)
        sizes, root = standing(rng, PEPPER_SHOULDER_M, rng.uniform(1.2, 1.4), near_m=0.08)
        floor = PEPPER_SHOULDER_M[2] - sizes.length(0.818)
        person = Person(sizes, root, right=arm, floor_m=floor, offers="right")
        x, stature, given = float(rng.uniform(0.3, 0.45)), 1.2, {"floor_m": -0.82}
    else:
        person, _ = at_work(rng)
        x, stature, given = float(rng.uniform(0.38, 0.62)), None, {}
    start = float(rng.uniform(3.8, 5.5) if fast else rng.uniform(3.0, 4.5))
    if side == "front":
        y = float(rng.uniform(-0.5, -0.2))
        stop = float(rng.uniform(0.25, 0.35) if before_pepper else rng.uniform(0.3, 0.5))
        here, there = (x + 1.3, y - 0.5), (stop, y)
    else:
        sign = 1.0 if side == "right" else -1.0
        here, there = (x, -1.4 * sign), (x, 1.4 * sign)
    yaw = math.atan2(there[1] - here[1], there[0] - here[0])
    takes_s = math.dist(here, there) / speed
    other = bystander(rng, *here, yaw, stature, **given)
    other = replace(other, root=path((start, (*here, yaw)), (start + takes_s, (*there, yaw)), straight=True))
    parameters = PEPPER if before_pepper else {}
    return side, speed, Setting((person, other), start + takes_s + 1.5, Expectation(0.0), parameters=parameters)


def least_m(judged: Judgement, *parts: str) -> float:
    """Least distance of these parts of the walker [m]; 0.3 where none was nearer."""
    each = (judged.clearance_m.get(f"bystander {part}", 0.3) for part in parts)
    return min(each, default=0.3)


def main(argv: Sequence[str] | None = None) -> int:
    """Print each, and how many were touched."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--first", type=int, default=0, help="first seed (0)")
    parser.add_argument("--count", type=int, default=48, help="how many (48)")
    parser.add_argument("--fast", action="store_true", help="0.7 to 1.2 m/s, from the sides, when hands meet")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every one here")
    given = parser.parse_args(argv)
    found = []
    for seed in range(given.first, given.first + given.count):
        side, speed, setting = walker(seed, given.fast)
        judged = judge(setting, play(setting, seed))
        nearest, body = least_m(judged, "head", "trunk", "limbs"), least_m(judged, "head", "trunk")
        watched = min((value for kind, value in judged.clearance_m.items() if "watched" in kind), default=0.3)
        found.append({"seed": seed, "robot": setting.robot, "side": side, "speed_m_s": speed, "nearest_m": nearest})
        found[-1] |= {"body_m": body, "watched_m": watched, "limits": judged.limits}
        distances = f"{100 * nearest:6.1f} cm, head or trunk {100 * body:6.1f}, watched {100 * watched:5.1f}"
        print(f"{seed:4d} {setting.robot:7} {side:6}{speed:.2f} m/s {distances} {judged.limits or ''}", flush=True)
        if given.json is not None:
            given.json.write_text(json.dumps(found, indent=1) + "\n")
    touched = sum(float(one["nearest_m"]) < 0.0 for one in found)
    bodies = sum(float(one["body_m"]) < 0.0 for one in found)
    print(f"{len(found)} walkers, {touched} touched, {bodies} of these at head or trunk")
    return int(any(one["limits"] for one in found))


if __name__ == "__main__":
    sys.exit(main())
