# SPDX-License-Identifier: Apache-2.0
"""A retargeting under way, to be poked at."""

from __future__ import annotations

import numpy as np

from mild_core.retargeting.robots.yumi import YUMI
from mild_core.retargeting.stage import Request, Retargeting, RetargetingSettings, RetargetingState
from mild_core.shapes import FloatArray
from mild_core.signals import JointCommand, JointMeasurement, MotionWindow
from test.core.retargeting.perfect import START_NS, TICK_NS, measurement, window

Given = MotionWindow | JointMeasurement | Request | None
AWAY = YUMI.home_rad + 0.3
"""A pose to go to: 17 degrees from home in every joint."""

SECOND_NS = 1_000_000_000


class Run:
    """A retargeting under way: time passes in ticks; everything it said is kept."""

    def __init__(self, settings: RetargetingSettings | None = None, at_rad: FloatArray | None = YUMI.home_rad) -> None:
        self.retargeting = Retargeting(YUMI, settings or RetargetingSettings())
        self.state: RetargetingState = self.retargeting.init()
        self.now_ns = START_NS
        self.commands: list[JointCommand] = []
        if at_rad is not None:
            self.give(measurement(at_rad))

    def give(self, *inputs: Given) -> str:
        """Give these at one time; the outcome of the last."""
        for given in inputs:
            self.state, new = self.retargeting.step(self.state, given, self.now_ns)
            self.commands += new
        return self.state.outcome

    def wait(self, seconds: float, motion_rad: FloatArray | None = None, **window_fields: object) -> None:
        """Tick on for a while; with a motion, a fresh window that stands at `motion_rad` comes every third tick."""
        for tick in range(round(seconds * SECOND_NS / TICK_NS)):
            self.now_ns += TICK_NS
            if motion_rad is not None and tick % 3 == 0:
                self.give(window(np.tile(motion_rad, (40, 1)), self.now_ns, **window_fields))  # type: ignore[arg-type]
            self.give(None)

    @property
    def last(self) -> JointCommand:
        return self.commands[-1]
