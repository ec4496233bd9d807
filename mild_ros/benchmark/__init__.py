# SPDX-License-Identifier: Apache-2.0
"""Simulated people meet a robot in physics; seeds go in, what happened and why it failed comes out.

Nothing of the people comes from a model or a recording: their motion is that of a human arm with published timing.
"""
