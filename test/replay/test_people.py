# SPDX-License-Identifier: Apache-2.0
"""What is promised of the robot near people, in scenes that an independent judge measures."""

from __future__ import annotations

from pathlib import Path

import pytest

from test.bench.people import main, run_one, verdicts

FEW = ("bystander_staying", "turned_away", "handshake")


@pytest.mark.parametrize("name", FEW)
def test_the_promises_are_kept(name: str) -> None:
    judged = verdicts([run_one((name, 1))])
    assert {each.promise for each in judged} >= {"distance", "speed", "towards", "limits"}
    assert [f"{each.promise}: {each.figure}" for each in judged if not each.kept] == []


@pytest.mark.heavy
def test_the_promises_are_kept_in_every_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["--count", "2", "--json", str(tmp_path / "people.json")])
    assert [line for line in capsys.readouterr().out.splitlines() if line.startswith("broken:")] == []
    assert code == 0
