# SPDX-License-Identifier: Apache-2.0
"""The method without ROS: perception, inference and retargeting as pure stages, and how models are learned."""
