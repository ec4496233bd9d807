# SPDX-License-Identifier: Apache-2.0
"""A model folder with random weights, so that replay is tested whatever has been trained."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mild_core.inference.manifest import ControlledAgent, Manifest
from mild_core.inference.model import save_model
from mild_core.inference.start_pose import StartPose
from mild_core.retargeting.robots import ROBOTS
from mild_core.shapes import FloatArray
from test.core.inference.random_model import manifest, paper_member, random_arrays
from tools.scenes import SCENES, arm_track

YUMI = ControlledAgent("robot_joints", "yumi", ROBOTS["yumi"].joint_names, "rad")


def save_random_model(
    folder: Path, controlled: ControlledAgent = YUMI, about: FloatArray = ROBOTS["yumi"].home_rad, scale: float = 1.0
) -> Path:
    """A model of the paper's shape that knows the arm of our scenes and moves `controlled` about a frame of values."""
    of = manifest((paper_member(values=controlled.values),), components=6, controlled=controlled)
    arrays = random_arrays(of)
    windows = np.concatenate([_windows(arm_track(scene, of.rate_hz), of) for scene in SCENES])
    arrays["member_0.encoder.input.mean"] = windows.mean(axis=0)
    arrays["member_0.encoder.input.scale"] = windows.std(axis=0) + 0.05
    arrays["member_0.decoder.output.mean"] = np.tile(about, of.window)
    arrays["member_0.decoder.output.scale"] = np.full(of.controlled.values * of.window, scale)
    arrays["member_0.latent_radius"] = np.full(len(of.interactions), 100.0)  # everything is known
    if controlled.unit == "rad":  # the robot's start displaces what it does
        gains = np.tile(0.3 * np.eye(controlled.values), (len(of.interactions), 1, 1))
        mean = np.tile(about - 0.1, (len(of.interactions), 1))
        arrays |= StartPose(mean, np.array([2.0]), gains, 0.5 * gains, np.array([0.6]), np.array([0.25])).to_arrays()
    save_model(folder, of, arrays, "# Random\n\nNot trained.\n")
    return folder


def _windows(arm: FloatArray, of: Manifest) -> FloatArray:
    """(N, W D) of an arm with unit bones, given those of the model."""
    bones = np.diff(arm, axis=1) * np.array(of.observed.bone_lengths_m)[:, None]
    joints = np.concatenate([arm[:, :1], arm[:, :1] + np.cumsum(bones, axis=1)], axis=1)
    return np.stack([joints[i : i + of.window].ravel() for i in range(len(joints) - of.window)])
