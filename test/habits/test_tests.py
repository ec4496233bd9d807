# SPDX-License-Identifier: Apache-2.0
"""The tests themselves: each asserts something, none waits a fixed time."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from test.habits.tree import ROOT, called, functions, parse, plant, python_files

CHECKS = ("assert_", "check_", "require_", "_assert", "_check")
"""What a function starts with that asserts on behalf of a test."""


def silent_tests(root: Path) -> list[str]:
    """Tests that cannot fail but by accident."""
    found = []
    for path in python_files(root, "test"):
        defined = functions(parse(path))
        asserting: set[str] = set()
        while new := {function.name for function in defined if _asserts(function, asserting)} - asserting:
            asserting |= new
        silent = [test for test in defined if test.name.startswith("test_") and test.name not in asserting]
        found += [f"{path.relative_to(root)}:{test.lineno} {test.name}" for test in silent]
    return found


def _asserts(function: ast.AST, asserting: set[str]) -> bool:
    """Whether `function` has an assertion, or calls one of those `asserting` beside it."""
    for node in ast.walk(function):
        if isinstance(node, ast.Assert) and not isinstance(node.test, ast.Constant):
            return True
        if isinstance(node, ast.Call):
            name = called(node)
            if name in ("pytest.raises", "pytest.warns", "pytest.fail") or name in asserting:
                return True
            if name.split(".")[-1].startswith(CHECKS):
                return True
    return False


def fixed_waits(root: Path) -> list[str]:
    """Sleeps outside a loop: too short on a slow machine, a waste on a quick one. Poll with a deadline instead."""
    found = []
    for path in python_files(root, "test"):
        tree = parse(path)
        loops = [node for node in ast.walk(tree) if isinstance(node, ast.While | ast.For)]
        polled = {id(node) for loop in loops for node in ast.walk(loop)}
        sleeps = [
            node for node in ast.walk(tree) if isinstance(node, ast.Call) and called(node) in ("time.sleep", "sleep")
        ]
        found += [f"{path.relative_to(root)}:{node.lineno}" for node in sleeps if id(node) not in polled]
    return found


@pytest.mark.parametrize(
    "body", ["pass", "f()", "assert True", "try:\n        f()\n    except ValueError:\n        pass", "print(f())"]
)
def test_a_silent_test_is_rejected(tmp_path: Path, body: str) -> None:
    plant(tmp_path, "test/test_a.py", f"def test_a():\n    {body}\n")
    assert len(silent_tests(tmp_path)) == 1


@pytest.mark.parametrize(
    "body", ["assert f()", "with pytest.raises(ValueError):\n        f()", "assert_allclose(a, b)"]
)
def test_a_test_that_asserts_passes(tmp_path: Path, body: str) -> None:
    plant(tmp_path, "test/test_a.py", f"def test_a():\n    {body}\n")
    assert silent_tests(tmp_path) == []


def test_a_test_may_assert_through_a_function_beside_it(tmp_path: Path) -> None:
    plant(
        tmp_path,
        "test/test_a.py",
        "def refused():\n    assert x\n\ndef deep():\n    refused()\n\ndef test_a():\n    deep()\n",
    )
    assert silent_tests(tmp_path) == []


def test_a_fixed_wait_is_rejected(tmp_path: Path) -> None:
    plant(tmp_path, "test/test_a.py", "import time\ntime.sleep(1)\nwhile True:\n    time.sleep(0.01)\n")
    assert fixed_waits(tmp_path) == ["test/test_a.py:2"]


def test_every_test_asserts() -> None:
    assert silent_tests(ROOT) == []


def test_no_test_waits_a_fixed_time() -> None:
    assert fixed_waits(ROOT) == []
