# SPDX-License-Identifier: Apache-2.0
"""From what a tracker says to what a model sees: one person's arm, in its own frame, at the model's rate."""
