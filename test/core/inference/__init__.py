# SPDX-License-Identifier: Apache-2.0
"""Oracles, ladder and contract of the method's run time."""
