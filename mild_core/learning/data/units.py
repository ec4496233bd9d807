# SPDX-License-Identifier: Apache-2.0
"""Units of errors: joint angles of a robot, or positions of a partner's arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Unit:
    """How an error is named and shown.

    Attributes:
        squared: Of a squared error, in files.
        squared_shown: The same for people.
        key: Ending of the keys of plain errors in files.
        shown: Behind a plain error for people.
        scale: From radians or metres to what is shown.
        paper_scale: From a squared error to the figure that the MILD paper prints of it; None where it is the same.
    """

    squared: str
    squared_shown: str
    key: str
    shown: str
    scale: float
    paper_scale: float | None = None

    def plain(self, error: float | None) -> str:
        """An error that is not squared, for people: to a tenth of a degree or millimetre; "-" for none."""
        return "-" if error is None else f"{error * self.scale:.1f}{self.shown}"


ANGLES = Unit("rad^2", "rad²", "deg", "°", float(np.degrees(1.0)))
POSITIONS = Unit("m^2", "m²", "cm", " cm", 100.0, paper_scale=100.0)
"""The paper's tables of two people say cm; its figures are hundredths of square metres."""

UNITS = {unit.squared: unit for unit in (ANGLES, POSITIONS)}
"""By what files say."""
