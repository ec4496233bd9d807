# SPDX-License-Identifier: Apache-2.0
"""`mild measure` lists the benches, hands on their options and exit code, and says when there are none."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from mild_core.errors import SetupError
from mild_ros.command_line.main import main
from mild_ros.command_line.measure import benches, duration
from test.bench import BENCHES
from test.habits.tree import ROOT, plant

THERE = {path.stem for path in (ROOT / "test/bench").glob("[a-z]*.py")} - {"braking", "warm_tests"}


def run(*arguments: str) -> int | str:
    """Exit code of `mild measure arguments`."""
    with pytest.raises(SystemExit) as ended:
        main(["measure", *arguments])
    return ended.value.code or 0


@pytest.fixture
def planted(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """A bench in the place of `soak` that ends with exit code 3; what it was called with."""
    called: list[list[str]] = []

    def bench() -> int:
        called.append(sys.argv)
        return 3

    monkeypatch.setitem(sys.modules, "test.bench.soak", SimpleNamespace(main=bench))
    monkeypatch.setattr(sys, "argv", ["mild"])
    return called


@pytest.mark.parametrize("arguments", [(), ("--help",)])
def test_every_bench_is_listed_with_its_sentence_and_duration(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    assert run(*arguments) == 0
    shown = capsys.readouterr().out.splitlines()
    for name, bench in BENCHES.items():
        line = next(line for line in shown if bench.summary in line)
        assert f" {name} " in line
        assert duration(bench.minutes) in line


def test_the_table_and_the_folder_agree() -> None:
    assert set(BENCHES) - {"people"} == THERE - {"people"}


@pytest.mark.parametrize("name", sorted(set(BENCHES) & THERE))
def test_every_bench_says_how_it_is_called(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(name, "--help") == 0
    assert capsys.readouterr().out.startswith(f"usage: mild measure {name} ")


def test_options_go_to_the_bench_and_its_exit_code_comes_back(planted: list[list[str]]) -> None:
    assert run("soak", "--minutes", "0.1", "--help") == 3
    assert planted == [["mild measure soak", "--minutes", "0.1", "--help"]]


def test_an_unknown_bench_is_one_line_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("contcat") == 2
    assert "'contcat' is unknown; did you mean 'contact'?" in (said := capsys.readouterr().err)
    assert said.count("\n") == 1


def test_an_installed_package_has_none_and_says_so(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="tests are not installed: run `"):
        benches(tmp_path)


def test_the_benches_are_those_of_the_checkout_wherever_one_stands(tmp_path: Path) -> None:
    plant(tmp_path, "test/__init__.py", "raise SystemExit('imported from the current folder')")
    command = [sys.executable, "-m", "mild_ros.command_line.main", "measure"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "step_latency" in done.stdout
