# SPDX-License-Identifier: Apache-2.0
"""Writing an mcap bag so that a kill or a full disk costs at most the last second.

rosbags writes the records; this adds what a recording robot needs: chunks go to the disk at every flush, a write
that fails half way is cut off again, and a reserve of disk space is kept for a proper ending.
"""

from __future__ import annotations

import errno
import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys.store import Typestore

from mild_core.errors import BagError
from mild_ros.bag.parts import Part, continued, list_parts, set_aside
from mild_ros.bag.reader import jazzy_types

RESERVE_BYTES = 3 * 2**20
"""Room for the chunk in memory (at most 1 MiB and one message) and the index: kept free for the ending."""

_FOREVER = QosTime(2147483647, 4294967295)


class BagWriter:
    """A new bag in mcap with zstd; made by `create_bag`.

    Attributes:
        path: Its folder.
        types: Of what is written.
        counts: Messages written by topic.
    """

    def __init__(self, path: Path, *, durable: bool, split_bytes: int, types: Typestore) -> None:
        self.path = path
        self.types = types
        self.counts: dict[str, int] = {}
        self._split_bytes = split_bytes
        self._parts: list[Part] = []
        self._connections: dict[str, Connection] = {}
        self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()
        assert isinstance(self._writer.storage, McapWriter)
        self._begin_file(self._writer.storage)
        self._open = True
        self._reserve = path / ".reserve"
        if durable:
            with self._reserve.open("wb") as reserve:
                os.posix_fallocate(reserve.fileno(), 0, RESERVE_BYTES)

    def _begin_file(self, storage: McapWriter) -> None:
        """Write to `storage` from now on."""
        self._storage = self._writer.storage = storage
        self._file = _WholeWrites(storage.path, storage.bio)
        storage.bio = self._file  # type: ignore[assignment] # a binary file as good as the one it replaces
        self._whole = self._file.tell()

    def add_topic(self, topic: str, type_name: str, *, transient_local: bool = False) -> None:
        """Announce a topic; `write` does it by itself for topics of the usual kind."""
        if topic in self._connections:
            return
        qos = Qos(
            QosHistory.KEEP_LAST,
            10,
            QosReliability.RELIABLE,
            QosDurability.TRANSIENT_LOCAL if transient_local else QosDurability.VOLATILE,
            _FOREVER,
            _FOREVER,
            QosLiveliness.AUTOMATIC,
            _FOREVER,
            False,
        )
        self._connections[topic] = self._writer.add_connection(
            topic, type_name, typestore=self.types, offered_qos_profiles=[qos]
        )
        self.counts[topic] = 0

    def write(self, topic: str, type_name: str, time_ns: int, data: bytes) -> None:
        """Add one message as CDR bytes; does nothing once the bag has ended.

        Raises:
            BagError: The disk refused it; the bag has been ended with what it had.
        """
        if not self._open:
            return
        self.add_topic(topic, type_name)
        with self._or_rescue():
            self._split_if_full()
            self._writer.write(self._connections[topic], time_ns, data)
            self.counts[topic] += 1
            self._whole = self._file.tell()  # moves only when a chunk was full, and then by the whole of it

    def flush(self) -> None:
        """Bring everything so far to the disk as one whole chunk: a kill after this loses none of it.

        Raises:
            BagError: As for `write`.
        """
        if not self._open:
            return
        self._check_place()
        with self._or_rescue():
            if self._storage.chunk.bio.tell():
                self._storage.close_chunk()
            os.fsync(self._file.fileno())
            self._whole = self._file.tell()

    def close(self) -> None:
        """End the bag with its index and metadata; does nothing the second time.

        Raises:
            BagError: As for `write`.
        """
        if not self._open:
            return
        self._check_place()
        self._reserve.unlink(missing_ok=True)
        with self._or_rescue():
            self._end()
            self._open = False

    def _split_if_full(self) -> None:
        """End this file and go on in the next when it is as long as it may be; a part is whole by itself."""
        if not self._split_bytes or self._whole < self._split_bytes:
            return
        self._check_place()
        before = self._storage
        before.close(self._writer.version, "{}")
        self._parts.append(set_aside(before, len(self._parts)))
        self._begin_file(continued(before))

    def _end(self) -> None:
        """End the last file and write metadata.yaml, of all files."""
        last = self._storage
        self._writer.close()
        if self._parts:
            list_parts(self._writer.metapath, [*self._parts, set_aside(last, len(self._parts))])

    def _check_place(self) -> None:
        """Make sure that the file written to is still the one of that name: another program may remove the folder.

        Raises:
            BagError: It is not; nothing is written in its place, wherever that may lead now.
        """
        own = os.fstat(self._file.fileno())
        try:
            folder, file = os.lstat(self.path), os.lstat(self._storage.path)
        except OSError:
            pass
        else:
            if stat.S_ISDIR(folder.st_mode) and (file.st_dev, file.st_ino) == (own.st_dev, own.st_ino):
                return
        self._open, self.counts = False, {}
        self._file.close()
        remedy = "its messages are lost with it; if it was moved, --salvage reads what was flushed"
        raise BagError(str(self.path), "was removed or replaced while it was written", remedy)

    @contextmanager
    def _or_rescue(self) -> Iterator[None]:
        """Turn a disk's refusal into one line, after saving what can be saved."""
        try:
            yield
        except OSError as error:
            self._check_place()
            kept = self._rescue()
            total = sum(self.counts.values())
            what = f"the first {total} messages are kept" if kept else "what was flushed is kept, --salvage reads it"
            remedy = f"{what}; make room and record again"
            raise BagError(str(self.path), f"{_reason(error)} while writing", remedy) from None

    def _rescue(self) -> bool:
        """Cut off the half-written record and end the bag in the reserved space; False when that fails too."""
        self._open = False
        self._reserve.unlink(missing_ok=True)
        # The message that met the full disk is in the chunk, but not yet in the counts.
        parts = [*(part.counts for part in self._parts), self._storage.channel_stats]
        self._writer.counts.update({number: sum(part.get(number, 0) for part in parts) for number in parts[-1]})
        self.counts = {topic: self._writer.counts[each.id] for topic, each in self._connections.items()}
        try:
            self._file.cut(self._whole)
            self._end()
        except OSError:
            with suppress(OSError):
                self._file.cut(self._whole)
            with suppress(OSError):
                self._file.close()
            (self.path / "metadata.yaml.tmp").unlink(missing_ok=True)
            return False
        return True


