# SPDX-License-Identifier: Apache-2.0
"""From a predicted motion to joint commands that a robot can carry out."""
