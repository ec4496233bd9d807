# SPDX-License-Identifier: Apache-2.0
"""What may go wrong around the nodes, done to them on purpose, and a judge of what the robot does then."""