@contextmanager
def create_bag(
    path: Path | str, *, durable: bool = False, split_bytes: int = 0, types: Typestore | None = None
) -> Iterator[BagWriter]:
    """Write a new bag; it is ended properly however the block is left.

    Args:
        path: The folder to make; must not exist.
        durable: Keep disk space in reserve for a proper ending on a full disk (for live recording).
        split_bytes: Begin a new file when one is so long; 0 for never.
        types: Of what will be written; None for those of ROS 2 Jazzy.

    Raises:
        BagError: The folder exists or cannot be made, or the disk is full; what was written is kept.
    """
    path = Path(path)
    if path.exists():
        raise BagError(str(path), "exists already", "choose a new folder or remove this one")
    try:
        writer = BagWriter(path, durable=durable, split_bytes=split_bytes, types=types or jazzy_types())
    except (OSError, WriterError) as error:
        raise BagError(str(path), f"cannot be written ({_reason(error)})", "check the folder and the disk") from None
    try:
        yield writer
    finally:
        writer.close()


def _reason(error: Any) -> str:
    if isinstance(error, OSError):
        return "the disk is full" if error.errno in (errno.ENOSPC, errno.EDQUOT) else str(error.strerror)
    return str(error)


class _WholeWrites(io.RawIOBase):
    """An unbuffered file whose `write` either writes all or raises, so that the file's length is always known."""

    def __init__(self, path: Path, replaced: Any) -> None:
        super().__init__()
        replaced.close()
        self._raw = path.open("r+b", buffering=0)
        self._raw.seek(0, os.SEEK_END)

    def write(self, data: Any) -> int:
        """Write all of `data`."""
        done = 0
        try:
            with memoryview(data) as given, given.cast("B") as view:
                while done < len(view):
                    with view[done:] as rest:
                        done += self._raw.write(rest) or 0
        except OSError:
            if isinstance(data, memoryview):
                data.release()  # Python 3.12.1 dies collecting a view that a traceback has kept
            raise
        return done

    def tell(self) -> int:
        """Position, which is the length."""
        return self._raw.tell()

    def fileno(self) -> int:
        """The descriptor, for fsync."""
        return self._raw.fileno()

    def cut(self, length: int) -> None:
        """Forget everything after `length` bytes."""
        self._raw.truncate(length)
        self._raw.seek(length)

    def close(self) -> None:
        """Close the file."""
        self._raw.close()
        super().close()
