# SPDX-License-Identifier: Apache-2.0
"""How each kind of topic is delivered."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo


def _keep_last(depth: int, reliability: ReliabilityPolicy, durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=durability)


SENSOR = _keep_last(50, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)
"""Skeletons and joint states: matches every publisher, and a pause of a quarter of a second at 200 Hz loses nothing.
With depth 1, a pause of 40 ms did."""

BETWEEN_STAGES = _keep_last(50, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
"""Feature windows and motions: every one arrives, in order."""

COMMAND = _keep_last(1, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
"""Commands: only the newest matters."""

HANDLED = _keep_last(1000, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
"""What became of each input: a replay counts them."""

LATCHED = _keep_last(1, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
"""What changes rarely: who subscribes later gets the last one."""

STATIC_TRANSFORMS = _keep_last(100, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
"""`/tf_static`: the last message of each of its publishers, for who comes late too."""

CLOCK = _keep_last(50, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)
"""`/clock` of a simulation or a replay."""

STATE = _keep_last(10, ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
"""Where the robot is: matches subscribers that ask for reliable delivery and those that do not."""


SERVICE = QoSProfile(
    history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE
)
"""Services of the operator: with ROS's default, the newest ten, 3,000 calls at once got some forty answers."""


def is_latched(offers: Sequence[TopicEndpointInfo]) -> bool:
    """Whether every publisher of a topic is latched (transient local)."""
    return bool(offers) and all(o.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL for o in offers)


def as_offered(offer: TopicEndpointInfo, depth: int) -> QoSProfile:
    """The strictest that this publisher of a topic meets."""
    reliable = offer.qos_profile.reliability is ReliabilityPolicy.RELIABLE
    return _keep_last(
        depth,
        ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        DurabilityPolicy.TRANSIENT_LOCAL if is_latched([offer]) else DurabilityPolicy.VOLATILE,
    )
