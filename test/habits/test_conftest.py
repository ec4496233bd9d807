# SPDX-License-Identifier: Apache-2.0
"""The promises of `test/conftest.py`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
LEAVES_A_PROCESS = """
import subprocess, sys
GRANDCHILD = [sys.executable, "-c", "import time; print('runs', flush=True); time.sleep(60)"]
CHILD = f"import subprocess; subprocess.Popen({GRANDCHILD!r})"
def test_leaves_a_process():
    # Waits for the grandchild's word: while the kernel replaces one program by another, /proc shows neither.
    child = subprocess.Popen([sys.executable, "-c", CHILD], stdout=subprocess.PIPE, start_new_session=True)
    assert child.stdout.readline() == b"runs\\n"
    assert child.wait() == 0
"""


def test_each_session_has_a_domain_of_its_own(ros_domain: int) -> None:
    assert os.environ["ROS_DOMAIN_ID"] == str(ros_domain)
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert 1 <= ros_domain <= 101


@pytest.mark.slow
def test_a_process_left_behind_fails_the_test_that_left_it(tmp_path: Path) -> None:
    """The canary of the check: an orphaned grandchild is found, named and ended."""
    (tmp_path / "conftest.py").write_text((ROOT / "test" / "conftest.py").read_text())
    (tmp_path / "test_planted.py").write_text(LEAVES_A_PROCESS)
    arguments = ["-m", "pytest", "-c", "/dev/null", "--rootdir", str(tmp_path), "-p", "no:cacheprovider", str(tmp_path)]
    result = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    assert result.returncode == 1, result.stdout
    assert "still running" in result.stdout
    assert "time.sleep(60)" in result.stdout
