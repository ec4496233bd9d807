# SPDX-License-Identifier: Apache-2.0
"""Text for terminals."""

from __future__ import annotations

import io
import sys


def show_any_text() -> None:
    """Let standard output and error replace what their encoding cannot show: a latin-1 terminal has no check mark."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
