# SPDX-License-Identifier: Apache-2.0
"""Trials as tensors: padded to one length, bent a little each time, cut into windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from mild_core.compiled import compiled
from mild_core.inference.networks import Float32Array
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.windows import Protocol
from mild_core.learning.training.paired import repeated_by_others
from mild_core.learning.training.settings import Augmentation, Paired
from mild_core.shapes import FloatArray


@dataclass(frozen=True, eq=False)
class Tracks:
    """B trials at the recorded rate, padded at their ends with their last frame.

    Attributes:
        observed: (B, T, 3 J) positions [m].
        controlled: (B, T, J) joint angles [rad].
        alive: (B, T) whether the frame was recorded.
        label: (B,) place of the interaction among the corpus's.
    """

    observed: Tensor
    controlled: Tensor
    alive: Tensor
    label: Tensor

    def rows(self, chosen: Tensor) -> Tracks:
        """Some of the trials (n,), in that order."""
        return Tracks(self.observed[chosen], self.controlled[chosen], self.alive[chosen], self.label[chosen])


@dataclass(frozen=True, eq=False)
class WindowBatch:
    """N windows of each of B trials, every so many frames.

    Attributes:
        question: (B, N, W D) the human's.
        answer: (B, N, W J) the robot's.
        valid: (B, N) 1 where both were recorded, else 0: the first so many of each trial.
        label: (B,).
        first: Number of the first window; the others follow at the stride it was cut with.
    """

    question: Tensor
    answer: Tensor
    valid: Tensor
    label: Tensor
    first: int

    @cached_property
    def lengths(self) -> list[int]:
        """How many windows of each trial are valid, M in sum."""
        counts: list[int] = (self.valid > 0).sum(dim=1).tolist()
        return counts

    @cached_property
    def places(self) -> tuple[Tensor, Tensor]:
        """Trial (M,) and number in it (M,) of each valid window."""
        trial, number = torch.nonzero(self.valid, as_tuple=True)
        return trial, number

    def valid_of(self, values: Tensor) -> Tensor:
        """(B, N, ...) -> (M, ...), trial after trial: the others are not worth computing."""
        return values[self.places]


@dataclass(frozen=True, eq=False)
class Corpus:
    """What is learned from.

    Attributes:
        protocol: How trials are cut.
        rate_hz: Of the protocol's frames.
        interactions: By label.
        tracks: All trials.
        again: The same trials by other people, see `paired`: each of these like `tracks`.
        share: Of what is drawn that comes from `again`.
    """

    protocol: Protocol
    rate_hz: float
    interactions: tuple[str, ...]
    tracks: Tracks
    again: tuple[Tracks, ...] = ()
    share: float = 0.0

    @cached_property
    def everything(self) -> Tracks:
        """The trials as recorded, then by all others."""
        parts = (self.tracks, *self.again)
        names = ("observed", "controlled", "alive", "label")
        return Tracks(*(torch.cat([getattr(part, name) for part in parts]) for name in names))

    def drawn(self, copies: int) -> Tracks:
        """All trials so many times, each by a randomly drawn person. Draws from torch's global generator."""
        trials = torch.arange(len(self.tracks.label)).repeat(copies)
        if not self.again:
            return self.tracks.rows(trials)
        other = torch.rand(len(trials)) < self.share
        who = torch.where(other, torch.randint(len(self.again), (len(trials),)) + 1, 0)
        return self.everything.rows(trials + who * len(self.tracks.label))


def corpus_of(
    demonstrations: Sequence[Demonstration],
    protocol: Protocol,
    interactions: Sequence[str],
    paired: Paired | None = None,
    seed: int = 0,
) -> Corpus:
    """Put trials together, and by other people again where `paired` says how these differ.

    Raises:
        ValueError: There are none, or one shows an interaction that is not among `interactions`.
    """
    if not demonstrations:
        raise ValueError("there is no demonstration to learn from")
    rate_hz = demonstrations[0].rate_hz / protocol.keep_every
    again = repeated_by_others(demonstrations, paired, seed) if paired is not None else ()
    longest = max(d.frames for trials in (demonstrations, *again) for d in trials)
    tracks = tuple(_tracks(trials, interactions, longest) for trials in (demonstrations, *again))
    return Corpus(protocol, rate_hz, tuple(interactions), tracks[0], tracks[1:], paired.share if paired else 0.0)


def _tracks(demonstrations: Sequence[Demonstration], interactions: Sequence[str], longest: int) -> Tracks:
    """Trials padded to the longest."""
    observed = torch.stack([_padded(d.observed_m.reshape(d.frames, -1), longest) for d in demonstrations])
    controlled = torch.stack([_padded(d.controlled.reshape(d.frames, -1), longest) for d in demonstrations])
    alive = torch.stack([torch.arange(longest) < d.frames for d in demonstrations])
    label = torch.tensor([list(interactions).index(d.interaction) for d in demonstrations])
    return Tracks(observed, controlled, alive, label)


def _padded(track: FloatArray, longest: int) -> Tensor:
    frames = torch.tensor(track, dtype=torch.float32)
    return torch.cat([frames, frames[-1:].expand(longest - len(frames), -1)])


