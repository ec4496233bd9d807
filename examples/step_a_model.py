# SPDX-License-Identifier: Apache-2.0
"""Load a model and step it without ROS: a person raises a hand, the model predicts the robot's next second."""

import numpy as np

from mild_core import Inference, Perception, SkeletonFrame, load_model, perception_settings

HANGING = np.array([[0.0, 0.0, 1.4], [0.0, -0.03, 1.1], [0.08, -0.03, 0.78]])  # right shoulder, elbow, hand [m]
RAISED = np.array([[0.0, 0.0, 1.4], [0.18, -0.05, 1.16], [0.48, 0.02, 1.22]])  # x forward, y left, z up
NAMES = ("right_shoulder", "right_elbow", "right_hand")
RATE_HZ = 30.0


def skeletons(seconds: float) -> list[SkeletonFrame]:
    """Stand still for two seconds, then raise the hand; measured with a millimetre of noise."""
    rng, frames = np.random.default_rng(0), []
    for time_s in np.arange(0.0, seconds, 1.0 / RATE_HZ):
        raised = 0.5 - 0.5 * np.cos(np.pi * np.clip(time_s - 2.0, 0.0, 1.0))
        arm_m = HANGING + raised * (RAISED - HANGING) + rng.normal(0.0, 0.001, (3, 3))
        frames.append(SkeletonFrame(1_000_000_000 + int(time_s * 1e9), "camera", 1, NAMES, arm_m, np.ones(3)))
    return frames


def main() -> None:
    """Print what the model predicts, four times a second."""
    model = load_model("yumi_buetepage_ahead")
    perception = Perception(perception_settings(model.manifest, axes="given"))
    inference = Inference(model, "handshake")
    seen, state = perception.init(), inference.init()
    for number, frame in enumerate(skeletons(4.0)):
        seen, windows = perception.step(seen, (frame,), frame.stamp_ns)
        for window in windows:
            state, (motion,) = inference.step(state, window, frame.stamp_ns)
            if number % 8 == 0:
                print(motion.state, motion.belief.round(2), "ends at", motion.positions[-1].round(2), "rad")


if __name__ == "__main__":
    main()
