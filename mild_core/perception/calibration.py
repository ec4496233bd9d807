# SPDX-License-Identifier: Apache-2.0
"""Where a person's arm frame lies in the camera's: a value small enough to keep in a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mild_core.errors import SetupError
from mild_core.shapes import FloatArray, read_only, require_shape


@dataclass(frozen=True, eq=False)
class Calibration:
    """The person's arm frame.

    Attributes:
        stamp_ns: When it was made.
        frame_id: The tf frame it holds in.
        side: Whose shoulder is the origin.
        shoulder_m: (3,) that shoulder in `frame_id`.
        arm_from_source: (3, 3) rotation from the axes of `frame_id` to x forward, y left, z up of the person.
        bone_lengths_m: Of the watched arm, from the shoulder outwards.
    """

    stamp_ns: int
    frame_id: str
    side: Literal["right", "left"]
    shoulder_m: FloatArray
    arm_from_source: FloatArray
    bone_lengths_m: tuple[float, ...]

    def __post_init__(self) -> None:
        for name, shape in (("shoulder_m", (3,)), ("arm_from_source", (3, 3))):
            object.__setattr__(self, name, read_only(getattr(self, name)))
            require_shape(name, getattr(self, name), shape)

    def as_mapping(self) -> dict[str, Any]:
        """Plain numbers and lists, for a file; `calibration_from_mapping` reads them."""
        return {
            "stamp_ns": self.stamp_ns,
            "frame_id": self.frame_id,
            "side": self.side,
            "shoulder_m": self.shoulder_m.tolist(),
            "arm_from_source": self.arm_from_source.tolist(),
            "bone_lengths_m": list(self.bone_lengths_m),
        }


def calibration_from_mapping(values: Mapping[str, Any]) -> Calibration:
    """The calibration that `as_mapping` wrote.

    Raises:
        SetupError: It does not hold one.
    """
    try:
        calibration = Calibration(
            stamp_ns=int(values["stamp_ns"]),
            frame_id=str(values["frame_id"]),
            side=values["side"],
            shoulder_m=np.array(values["shoulder_m"], dtype=np.float64),
            arm_from_source=np.array(values["arm_from_source"], dtype=np.float64),
            bone_lengths_m=tuple(float(length) for length in values["bone_lengths_m"]),
        )
        rotation = calibration.arm_from_source
        sound = bool(np.isfinite(calibration.shoulder_m).all() and np.isfinite(rotation).all())
        sound = sound and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) and np.linalg.det(rotation) > 0.0
        sound = sound and all(0.0 < length < 2.0 for length in calibration.bone_lengths_m)
    except (KeyError, TypeError, ValueError) as error:
        raise SetupError("calibration", f"cannot be read ({error!r})", "calibrate again") from error
    if not sound or calibration.side not in ("right", "left"):
        raise SetupError("calibration", "does not hold a rotation, a shoulder and an arm", "calibrate again")
    return calibration
