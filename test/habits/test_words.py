# SPDX-License-Identifier: Apache-2.0
"""Plain words: none of those that hide what is meant, and no class name for two classes."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

from test.habits.tree import ROOT, files, parse, plant, python_files

INSTEAD = {
    "told": "given, reported, commanded",
    "tells": "shows, reports, classifies",
    "nobody": "no person, unknown",
    "somebody": "a person, another node",
    "anybody": "a person, untrusted",
    "whoever": "name the person or the process",
    "whomever": "name the person or the process",
    "anew": "again, reset, re-",
    "afresh": "reset",
    "fate": "outcome",
    "fates": "outcomes",
    "begun": "started",
    "ReadyMember": "CompiledMember",
    "late comers": "latched",
    "how old": "age, latency",
}
"""Words that no source, document or message uses, and what to write."""

WORD = re.compile(
    r"(?<![A-Za-z])(?:" + "|".join(word.replace(" ", r"\s+") for word in INSTEAD) + r")(?![A-Za-z])", re.IGNORECASE
)
TEXTS = {".py", ".md", ".toml", ".yaml", ".yml", ".xml", ".cfg", ".rviz", ".urdf", ".sh", ""}
OF_ITS_TIME = ("models", "LICENSE")
"""Shipped models keep the text that they were trained and digested with."""


def hidden_meanings(root: Path) -> list[str]:
    """Words of `INSTEAD`, alone or as a part of a name. A renamed name stands in quotes in the list of changes."""
    found = []
    for path in files(root):
        name = path.relative_to(root)
        if path.suffix not in TEXTS or name.parts[0] in OF_ITS_TIME or path.name == Path(__file__).name:
            continue
        text = path.read_text(errors="replace")
        if name.name == "CHANGELOG.md":
            text = re.sub(r"`[^`]*`", lambda quoted: re.sub(r"\S", "-", quoted.group()), text)
        for match in WORD.finditer(text):
            word = " ".join(match.group().lower().split())
            instead = next(better for banned, better in INSTEAD.items() if banned.lower() == word)
            found.append(f"{name}:{text.count(chr(10), 0, match.start()) + 1} {word}: {instead}")
    return found


def names_of_two(root: Path) -> list[str]:
    """Names of several public classes of the packages."""
    places = defaultdict(list)
    for path in python_files(root, "mild_core", "mild_ros"):
        for node in ast.walk(parse(path)):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(path.relative_to(root)))
    return [f"{name}: {', '.join(where)}" for name, where in sorted(places.items()) if len(where) > 1]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.py", '"""What it is told."""'),
        ("a.py", "def make_told(): ..."),
        ("a.py", "Fates = 1"),
        ("docs/a.md", "Nobody is there."),
        ("docs/a.md", "It is kept for late\ncomers."),
        ("CHANGELOG.md", "`told` is gone, and begun too."),
        ("mild", "echo Whoever"),
        ("a.toml", "# starts anew"),
    ],
)
def test_a_planted_word_is_found(tmp_path: Path, name: str, text: str) -> None:
    plant(tmp_path, name, text)
    assert len(hidden_meanings(tmp_path)) == 1


def test_plain_words_pass(tmp_path: Path) -> None:
    plant(tmp_path, "a.py", '"""The given interaction; a fateful stream.tell() of newcomers."""')
    plant(tmp_path, "CHANGELOG.md", "`nobody` is `no_person`.")
    plant(tmp_path, "models/a/REPORT.md", "told")
    assert hidden_meanings(tmp_path) == []


def test_two_classes_of_one_name_are_found(tmp_path: Path) -> None:
    plant(tmp_path, "mild_core/a.py", "class Chain: ...\nclass _Part: ...")
    plant(tmp_path, "mild_ros/b.py", "class Chain: ...\nclass _Part: ...")
    assert names_of_two(tmp_path) == ["Chain: mild_core/a.py, mild_ros/b.py"]


def test_the_tree_uses_plain_words() -> None:
    assert hidden_meanings(ROOT) == []


def test_each_class_name_of_the_tree_names_one_class() -> None:
    assert names_of_two(ROOT) == []
