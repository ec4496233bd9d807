# SPDX-License-Identifier: Apache-2.0
"""What a model sees and what it must answer: the three protocols as data, and trials cut into windows by them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mild_core.errors import DatasetError, unknown_name
from mild_core.learning.data.demonstration import Demonstration
from mild_core.shapes import FloatArray
from mild_core.signals import FeatureWindow

NANOSECONDS_PER_SECOND = 1_000_000_000

ONSET_M, REST_FRAMES = 0.05, 10
"""A motion starts when the hand is this far from its mean place in the first frames."""


@dataclass(frozen=True)
class Protocol:
    """How a recording is cut into questions and answers. Figures compare only within one protocol.

    Attributes:
        name: "same", "ahead" or "next".
        keep_every: One frame in so many is kept.
        window: W, frames of a question and of an answer.
        features: "positions" or "positions_velocities".
        lead_frames: First frame of the answer relative to the newest frame of the question.
        meaning: For people.
    """

    name: str
    keep_every: int
    window: int
    features: str
    lead_frames: int
    meaning: str

    def windows_of(self, frames: int) -> int:
        """N, the windows of a trial of `frames` kept frames: stride 1, the resting ones included."""
        return max(0, frames - self.window + 1 - max(0, self.lead_frames + self.window - 1))


def protocols(window: int, keep_every: int) -> Mapping[str, Protocol]:
    """The three protocols of a recording, by name.

    Args:
        window: W of "same" and "ahead", at the recorded rate: one second of the YuMi recording, five frames of NuiSI.
        keep_every: Of "next", whose windows have five frames: a fifth of the YuMi recording's rate, NuiSI's own.

    Source: "same" is the protocol of the MILD paper, "next" that of the authors' later code.
    """
    same = "from the person's last window to the other agent's same window (the paper)"
    ahead = "from the person's last window to the other agent's next window"
    after = "from five frames of the person, with velocities, to the other agent's next five"
    return MappingProxyType(
        {
            "same": Protocol("same", 1, window, "positions", 1 - window, same),
            "ahead": Protocol("ahead", 1, window, "positions", 1, ahead),
            "next": Protocol("next", keep_every, 5, "positions_velocities", 1, after),
        }
    )


PROTOCOLS = protocols(window=40, keep_every=5)
"""Those of the YuMi recording, as the paper has them; those of another are its `Recording.protocols`."""


def protocol_named(name: str, among: Mapping[str, Protocol] = PROTOCOLS) -> Protocol:
    """The protocol of that name.

    Raises:
        SetupError: There is none.
    """
    if name not in among:
        raise unknown_name("protocol", name, among)
    return among[name]


@dataclass(frozen=True, eq=False)
class Windows:
    """All questions and answers of one trial.

    Attributes:
        observed: (N, W, D) features.
        controlled: (N, W, J) joint angles [rad], or (N, W, J, 3) the partner's arm [m].
    """

    observed: FloatArray
    controlled: FloatArray


def thin(demonstration: Demonstration, protocol: Protocol) -> Demonstration:
    """The trial at the protocol's rate.

    Frames 0, n, 2n, … are kept, as many as T // n: the published code keeps as many but spreads them from the first
    frame to the last, which makes the rate depend on the length of the trial; here it is exactly 1/n.
    """
    n = protocol.keep_every
    if n == 1:
        return demonstration
    kept = slice(0, demonstration.frames // n * n, n)
    return replace(
        demonstration,
        rate_hz=demonstration.rate_hz / n,
        observed_m=demonstration.observed_m[kept],
        controlled=demonstration.controlled[kept],
        active=demonstration.active[kept],
    )


def features_of(demonstration: Demonstration, kind: str) -> FloatArray:
    """Features of each frame.

    Args:
        demonstration: At the model's rate.
        kind: "positions" or "positions_velocities".

    Returns:
        (T, 3 J) positions [m], joint by joint; or (T, 6 J), then velocities [m/s]: the difference to the frame
        before times the rate, zero in the first frame.
    """
    positions = demonstration.observed_m.reshape(demonstration.frames, -1)
    if kind == "positions":
        return positions
    velocities = np.diff(positions, axis=0, prepend=positions[:1]) * demonstration.rate_hz
    return np.concatenate([positions, velocities], axis=1)


def cut(demonstration: Demonstration, protocol: Protocol) -> Windows:
    """All windows of a trial, in order of time, stride 1.

    Args:
        demonstration: As recorded; it is thinned here.
        protocol: What to cut.

    Returns:
        N windows; N is 0 for a trial too short for one.
    """
    trial = thin(demonstration, protocol)
    count, width = protocol.windows_of(trial.frames), protocol.window
    features = features_of(trial, protocol.features)
    first = width - 1 + protocol.lead_frames
    if count == 0:
        return Windows(np.empty((0, width, features.shape[1])), np.empty((0, width, *trial.controlled.shape[1:])))
    observed = np.moveaxis(sliding_window_view(features, width, axis=0), -1, 1)[:count]
    controlled = np.moveaxis(sliding_window_view(trial.controlled, width, axis=0), -1, 1)[first : first + count]
    return Windows(np.ascontiguousarray(observed), np.ascontiguousarray(controlled))


def require_windows(demonstrations: Sequence[Demonstration], protocol: Protocol) -> None:
    """Refuse a trial that has no window.

    Raises:
        DatasetError: It is too short for one.
    """
    for trial in demonstrations:
        if not protocol.windows_of(trial.frames // protocol.keep_every):
            problem = f"its {trial.frames} frames are too few for one window and its answer, protocol '{protocol.name}'"
            raise DatasetError(f"trial {trial.trial} ({trial.interaction})", problem, "leave it out")


def onset_frame(demonstration: Demonstration) -> int:
    """The frame of a trial at which the motion begins; 0 where there is none."""
    hand = demonstration.observed_m[:, -1]
    return int((np.linalg.norm(hand - hand[:REST_FRAMES].mean(axis=0), axis=1) > ONSET_M).argmax())


def onset_window(demonstration: Demonstration, protocol: Protocol, after_s: float = 0.0) -> int:
    """Number of the first window of a trial whose newest frame comes `after_s` seconds after the motion's onset.

    It may lie beyond the last window, and is 0 where the motion began before there was a window.
    """
    frame = onset_frame(demonstration) + round(after_s * demonstration.rate_hz)
    return max(0, frame // protocol.keep_every - (protocol.window - 1))


def feature_windows(demonstration: Demonstration, protocol: Protocol) -> Iterator[FeatureWindow]:
    """The questions of a trial as the signals that perception would hand to inference, stamped from its start.

    Yields:
        N windows in the arm frame; `stamp_ns` is the time of the newest frame since the start of the trial.
    """
    rate_hz = demonstration.rate_hz / protocol.keep_every
    for index, features in enumerate(cut(demonstration, protocol).observed):
        stamp_ns = round((index + protocol.window - 1) / rate_hz * NANOSECONDS_PER_SECOND)
        yield FeatureWindow(stamp_ns, "arm", demonstration.observed_names, features)
