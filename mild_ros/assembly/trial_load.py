# SPDX-License-Identifier: Apache-2.0
"""A description is first loaded in a child process: native libraries die of some, and that must not end a node.

The child has a bounded memory and time. That a library refuses a description is no death: it says why itself, later. A
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
from contextlib import suppress
from pathlib import Path

from mild_core.errors import SetupError
from mild_core.retargeting.robots import ROBOTS
from mild_core.retargeting.urdf import read_description
from mild_ros.assembly.private import private_folder

MEMORY_BYTES, PROCESSOR_S, PATIENCE_S = 4_000_000_000, 30, 60.0
"""What a child may use. A large humanoid with meshes takes 0.5 GB and 3 s."""

LIBRARIES = ("pinocchio", "pybullet")


def try_load(path: Path, library: str) -> None:
    """Make sure that a library survives the description at `path`, which `read_description` has examined.

    Args:
        path: Of the description, its meshes found.
        library: One of `LIBRARIES`.

    Raises:
        SetupError: It does not.
    """
    if any(path == robot.urdf_path for robot in ROBOTS.values()):
        return
    marks = private_folder() / "survived"
    marks.mkdir(mode=0o700, exist_ok=True)
    mark = marks / f"{library}-{_digest(path)}"
    if mark.exists():
        return
    command = [sys.executable, "-P", "-m", "mild_ros.assembly.trial_load", library, str(path.resolve())]
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))}
    try:
        done = subprocess.run(
            command, env=environment, cwd=tempfile.gettempdir(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL, timeout=PATIENCE_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise SetupError(str(path), f"{library} does not finish loading it", "simplify its meshes and shapes") from None
    if done.returncode == 0:
        mark.touch()
        return
    with suppress(ValueError):
        how = f"dies of it ({signal.Signals(-done.returncode).name})"
        raise SetupError(str(path), f"{library} {how}", "give a description that it can load")
    last = (done.stderr.decode(errors="replace").strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    raise SetupError(str(path), f"{library} cannot survive it ({last})", "give a description that it can load")


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


def load(library: str, path: Path) -> None:
    """Load it, in this process."""
    if library == "pinocchio":
        import pinocchio

        pinocchio.buildModelFromUrdf(str(path))
        return
    from mild_ros.simulation.bullet import load_pybullet

    bullet = load_pybullet()
    client = bullet.connect(bullet.DIRECT)
    body = bullet.loadURDF(
        str(path), useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
    )
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
        load(sys.argv[1], Path(sys.argv[2]))
    except MemoryError:
        print(f"it needs more than {MEMORY_BYTES / 1e9:g} GB", file=sys.stderr)
        return 1
    except Exception as error:  # what it does not like it says again when it is really loaded
        print(f"refused: {error}", file=sys.stderr)
    sys.stderr.flush()
    os._exit(0)  # libraries may die while they are taken down; that happens to a node at its end only


if __name__ == "__main__":
    raise SystemExit(main())
