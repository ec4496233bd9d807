# SPDX-License-Identifier: Apache-2.0
"""Every fault that `./mild measure mutations` plants fits the code, and the bench notices what it should."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from mild_core.errors import SetupError
from test.bench import mutations
from test.bench.mutations import Copy, Outcome, Results, chosen, key, noticed_by, remember, report, run
from test.bench.warm_tests import importers
from test.habits.tree import ROOT, functions, parse, plant
from test.mutations import FAULTS
from test.mutations.fault import Fault, faulty

AREAS = {
    *("mild_core/perception", "mild_core/inference", "mild_core/inference/priors", "mild_core/learning/training"),
    *("mild_core/retargeting", "mild_ros/bag", "mild_ros/messages"),
}


def missing_tests(fault: Fault, root: Path) -> list[str]:
    """Tests of a fault that there are not."""
    found = []
    for name in fault.tests:
        path, *nodes = name.split("::")
        there = root / path
        if not there.exists() or (nodes and nodes[-1].split("[")[0] not in {f.name for f in functions(parse(there))}):
            found.append(name)
    return found


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_fault_fits_the_code_and_has_tests(fault: Fault) -> None:
    faulty(fault, ROOT)
    assert missing_tests(fault, ROOT) == []
    assert fault.tests
    assert re.fullmatch(r"[A-Z].*\.", fault.breaks), "one sentence"


def test_there_are_faults_of_every_area_each_with_a_name_of_its_own() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) >= 60
    assert {str(Path(fault.file).parent) for fault in FAULTS} >= AREAS


CODE = '"""Words."""\n\n\ndef double(x: int) -> int:\n    """Two times two is four."""\n    return 2 * x  # two\n'
TEST = "from mild_core.a import double\n\n\ndef test_double():\n    assert double({}) == {}\n"
GOOD, BLIND = (
    Fault("three", "It triples.", "mild_core/a.py", "2 * x", "3 * x", ("test/test_a.py",)),
    ("test/test_b.py",),
)


@pytest.mark.parametrize(
    "changes",
    [
        {"old": "4 * x"},
        {"old": "x"},
        {"old": "wo"},
        {"old": "Words", "new": "Deeds"},
        {"old": "# two", "new": "# three"},
        {"old": "return", "new": "retrun x"},
        {"file": "mild_core/b.py"},
    ],
)
def test_a_fault_that_does_not_fit_is_rejected(tmp_path: Path, changes: dict[str, str]) -> None:
    plant(tmp_path, "mild_core/a.py", CODE)
    with pytest.raises(ValueError, match="three"):
        faulty(GOOD._replace(**changes), tmp_path)
    assert faulty(GOOD, tmp_path) == CODE.replace("2 * x", "3 * x")


@pytest.fixture(name="tree")
def _tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small checkout: a function, a test that knows what it does and one that does not."""
    monkeypatch.setattr(mutations, "LIBRARIES", ())  # none of its tests imports them
    tree = tmp_path / "tree"
    for name in ("mild_core/__init__.py", "mild_ros/__init__.py", "test/__init__.py"):
        plant(tree, name, "")
    plant(tree, "mild_core/a.py", CODE)
    plant(tree, "test/test_a.py", TEST.format(2, 4))
    plant(tree, "test/test_b.py", TEST.format(0, 0))
    plant(tree, "pyproject.toml", '[tool.pytest.ini_options]\nmarkers = ["slow", "talks", "heavy"]\n')
    return tree


