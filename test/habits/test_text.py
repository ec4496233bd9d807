# SPDX-License-Identifier: Apache-2.0
"""What is committed: licence lines, telling names, no machine's paths, no recordings, nothing large, nothing unsafe."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from test.habits.tree import ROOT, called, files, parse, plant, python_files

LICENCE = "# SPDX-License-Identifier: Apache-2.0"
EMPTY_NAMES = {"utils", "util", "common", "helpers", "helper", "misc", "stuff"}
MACHINE_PATH = re.compile(r"(?<![\w.~$}/-])/(?:work|root|home/\w+|Users/\w+|opt/wheels|mnt|media)(?=[/\s\"'`)]|$)")
LARGEST_BYTES, LARGEST_WEIGHTS_BYTES = 2**20, 3 * 2**19
DATA_SUFFIXES = {
    *(".npz", ".npy", ".pt", ".pth", ".pkl", ".pickle", ".joblib", ".mat", ".h5", ".hdf5", ".parquet", ".feather"),
    *(".csv", ".tsv", ".txt", ".zip", ".gz", ".zst", ".bag", ".db3", ".mcap", ".safetensors", ".bin", ".bvh", ".c3d"),
}
UNSAFE_MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
UNSAFE_CALLS = {"eval", "exec", "yaml.load", "os.system", "torch.hub.load", "pickle.load", "pickle.loads"}
READER = "mild_core/learning/data/safe_npz.py"
"""Reads the published pickles by its own rules: it may have the module, but not the calls that trust a file."""
ATTACKS = "test/core/learning/test_safe_npz.py"
"""Shows that the reader refuses what plain pickle runs, so it has to run it."""


def licences(root: Path) -> list[str]:
    """Sources whose first line (below a #!) is not the licence."""
    found = []
    for path in files(root):
        head = path.read_bytes()[:200].decode(errors="replace").splitlines() or [""]
        if path.suffix == ".py" and head[0] != LICENCE:
            found.append(f"{path.relative_to(root)}: the first line is not the licence")
        elif head[0].startswith("#!") and LICENCE not in head[:2]:
            found.append(f"{path.relative_to(root)}: the second line is not the licence")
    return found


def empty_names(root: Path) -> list[str]:
    """Files and folders whose names say nothing."""
    named = {part for path in files(root) for part in path.relative_to(root).with_suffix("").parts}
    return sorted(named & EMPTY_NAMES)


def machine_paths(root: Path) -> list[str]:
    """Paths that exist on a developer's machine only."""
    found = []
    for path in files(root):
        content = path.read_bytes()
        if path.name == Path(__file__).name or b"\0" in content:
            continue
        for number, line in enumerate(content.decode(errors="replace").splitlines(), 1):
            found += [f"{path.relative_to(root)}:{number} {match.group()}" for match in MACHINE_PATH.finditer(line)]
    return found


def absent_documents(root: Path) -> list[str]:
    """References to documents that a reader of this repository does not have."""
    found = []
    for path in files(root):
        if path.name != Path(__file__).name and path.suffix in (".py", ".md", ".urdf", ".json"):
            named = re.findall(
                r"\b[A-Z]{4,} §[\d.]+|\b(?:METHOD|DESIGN|FACTS|EXAMPLES)(?:\.md\b| section \d)", path.read_text()
            )
            found += [f"{path.relative_to(root)}: {name}" for name in named]
    return found


def large_files(root: Path) -> list[str]:
    """Files that make every clone slow for ever."""
    found = []
    for path in files(root):
        weights = path.match("models/*/weights.safetensors")
        if path.stat().st_size > (LARGEST_WEIGHTS_BYTES if weights else LARGEST_BYTES):
            found.append(str(path.relative_to(root)))
    return found


def recordings(root: Path) -> list[str]:
    """Data that has no place here: recordings are other people's. Models and our own synthetic bags do have one."""
    found = []
    for path in files(root):
        name = path.relative_to(root)
        top, parent = name.parts[0], path.parent
        of_a_model = top == "models" and name.name in ("golden.npz", "weights.safetensors") and len(name.parts) == 3
        of_a_bag = top == "bags" and path.suffix in (".mcap", ".db3") and _says_synthetic(parent / "SOURCE.md")
        of_the_locks = top == "requirements" and path.suffix == ".txt"
        if path.suffix in DATA_SUFFIXES and not (of_a_model or of_a_bag or of_the_locks):
            found.append(str(name))
    return found


def _says_synthetic(source: Path) -> bool:
    return source.exists() and "synthetic" in source.read_text().lower()


def unsafe_loading(root: Path) -> list[str]:
    """Code that would run what a file says."""
    found = []
    for path in python_files(root):
        name = path.relative_to(root).as_posix()
        may_name_pickle = name == READER or name.startswith("test/")
        for node in ast.walk(parse(path)):
            is_excepted = name == ATTACKS or (may_name_pickle and isinstance(node, ast.Import)) or _of_own_making(node)
            if (why := _unsafe(node)) and not is_excepted:
                found.append(f"{path.relative_to(root)}:{getattr(node, 'lineno', 0)} {why}")
    return found


def _of_own_making(node: ast.AST) -> bool:
    """`pickle.loads(pickle.dumps(x))`: a copy, as saved and restored, of what this process made."""
    return ast.unparse(node).startswith("pickle.loads(pickle.dumps(") if isinstance(node, ast.Call) else False


def _unsafe(node: ast.AST) -> str:
    if isinstance(node, ast.Import | ast.ImportFrom):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
        return ", ".join(name for name in names if name.split(".")[0] in UNSAFE_MODULES)
    if not isinstance(node, ast.Call):
        return ""
    given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
    name = called(node)
    if name in UNSAFE_CALLS or given.get("shell") == "True" or given.get("allow_pickle", "False") != "False":
        return ast.unparse(node)
    return ast.unparse(node) if name == "torch.load" and given.get("weights_only") != "True" else ""


GATES: dict[Callable[[Path], list[str]], list[tuple[str, str]]] = {
    licences: [
        ("a.py", '"""Words."""\n'),
        ("a.py", f"\n{LICENCE}\n"),
        ("a.py", ""),
        ("run", "#!/bin/sh\necho\n"),
    ],
    empty_names: [("mild_core/utils.py", ""), ("mild_core/common/x.py", ""), ("test/helpers.py", "")],
    machine_paths: [
        ("a.md", "see /home/ann/notes"),
        ("a.py", 'DATA = "/work/data"'),
        ("a.cfg", "/root/x"),
        ("b", "p=/Users/bo/x"),
    ],
    absent_documents: [("a.py", "# METHOD §3"), ("a.py", "# METHOD section 3"), ("a.md", "see DESIGN.md")],
    large_files: [
        ("a.png", "x" * (LARGEST_BYTES + 1)),
        ("models/a/weights.safetensors", "x" * (LARGEST_WEIGHTS_BYTES + 1)),
    ],
    recordings: [
        ("test/core/trial.npz", ""),
        ("docs/table.csv", ""),
        ("models/a/windows.npz", ""),
        ("models/a/b/golden.npz", ""),
        ("bags/a/a.mcap", ""),
        ("notes.txt", ""),
    ],
    unsafe_loading: [
        ("a.py", "import pickle"),
        ("a.py", "def f():\n    from joblib import load"),
        ("a.py", "numpy.load(path, allow_pickle=True)"),
        ("a.py", "numpy.load(path, allow_pickle=trust)"),
        ("a.py", "torch.load(path)"),
        ("a.py", "torch.load(path, weights_only=False)"),
        ("a.py", "yaml.load(text)"),
        ("a.py", "subprocess.run(line, shell=True)"),
        ("a.py", "eval(text)"),
        ("mild_core/learning/data/safe_npz.py", "import pickle\npickle.loads(text)"),
        ("test/test_a.py", "import pickle\npickle.loads(text)"),
    ],
}


@pytest.mark.parametrize(
    ("gate", "name", "text"), [(gate, *planted) for gate, all_planted in GATES.items() for planted in all_planted]
)
def test_a_planted_violation_is_rejected(
    tmp_path: Path, gate: Callable[[Path], list[str]], name: str, text: str
) -> None:
    plant(tmp_path, name, text)
    assert len(gate(tmp_path)) == 1


def test_what_is_allowed_passes(tmp_path: Path) -> None:
    plant(tmp_path, "run", f"#!/bin/sh\n{LICENCE}\n. /usr/share/x; echo docs/work/a ~/work $HOME/work /workshop\n")
    plant(tmp_path, "mild_core/a.py", f"{LICENCE}\nimport torch\ntorch.load(path, weights_only=True)\n")
    plant(tmp_path, "test/test_a.py", f"{LICENCE}\nimport pickle\npickle.loads(pickle.dumps(state))\n")
    plant(tmp_path, "models/a/golden.npz", "")
    plant(tmp_path, "bags/a/SOURCE.md", "Synthetic: sampled from a model.")
    plant(tmp_path, "bags/a/a_0.mcap", "")
    assert [violation for gate in GATES for violation in gate(tmp_path)] == []


@pytest.mark.parametrize("gate", GATES)
def test_the_tree_passes(gate: Callable[[Path], list[str]]) -> None:
    assert gate(ROOT) == []
