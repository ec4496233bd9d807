# SPDX-License-Identifier: Apache-2.0
"""What the documents say is so: generated parts are up to date, commands and links exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from mild_core.errors import SetupError
from mild_core.perception import stage
from mild_ros.command_line.main import COMMANDS
from mild_ros.controllers import OUTPUTS
from mild_ros.node_kit.diagnostics import UNREMARKABLE
from test.bench import BENCHES
from test.habits.tree import ROOT, called, files, parse, plant, python_files
from tools.documentation import DELIVERY, SECTIONS, TOPICS, filled

OUTCOMES = (stage.__doc__ or "").split("Beside them")[0].split("outcome,", 1)[-1]
"""What perception says of its outcomes."""

DOCUMENTS = [path for path in files(ROOT) if path.suffix == ".md"]


def wrong_commands(text: str) -> list[str]:
    """Commands and benches, in blocks and in sentences, that `./mild` does not have; modules of tests that are run."""
    called_so = re.findall(r"\./mild\s+(--?\w+|\w+)", text)
    wrong = [name for name in called_so if name not in (*COMMANDS, "check", "test", "--help")]
    measured = re.findall(r"\./mild\s+measure\s+([\w-]+)", text)
    wrong += [f"measure {name}" for name in measured if name not in (*BENCHES, "NAME", "--help")]
    return wrong + re.findall(r"python3? -m (test\.[\w.]+)", text)


def only_with_ros2(text: str) -> list[str]:
    """Blocks (fence, row or paragraph) that need the command `ros2`, which `./mild` does not bring."""
    fences = re.findall(r"^```.*?^```", text, flags=re.DOTALL | re.MULTILINE)
    rest = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    blocks = fences + [part for block in rest.split("\n\n") for part in re.split(r"\n(?=\|)", block)]
    ros2_only = re.compile(r"ros2 (?:(?:run|launch) mild_ros|service|topic)")
    return [block for block in blocks if ros2_only.search(block) and "./mild" not in block]


def broken_links(path: Path) -> list[str]:
    """Links and pictures of a document that lead to no file."""
    text = re.sub(r"^```.*?^```", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)|<img[^>]+src=\"([^\"]+)\"", text)
    names = [
        target for pair in targets for target in pair if target and "://" not in target and "mailto:" not in target
    ]
    return [name for name in names if not (path.parent / name).exists()]


def _nodes(root: Path) -> list[Path]:
    """Files of the shell."""
    return python_files(root, "mild_ros")


def topics_in_code(root: Path) -> set[tuple[str, str]]:
    """Name and type of every topic that the shell publishes or subscribes to under a fixed name."""
    found = set()
    for path in _nodes(root):
        tree = parse(path)
        texts = {
            node.targets[0].id: node.value.value
            for node in tree.body
            if isinstance(node, ast.Assign)
            and isinstance(node.targets[0], ast.Name)
            and isinstance(node.value, ast.Constant)
        }
        packages = {
            alias.name: (node.module or "").split(".")[0]
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            if called(call).split(".")[-1] in ("create_publisher", "create_subscription"):
                kind, name = ast.unparse(call.args[0]), call.args[1]
                text = name.value if isinstance(name, ast.Constant) else texts.get(ast.unparse(name))
                if text is not None:
                    found.add((str(text), f"{packages[kind]}/{kind}" if kind in packages else "by `source`"))
    return found


@pytest.mark.parametrize("name", SECTIONS)
def test_an_outdated_table_is_rejected(name: str) -> None:
    whole = filled(f"# A\n\n<!-- generated: {name} -->\n<!-- end -->\nB\n", "a.md")
    assert SECTIONS[name]() in whole
    assert filled(whole, "a.md") == whole
    lines = whole.splitlines(keepends=True)
    for index in range(3, len(lines) - 2):
        outdated = "".join(lines[:index] + lines[index + 1 :])
        assert filled(outdated, "a.md") == whole != outdated


@pytest.mark.parametrize("text", ["<!-- generated: nothing -->\n<!-- end -->", "<!-- generated: topics -->\n"])
def test_a_wrong_mark_is_refused(text: str) -> None:
    with pytest.raises(SetupError, match=r"a\.md"):
        filled(text, "a.md")


def test_wrong_commands_and_links_are_rejected(tmp_path: Path) -> None:
    text = (
        "[a](a.md) [b](b.md#part) [c](https://c.example) ![d](d.png)\n```bash\n./mild dmeo\n./mild demo --help\n```\n"
    )
    assert wrong_commands(text) == ["dmeo"]
    sentence = (
        "Figures of `./mild measure contact --every 2`, `./mild measure contcat` and `python -m test.bench.soak`."
    )
    assert wrong_commands(sentence) == ["measure contcat", "test.bench.soak"]
    plant(tmp_path, "b.md", "")
    assert broken_links(plant(tmp_path, "a.md", text)) == ["d.png"]


def test_topics_are_found_in_code(tmp_path: Path) -> None:
    lines = (
        "from std_msgs.msg import String",
        "TOPIC = 'b'",
        "self.create_publisher(String, 'a', 1)",
        "node.create_subscription(kind, TOPIC, call, 1)",
    )
    plant(tmp_path, "mild_ros/a.py", "\n".join(lines))
    assert topics_in_code(tmp_path) == {("a", "std_msgs/String"), ("b", "by `source`")}


def test_the_table_of_deliveries_is_the_code() -> None:
    """Every topic with a fixed name stands in the row of the quality of service that the code gives it."""
    for path in _nodes(ROOT):
        for call in (node for node in ast.walk(parse(path)) if isinstance(node, ast.Call)):
            kind = called(call).split(".")[-1]
            if kind in ("create_publisher", "create_subscription") and isinstance(call.args[1], ast.Constant):
                name, quality = call.args[1].value, ast.unparse(call.args[-1])
                if quality in DELIVERY and name != "/clock":  # of which a replay sends every tick reliably
                    assert f"`{name}`" in DELIVERY[quality][0], f"{path.name}: {name} with {quality}"


def reasons_in_code() -> set[str]:
    """Every reason for which an input is not used, as diagnostics count it."""
    found = set()
    for path in python_files(ROOT, "mild_core", "mild_ros"):
        for call in (node for node in ast.walk(parse(path)) if isinstance(node, ast.Call)):
            if called(call) == "DataError" and isinstance(call.args[0], ast.Constant):
                found.add(str(call.args[0].value))
    return found


def test_every_reason_is_explained_to_operators() -> None:
    explained = (ROOT / "docs/diagnostics.md").read_text()
    outcomes = set().union(*UNREMARKABLE.values()) | set(re.findall(r"\b[a-z]+_[a-z_]+\b|\bmoving\b", OUTCOMES))
    assert [name for name in sorted(reasons_in_code() | outcomes) if f"`{name}`" not in explained] == []


def test_the_table_of_topics_is_the_code() -> None:
    trackers = {("skeleton", "by `source`")}  # a tracker's topics stand in its feeds
    by_model = {("motion", "`trajectory_msgs/JointTrajectory` or `sensor_msgs/PointCloud2`")}
    controllers = {(output.topic, output.type_name.replace("/msg/", "/")) for output in OUTPUTS.values()}
    in_code = topics_in_code(ROOT) - {("motion", "by `source`")}
    assert in_code | trackers | by_model | controllers == {(topic.name, topic.message) for topic in TOPICS}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_document_is_so(path: Path) -> None:
    text = path.read_text()
    assert filled(text, str(path)) == text, f"run: python -m tools.documentation {path.relative_to(ROOT)}"
    assert wrong_commands(text) == []
    assert broken_links(path) == []


def test_the_reference_holds_the_tables() -> None:
    marks = re.findall(r"<!-- generated: (\w+) -->", (ROOT / "docs/reference.md").read_text())
    assert {"topics", "qualities", "parameters", "commands"} <= set(marks)


def test_the_readme_is_read_in_five_minutes() -> None:
    assert len((ROOT / "README.md").read_text().split()) < 1200


TELLING = [path for path in DOCUMENTS if path.name != "CHANGELOG.md"]


@pytest.mark.parametrize("path", TELLING, ids=lambda path: str(path.relative_to(ROOT)))
def test_all_that_is_documented_can_be_done_without_ros2(path: Path) -> None:
    assert only_with_ros2(path.read_text()) == []


@pytest.mark.parametrize(
    "text",
    [
        "Run\n\n```\nros2 run mild_ros pipeline\n```\n\n./mild demo\n",
        "| a | ./mild |\n| b | `ros2 service call /x` |\n",
        "Do `ros2 launch mild_ros live.launch.py`.\n",
    ],
)
def test_what_needs_ros2_is_noticed(text: str) -> None:
    assert len(only_with_ros2(text)) == 1