def test_what_the_tests_notice_is_killed_and_what_they_do_not_survives(
    tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hangs = Fault("endless", "It never ends.", "mild_core/a.py", "return 2 * x", "return double(x) * 2", BLIND)
    faults = (GOOD, GOOD._replace(name="blind", tests=BLIND), hangs)
    outcomes = run(faults, 2, tmp_path / "work", tree)
    assert [one.verdict for one in outcomes] == ["killed", "survived", "killed"]
    assert "SURVIVED blind (mild_core/a.py): It triples." in report(faults, outcomes)
    assert (tree / "mild_core/a.py").read_text() == CODE
    assert (tmp_path / "work/copy-0/tree/mild_core/a.py").read_text() == CODE
    capsys.readouterr()
    assert run(faults, 2, tmp_path / "work", tree) == outcomes
    assert capsys.readouterr().out == "3 of 3 are known from before\n"


def test_what_hangs_is_noticed_and_its_processes_end(tree: Path, tmp_path: Path) -> None:
    stands = GOOD._replace(new="__import__('time').sleep(60)")
    with Copy(tree, tmp_path / "work") as copy:
        assert copy.judge(stands, 3.0).verdict == "hangs"


def test_tests_that_are_not_there_are_an_error_and_no_survivor(tree: Path, tmp_path: Path) -> None:
    plant(tree, "test/test_c.py", "x = 1\n")
    with Copy(tree, tmp_path / "work") as copy:
        assert copy.judge(GOOD._replace(tests=("test/test_c.py",))).verdict == "error"


def test_tests_that_fail_without_a_fault_end_it_in_one_line(tree: Path, tmp_path: Path) -> None:
    plant(tree, "test/test_a.py", TEST.format(2, 5))
    with pytest.raises(SetupError, match="do not pass"):
        run((GOOD,), 1, tmp_path / "work", tree)


def test_the_test_that_noticed_a_fault_runs_first_and_alone_and_the_others_where_it_does_not(
    tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mutations, "FAULTS", (GOOD,))
    with Copy(tree, tmp_path / "work") as copy:
        found = copy.judge(GOOD)
        assert (found.verdict, found.test) == ("killed", "test/test_a.py::test_double")
        plant(tree, "test/mutations/__init__.py", "")
        remember([found, Outcome("gone", "killed", 1.0, "", "test/test_a.py::test_gone")], tree)
        assert noticed_by(tree) == {"three": "test/test_a.py::test_double"}
        assert copy.judge(GOOD._replace(tests=BLIND), first=noticed_by(tree)["three"]).verdict == "killed"
        for stale in ("test/test_b.py::test_double", "test/test_a.py::test_gone", "test/test_z.py"):
            assert copy.judge(GOOD, first=stale).verdict == "killed"


def test_machine_code_is_kept_but_for_what_a_fault_concerns(tmp_path: Path) -> None:
    for name, text in {
        "a": "x = 1",
        "b": "from mild_core.a import x",
        "c": "from mild_core import b",
        "d": "from mild_core.aa import x",
    }.items():
        plant(tmp_path, f"mild_core/{name}.py", text)
    assert importers("mild_core/a.py", tmp_path) == {"mild_core.a", "mild_core.b", "mild_core.c"}


def test_every_test_that_noticed_a_fault_is_of_one_that_there_is() -> None:
    assert noticed_by(ROOT).keys() <= {fault.name for fault in FAULTS}


def test_an_outcome_counts_until_the_fault_the_file_or_a_test_beside_it_changes(tree: Path) -> None:
    seen = {key(GOOD, tree), key(GOOD._replace(breaks="It does."), tree)}
    for name in ("mild_core/a.py", "test/test_a.py", "test/test_b.py"):
        path = tree / name
        path.write_text(path.read_text() + "\n# changed\n")
        seen.add(key(GOOD, tree))
    assert len(seen) == 5


def test_a_broken_outcome_is_none(tmp_path: Path) -> None:
    results, outcome = Results(tmp_path), Outcome("a", "killed", 1.0, "")
    results.put("x", outcome)
    assert results.get("x") == outcome
    for text in ("", "{}", json.dumps({"fault": "a"})):
        (tmp_path / "x.json").write_text(text)
        assert results.get("x") is None


def test_two_at_once_do_not_share_their_copies(tmp_path: Path) -> None:
    with mutations.alone(tmp_path), pytest.raises(SetupError, match="another one runs"), mutations.alone(tmp_path):
        pass


def test_parts_are_areas_files_or_faults_and_an_unknown_one_is_refused_in_one_line() -> None:
    assert chosen(()) == list(FAULTS)
    assert chosen(("shell",)) == list(mutations.AREAS["shell"])
    assert {fault.file for fault in chosen(("mild_ros/bag/types",))} == {"mild_ros/bag/types.py"}
    assert chosen((FAULTS[0].name,)) == [FAULTS[0]]
    with pytest.raises(SetupError, match=r"'shel'.*did you mean 'shell'.*perception, inference") as refused:
        chosen(("shel",))
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300  # not all names of hundreds of faults
