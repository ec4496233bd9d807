# SPDX-License-Identifier: Apache-2.0
"""Families: one file per member, one plain table per family, and the two agree."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

from test.habits.tree import ROOT, imports, parse, plant

FAMILIES = {
    "mild_core/perception/skeletons": "SOURCES",
    "mild_core/inference/priors": "PRIORS",
    "mild_core/retargeting/robots": "ROBOTS",
    "mild_core/learning/datasets": "DATASETS",
    "mild_core/learning/baselines": "BASELINES",
    "mild_ros/controllers": "OUTPUTS",
}


def violations(root: Path, folder: str, table: str) -> list[str]:
    """What keeps `table` in the package `folder` from being the whole truth about the files there.

    A file counts as known when the table's file imports it, a known file does (a contract that members share), or
    its name begins with a member's (`yumi_description.py` makes the URDF of `yumi.py`).
    """
    package = root / folder
    names = _names_in(package / "__init__.py", table)
    if names is None:
        return [f"{folder}: __init__.py has no table {table}"]
    prefix = folder.replace("/", ".")
    taken = {item.module for item in imports(root, package / "__init__.py")}
    found = [
        f"{folder}: {table} holds {name}, which comes from no file of the folder"
        for name in sorted(names)
        if not any(module.startswith(prefix + ".") and module.split(".")[-1] == name for module in taken)
    ]
    modules = {path.stem for path in package.glob("*.py")} - {"__init__"}
    members = {module.split(".")[-2] for module in taken if module.split(".")[-1] in names} & modules
    members_own = {stem for stem in modules if any(stem.startswith(member + "_") for member in members)}
    known, new = members | members_own, members | members_own
    while new:
        reached = {item.module for stem in new for item in imports(root, package / f"{stem}.py")}
        new = {stem for stem in modules - known if any(_is_in(module, f"{prefix}.{stem}") for module in reached)}
        known |= new
    found += [f"{folder}/{stem}.py: not in {table}, and no member needs it" for stem in sorted(modules - known)]
    if table == "ROBOTS":
        found += [
            f"{folder}/{stem}.urdf: missing" for stem in sorted(members) if not (package / f"{stem}.urdf").exists()
        ]
    return found


def _is_in(module: str, prefix: str) -> bool:
    return module == prefix or module.startswith(prefix + ".")


def _names_in(path: Path, table: str) -> set[str] | None:
    """The names in upper or mixed case that the expression of `table` mentions; None when there is no such table."""
    for node in parse(path).body if path.exists() else []:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        if any(isinstance(target, ast.Name) and target.id == table for target in targets):
            value = getattr(node, "value", None)
            names = {part.id for part in ast.walk(value) if isinstance(part, ast.Name)} if value is not None else set()
            return {name for name in names if name[0].isupper()}
    return None


def _plant_family(root: Path) -> None:
    plant(root, "robots/__init__.py", 'from robots.yumi import YUMI\n\nROBOTS = {"yumi": YUMI}\n')
    plant(root, "robots/yumi.py", "from robots.contract import Robot\n\nYUMI = Robot()\n")
    plant(root, "robots/contract.py", "class Robot: ...\n")
    plant(root, "robots/yumi.urdf", "<robot/>")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("robots/pepper.py", "from robots.contract import Robot\n\nPEPPER = Robot()\n"),
        ("robots/__init__.py", "from robots.yumi import YUMI\n"),
        (
            "robots/__init__.py",
            'from robots.yumi import YUMI\nfrom attic import OLD\n\nROBOTS = {"y": YUMI, "o": OLD}\n',
        ),
        ("robots/__init__.py", 'from robots.contract import Robot\n\nROBOTS = {"contract": Robot}\n'),
    ],
    ids=["a file without a line", "no table", "a line without a file", "a robot without a description"],
)
def test_a_planted_violation_is_rejected(tmp_path: Path, name: str, text: str) -> None:
    _plant_family(tmp_path)
    assert violations(tmp_path, "robots", "ROBOTS") == []
    plant(tmp_path, name, text)
    assert violations(tmp_path, "robots", "ROBOTS")


@pytest.mark.parametrize(("folder", "table"), FAMILIES.items(), ids=FAMILIES.values())
def test_table_and_folder_agree(folder: str, table: str) -> None:
    assert violations(ROOT, folder, table) == []


@pytest.mark.parametrize(("folder", "table"), FAMILIES.items(), ids=FAMILIES.values())
def test_each_key_is_the_name_of_its_member(folder: str, table: str) -> None:
    members = getattr(importlib.import_module(folder.replace("/", ".")), table)
    assert members
    for key, member in members.items():
        assert getattr(member, "name", key) == key


def _tables(path: Path) -> set[str]:
    """The names in capitals that a file binds to a dict."""
    assigned = [node for node in parse(path).body if isinstance(node, ast.Assign | ast.AnnAssign)]
    found = set()
    for node in assigned:
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        named = isinstance(target, ast.Name) and target.id.isupper() and not target.id.startswith("_")
        if named and isinstance(node.value, ast.Dict | ast.DictComp):
            found.add(target.id)
    return found


def test_a_new_table_is_seen(tmp_path: Path) -> None:
    assert _tables(
        plant(tmp_path, "__init__.py", 'from a import A\n\nTABLE: dict[str, A] = {"a": A}\nB = {1: 2}\nC = 1\n')
    ) == {
        "TABLE",
        "B",
    }


def test_every_family_is_known_here() -> None:
    """A package with a table is a family, and then the gates above have to know it."""
    inits = [path for top in ("mild_core", "mild_ros") for path in (ROOT / top).rglob("__init__.py")]
    tables = {(path.parent.relative_to(ROOT).as_posix(), table) for path in inits for table in _tables(path)}
    assert tables == set(FAMILIES.items())
