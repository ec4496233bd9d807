# SPDX-License-Identifier: Apache-2.0
"""How long one step of inference takes: `./mild measure step_latency [--model FOLDER] [--interaction NAME|auto]`.

One thread, the whole step: from a feature window to a motion window with covariance, belief and phase. Without a model
it takes one of the paper's sizes with random weights: 360-250-150-5 and 5-150-250-280, K = 10 components.
"""

from __future__ import annotations

import argparse
import gc
from pathlib import Path
from time import perf_counter_ns

import numpy as np

from mild_core.errors import SetupError
from mild_core.inference.golden import synthetic_windows
from mild_core.inference.model import MildModel, build_model, load_model
from mild_core.inference.stage import Inference
from mild_core.signals import FeatureWindow
from test.core.inference.random_model import manifest, paper_member, random_arrays

WARM_UP = 50


def paper_sized() -> MildModel:
    """Random weights of the paper's sizes, whose filter and decoder cost what trained ones cost."""
    of = manifest((paper_member(),), components=10)
    return build_model(of, random_arrays(of))


def measure(model: MildModel, interaction: str, steps: int) -> np.ndarray:
    """Microseconds of each step, after a warm-up that compiles. Windows are swaying ones near to what a model knows."""
    manifest_, cycle = model.manifest, synthetic_windows(model)
    period_ns = round(1e9 / manifest_.rate_hz)
    windows = [
        FeatureWindow(i * period_ns, "arm", manifest_.observed.joint_names, cycle[i % len(cycle)])
        for i in range(WARM_UP + steps)
    ]
    stage = Inference(model, interaction)
    state, microseconds = stage.init(), np.empty(len(windows))
    gc.collect()
    for i, window in enumerate(windows):
        start = perf_counter_ns()
        state, motions = stage.step(state, window, window.stamp_ns)
        microseconds[i] = (perf_counter_ns() - start) / 1e3
        assert len(motions) == 1
    return microseconds[WARM_UP:]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, help="a model folder; left out: random weights of the paper's sizes")
    parser.add_argument("--interaction", help="one of the model's, or auto; left out: the first one and auto")
    parser.add_argument("--steps", type=int, default=5000)
    given = parser.parse_args()
    try:
        model = load_model(given.model) if given.model else paper_sized()
    except SetupError as error:
        raise SystemExit(str(error)) from None
    chosen = [given.interaction] if given.interaction else [model.manifest.interactions[0], "auto"]
    print(
        f"model {model.manifest.name}: {len(model.members)} member(s), {len(model.manifest.interactions)} interactions"
    )
    for interaction in chosen:
        times = measure(model, interaction, given.steps)
        median, high = np.median(times), np.percentile(times, 99)
        print(f"{interaction:>16}: median {median:6.1f} us, p99 {high:6.1f} us, least {times.min():6.1f} us per step")


if __name__ == "__main__":
    main()
