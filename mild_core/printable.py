# SPDX-License-Identifier: Apache-2.0
"""Foreign text made fit for a log, a terminal or a diagnostic: it can neither command nor flood it.

Names of frames, joints, topics and folders come from others' messages and files. An escape sequence in one would colour
or erase a terminal, a line break would forge a line of the log, a mark of direction would show it backwards.
"""

from __future__ import annotations

LIMIT = 300
"""Characters that are shown of a text, unless something else is asked for."""

CUT = "…"


def printable(text: object, limit: int = LIMIT) -> str:
    """The text with what does not print as escapes, at most `limit` characters long.

    Args:
        text: Anything; `str` of it is taken.
        limit: Largest length; what is longer ends in "…".
    """
    whole = text if isinstance(text, str) else str(text)
    shown = whole[: limit + 1]
    if not shown.isprintable():  # no control, format (direction, zero width), surrogate, private or odd space in it
        shown = "".join([_shown(character) for character in shown])
    return shown if len(shown) <= limit else shown[: limit - 1] + CUT


def printable_lines(text: str, limit: int = 10 * LIMIT) -> str:
    """The same of a text of ours with several lines."""
    return "\n".join(printable(line, limit) for line in text[: 10 * limit].split("\n"))


def _shown(character: str) -> str:
    if character.isprintable():
        return character
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
