# SPDX-License-Identifier: Apache-2.0
"""`mild data`: the recordings that models are learned from."""

from __future__ import annotations

import os
import shlex
import tempfile
import urllib.error
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.padding import Padding
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn
from rich.text import Text

from mild_core.errors import DatasetError
from mild_ros.command_line.console import Console

if TYPE_CHECKING:
    from mild_core.learning.data.recording import Recording

MADE, MADE_FOR, MADE_TRIALS = "kinematic_", ("yumi", "pepper"), 16
"""Data sets that are made here, the robots that they are made for, and trials of each interaction in them."""

NETWORK_PATIENCE_S = 20.0
CHUNK_BYTES = 1 << 16
LARGEST_DOWNLOAD = 100_000_000
"""Bytes, of a file whose size is not known: what its publisher's server gives at most."""


def data(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="A recording to fetch; without, all are listed.")] = "",
) -> None:
    """Recordings to learn from: what there is, under which licence, and how to get it.

        mild data

    Fetch one from its publisher into `$MILD_DATA`, or where that is not set into your data folder. The content is
    checked by its hash. Without a network, the command prints which file to put where:

        mild data buetepage_hr

    People of our own making, under this package's licence, as a folder of trials to learn from:

        mild data kinematic_yumi

    None of them is part of this package: each has its own licence. Your own recordings: `mild demonstrations --help`.
    """
    from mild_core.learning.data.recording import data_folder
    from mild_core.learning.datasets import DATASETS

    console = Console(highlight=False)
    if not name:
        _list(list(DATASETS.values()), console)
        for robot in MADE_FOR:
            console.print(Text(f"{MADE}{robot}", style="bold"), Text("made here: kinematic people, licence Apache-2.0"))
        console.print(Text(f"folder: {data_folder()} (MILD_DATA names another one)"))
        return
    if name not in DATASETS:
        from mild_core.errors import unknown_name

        made = {f"{MADE}{robot}": robot for robot in MADE_FOR}
        if name in made:
            _make(name, made[name], console)
            return
        raise unknown_name("recording", name, (*DATASETS, *made))
    recording = DATASETS[name]
    path = recording.default_path()
    if path.exists():
        console.print(Text(f"{path} is here already"))
        return
    if recording.download is None:
        raise DatasetError(
            name, "cannot be fetched", f"get it as its source says ({recording.source}); put it at {path}"
        )
    console.print(Text(f"{recording.title}; licence: {recording.licence}"))
    _fetch(recording, path, console)
    console.print(Text(f"{path}: {len(recording.read(path).train)} training trials"))


def _make(name: str, robot: str, console: Console) -> None:
    """Write a folder of made trials."""
    from mild_core.learning.data.recording import data_folder
    from mild_core.learning.data.trials import write_trials
    from mild_core.learning.training.kinematic_people import kinematic_trials
    from mild_core.retargeting.robots import ROBOTS

    folder = data_folder() / name
    trials, made = kinematic_trials(robot, ROBOTS[robot], MADE_TRIALS, seed=0)
    write_trials(folder, trials, made)
    train = shlex.join(["mild", "train", "--dataset", str(folder), "--people", "own", "--out", "my_model"])
    console.print(Text(f"{folder}: {len(made)} trials; {train}"))


def _list(recordings: list[Recording], console: Console) -> None:
    for one in recordings:
        size = f", {one.download.size_bytes / 1e6:.1f} MB" if one.download and one.download.size_bytes else ""
        here = "here" if one.default_path().exists() else "not here"
        console.print(Text(one.name, style="bold"), Text(f"{here}{size}"))
        for line in (one.title, f"licence: {one.licence}", f"source: {one.source}"):
            console.print(Padding(Text(line), (0, 0, 0, 2)))


def _fetch(recording: Recording, path: Path, console: Console) -> None:
    """Write the publisher's file to `path`, whole and with the right content, or not at all.

    Raises:
        DatasetError: The network does not give it, or gives something else.
    """
    download = recording.download
    assert download is not None
    by_hand = f"download {download.url} elsewhere and put it at {path}"
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TransferSpeedColumn())
    handle, part = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    most, size = download.size_bytes or LARGEST_DOWNLOAD, 0
    try:
        with os.fdopen(handle, "wb") as file, Progress(*columns, console=console, transient=True) as progress:
            task = progress.add_task(recording.name, total=download.size_bytes)
            with urllib.request.urlopen(download.url, timeout=NETWORK_PATIENCE_S) as answer:
                while size <= most and (chunk := answer.read(CHUNK_BYTES)):
                    file.write(chunk)
                    size += len(chunk)
                    progress.update(task, completed=size)
        if size > most or not download.is_content_of(Path(part)):
            known = f"the file of {download.size_bytes} bytes" if download.size_bytes else "its file"
            problem = f"its publisher sent {size} bytes that are not {known}"
            raise DatasetError(recording.name, problem, by_hand)
        Path(part).replace(path)
    except (urllib.error.URLError, TimeoutError, ConnectionError) as error:
        reason = getattr(error, "reason", error)
        raise DatasetError(recording.name, f"cannot be fetched ({reason})", by_hand) from None
    finally:
        Path(part).unlink(missing_ok=True)
