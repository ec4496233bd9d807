# SPDX-License-Identifier: Apache-2.0
"""Compiled functions work where nothing can be written, and are never taken from machine code of other sources."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import mild_core

PACKAGE = Path(mild_core.__file__).parent

PROGRAM = """
import numpy as np
from mild_core.compiled import _cache_folder
from mild_core.inference.priors.filtering import factorise
print(round(float(factorise(np.array([[4.0, 2.0], [2.0, 5.0]]), 2, np.empty(2))), 6), _cache_folder(), sep="|")
"""


def run(path: Path, **environment: str) -> list[str]:
    """What the program prints: the factor's log-determinant and where machine code is kept."""
    variables = os.environ | {"PYTHONPATH": str(path)} | environment
    variables.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        env=variables,
        capture_output=True,
        text=True,
        cwd=path,
        timeout=200,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip().split("|")


def copied(tmp_path: Path) -> Path:
    (tmp_path / "mild_core").mkdir()
    for name in ("__init__.py", "shapes.py", "errors.py", "signals.py", "compiled.py"):
        shutil.copy(PACKAGE / name, tmp_path / "mild_core" / name)
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(PACKAGE / "inference", tmp_path / "mild_core" / "inference", ignore=ignored)
    return tmp_path


def test_a_change_in_any_compiled_file_is_recompiled(tmp_path):
    path = copied(tmp_path)
    value, folder = run(path, NUMBA_CACHE_DIR="")
    # det [[4, 2], [2, 5]] = 16, and the factor's is its root.
    assert value == "1.386294"
    assert Path(folder).is_relative_to(path)
    assert list(Path(folder).rglob("*.nbi"))
    edited = path / "mild_core" / "inference" / "networks.py"
    edited.write_text(edited.read_text() + "\n# changed\n")
    _, other = run(path, NUMBA_CACHE_DIR="")
    assert other != folder
    untouched = path / "mild_core" / "inference" / "recognition.py"
    untouched.write_text(untouched.read_text() + "\n# changed\n")
    assert run(path, NUMBA_CACHE_DIR="")[1] == other


def test_where_nothing_can_be_written_it_still_computes(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("no folder can be made below a file")
    value, folder = run(copied(tmp_path), NUMBA_CACHE_DIR=str(blocked / "cache"))
    assert (value, folder) == ("1.386294", "None")
