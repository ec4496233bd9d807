# SPDX-License-Identifier: Apache-2.0
"""The whole messages of a broken sqlite3 bag, and of one whose recorder was killed with its journal still beside it."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from mild_ros.bag.budgets import CHUNK_BYTES, check_scratch, only_reading
from mild_ros.bag.salvage_found import Found, Loss, message_bytes

_BESIDE = ("", "-wal", "-journal")
"""sqlite3 keeps what it has not yet put into the file in these."""

_MISSES = 5000
"""So many rows in a row that cannot be read are the end."""

_LONGEST = 64
"""A file that is a smaller part of what its head says is not worth the search; the head may be broken too."""

_STEPS = 10**6
"""sqlite3's virtual machine may take so many steps for one query: a broken tree can lead round in a circle."""

_FAULTS = (sqlite3.Error, OverflowError, UnicodeDecodeError)
"""The last when even the words of the error are broken."""

Row = tuple[object, ...]


def sqlite_messages(file: Path, scratch: Path, loss: Loss) -> Iterator[Found]:
    """Messages in the order of their numbers, read from a copy in `scratch` so that the bag stays as it is."""
    scratch.mkdir()
    size = file.stat().st_size
    check_scratch(scratch, size, size)
    for ending in _BESIDE:
        beside = file.with_name(file.name + ending)
        if beside.is_file():
            shutil.copyfile(beside, scratch / beside.name)
    _pad(scratch / file.name)
    with closing(sqlite3.connect(scratch / file.name)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, CHUNK_BYTES)
        database.set_authorizer(only_reading)
        database.text_factory = lambda text: text.decode(errors="replace")
        topics = {row[0]: row[1:] for row in _rows(database, "SELECT id, name, type FROM topics")}
        texts = _rows(database, "SELECT topic_type, encoded_message_definition FROM message_definitions")
        definitions = dict(row for row in texts if len(row) == 2)
        if not topics:
            loss.unread_bytes += file.stat().st_size
        for row in _messages(database, loss) if topics else ():
            found = _found(row, topics, definitions)
            if found is None:
                loss.messages += 1
            else:
                yield found


def _pad(database: Path) -> None:
    """Make a file that was cut off as long as its head says: sqlite3 reads nothing at all of a shorter one.

    Half a page would be read as rows of zeros; it is left out.
    """
    with database.open("r+b") as file:
        head, size = file.read(32), file.seek(0, os.SEEK_END)
        page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
        page = 65536 if page == 1 else page
        if page and size < page * pages:
            file.truncate(size // page * page)
            file.truncate(min(page * pages, _LONGEST * size))


def _found(row: Row, topics: dict[object, Row], definitions: dict[object, object]) -> Found | None:
    """A row (topic's number, time, data) as a message; None when it is none: sqlite3 keeps anything in any column."""
    number, time_ns, data = row
    topic, type_name = topics.get(number, (None, None))
    if not (isinstance(topic, str) and isinstance(type_name, str) and isinstance(data, bytes)):
        return None
    message = message_bytes(data)
    if message is None or not isinstance(time_ns, int) or not 0 <= time_ns < 2**63:
        return None
    return Found(topic, type_name, str(definitions.get(type_name, "")), time_ns, message)


def _messages(database: sqlite3.Connection, loss: Loss) -> Iterator[Row]:
    """Topic, time and bytes of each row that can be read; those between them are counted as lost."""
    columns = "SELECT id, topic_id, timestamp, data FROM messages WHERE id"
    number = misses = 0
    while misses < _MISSES:
        try:
            # One by one: each row may be as long as the file.
            rows: Iterator[Row] = iter(_limited(database).execute(f"{columns} > ? ORDER BY id LIMIT 500", (number,)))
            row = next(rows, None)
            if row is None:
                return
        except _FAULTS:  # somewhere behind `number`: go on one by one
            number += 1
            rows = iter(_rows(database, f"{columns} = {number}"))
            row = next(rows, None)
            misses += row is None
        while row is not None:
            if not isinstance(row[0], int) or row[0] < number:
                return  # the order is broken: it would lead round in a circle
            number = row[0]
            loss.messages, misses = loss.messages + misses, 0
            yield row[1:]
            try:
                row = next(rows, None)
            except _FAULTS:
                break
    loss.messages += 1  # and perhaps more: how many follow what cannot be read is unknown


def _rows(database: sqlite3.Connection, query: str) -> list[Row]:
    """All rows of a query; none when it fails."""
    try:
        return _limited(database).execute(query).fetchall()
    except _FAULTS:
        return []


def _limited(database: sqlite3.Connection) -> sqlite3.Connection:
    """Let the next query run for a bounded number of steps."""
    database.set_progress_handler(lambda: 1, _STEPS)
    return database
