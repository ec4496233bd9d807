# SPDX-License-Identifier: Apache-2.0
"""Tables of held-out trials at run time, and of the detection of unknown motions: for people and for machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from mild_core.learning.evaluation.comparison import Row
    from mild_core.learning.evaluation.run_time import RunTime
    from mild_core.learning.evaluation.unknown import Separation

RECOGNITION_ADDS = ("recognition adds until 1 s after onset", "recognition adds later")
"""Growth of the error where the model has to recognise the interaction; a resting person shows nothing of it."""

SCORES = {"ours": "ours", "nearest_neighbour": "nearest neighbour"}


def run_time_as_data(rows: Sequence[Row]) -> dict[str, Any]:
    """By method, as plain data; means over seeds."""
    return {row.method: _data(row.run_time) for row in rows if row.run_time is not None}


def _data(run_time: RunTime) -> dict[str, Any]:
    from mild_core.learning.evaluation.uncertainty_calibration import LEVELS

    calibrations = run_time.calibrations

    def mean(of: str, name: str, kind: str) -> list[float]:
        curve: list[float] = np.mean([getattr(getattr(c, of)[name], kind) for c in calibrations], axis=0).tolist()
        return curve

    kinds = {"joint": ("after", "joint"), "marginal": ("after", "marginal")}
    kinds |= {"joint_unscaled": ("before", "joint"), "marginal_unscaled": ("before", "marginal")}
    return {
        "trials": run_time.trials,
        "wrong_after_s": {f"{seconds:g}": wrong for seconds, wrong in run_time.wrong.items()},
        "called_unknown": run_time.unknown,
        "recognition_adds": dict(zip(("until_1_s", "later"), run_time.recognition_cost.tolist(), strict=True)),
        "covariance_scale": {n: float(np.mean([c.scale[n] for c in calibrations])) for n in calibrations[0].scale},
        "radii": {n: np.mean([c.radii[n] for c in calibrations], axis=0).tolist() for n in calibrations[0].radii},
        "levels": list(LEVELS),
        "reliability": {
            name: {key: mean(of, name, kind) for key, (of, kind) in kinds.items()} for name in calibrations[0].after
        },
    }


def run_time_cells(found: Mapping[str, Any], titles: Mapping[str, str]) -> list[list[str]]:
    """Header and a line per method: recognition, and how much the 90 % regions hold, jointly / one value at a time."""
    from mild_core.learning.evaluation.uncertainty_calibration import REGION

    lines: list[list[str]] = []
    for method, one in found.items():
        if not lines:
            seconds = [f"wrong after {s} s" for s in one["wrong_after_s"]]
            regions = [f"{REGION:.0%} holds: {name}" for name in one["reliability"]]
            lines.append(["method", "trials", *seconds, "called unknown", *RECOGNITION_ADDS, *regions])
        place = one["levels"].index(REGION)
        shares = [f"{r['joint'][place]:.0%} / {r['marginal'][place]:.0%}" for r in one["reliability"].values()]
        wrong = [f"{count:.2g}" for count in one["wrong_after_s"].values()]
        added = [f"{share:+.1%}" for share in one["recognition_adds"].values()]
        lines.append([titles[method], str(one["trials"]), *wrong, f"{one['called_unknown']:.1%}", *added, *shares])
    return lines


def unknown_as_data(found: Mapping[str, Mapping[str, Separation]]) -> dict[str, Any]:
    """By interaction left out and score, as plain data."""
    return {name: {score: vars(one) for score, one in scores.items()} for name, scores in found.items()}


def unknown_cells(found: Mapping[str, Mapping[str, Separation]]) -> list[list[str]]:
    """Header and a line per interaction left out."""
    heads = [head for title in SCORES.values() for head in (f"{title}: detected", "area under curve")]
    return [
        ["left out", *heads],
        *(
            [name, *(cell for key in SCORES for cell in (f"{scores[key].share:.0%}", f"{scores[key].area:.2f}"))]
            for name, scores in found.items()
        ),
    ]
