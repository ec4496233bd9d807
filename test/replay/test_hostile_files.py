# SPDX-License-Identifier: Apache-2.0
"""Hostile files are refused in one line, within limits of memory, disk and time that the system enforces."""

from __future__ import annotations

import json
import shlex
import subprocess
import time
from collections.abc import Iterable
from pathlib import Path

import pytest

from mild_core.errors import BagError
from mild_core.yaml_budget import check_yaml
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.bag.budgets import OverBudgetError, TimeBudget, unbz2, unlz4, unzstd
from mild_ros.bag.reader import open_bag
from mild_ros.environment.processes import PYTHON
from mild_ros.node_kit.parameter_files import read_parameters
from test.bench import hostile_files
from test.bench.hostile_files import BAGS, OTHERS, START_NS, aliases, made
from test.faults.broken_bags import opened, write_ours
from test.habits.tree import ROOT

MEMORY_BYTES, FILE_BYTES, SECONDS = 1 << 30, 1 << 30, 60
"""What a process that opens a hostile bag may take beyond what it has when it starts to."""

EVENTS = ("a message a year after the others", "a message every 9 minutes")
"""What only a replay falls for; reading them is no harm."""

SALVAGED = {
    "mcap, a chunk that announces 2 GB": "",
    "mcap, an index that lists a chunk of 200 MB 10,000 times": "",
    "mcap, qualities of service nested 100,000 deep": "",
    "`metadata.yaml` whose aliases stand for 10^12 values": "",
    "`metadata.yaml` nested 100,000 deep": "",
    "`metadata.yaml` of 50 MB": "",
    "sqlite3, a view of endless definitions": "",
    "sqlite3, a tree of 10 pages with 60^10 rows": "",  # each number is read once
}
"""Of which --salvage never reads what is hostile, so it may read the rest."""

WORDS = {
    "zstd per file": "unpacks to more than 400 MB",
    "zstd per message": "holds a block of zstd",
    "40 chunks": "overlap in time",
    "eight million": "more than 2000000 messages",
    "defined in 4 MB": "defines its messages",
    "500 million": "defines visualization_msgs/msg/MarkerArray with",
    "qualities": "nested deeper",
    "12 values": "each use of an alias",
    "definitions": "not authorized",
    "60^10": "interrupted",
    "bzip2": "holds a block of bzip2",
}
"""By which budget; several would end with some other failure, a while later."""

OPEN = """
import json, resource, sys, tempfile
from pathlib import Path
sys.path.insert(0, str(Path.cwd()))
from test.faults.broken_bags import opened
file, salvage, memory, size, seconds = sys.argv[1:]
page = resource.getpagesize()
have = int(Path("/proc/self/statm").read_text().split()[0]) * page
resource.setrlimit(resource.RLIMIT_AS, (have + int(memory),) * 2)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(size),) * 2)
resource.setrlimit(resource.RLIMIT_CPU, (int(seconds),) * 2)
found = opened(Path(file), salvage=salvage == "True")
line = "" if found.error is None else str(found.error)
print(json.dumps([found.read, found.undecodable, line]))
"""


def read_within_limits(file: Path, salvage: bool) -> tuple[int, int, str]:
    """Read everything in a process with limits: messages, those of them that do not decode, and the line at the end."""
    limits = (str(file), str(salvage), str(MEMORY_BYTES), str(FILE_BYTES), str(SECONDS))
    done = subprocess.run(
        [*PYTHON, "-c", OPEN, *limits], cwd=ROOT, capture_output=True, text=True, check=False, timeout=4 * SECONDS
    )
    assert done.returncode == 0, f"code {done.returncode}: {done.stderr[-2000:]}"
    read, undecodable, line = json.loads(done.stdout)
    return read, undecodable, line


@pytest.mark.parametrize("salvage", [False, True], ids=["plain", "salvage"])
@pytest.mark.parametrize("name", [name for name in BAGS if name not in EVENTS])
def test_a_hostile_bag_is_refused_within_its_limits(name: str, salvage: bool, tmp_path: Path) -> None:
    file = made(name, tmp_path)
    read, undecodable, line = read_within_limits(file, salvage)
    assert "\n" not in line
    if name == "messages of 10 MB of small parts":
        assert (read, undecodable, line) == (2, 2, "")
    elif not (salvage and name in SALVAGED):
        assert line.startswith(str(file.parent)), "refused, and by name"
        assert read <= 2, "what stands before the hostile part is read"
        assert salvage or all(words in line for key, words in WORDS.items() if key in name)


def test_what_leads_out_is_refused_in_the_same_words_with_and_without_salvage(tmp_path: Path) -> None:
    for index, name in enumerate(name for name in BAGS if "pipe" in name or "socket" in name or "link" in name):
        (tmp_path / str(index)).mkdir()
        file = made(name, tmp_path / str(index))
        lines = {str(opened(file, salvage=salvage).error) for salvage in (False, True)}
        assert len(lines) == 1, lines
        line = lines.pop()
        kinds = ("is a named pipe", "is a socket", "is a device", "is a link out of the bag, to /")
        assert any(words in line for words in kinds)


