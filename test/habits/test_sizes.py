# SPDX-License-Identifier: Apache-2.0
"""Modules, functions and nodes stay small enough to read in one sitting."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from test.habits.tree import ROOT, functions, parse, plant, python_files

MODULE, FUNCTION, NODE = 300, 40, 120


def violations(root: Path) -> list[str]:
    """Every file and function that is too long. A function's docstring does not count: it is never too long."""
    found = []
    for path in python_files(root):
        name = path.relative_to(root).as_posix()
        lines = len(path.read_text().splitlines())
        limit = NODE if name.startswith("mild_ros/") and name.endswith("_node.py") else MODULE
        if lines > limit:
            found.append(f"{name}: {lines} lines, at most {limit}")
        for function in functions(parse(path)):
            if (length := _length(function)) > FUNCTION:
                found.append(f"{name}:{function.lineno} {function.name}: {length} lines, at most {FUNCTION}")
    return found


def _length(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    first = function.body[0]
    is_documented = isinstance(first, ast.Expr) and ast.get_docstring(function) is not None
    docstring = (first.end_lineno or 0) - first.lineno + 1 if is_documented else 0
    return (function.end_lineno or 0) - function.lineno + 1 - docstring


def _function(lines: int) -> str:
    return "def f():\n" + "    x = 0\n" * (lines - 1)


@pytest.mark.parametrize(
    ("name", "at_the_limit", "beyond"),
    [
        ("mild_core/a.py", "x = 0\n" * 300, "x = 0\n" * 301),
        ("mild_core/a.py", _function(40), _function(41)),
        ("mild_core/a.py", "class A:\n    async " + _function(40).replace("\n", "\n    ").rstrip() + "\n", None),
        ("mild_ros/a_node.py", "x = 0\n" * 120, "x = 0\n" * 121),
        ("mild_ros/node.py", "x = 0\n" * 300, "x = 0\n" * 301),
        ("mild_core/a.py", 'def f():\n    """' + "word\n" * 100 + '"""\n' + "    x = 0\n" * 39, None),
        ("test/a.py", _function(40), _function(41)),
    ],
)
def test_a_planted_violation_is_rejected(tmp_path: Path, name: str, at_the_limit: str, beyond: str | None) -> None:
    plant(tmp_path, name, at_the_limit)
    assert violations(tmp_path) == []
    if beyond is not None:
        plant(tmp_path, name, beyond)
        assert len(violations(tmp_path)) == 1


def test_the_tree_is_small() -> None:
    assert violations(ROOT) == []
