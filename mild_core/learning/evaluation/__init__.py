# SPDX-License-Identifier: Apache-2.0
"""Evaluation: a method and trials that it has not learned from in, errors with their intervals out."""
