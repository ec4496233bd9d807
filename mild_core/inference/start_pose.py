# SPDX-License-Identifier: Apache-2.0
"""Correction of the predicted window by the robot's pose at the start.

Two demonstrations of one interaction differ most by a constant: the robot stood elsewhere, the person too, and nothing
in the person's motion explains. Where the robot stood does, partly. Near its start the robot is where it stood; far
from it, displaced by a share of how unusually it stood. And while the person rests, the robot still stands there.

Source: ours; a third of the error is a constant offset per trial, see `mild_core/README.md`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.inference.novelty_detector import TakeArray
from mild_core.shapes import FloatArray, read_only


@dataclass(frozen=True, eq=False)
class StartPose:
    """How motion depends on the pose before it.

    Attributes:
        mean: (P, J) where the robot started, by interaction [rad].
        reach: (1,) distance from there up to which a start is used [rad]. One beyond is ignored.
        resting: (P, J, J) displacement of a pose at the start, by how unusual the start is.
        moving: (P, J, J) the same of a pose far from it.
        nearness: (1,) distance from the start at which a pose is of both kinds, as exp(-1/2) [rad].
        standing: (1,) distance from the start up to which a predicted pose means standing there while the person
            rests, as exp(-1/2) [rad].

    Raises:
        ValueError: A distance is not above zero.
    """

    mean: FloatArray
    reach: FloatArray
    resting: FloatArray
    moving: FloatArray
    nearness: FloatArray
    standing: FloatArray

    def __post_init__(self) -> None:
        if not min(self.reach[0], self.nearness[0], self.standing[0]) > 0.0:
            raise ValueError("array start_pose.reach, .nearness or .standing is no distance above zero")

    def displaced(self, motion: FloatArray, start: FloatArray, label: FloatArray, resting: float) -> FloatArray:
        """(W, J) a predicted window, displaced [rad].

        Args:
            motion: (W, J) the window [rad].
            start: (J,) where the robot stood before it [rad].
            label: (P,) probability of each interaction.
            resting: How much the person still rests, see `resting.rests`.
        """
        unusual = start - self.mean
        known = label * (np.linalg.norm(unusual, axis=1) <= self.reach[0])
        near = near_start(motion, self.mean[:, None], self.nearness[0])[..., None]
        at_rest, moved = (np.einsum("pjk,pk->pj", gain, unusual)[:, None] for gain in (self.resting, self.moving))
        displaced: FloatArray = motion + np.tensordot(known, near * at_rest + (1.0 - near) * moved, axes=1)
        stands = resting * known.sum() * near_start(displaced, start, self.standing[0])[:, None]
        displaced += stands * (start - displaced)
        return displaced

    def to_arrays(self) -> dict[str, FloatArray]:
        """What `take_start_pose` takes."""
        return {f"start_pose.{name}": getattr(self, name) for name in self.__dataclass_fields__}


def near_start(poses: FloatArray, start: FloatArray, nearness: float) -> FloatArray:
    """How much poses (..., J) are such as at the start, 1 to 0: by their distance from where the robot starts."""
    near: FloatArray = np.exp(-((poses - start) ** 2).sum(axis=-1) / (2.0 * nearness**2))
    return near


def take_start_pose(take: TakeArray, interactions: int, joints: int) -> StartPose:
    """Put it together from a model's arrays.

    Raises:
        ValueError: One is missing or has another shape.
    """
    gain = (interactions, joints, joints)
    distances = dict.fromkeys(("reach", "nearness", "standing"), (1,))
    shapes = {"mean": (interactions, joints), "resting": gain, "moving": gain, **distances}
    return StartPose(**{name: read_only(take(f"start_pose.{name}", shape)) for name, shape in shapes.items()})
