# SPDX-License-Identifier: Apache-2.0
"""A robot as geometry: its description in, kinematics, capsules and inverse kinematics out."""
