# SPDX-License-Identifier: Apache-2.0
"""A source tree as the gates see it. Every gate takes the root of a tree, so that its canary can plant one."""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent.parent


class Import(NamedTuple):
    """One imported module: `module` in full, on `line`; `lazily` when inside a function or for type checkers only."""

    module: str
    line: int
    lazily: bool


def files(root: Path) -> list[Path]:
    """Everything that is committed in `root`, or could be: git's view of it, or all of a planted tree."""
    if not (root / ".git").exists():
        return sorted(path for path in root.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    command = ["git", "-C", str(root), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")
    return sorted({root / name for name in names if name and (root / name).is_file()})


def python_files(root: Path, *tops: str) -> list[Path]:
    """The .py files of `root`, of the folders `tops` only where any are given."""
    found = (path for path in files(root) if path.suffix == ".py")
    return [path for path in found if not tops or path.relative_to(root).parts[0] in tops]


def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(), filename=str(path))


def imports(root: Path, path: Path) -> list[Import]:
    """Every module that `path` imports, however it is written; `from a import b` counts as `a.b`."""
    tree = parse(path)
    package = path.relative_to(root).parent.parts
    inside = {id(node) for later in [*functions(tree), *_for_type_checkers(tree)] for node in ast.walk(later)}
    found = []
    for node in ast.walk(tree):
        for module in _modules(node, package):
            found.append(Import(module, getattr(node, "lineno", 0), id(node) in inside))
    return found


def _for_type_checkers(tree: ast.AST) -> list[ast.stmt]:
    """What stands under `if TYPE_CHECKING:`; its `else` is run."""
    guards = [node for node in ast.walk(tree) if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    return [statement for guard in guards for statement in guard.body]


def _modules(node: ast.AST, package: tuple[str, ...]) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        above = package[: len(package) - node.level + 1] if node.level else ()
        base = ".".join((*above, *((node.module,) if node.module else ())))
        yield from (f"{base}.{alias.name}" for alias in node.names)
    elif isinstance(node, ast.Call) and called(node) in ("import_module", "importlib.import_module", "__import__"):
        yield from (given.value for given in node.args[:1] if isinstance(given, ast.Constant))


def called(node: ast.Call) -> str:
    """The dotted name of what is called, as it is written; empty for anything else."""
    return ast.unparse(node.func) if isinstance(node.func, ast.Name | ast.Attribute) else ""


def functions(tree: ast.AST) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def is_under(module: str, prefix: str) -> bool:
    """Whether `module` is `prefix` or something in it."""
    return module == prefix or module.startswith(prefix + ".")


def plant(root: Path, name: str, text: str) -> Path:
    """Write one file of a planted tree and the folders above it."""
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path
