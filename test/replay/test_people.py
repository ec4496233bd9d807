# SPDX-License-Identifier: Apache-2.0
"""What is promised of the robot near people, in scenes that an independent judge measures."""

from __future__ import annotations

from pathlib import Path

import pytest

from test.bench.around_people.scenes import SCENES
from test.bench.people import main, run_one, verdicts

FEW = ("bystander_staying", "turned_away", "handshake")
HELD = ("distance", "speed", "contact", "limits")
"""What holds in every scene; docs/safety.md says what does not."""


@pytest.mark.parametrize("name", FEW)
def test_the_promises_are_kept(name: str) -> None:
    judged = verdicts([run_one((name, 1))])
    assert {each.promise for each in judged} >= {"distance", "speed", "towards", "limits"}
    assert [f"{each.promise}: {each.figure}" for each in judged if not each.kept and each.promise in HELD] == []


@pytest.mark.heavy
def test_the_promises_are_kept_in_every_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["--count", "1", "--json", str(tmp_path / "people.json")])
    lines = capsys.readouterr().out.splitlines()
    broken = [line for line in lines if line.startswith("broken: ") and line.split(": ")[2] in HELD]
    assert broken == []
    assert lines[-1].startswith(f"{len(SCENES)} runs")