def test_links_within_the_bag_and_to_the_bag_are_followed(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    write_ours(bag)
    (bag / "bag.mcap").rename(bag / "0a1b")
    (bag / "bag.mcap").symlink_to("0a1b")
    (tmp_path / "link").symlink_to("bag")
    (tmp_path / "file.mcap").symlink_to("bag/0a1b")
    for path in (bag, tmp_path / "link", tmp_path / "file.mcap"):
        for salvage in (False, True):
            found = opened(path, salvage=salvage)
            assert (found.read, found.error) == (24, None), path


def test_a_bag_of_links_says_how_to_open_it_and_that_works(tmp_path: Path) -> None:
    """As caches and data set managers lay out files."""
    bag = tmp_path / "my bag"
    write_ours(tmp_path / "bag")
    (tmp_path / "bag").rename(bag)
    (bag / "bag.mcap").rename(tmp_path / "0a1b")
    (bag / "bag.mcap").symlink_to("../0a1b")
    words = r"bag\.mcap: is a link out of the bag, to .*/0a1b; if you trust it: cp -rL .*/my bag' COPY"
    for salvage in (False, True):
        with pytest.raises(BagError, match=words) as refused, open_bag(bag, salvage=salvage):
            pass
    followed = str(refused.value).partition("if you trust it: ")[2]
    subprocess.run(shlex.split(followed), check=True, cwd=tmp_path)
    assert opened(tmp_path / "COPY", salvage=False).read == 24
    (tmp_path / "0a1b").unlink()
    for salvage in (False, True):
        with pytest.raises(BagError, match="restore what it leads to"), open_bag(bag, salvage=salvage):
            pass


@pytest.mark.slow
def test_a_replay_does_not_wait_for_ever(tmp_path: Path) -> None:
    outcome = hostile_files.opened(EVENTS[0], tmp_path / "run")
    assert (outcome.code, outcome.lines) == (2, 1), outcome
    assert "has no message for 365 days after its first 2" in outcome.line
    assert "a replay lasts at most 10 min and 10 s for each message" in outcome.line


def test_honest_pauses_pass() -> None:
    times = [index * 3.3e7 for index in range(1000)]
    times += [times[-1] + 9e12, *(times[-1] + 9e12 + index * 3.3e7 for index in range(1000)), 0.0, 1e9]
    assert lived_through(map(round, times)) == len(times)


def lived_through(times_ns: Iterable[int]) -> int:
    """How many times were reached within the budget."""
    budget, reached = TimeBudget(), 0
    for time_ns in times_ns:
        budget.reach(time_ns)
        reached += 1
    return reached


def test_endless_pauses_do_not_pass() -> None:
    with pytest.raises(OverBudgetError, match="has no message for 365 days after its first 2"):
        lived_through((0, 1, 365 * 24 * 3600 * 10**9))
    with pytest.raises(OverBudgetError, match=r"has no message for 0\.1 hours"):  # time that begins again and again
        lived_through(START_NS + index % 2 * 500 * 10**9 for index in range(10_000))
    with pytest.raises(OverBudgetError, match="has no message for 2 days"):
        lived_through([*range(100_000), 48 * 3600 * 10**9 + 10**6])


@pytest.mark.parametrize("unpack", [unzstd, unlz4, unbz2])
def test_unpackers_give_all_or_say_why_not(unpack) -> None:
    import bz2

    import lz4.frame
    import zstandard

    pack = {unzstd: zstandard.ZstdCompressor().compress, unlz4: lz4.frame.compress, unbz2: bz2.compress}[unpack]
    content = bytes(range(256)) * 1000
    assert unpack(pack(content)) == content
    assert unpack(pack(b"")) == b""
    if unpack is not unlz4:
        assert unpack(pack(content) * 2) == content * 2
    with pytest.raises(ValueError, match="cut off"):
        unpack(pack(content)[:-10])
    with pytest.raises(ValueError, match="longer than announced"):
        unpack(pack(content), len(content) - 1)


def test_yaml_counts_each_use_of_an_alias() -> None:
    check_yaml("a: &a [1, 2]\nb: [*a, *a]\n")
    check_yaml("{ this is no yaml")
    for text in (aliases(), "a: &a [*a]", "[" * 100 + "]" * 100, "a: &a " + "x" * 400_000 + "\n" + "b: [*a]\n" * 2000):
        begin = time.monotonic()
        with pytest.raises(ValueError, match="YAML"):
            check_yaml(text)
        assert time.monotonic() - begin < 5


@pytest.mark.parametrize("name", [name for name in OTHERS if name.startswith("parameter file")])
def test_a_hostile_parameter_file_is_one_line(name: str, tmp_path: Path) -> None:
    with pytest.raises(Exception, match="is no YAML") as caught:
        read_parameters(PipelineParameters, "pipeline", str(made(name, tmp_path)))
    assert "\n" not in str(caught.value)


def test_the_document_lists_every_hostile_file() -> None:
    lines = (ROOT / "docs" / "bags.md").read_text().splitlines()
    listed = [line.split("|")[1].strip() for line in lines if line.startswith("|")]
    assert [name for name in (*BAGS, *OTHERS) if name not in listed] == []


def test_the_table_of_the_document_is_rewritten_and_nothing_else() -> None:
    document = (ROOT / hostile_files.DOCUMENT).read_text()
    outcomes = [hostile_files.Outcome("a pipe", False, 2, "is none", 1, 3.4, 271.0, 0.2)]
    after = hostile_files.written(document, hostile_files.table(outcomes))
    assert after.endswith("| a pipe | *is none* | 3 | 271 | 0 |\n")
    assert document.startswith(after[: after.index("| File | Outcome |")])
    with pytest.raises(ValueError, match="0 tables"):
        hostile_files.written("nothing", "")


def test_a_full_disk_for_temporary_files_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mild_ros.bag.budgets.SCRATCH_LEFT_BYTES", 1 << 60)
    hostile_files.write_packed_file(tmp_path / "bag")
    with pytest.raises(BagError, match=r"would fill the disk of .*; set TMPDIR to"), open_bag(tmp_path / "bag"):
        pass
