# SPDX-License-Identifier: Apache-2.0
"""`mild`: offline work, one file per command. Only the wanted command is imported, so each starts as fast as it can."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Any

import typer

from mild_core.errors import MildError, SetupError
from mild_core.printable import printable_lines
from mild_ros.environment.local_dds import OPTION, keep_to_this_machine
from mild_ros.node_kit.libraries import unusable
from mild_ros.node_kit.terminal import show_any_text

COMMANDS = {
    "demo": "Runs the whole system on a shipped bag with a simulated robot and shows the result.",
    "replay": "Replays a bag, or a trial of a dataset, through the pipeline.",
    "view": "Shows a recorded run in a 3-D page.",
    "models": "Lists the models with their training data and errors.",
    "robot": "Proposes a robot file from a URDF alone, with a picture and what to check.",
    "camera": "Finds where the camera is: you hold your hand at the robot's tool.",
    "doctor": "Checks Python, ROS 2 and the network of this machine and says what to fix.",
    "run": "Starts a node, as `ros2 run` does.",
    "launch": "Starts all nodes of a live, simulated or replayed system, as `ros2 launch` does.",
    "record": "Records topics into a bag.",
    "status": "Shows nodes, mode, rates, latency and alarms on one screen.",
    "hold": "Stops every robot smoothly at once, until it is released.",
    "enable": "Lets robots follow, or with --off stops them and sends no more commands.",
    "reset": "Forgets the person; the robot stops smoothly and goes home.",
    "pause": "Pauses a running replay, or resumes it with --off.",
    "label": "Labels the interaction that starts now, in a recording for training.",
    "faults": "Injects faults around real nodes and checks the commands.",
    "benchmark": "Lets simulated people meet a robot and counts how often hands are met.",
    "data": "Lists public recordings with licence and size, and fetches them.",
    "measure": "Runs the benches behind the figures that README and docs print.",
    "demonstrations": "Cuts recorded bags into labelled trials for training.",
    "train": "Trains a model from demonstrations.",
    "evaluate": "Measures a model's error per interaction, or cross-validates it beside the baselines.",
    "plot": "Draws the figures and tables of a paper from a model or from measured errors.",
}
"""Each is the function of that name in the module of that name, which may set click's `CONTEXT_SETTINGS` of it.

