# SPDX-License-Identifier: Apache-2.0
"""The layer law: who may import whom. One package.xml has no build system to guard the borders, so this does."""

from __future__ import annotations

import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

from test.habits.tree import ROOT, Import, imports, is_under, plant, python_files

FOUNDATION = (
    *("mild_core.signals", "mild_core.shapes", "mild_core.errors", "mild_core.compiled", "mild_core.fields"),
    *("mild_core.budgets", "mild_core.yaml_budget"),
    *("mild_core.joint_measurements", "mild_core.parameters", "mild_core.printable"),
)
STAGES = ("mild_core.perception", "mild_core.inference", "mild_core.retargeting")
NUMERICS = ("numpy", "numba", "ruckig", "safetensors")


class Law(NamedTuple):
    """For every file whose path starts with `where` (the longest match counts): what it may import of ours and others'.

    `others` None: anything that is declared (test_dependencies.py) but torch.
    """

    where: str
    ours: tuple[str, ...]
    others: tuple[str, ...] | None


LAWS = (
    Law("mild_core/__init__.py", ("mild_core",), ()),
    Law(
        "mild_core/resources.py", (*FOUNDATION, "mild_core.perception", "mild_core.inference"), ("ament_index_python",)
    ),
    Law("mild_core/signals.py", FOUNDATION, ("numpy",)),
    Law("mild_core/shapes.py", FOUNDATION, ("numpy",)),
    Law("mild_core/joint_measurements.py", FOUNDATION, ("numpy",)),
    Law("mild_core/printable.py", (), ()),
    Law("mild_core/errors.py", FOUNDATION, ("numpy",)),
    Law("mild_core/fields.py", FOUNDATION, ()),
    Law("mild_core/parameters.py", FOUNDATION, ()),
    Law("mild_core/budgets.py", FOUNDATION, ("numpy",)),
    Law("mild_core/yaml_budget.py", (), ("yaml",)),
    Law("mild_core/compiled.py", (), ("numba",)),
    Law("mild_core/perception/", (*FOUNDATION, "mild_core.perception"), NUMERICS),
    Law("mild_core/inference/", (*FOUNDATION, "mild_core.inference"), NUMERICS),
    Law("mild_core/retargeting/", (*FOUNDATION, "mild_core.retargeting"), NUMERICS),
    Law(
        "mild_core/retargeting/robot_model/inverse_kinematics.py",
        (*FOUNDATION, "mild_core.retargeting"),
        (*NUMERICS, "daqp", "pinocchio"),
    ),
    Law(
        "mild_core/retargeting/robot_model/joint_limits.py", (*FOUNDATION, "mild_core.retargeting"), (*NUMERICS, "yaml")
    ),
    Law("mild_core/pipeline.py", (*FOUNDATION, *STAGES), ("numpy",)),
    Law(
        "mild_core/learning/",
        (*FOUNDATION, *STAGES, "mild_core.pipeline", "mild_core.learning"),
        (*NUMERICS, "scipy", "torch"),
    ),
    Law("mild_ros/", (*FOUNDATION, *STAGES, "mild_core.pipeline", "mild_core.resources", "mild_ros"), None),
    Law("mild_ros/command_line/", ("mild_core", "mild_ros"), None),
    Law("mild_ros/command_line/measure.py", ("mild_core.errors", "mild_ros", "test.bench"), None),
    Law("mild_ros/command_line/faults.py", ("mild_core.errors", "mild_ros", "test.faults"), None),
    Law("mild_ros/nodes/perception_node.py", (*FOUNDATION, "mild_core.perception", "mild_ros"), None),
    Law("mild_ros/nodes/retargeting_node.py", (*FOUNDATION, "mild_core.retargeting", "mild_ros"), None),
    Law("mild_ros/nodes/inference_node.py", (*FOUNDATION, "mild_core.inference", "mild_ros"), None),
)


def violations(root: Path) -> list[str]:
    """Every import that the law forbids, as `file:line why`."""
    found = []
    for path in python_files(root, "mild_core", "mild_ros"):
        name = path.relative_to(root).as_posix()
        law = max((law for law in LAWS if name.startswith(law.where)), key=lambda law: len(law.where), default=None)
        taken = imports(root, path)
        if law is None:
            found.append(f"{name}: no law covers it")
            continue
        found += [f"{name}:{item.line} {why}" for item in taken if (why := _broken(law, name, item))]
        modules = {item.module.split(".")[0] for item in taken}
        if {"rosbags", "rclpy"} <= modules:
            found.append(f"{name}: reads bags with rosbags and needs rclpy; bags are read where ROS is not installed")
    return found


def _broken(law: Law, name: str, item: Import) -> str:
    """Why `item` breaks `law` in file `name`; empty when it does not."""
    top = item.module.split(".")[0]
    if top == "test":
        allowed = any(is_under(item.module, prefix) for prefix in law.ours)
        return "" if allowed and item.lazily else "imports tests"  # benches are run from a checkout, by `mild measure`
    if top in ("mild_core", "mild_ros"):
        if not any(is_under(item.module, prefix) for prefix in law.ours):
            return f"may not import {item.module}"
        if is_under(item.module, "mild_core.learning") and top != name.split("/")[0] and not item.lazily:
            return f"imports {item.module} outside a function: the demo has to start without torch"
        parts = item.module.split(".")
        if len(parts) > 2 and parts[2].endswith("_node") and "/".join(parts[:3]) + ".py" != name:
            return f"imports another node, {item.module}"
        return ""
    if top in sys.stdlib_module_names:
        return ""
    if top == "torch" and (law.others is None or "torch" not in law.others):
        return "imports torch outside mild_core/learning"
    return f"may not import {top}" if law.others is not None and top not in law.others else ""


