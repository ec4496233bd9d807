# SPDX-License-Identifier: Apache-2.0
"""A fault as data, and how it is put into a source file."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import NamedTuple


class Fault(NamedTuple):
    """One change of one file that the quick tests of its area have to notice.

    Attributes:
        name: Short and unique.
        breaks: What is wrong with it, in one sentence.
        file: Of the checkout.
        old: Text that stands exactly once in the file.
        new: What takes its place.
        tests: Files or folders of tests, or single ones (`file::test`), of its area.
    """

    name: str
    breaks: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]


INTERPRETED = frozenset(
    {
        "test/core/inference/test_networks.py",
        "test/core/inference/test_small_sums.py",
        "test/core/learning/test_corpus.py",
        "test/core/perception/test_bodies_in_view.py",
        "test/core/retargeting/test_geometry.py",
        "test/core/retargeting/test_guard_geometry.py",
        "test/core/retargeting/test_obstacles.py",
        "test/core/retargeting/test_yielding.py",
    }
)
"""Tests that take seconds without numba's compiler too; by them faults of compiled functions are judged uncompiled."""


def faulty(fault: Fault, root: Path) -> str:
    """The text of the file with the fault in it.

    Raises:
        ValueError: The fault does not fit the code any more, or changes nothing that runs.
    """
    path = root / fault.file
    text = path.read_text() if path.is_file() else ""
    if (count := text.count(fault.old)) != 1:
        raise ValueError(f"{fault.name}: its old text stands {count} times in {fault.file}; carry the fault along")
    planted = text.replace(fault.old, fault.new)
    try:
        same = _code(planted) == _code(text)
    except SyntaxError as error:
        raise ValueError(f"{fault.name}: {fault.file} is no Python with it: {error}") from None
    if same:
        raise ValueError(f"{fault.name}: only comments or docstrings of {fault.file} change")
    return planted


def _code(text: str) -> str:
    """What runs: the syntax tree without docstrings."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [one for one in body if not _is_docstring(one)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
