# SPDX-License-Identifier: Apache-2.0
"""The nodes, by themselves and together."""