PLANTED = {
    "a stage imports another": ("mild_core/perception/x.py", "from mild_core.inference.stage import Inference"),
    "a stage imports another by package": ("mild_core/inference/x.py", "from mild_core import retargeting"),
    "a stage imports another relatively": ("mild_core/inference/x.py", "from ..perception import stage"),
    "a stage imports learning": ("mild_core/inference/x.py", "def f():\n    import mild_core.learning.training.vae"),
    "a stage imports the pipeline": ("mild_core/retargeting/x.py", "import mild_core.pipeline"),
    "a stage imports torch": ("mild_core/inference/x.py", "def f():\n    import torch"),
    "a stage imports scipy": ("mild_core/inference/x.py", "import scipy.linalg"),
    "a signal imports a stage": ("mild_core/signals.py", "from mild_core.perception.stage import Perception"),
    "the core imports rclpy": ("mild_core/learning/x.py", "import rclpy.node"),
    "the core imports a message": ("mild_core/perception/x.py", "from sensor_msgs.msg import JointState"),
    "the core imports the shell": ("mild_core/learning/x.py", "from mild_ros.bag.reader import read"),
    "the core imports by name": ("mild_core/perception/x.py", "import importlib\nimportlib.import_module('pybullet')"),
    "the shell imports torch": ("mild_ros/bag/reader.py", "from torch import nn"),
    "the shell imports learning": (
        "mild_ros/replay/in_process.py",
        "def f():\n    from mild_core.learning import datasets",
    ),
    "the command line imports learning at once": ("mild_ros/command_line/x.py", "from mild_core.learning import vae"),
    "the command line imports learning where no type checker guards it": (
        "mild_ros/command_line/x.py",
        "if TYPE_CHECKING:\n    import os\nelse:\n    from mild_core.learning import vae",
    ),
    "a node imports another stage": (
        "mild_ros/nodes/perception_node.py",
        "from mild_core.inference.stage import Inference",
    ),
    "a node imports another node": (
        "mild_ros/nodes/pipeline_node.py",
        "from mild_ros.nodes.perception_node import PerceptionNode",
    ),
    "bags need rclpy": ("mild_ros/bag/reader.py", "import rclpy\nfrom rosbags.highlevel import AnyReader"),
    "the shell imports tests": ("mild_ros/bag/reader.py", "from test.conftest import ROOT"),
    "a command imports benches": ("mild_ros/command_line/x.py", "def f():\n    import test.bench"),
    "the benches are imported before they are known to be there": (
        "mild_ros/command_line/measure.py",
        "import test.bench",
    ),
    "the benches' command imports other tests": ("mild_ros/command_line/measure.py", "def f():\n    import test.core"),
    "a new part of the core has no law": ("mild_core/extras/x.py", "import os"),
}


@pytest.mark.parametrize(("name", "text"), PLANTED.values(), ids=PLANTED)
def test_a_planted_violation_is_rejected(tmp_path: Path, name: str, text: str) -> None:
    plant(tmp_path, name, text)
    assert len(violations(tmp_path)) == 1


def test_what_the_law_allows_passes(tmp_path: Path) -> None:
    plant(tmp_path, "mild_core/inference/x.py", "import math\nimport numpy\nfrom mild_core.signals import MotionWindow")
    plant(tmp_path, "mild_core/learning/x.py", "import torch\nfrom mild_core.inference.model import save_model")
    plant(tmp_path, "mild_ros/command_line/x.py", "def f():\n    from mild_core.learning import vae")
    plant(tmp_path, "mild_ros/command_line/y.py", "if TYPE_CHECKING:\n    from mild_core.learning import vae")
    plant(
        tmp_path, "mild_ros/nodes/perception_node.py", "import rclpy\nfrom mild_core.perception.stage import Perception"
    )
    assert violations(tmp_path) == []


def test_the_tree_keeps_the_law() -> None:
    assert violations(ROOT) == []


def rooms(root: Path) -> dict[str, set[str]]:
    """Which other rooms each room imports: folders with all below them, those of learning each by itself, and the
    files beside them."""
    files = (path.relative_to(root) for path in python_files(root, "mild_core", "mild_ros"))
    paths = {path.with_suffix("") for path in files if ".launch" not in path.suffixes}
    modules = {".".join(path.parts).removesuffix(".__init__"): path for path in paths}

    def room(module: str) -> str:
        path = modules[module]
        depth = 3 if path.parts[1] == "learning" else 2
        return ".".join(path.parts[: min(depth, len(path.parts) - 1)] if len(path.parts) > 2 else path.parts)

    found: dict[str, set[str]] = {room(module): set() for module in modules}
    for module, path in modules.items():
        for item in imports(root, root / path.with_suffix(".py")):
            taken = item.module
            while taken and taken not in modules:
                taken = taken.rpartition(".")[0]
            if taken and room(taken) != room(module):
                found[room(module)].add(room(taken))
    return found


def test_no_rooms_need_each_other(tmp_path: Path) -> None:
    assert list(TopologicalSorter(rooms(ROOT)).static_order())
    plant(tmp_path, "mild_ros/a/x.py", "from mild_ros.b.y import Y")
    plant(tmp_path, "mild_ros/b/y.py", "def f():\n    from mild_ros.c import z")
    plant(tmp_path, "mild_ros/c/z.py", "import mild_ros.a.x")
    with pytest.raises(CycleError):
        TopologicalSorter(rooms(tmp_path)).prepare()
