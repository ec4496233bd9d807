# SPDX-License-Identifier: Apache-2.0
"""Trials as tensors: padded to one length, bent a little each time, cut into windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from mild_core.learning.demonstration import Demonstration
from mild_core.learning.settings import Augmentation
from mild_core.learning.windows import Protocol
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


@dataclass(frozen=True, eq=False)
class WindowBatch:
    """N windows of each of B trials, every so many frames.

    Attributes:
        question: (B, N, W D) the human's.
        answer: (B, N, W J) the robot's.
        valid: (B, N) 1 where both were recorded, else 0.
        label: (B,).
        first: Number of the first window; the others follow at the stride it was cut with.
    """

    question: Tensor
    answer: Tensor
    valid: Tensor
    label: Tensor
    first: int


@dataclass(frozen=True, eq=False)
class Corpus:
    """What is learned from.

    Attributes:
        protocol: How trials are cut.
        rate_hz: Of the protocol's frames.
        interactions: By label.
        tracks: All trials.
    """

    protocol: Protocol
    rate_hz: float
    interactions: tuple[str, ...]
    tracks: Tracks


def corpus_of(demonstrations: Sequence[Demonstration], protocol: Protocol, interactions: Sequence[str]) -> Corpus:
    """Put trials together.

    Raises:
        ValueError: There are none, or one shows an interaction that is not among `interactions`.
    """
    if not demonstrations:
        raise ValueError("there is no demonstration to learn from")
    longest = max(d.frames for d in demonstrations)
    observed = torch.stack([_padded(d.observed_m.reshape(d.frames, -1), longest) for d in demonstrations])
    controlled = torch.stack([_padded(d.controlled.reshape(d.frames, -1), longest) for d in demonstrations])
    alive = torch.stack([torch.arange(longest) < d.frames for d in demonstrations])
    label = torch.tensor([list(interactions).index(d.interaction) for d in demonstrations])
    rate_hz = demonstrations[0].rate_hz / protocol.keep_every
    return Corpus(protocol, rate_hz, tuple(interactions), Tracks(observed, controlled, alive, label))


def _padded(track: FloatArray, longest: int) -> Tensor:
    frames = torch.tensor(track, dtype=torch.float32)
    return torch.cat([frames, frames[-1:].expand(longest - len(frames), -1)])


def bend(tracks: Tracks, augmentation: Augmentation) -> Tracks:
    """Each trial `copies` times: at another speed, by a person of another size who stands a little differently.

    Both agents are bent in time together; what is done to the human's place and size leaves the robot alone.
    Draws from torch's global generator.
    """
    copies = augmentation.copies
    count, length = len(tracks.label) * copies, tracks.observed.shape[1]
    knots = torch.randn(count, 1, augmentation.knots) * augmentation.unsteadiness
    log_speed = functional.interpolate(knots, size=length, mode="linear", align_corners=True)[:, 0]
    log_speed = log_speed + _uniform((count, 1), augmentation.speed)
    times = torch.cumsum(torch.exp(log_speed), dim=1)
    times = times - times[:, :1]
    last = tracks.alive.sum(dim=1).repeat(copies)[:, None] - 1
    alive, times = times <= last, torch.minimum(times, last.to(times.dtype))
    before = times.floor().long().clamp(max=length - 2)
    share = (times - before)[..., None]
    row = torch.arange(len(tracks.label)).repeat(copies)[:, None]
    both = torch.cat([tracks.observed, tracks.controlled], dim=-1)
    both = torch.lerp(both[row, before], both[row, before + 1], share)
    width = tracks.observed.shape[2]
    observed = both[..., :width] * (1 + _uniform((count, 1, 1), augmentation.arm_scale))
    observed = _turned(observed, _uniform((count, 1, 1), augmentation.yaw_rad))
    observed = observed + augmentation.offset_m * torch.randn(count, 1, width)
    return Tracks(observed, both[..., width:], alive, tracks.label.repeat(copies))


def _uniform(shape: tuple[int, ...], bound: float) -> Tensor:
    return (torch.rand(shape) * 2 - 1) * bound


def _turned(positions: Tensor, yaw: Tensor) -> Tensor:
    """Positions (..., 3 J) turned about z by `yaw` [rad], broadcast to (..., J)."""
    x, y, z = positions.reshape(*positions.shape[:-1], -1, 3).unbind(-1)
    cosine, sine = torch.cos(yaw), torch.sin(yaw)
    return torch.stack([cosine * x - sine * y, sine * x + cosine * y, z], dim=-1).flatten(-2)


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
