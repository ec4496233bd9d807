# SPDX-License-Identifier: Apache-2.0
"""What may be set of the node that shows hands and predictions."""

from __future__ import annotations

from dataclasses import dataclass

from mild_core.parameters import parameter


@dataclass(frozen=True)
class MarkersParameters:
    """Of the markers node: the same as of the pipeline that it looks at."""

    model: str = parameter("yumi_buetepage_ahead", "Model of the pipeline: a name of `mild models`, or a folder.")
    interaction: str = parameter("auto", "Interaction of the pipeline, or `auto`.")
    robot: str = parameter("yumi", "Robot of the pipeline: `yumi`, `pepper`, or the path of a robot file (.toml).")
    robot_description: str = parameter("", "URDF in place of the robot's own: a path; empty for its own.")
