# SPDX-License-Identifier: Apache-2.0
"""What `ros2 launch` and `mild launch` start: one table of nodes in, processes out."""
