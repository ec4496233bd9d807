# SPDX-License-Identifier: Apache-2.0
"""`--help` shows every word of what is written for it: neither brackets nor anything else is taken for markup."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer

from mild_ros.command_line.main import COMMANDS, assemble


def commands(name: str) -> Iterator[tuple[list[str], Any]]:
    """A command, or each of its parts, with its words."""
    root: Any = typer.main.get_command(assemble(name))
    found = root.commands[name]
    if hasattr(found, "commands"):
        yield from (([name, part], command) for part, command in found.commands.items())
    else:
        yield [name], found


def bare(text: str) -> str:
    """A text without its layout: spaces, borders, and what Markdown means by stars and backticks."""
    return re.sub(r"[\s`*•│╭╮╰╯─]", "", re.sub(r"^- ", "", text, flags=re.MULTILINE))


def lost(shown: str, command: Any) -> list[str]:
    """What is written of a command and not shown."""
    written = [paragraph for paragraph in inspect.cleandoc(command.help or "").split("\n\n") if paragraph.strip()]
    written += [parameter.help for parameter in command.params if getattr(parameter, "help", None)]
    return [text for text in written if bare(text) not in bare(shown)]


def shown_by(words: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 2000)
    monkeypatch.setattr("typer.rich_utils.COLOR_SYSTEM", None)
    with pytest.raises(SystemExit) as ended:
        assemble(words[0])(args=[*words, "--help"], prog_name="mild")
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "run"])
def test_help_loses_nothing(name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for words, command in commands(name):
        assert lost(shown_by(words, capsys, monkeypatch), command) == [], words


@pytest.mark.parametrize("text", ["Where [default: <its name>].", "Read [red]this[/red].", "See [this](there)."])
def test_a_lost_word_is_noticed(text: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    app = typer.Typer(rich_markup_mode="markdown" if "red" not in text else "rich")
    app.command(help=text)(lambda: None)
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 2000)
    with pytest.raises(SystemExit):
        app(args=["--help"], prog_name="mild")
    assert lost(capsys.readouterr().out, typer.main.get_command(app)) == [text]
