# SPDX-License-Identifier: Apache-2.0
"""The shell around mild_core: ROS 2 nodes, messages, bags, simulation and the command line."""
