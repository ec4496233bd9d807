# SPDX-License-Identifier: Apache-2.0
"""A minute of the soak: random people, interactions and faults, one after the other; `test/bench/soak.py` has hours."""

from __future__ import annotations

from mild_ros.assembly.inference import load
from mild_ros.assembly.pipeline import make_pipeline
from mild_ros.assembly.settings import PipelineParameters
from test.bench.soak import soaked


def test_a_minute_of_random_people_and_faults_breaks_no_limit() -> None:
    result = soaked(make_pipeline(PipelineParameters(), load(PipelineParameters().model)), 60.0, seed=7)
    assert result.broken == []
    assert result.commands > 5000
    assert result.followed >= result.acts // 2 > 0
    assert sum(result.faults.values()) - result.faults["none"] > 0
    assert result.grown_mb < 5.0
