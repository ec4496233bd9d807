# SPDX-License-Identifier: Apache-2.0
"""The machine and DDS around the nodes: own processes in a clean environment, and what `mild doctor` looks at."""
