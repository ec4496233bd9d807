# SPDX-License-Identifier: Apache-2.0
"""The table of equations in `mild_core/README.md` names functions that run: each is called in a run of the live model,
given an interaction and recognising it, or in a small training.

Run as a module it makes these runs and prints what was called. Compiled functions of the named modules are left to
Python there, so that their calls are seen.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from types import FrameType
from typing import Any

import numpy as np

from mild_core import compiled
from test.habits.tree import ROOT

IN_PYTHON = ("mixing", "filtering", "member", "semi_markov_chain", "demonstrations", "latent_prior")
"""Modules with compiled functions that the table names, or that call those."""


def named(text: str) -> list[str]:
    """What the table names: `module.function` or `Class.method`."""
    table = text[text.index("| Equation |") :].split("\n\n")[0]
    return re.findall(r"`(\w+\.\w+)`", table)


def runs() -> None:
    """A few windows through the live model, and two short trainings."""
    from mild_core import FeatureWindow, Inference, load_model
    from mild_core.learning.data.windows import PROTOCOLS
    from mild_core.learning.training.algorithm import train
    from mild_core.learning.training.learned_model import finished
    from mild_ros.assembly.settings import InferenceParameters
    from test.core.learning.made_trials import made_trials
    from test.core.learning.small_settings import SMALL

    model = load_model(InferenceParameters().model)
    features = np.zeros((model.manifest.window, 3 * len(model.manifest.observed.joint_names)))
    window = FeatureWindow(10**9, "human_1", model.manifest.observed.joint_names, features)
    for stage in (Inference(model, model.manifest.interactions[0]), Inference(model)):
        stage.step(stage.init(), window, 0)
    finished(train(made_trials(each=1), PROTOCOLS["same"], replace(SMALL, epochs=3, observed_share=0.4), 0))


def called() -> set[str]:
    """`module.function` and `Class.method` of everything of `mild_core` that was called in `runs`."""
    compile_it, found = compiled._compiled, set()

    def left_to_python(function: Any, freedom: Any) -> Any:
        return function if function.__module__.split(".")[-1] in IN_PYTHON else compile_it(function, freedom)

    def see(frame: FrameType, event: str, _: object) -> None:
        module = frame.f_globals.get("__name__", "")
        if event == "call" and module.startswith("mild_core."):
            name = frame.f_code.co_qualname
            found.add(name if "." in name else f"{module.split('.')[-1]}.{name}")

    compiled._compiled = left_to_python
    sys.setprofile(see)
    try:
        runs()
    finally:
        sys.setprofile(None)
        compiled._compiled = compile_it
    return found


def test_each_function_that_the_table_of_equations_names_runs() -> None:
    wanted = named((ROOT / "mild_core/README.md").read_text())
    assert len(wanted) > 20
    command = [sys.executable, "-m", "test.core.test_equations"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}  # `./mild test` takes nothing from where it stands
    printed = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True, timeout=120
    ).stdout
    assert sorted(set(wanted) - set(json.loads(printed))) == []


def test_a_name_that_the_table_takes_from_nowhere_is_seen() -> None:
    assert named("words `a.b`\n\n| Equation | |\n|---|---|\n| x | `a.c`, by `D.e` |\n\nand `a.f`") == ["a.c", "D.e"]


if __name__ == "__main__":
    print(json.dumps(sorted(called())))
