# SPDX-License-Identifier: Apache-2.0
"""A description is first loaded in a child process: PyBullet dies of some, and that must not end a node.

The child has a bounded memory and time. That PyBullet refuses a description is no death: it says why itself, later. A
description that was loaded once, meshes included, is not tried again; our own are known.
"""

from __future__ import annotations

import hashlib
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.rigid_bodies import rigid_bodies
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import read_description
from mild_core.retargeting.robots import ROBOTS
from mild_ros.assembly.description import temporary
from mild_ros.assembly.private import private_folder

MEMORY_BYTES, PROCESSOR_S, PATIENCE_S = 4_000_000_000, 30, 60.0
"""What a child may use. A large humanoid with meshes takes 0.5 GB and 3 s."""


def survivable(robot: RobotModel, others: Collection[str] = ()) -> Path:
    """A description of what moves of a robot, that PyBullet survives; see `rigid_bodies`.

    Raises:
        SetupError: It does not survive it, for the meshes that the robot's own description names.
    """
    path = temporary(rigid_bodies(robot, others))
    if all(robot.urdf_path != known.urdf_path for known in ROBOTS.values()):
        try_load(path, robot.source)
    return path


def try_window() -> None:
    """Make sure that PyBullet opens a window: where it cannot, it ends the process.

    Raises:
        SetupError: It does not.
    """
    done = _child("window")
    if done is None or done.returncode:
        display = os.environ.get("DISPLAY", "")
        there = f"the display '{display}' (DISPLAY) cannot be used" if display else "there is no display (DISPLAY)"
        raise SetupError("parameter gui", f"PyBullet opens no window: {there}", "run without gui, or on a desktop")


def try_load(path: Path, source: str) -> None:
    """Make sure that PyBullet survives the description at `path`, which `read_description` has examined.

    Args:
        path: Of the description, its meshes found.
        source: The description as messages name it.

    Raises:
        SetupError: It does not.
    """
    marks = private_folder() / "survived"
    marks.mkdir(mode=0o700, exist_ok=True)
    mark = marks / f"pybullet-{_digest(path)}"
    if mark.exists():
        return
    done = _child(str(path.resolve()))
    if done is None:
        raise SetupError(source, "PyBullet does not finish loading it", "simplify its meshes and shapes")
    if done.returncode == 0:
        mark.touch()
        return
    with suppress(ValueError):
        how = f"dies of it ({signal.Signals(-done.returncode).name})"
        raise SetupError(source, f"PyBullet {how}", "give a description that it can load")
    last = (done.stderr.decode(errors="replace").strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    raise SetupError(source, f"PyBullet cannot survive it ({last})", "give a description that it can load")


def _child(given: str) -> subprocess.CompletedProcess[bytes] | None:
    """What became of a child; None if it had to be ended."""
    command = [sys.executable, "-P", "-m", "mild_ros.simulation.trial_load", given]
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))}
    try:
        return subprocess.run(
            command, env=environment, cwd=tempfile.gettempdir(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL, timeout=PATIENCE_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None


def _digest(path: Path) -> str:
    """Of the description and of which meshes it names, by size and time of change."""
    described = read_description(path)
    digest = hashlib.sha256(path.read_bytes())
    for mesh in described.iter("mesh"):
        file = path.parent / mesh.get("filename", "").removeprefix("file://")
        with suppress(OSError, ValueError):
            found = file.stat()
            digest.update(f"{file} {found.st_size} {found.st_mtime_ns}".encode(errors="replace"))
    return digest.hexdigest()


def load(path: str) -> None:
    """Load it in this process, or open a window for "window"."""
    from mild_ros.simulation.bullet import load_pybullet

    bullet = load_pybullet()
    client = bullet.connect(bullet.GUI if path == "window" else bullet.DIRECT)
    if path == "window":
        if client < 0:
            raise SystemExit(1)
        return
    body = bullet.loadURDF(path, useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    for number in range(bullet.getNumJoints(body, physicsClientId=client)):
        bullet.getJointInfo(body, number, physicsClientId=client)
    for _ in range(10):
        bullet.stepSimulation(physicsClientId=client)
    bullet.disconnect(client)


def main() -> int:
    """The child: 0 if it lives, whatever the library says of the description."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_S, PROCESSOR_S))
    try:
        load(sys.argv[1])
    except MemoryError:
        print(f"it needs more than {MEMORY_BYTES / 1e9:g} GB", file=sys.stderr)
        return 1
    except Exception as error:  # what it does not like it says again when it is really loaded
        print(f"refused: {error}", file=sys.stderr)
    sys.stderr.flush()
    os._exit(0)  # libraries may die while they are taken down; that happens to a node at its end only


if __name__ == "__main__":
    raise SystemExit(main())
