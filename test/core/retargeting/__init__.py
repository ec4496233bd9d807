# SPDX-License-Identifier: Apache-2.0
"""Kinematics, limits, and what happens when input stops or is bad."""
