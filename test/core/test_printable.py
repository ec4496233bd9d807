# SPDX-License-Identifier: Apache-2.0
"""Foreign text reaches no log and no terminal raw."""

from __future__ import annotations

import pickle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mild_core.errors import PROBLEM_LIMIT, THING_LIMIT, BagError, DataError, SetupError, unknown_name
from mild_core.printable import LIMIT, printable, printable_lines

HOSTILE = {
    "red": "\x1b[31mred\x1b[0m",
    "erase": "\x1b[2J\x1b[H",
    "title": "\x1b]0;owned\x07",
    "c1": "\x9b31m",
    "forged line": "frame\n[ERROR] [forged]: all is lost",
    "carriage return": "good\rbad",
    "backwards": "\u202egnp.exe",
    "isolated": "\u2066a\u2069",
    "zero width": "arm\u200b",
    "separator": "a\u2028b\u2029c\x85d",
    "surrogate": "bad\udcff",
    "NUL": "a\0b",
    "tag": "\U000e0041",
    "long": "x" * 1_000_000,
    "long and hostile": "\x1b" * 1_000_000,
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_hostile_text_is_shown_harmless_and_short(text: str) -> None:
    bad_data = DataError("unknown_frame", f"people are in '{text}'")
    errors = (bad_data, BagError(text, text, text), unknown_name(text, text, ["yumi"]))
    for shown in (printable(text), printable_lines(text.replace("\n", "")), *(str(error) for error in errors)):
        assert shown.isprintable()
        assert not set(shown) & set("\u202e\u2066\u200b\u2028")
        assert len(shown) <= max(10 * LIMIT, THING_LIMIT + 2 * PROBLEM_LIMIT + 4)
        shown.encode("utf-8")
    assert bad_data.detail.isprintable()
    assert len(printable(text, 40)) <= 40


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.text(), st.integers(1, 50))
def test_any_text_is_printable_within_its_limit(text: str, limit: int) -> None:
    shown = printable(text, limit)
    assert shown.isprintable()
    assert len(shown) <= limit


@pytest.mark.parametrize("text", ["camera_link", "Bütepage 手 1.5 m → 0 °", "a b"])
def test_ordinary_text_stays_as_it_is(text: str) -> None:
    assert printable(text) == text


def test_lines_of_ours_stay_lines() -> None:
    assert printable_lines("one\ntwo\x1b[1m") == "one\ntwo\\x1b[1m"


def test_an_error_comes_back_whole_from_another_process() -> None:
    error = pickle.loads(pickle.dumps(SetupError("a\x1b", "b", "c")))
    assert (error.thing, str(error)) == ("a\x1b", "a\\x1b: b; c")
