# SPDX-License-Identifier: Apache-2.0
"""The three questions: latency of a step, age of a command, error of a prediction; one script each."""
