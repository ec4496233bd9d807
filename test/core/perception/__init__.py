# SPDX-License-Identifier: Apache-2.0
"""Perception against people of known geometry."""