The text is what `mild --help` says of it.
"""

MODULES = {
    "launch": "run",
    "record": "run",
    "pause": "operate",
    "label": "operate",
    "status": "operate",
    "hold": "operate",
    "enable": "operate",
    "reset": "operate",
}
"""Commands that share a module with others."""

LOCAL = ("demo", "replay", "faults")
"""They start all nodes that they talk to, on this machine; with `--local` any command keeps to it."""

EXIT_SET_UP, EXIT_INTERRUPTED = 2, 130

USAGE_ERROR: type[Exception] = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "UsageError")
"""Of click, which typer brings or wants, by its version."""

FULL = (errno.ENOSPC, errno.EDQUOT)
"""What a disk without room says."""


def _say(line: str) -> None:
    print(printable_lines(f"mild: {line}"), file=sys.stderr)


def _in_one_line(command: Callable[..., Any]) -> Callable[..., None]:
    """`command`, its faults printed in one line: the only place where the command line catches them."""

    @wraps(command)
    def reporting(*arguments: object, **options: object) -> None:
        try:
            _check_writable(options.get("out"))
            command(*arguments, **options)
        except MildError as error:
            _say(str(error))
        except ImportError as error:
            _say(str(unusable(error)))
        except KeyboardInterrupt:
            _say("interrupted")
            raise typer.Exit(EXIT_INTERRUPTED) from None
        except OSError as error:
            # Faults of the disk belong to the user, all others to us, and those show where they come from.
            if error.filename is None and error.errno not in FULL:
                raise
            _say(f"{error.filename or 'the disk'}: {error.strerror}" + "; make room on it" * (error.errno in FULL))
        else:
            return
        raise typer.Exit(EXIT_SET_UP)

    return reporting


def _check_writable(out: object) -> None:
    """Make sure, before a command begins, that what is to be written finds a folder.

    Args:
        out: What was given as `--out`: a folder or a file, there or not.

    Raises:
        SetupError: It does not.
    """
    if not isinstance(out, Path):
        return
    place = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.exists())
    if place.is_file() and place != out.absolute():
        raise SetupError(f"--out {out}", f"{place} is no folder", "choose another place")
    if not os.access(place, os.W_OK, effective_ids=True):  # as writing will be judged
        raise SetupError(f"--out {out}", f"{place} cannot be written", "choose a folder of yours")


def _not_imported() -> None:
    """Placeholder in the list of `--help` for a command that is not called."""
    raise AssertionError("a command was called that was not asked for")


def assemble(wanted: str | None) -> typer.Typer:
    """The command line with the `wanted` command imported and the others listed.

    Args:
        wanted: A name in `COMMANDS`; any other, or None, imports nothing.
    """
    app = typer.Typer(
        name="mild",
        help="A person's movement in, a robot's movement out. `mild COMMAND --help` for more, with examples.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="markdown",
    )
    app.callback()(lambda: None)
    for name, summary in COMMANDS.items():
        if name != wanted:
            app.command(name, help=summary)(_not_imported)
            continue
        module = import_module(f"mild_ros.command_line.{MODULES.get(name, name)}")
        command, settings = getattr(module, name), getattr(module, "CONTEXT_SETTINGS", {}).get(name)
        if isinstance(command, typer.Typer):
            for part in command.registered_commands:
                part.callback = _in_one_line(part.callback) if part.callback else None
            app.add_typer(command, name=name, short_help=summary)
        else:
            app.command(name, short_help=summary, context_settings=settings)(_in_one_line(command))
    return app


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; ends the program.

    Args:
        arguments: Without the program's name; those of the process by default.
    """
    show_any_text()
    given = list(sys.argv[1:] if arguments is None else arguments)
    wanted = next((word for word in given if not word.startswith("-")), None)
    if OPTION in given or wanted in LOCAL:
        given = [word for word in given if word != OPTION]
        keep_to_this_machine()
    try:
        app = assemble(wanted)
        code = app(args=given, prog_name="mild", standalone_mode=False)
    except ImportError as error:
        _say(str(unusable(error)))
        raise SystemExit(EXIT_SET_UP) from None
    except USAGE_ERROR as error:
        if line := _of_usage(error, given):
            _say(line)
        raise SystemExit(EXIT_SET_UP) from None
    except typer.Abort:
        _say("interrupted")
        raise SystemExit(EXIT_INTERRUPTED) from None
    raise SystemExit(code if isinstance(code, int) else 0)


def _of_usage(error: Any, given: Sequence[str]) -> str:
    """What is wrong with a command line and what works, in one line; "" where help was shown in its place."""
    said = error.format_message().partition(" (Possible")[0].partition(" Did you mean")[0].rstrip(".")
    if not said or "\n" in said:
        return ""
    command = error.ctx.command if error.ctx else None
    path = " ".join(error.ctx.command_path.split()[1:]) if error.ctx else next(iter(given), "")
    options = [name for one in getattr(command, "params", ()) for name in one.opts]
    # The words that it complains of are in what it says, and in no other way.
    blamed = [word for word in given if re.search(rf"(?<![\w-]){re.escape(word)}(?![\w-])", said)]
    word = max(blamed, key=len, default="")
    name, sign, value = word.partition(":=")
    known = options if word.startswith("-") else list(getattr(command, "commands", ()))
    close = get_close_matches(word.partition("=")[0], known, n=1)
    if sign and "-p" in options:
        remedy = f"write -p {word}"
    elif sign and f"--{name}" in options:
        remedy = f"write --{name} {value}"
    elif close and close != [word]:
        remedy = f"did you mean '{close[0]}'?"
    elif known and word and not word.startswith("-"):
        remedy = f"there are {', '.join(known)}"
    else:
        remedy = f"see mild {path} --help".replace("  ", " ")
    return f"{path or 'command line'}: {said[:1].lower()}{said[1:]}; {remedy}"


if __name__ == "__main__":
    main()
