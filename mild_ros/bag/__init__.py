# SPDX-License-Identifier: Apache-2.0
"""Bags without ROS: any bag in, messages of today's types out; written so that a kill costs a second, and salvaged."""
