# SPDX-License-Identifier: Apache-2.0
"""The linters of `./mild check`, and that they do reject: a linter that is misconfigured finds nothing either."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from test.habits.tree import ROOT, plant

LINTERS = {
    "lint": ["ruff", "check", "."],
    "format": ["ruff", "format", "--check", "."],
    "types": ["mypy"],
}
PLANTED = {
    "lint": "import os\n",
    "format": "x = { 1:2 }\n",
    "types": "def double(x):\n    return x * 2\n",
}

PACKAGES = ("mild_core", "mild_ros")


def _run(name: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", *LINTERS[name]]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", LINTERS)
def test_the_tree_passes(name: str) -> None:
    result = _run(name, ROOT)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", LINTERS)
def test_a_planted_violation_is_rejected(tmp_path: Path, name: str) -> None:
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    header = '# SPDX-License-Identifier: Apache-2.0\n"""Planted."""\n\n'
    for package in PACKAGES:
        plant(tmp_path, f"{package}/__init__.py", header.rstrip() + "\n")
        plant(tmp_path, f"{package}/planted.py", header.rstrip() + "\n")
    assert _run(name, tmp_path).returncode == 0
    for package in PACKAGES:
        plant(tmp_path, f"{package}/planted.py", header + PLANTED[name])
        assert _run(name, tmp_path).returncode == 1
        plant(tmp_path, f"{package}/planted.py", header.rstrip() + "\n")
