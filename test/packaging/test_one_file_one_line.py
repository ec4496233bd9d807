# SPDX-License-Identifier: Apache-2.0
"""A source, a prior, a robot, a data set, a baseline and an output more: one file and a line of its table each."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from test.habits.tree import ROOT, files

FAMILIES = {
    "mild_core/perception/skeletons": ("pose_array", "*(TF, HRI, ZED, YOLO)", "*(TF, HRI, ZED, YOLO, COUSIN)"),
    "mild_core/inference/priors": ("hsmm", '"hsmm": HSMM}', '"hsmm": HSMM, "cousin": COUSIN}'),
    "mild_core/retargeting/robots": ("yumi", '{"pepper": PEPPER', '{"cousin": COUSIN, "pepper": PEPPER'),
    "mild_core/learning/datasets": ("nuisi", "(BUETEPAGE_HR,", "(COUSIN, BUETEPAGE_HR,"),
    "mild_core/learning/baselines": ("action_mean", "ACTION_MEAN),", "ACTION_MEAN, COUSIN),"),
    "mild_ros/controllers": ("position_command", "JOINT_ANGLES)", "JOINT_ANGLES, COUSIN)"),
}
"""Of each family: the member whose file is imitated, and the line of the table, before and after."""

WALKS = (
    *("test/habits/test_tables.py", "test/habits/test_layers.py", "test/habits/test_documents.py"),
    *("test/core/perception/test_skeletons.py", "test/core/inference/test_priors.py", "test/core/test_yumi.py"),
    *("test/core/learning/test_baselines.py", "test/command_line/test_data.py", "test/ros/test_command_topics.py"),
    *("test/ros/test_controllers.py", "test/ros/test_message_layouts.py", "test/packaging/test_layouts.py"),
)
"""Tests that go through the tables."""


def add_a_cousin(root: Path, folder: str, member: str, line: str, longer: str) -> None:
    """Write one file, which is the member's under another name, and the line of the table."""
    text = (root / folder / f"{member}.py").read_text()
    for named in (member, member.upper()):
        text = re.sub(rf"\b{named}\b(?! import)", "cousin" if named.islower() else "COUSIN", text)
    text = text.replace(f"class {member.upper()}(", "class COUSIN(").replace('message="cousin"', f'message="{member}"')
    text = text.replace('with_name("yumi.urdf")', 'with_name("cousin.urdf")').replace(
        'file="cousin/', f'file="{member}/'
    )
    (root / folder / "cousin.py").write_text(text)
    if (urdf := root / folder / f"{member}.urdf").exists():
        shutil.copy(urdf, urdf.with_name("cousin.urdf"))
    table = root / folder / "__init__.py"
    before = table.read_text()
    assert before.count(line) == 1
    module = folder.replace("/", ".")
    first = before.index("from mild_")
    imported = f"from {module}.cousin import COUSIN\n"
    table.write_text(before[:first] + imported + before[first:].replace(line, longer))


@pytest.mark.heavy
@pytest.mark.timeout(600)
def test_all_that_must_know_of_a_new_member_derives_it_from_its_table(tmp_path: Path) -> None:
    for path in files(ROOT):
        (copy := tmp_path / path.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copy)
    for folder, (member, line, longer) in FAMILIES.items():
        add_a_cousin(tmp_path, folder, member, line, longer)
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    documents = [str(path.relative_to(tmp_path)) for path in tmp_path.glob("docs/*.md")]
    for words in (["-m", "tools.documentation", *documents], ["-m", "pytest", *WALKS, "-m", "not talks"]):
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
    assert "cousin" in (tmp_path / "docs" / "trackers.md").read_text()
    assert "cousin" in (tmp_path / "docs" / "reference.md").read_text()
