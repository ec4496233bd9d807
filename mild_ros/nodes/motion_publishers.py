# SPDX-License-Identifier: Apache-2.0
"""Publishers of the predicted motion: for retargeting, people and tools."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64MultiArray, String

from mild_core.inference.manifest import Manifest
from mild_core.signals import MotionWindow
from mild_ros.messages.feature_window import feature_window_to_msg
from mild_ros.messages.motion import belief_to_msg, motion_state_to_msg, motion_to_msg, motion_type
from mild_ros.messages.person import person_to_msg
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.quality_of_service import BETWEEN_STAGES, LATCHED

if TYPE_CHECKING:
    from mild_core.pipeline import PipelineOutput


class MotionPublishers:
    """Publishers of a motion.

    Args:
        node: Who infers.
        manifest: Of the model: its interactions, and whether it moves joints or a partner's arm.
        diagnostics: Where the newest motion is reported too.
    """

    def __init__(self, node: Node, manifest: Manifest, diagnostics: Diagnostics) -> None:
        self._interactions, self._diagnostics = manifest.interactions, diagnostics
        self._newest_interaction: str | None = None
        self._motion = node.create_publisher(motion_type(manifest.controlled.kind), "motion", BETWEEN_STAGES)
        self._state = node.create_publisher(PointCloud2, "motion_state", BETWEEN_STAGES)
        self._belief = node.create_publisher(Float64MultiArray, "belief", BETWEEN_STAGES)
        self._interaction = node.create_publisher(String, "interaction", LATCHED)

    def publish_motion(self, motion: MotionWindow) -> None:
        """The pair of messages that retargeting takes."""
        self._motion.publish(motion_to_msg(motion))
        self._state.publish(motion_state_to_msg(motion, self._interactions))
        self._diagnostics.flowed("motion")

    def are_heard(self) -> bool:
        """Whether the pair has a subscriber."""
        return bool(self._motion.get_subscription_count() or self._state.get_subscription_count())

    def publish_recognition(self, motion: MotionWindow) -> None:
        """The belief; the interaction when it changes."""
        if self._belief.get_subscription_count():
            self._belief.publish(belief_to_msg(motion))
        if motion.interaction != self._newest_interaction:
            self._newest_interaction = motion.interaction
            self._interaction.publish(String(data=motion.interaction))
        self._diagnostics.facts.update(
            {
                "interaction": motion.interaction or "unknown",
                "probability": f"{motion.probability:.3f}",
                "phase": f"{motion.phase:.3f}",
                "out of distribution": f"{motion.out_of_distribution:.3f}",
            }
        )


class IntermediatePublishers:
    """What passes between the stages inside a pipeline, for those who listen: building it costs more than inferring it.

    Args:
        node: Who runs the pipeline.
        topics: Of the motion.
        wanted: Whether to publish windows and motions at all.
    """

    def __init__(self, node: Node, topics: MotionPublishers, wanted: bool) -> None:
        self._topics, self._wanted = topics, wanted
        self._windows = node.create_publisher(PointCloud2, "feature_window", BETWEEN_STAGES)
        self._person = node.create_publisher(PointCloud2, "person", BETWEEN_STAGES)

    def publish(self, output: PipelineOutput) -> None:
        """Publish what one input led to."""
        if self._wanted and output.windows and self._windows.get_subscription_count():
            for window in output.windows:
                self._windows.publish(feature_window_to_msg(window))
        if self._wanted and output.person is not None and self._person.get_subscription_count():
            self._person.publish(person_to_msg(output.person))
        if self._wanted and output.motions and self._topics.are_heard():
            for motion in output.motions:
                self._topics.publish_motion(motion)
        for motion in output.motions:
            self._topics.publish_recognition(motion)