def augment(tracks: Tracks, augmentation: Augmentation) -> Tracks:
    """Each trial `copies` times: at another speed, by a person of another size who stands a little differently.

    Both agents are bent in time together; what is done to the human's place and size leaves the robot alone.
    Draws from torch's global generator.
    """
    copies = augmentation.copies
    count, length = len(tracks.label) * copies, tracks.observed.shape[1]
    knots = torch.randn(count, 1, augmentation.knots) * augmentation.unsteadiness
    log_speed = functional.interpolate(knots, size=length, mode="linear", align_corners=True)[:, 0]
    log_speed = log_speed + _uniform(count, augmentation.speed)[:, None]
    times = torch.cumsum(torch.exp(log_speed), dim=1)
    times = times - times[:, :1]
    last = tracks.alive.sum(dim=1).repeat(copies)[:, None] - 1
    alive, times = times <= last, torch.minimum(times, last.to(times.dtype))
    scale, yaw = 1 + _uniform(count, augmentation.arm_scale), _uniform(count, augmentation.yaw_rad)
    turned = torch.stack([scale * torch.cos(yaw), scale * torch.sin(yaw), scale], dim=1).numpy()
    moved = (augmentation.offset_m * torch.randn(count, tracks.observed.shape[2])).numpy()
    observed = torch.empty(count, *tracks.observed.shape[1:])
    controlled = torch.empty(count, *tracks.controlled.shape[1:])
    resample(tracks.controlled.numpy(), times.numpy(), controlled.numpy())
    resample(tracks.observed.numpy(), times.numpy(), observed.numpy())
    turn_and_move(observed.numpy(), turned, moved)
    return Tracks(observed, controlled, alive, tracks.label.repeat(copies))


def _uniform(count: int, bound: float) -> Tensor:
    return (torch.rand(count) * 2 - 1) * bound


@compiled
def resample(tracks: Float32Array, times: Float32Array, bent: Float32Array) -> None:
    """Fill `bent` (C B, T, D) with tracks (B, T, D), copy after copy, at `times` (C B, T) [frames], between frames."""
    length = tracks.shape[1]
    for copy in range(times.shape[0]):
        track = tracks[copy % tracks.shape[0]]
        for t in range(length):
            before = min(int(times[copy, t]), length - 2)
            share = times[copy, t] - np.float32(before)
            for d in range(tracks.shape[2]):
                bent[copy, t, d] = track[before, d] + share * (track[before + 1, d] - track[before, d])


@compiled
def turn_and_move(positions: Float32Array, turned: Float32Array, moved: Float32Array) -> None:
    """Scale positions (B, T, 3 J), turn them about z, and move each joint, in place.

    Args:
        positions: x, y, z of each joint [m].
        turned: (B, 3) cosine and sine of the turn times the scale, and the scale.
        moved: (B, 3 J) [m].
    """
    for b in range(positions.shape[0]):
        cosine, sine, scale = turned[b]
        for t in range(positions.shape[1]):
            for x in range(0, positions.shape[2], 3):
                forward, left = positions[b, t, x], positions[b, t, x + 1]
                positions[b, t, x] = cosine * forward - sine * left + moved[b, x]
                positions[b, t, x + 1] = sine * forward + cosine * left + moved[b, x + 1]
                positions[b, t, x + 2] = scale * positions[b, t, x + 2] + moved[b, x + 2]


def cut_tracks(corpus: Corpus, tracks: Tracks, first: int, stride: int, phase: int = 0) -> WindowBatch:
    """Windows number `first`, `first` + `stride`, … of each trial; the tensors' counterpart of `windows.cut`.

    Args:
        corpus: Says how.
        tracks: Its trials, bent or as recorded.
        first: Number of the first window.
        stride: Windows from one to the next.
        phase: First frame that thinning keeps, less than the protocol's `keep_every`.
    """
    protocol = corpus.protocol
    # As `windows.thin`: a frame is kept when the frames up to the next kept one were recorded as well.
    alive = tracks.alive[:, phase + protocol.keep_every - 1 :: protocol.keep_every]
    kept = slice(phase, phase + alive.shape[1] * protocol.keep_every, protocol.keep_every)
    observed, controlled = tracks.observed[:, kept], tracks.controlled[:, kept]
    if protocol.features == "positions_velocities":
        velocities = torch.diff(observed, dim=1, prepend=observed[:, :1]) * corpus.rate_hz
        observed = torch.cat([observed, velocities], dim=-1)
    width = protocol.window
    answered = width - 1 + protocol.lead_frames
    reach = max(0, protocol.lead_frames + width - 1)
    question = _unfolded(observed[:, first : observed.shape[1] - reach], width, stride)
    answer = _unfolded(controlled[:, first + answered :], width, stride)
    valid = alive[:, first + width - 1 + reach :: stride].to(torch.float32)
    count = valid.shape[1]
    return WindowBatch(question[:, :count], answer[:, :count], valid, tracks.label, first)


def _unfolded(track: Tensor, width: int, stride: int) -> Tensor:
    """(B, T, D) -> (B, N, width D), oldest frame first."""
    return track.unfold(1, width, stride).transpose(2, 3).flatten(2)
