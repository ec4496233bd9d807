# SPDX-License-Identifier: Apache-2.0
"""Signals to standard messages and back, one file each; reading only takes attributes, so bags work without ROS."""
