# SPDX-License-Identifier: Apache-2.0
"""One recorded interaction: what the observed agent did and what the controlled agent did meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mild_core.shapes import FloatArray, read_only, require_shape


@dataclass(frozen=True, eq=False)
class Demonstration:
    """Both agents of one trial, frame by frame at a constant rate.

    Attributes:
        trial: Index of the trial in its recording; names it in reports and in `replay --trial`.
        interaction: What the two were doing.
        rate_hz: Frames per second.
        observed_names: The J observed joints of one arm, from the shoulder outwards.
        observed_m: (T, J, 3) metres; x forward, y left, z up, origin at the shoulder of the first frame.
        controlled_names: The controlled joints.
        controlled: (T, J) joint angles [rad], or (T, J, 3) the partner's arm [m] in its own arm frame.
        active: (T,) 1 while the interaction goes on and 0 where the publisher says "not active". Kept for
            reports: learning and scoring use all frames.
    """

    trial: int
    interaction: str
    rate_hz: float
    observed_names: tuple[str, ...]
    observed_m: FloatArray
    controlled_names: tuple[str, ...]
    controlled: FloatArray
    active: FloatArray

    def __post_init__(self) -> None:
        for name in ("observed_m", "controlled", "active"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} of trial {self.trial} holds values that are not finite")
        frames = len(self.observed_m)
        require_shape("observed_m", self.observed_m, (frames, len(self.observed_names), 3))
        joints = len(self.controlled_names)
        require_shape("controlled", self.controlled, (frames, joints, *self.controlled.shape[2:3]))
        require_shape("active", self.active, (frames,))

    @property
    def frames(self) -> int:
        """T, the number of frames."""
        return len(self.observed_m)

    @property
    def partner(self) -> bool:
        """Whether the controlled agent is a second person, described by positions, and no robot."""
        return self.controlled.ndim == 3
