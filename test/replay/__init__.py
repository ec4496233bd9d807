# SPDX-License-Identifier: Apache-2.0
"""Bags, replay, recording and viewing."""
