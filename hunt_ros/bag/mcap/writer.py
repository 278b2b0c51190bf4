"""
One MCAP file being written: chunks that reach the disk early, an index when it is closed.

What has been flushed is readable whatever happens next: schemas, channels and
notes stand in front of the chunks that need them, and every chunk carries its own
index and CRC.
"""

from __future__ import annotations

import fcntl
import os
import struct
import tempfile
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from io import FileIO
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.compression import compress
from hunt_ros.bag.mcap import format as fmt
from hunt_ros.bag.mcap.walk import Walk

#: Chunks are closed at this many bytes, before compression.
CHUNK_BYTES = 1 << 20

_ENTRY = struct.Struct('<QQ')
#: Bytes of a message index in front of its entries.
_INDEX_HEAD = 15


class Rows(NamedTuple):
    """
    Messages of one topic that are equally long.

    `log_ns` has shape (n,) int64, `messages` shape (n, bytes) uint8.
    """

    topic: int
    log_ns: NDArray[np.int64]
    messages: NDArray[np.uint8]


class McapWriter:
    """
    An MCAP file being written.

    Parameters
    ----------
    path : str or Path
        Must not exist.
    compression : '', 'lz4' or 'zstd'
    chunk_bytes : int
        Size at which a chunk is closed.

    Raises
    ------
    OSError
        Any method, where the disk refuses. A chunk is in the file whole or, after
        an error, cut off again.
    """

    def __init__(
        self, path: str | Path, compression: str = 'zstd', chunk_bytes: int = CHUNK_BYTES
    ) -> None:
        self._begin(path, 'xb', compression, chunk_bytes)
        self._put(fmt.MAGIC + fmt.record(fmt.HEADER, fmt.text('ros2'), fmt.text('hunt_ros')))

    def _begin(self, path: str | Path, mode: str, compression: str, chunk_bytes: int) -> None:
        """Open the file, lock it, and start with nothing in it."""
        self.path = Path(path)
        self.compression = compression
        self.chunk_bytes = chunk_bytes
        self.size = 0
        self.counts: Counter[int] = Counter()
        self.first_ns: int | None = None
        self.last_ns = 0
        self._file = open(self.path, mode, buffering=0)  # noqa: SIM115 - closed by close()
        # Held while the file is written, and let go by the system when the process dies:
        # so a later start can tell what a dead recorder left from what a live one writes.
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            pass  # a file system without locks
        self._schemas: dict[str, fmt.Schema] = {}
        self._channels: dict[int, fmt.Channel] = {}
        # As it goes into the summary, on the same disk, without a name: in memory it would grow
        # by 4 MB and more an hour, and to read it back from the chunks takes seconds.
        self._chunk_index = tempfile.TemporaryFile(buffering=0, dir=self.path.parent)  # noqa: SIM115
        self._chunk_count = 0
        self._metadata: list[tuple[int, int, str]] = []
        self._parts: list[bytes] = []
        self._filled = 0
        self._entries: dict[int, list[bytes]] = {}
        self._span: tuple[int, int] | None = None

    @classmethod
    def resume(cls, path: Path, walk: Walk, size: int) -> McapWriter:
        """
        Go on where a writer was killed.

        Parameters
        ----------
        path : Path
            Its file.
        walk : Walk
            What is in the first `size` bytes; every chunk with its message indexes.
        size : int
            The file is cut off here; the end of a record.
        """
        writer = cls.__new__(cls)
        writer._begin(
            path, 'r+b', walk.chunks[-1].compression if walk.chunks else 'zstd', CHUNK_BYTES
        )
        writer._schemas = {schema.name: schema for schema in walk.schemas.values()}
        writer._channels = dict(walk.channels)
        for chunk in walk.chunks:
            places = walk.indexes[chunk.offset]
            writer._add_chunk(
                fmt.ChunkIndex(
                    chunk.first_ns, chunk.last_ns, chunk.offset, chunk.end - chunk.offset,
                    {key: start - _INDEX_HEAD for key, (start, _) in places.items()},
                    sum(_INDEX_HEAD + count * _ENTRY.size for _, count in places.values()),
                    chunk.compression, chunk.stored, chunk.size,
                )
            )  # fmt: skip
        writer._chunk_count = len(walk.chunks)
        writer._metadata = list(walk.metadata_places)
        writer.counts = Counter(walk.counts)
        if walk.span_ns is not None:
            writer.first_ns, writer.last_ns = walk.span_ns
        writer.size = size
        writer._file.truncate(size)
        writer._file.seek(size)
        return writer

    def add_topic(
        self,
        key: int,
        topic: str,
        message_type: str,
        definition: str,
        metadata: Mapping[str, str],
        *,
        encoding: str = 'cdr',
        definition_encoding: str = 'ros2msg',
    ) -> None:
        """Describe a topic, before its first message; `key` is its number in this file."""
        head = b''
        if message_type not in self._schemas:
            form = definition_encoding if definition else ''
            schema = fmt.Schema(len(self._schemas) + 1, message_type, form, definition)
            self._schemas[message_type] = schema
            head = fmt.schema_record(schema)
        schema = self._schemas[message_type]
        channel = fmt.Channel(key, schema.id, topic, encoding, dict(metadata))
        self._channels[key] = channel
        self._put(head + fmt.channel_record(channel))

    def add_metadata(self, name: str, strings: Mapping[str, str]) -> None:
        """Write named strings, such as notes, at once."""
        raw = fmt.record(fmt.METADATA, fmt.text(name), fmt.text_map(strings))
        self._metadata.append((self.size, len(raw), name))
        self._put(raw)

    def add(self, topic: int, log_ns: int, message: bytes) -> None:
        """Add one message to the chunk at hand; a full chunk is written out."""
        head = fmt.RECORD.pack(fmt.MESSAGE, len(message) + fmt.MESSAGE_HEAD.size)
        sequence = (self.counts[topic] + len(self._entries.get(topic, ()))) & 0xFFFFFFFF
        head += fmt.MESSAGE_HEAD.pack(topic, sequence, log_ns, log_ns)
        self._entries.setdefault(topic, []).append(_ENTRY.pack(log_ns, self._filled))
        self._parts += (head, message)
        self._filled += len(head) + len(message)
        self._extend(log_ns, log_ns)
        if self._filled >= self.chunk_bytes:
            self.flush()

    def add_rows(self, several: Sequence[Rows]) -> None:
        """
        Add messages of several topics as one chunk, in the order of their log times.

        The chunk is built as a whole in numpy; what `add` collected before is written
        first.
        """
        several = [rows for rows in several if rows.log_ns.size]
        if not several:
            return
        self.flush()
        log_ns = np.concatenate([rows.log_ns for rows in several])
        sizes = [rows.messages.shape[1] + fmt.MESSAGE_PREFIX for rows in several]
        counts = [rows.log_ns.size for rows in several]
        order = np.argsort(log_ns, kind='stable')
        offsets = np.empty(log_ns.size, dtype=np.int64)
        sorted_sizes = np.repeat(sizes, counts)[order]
        offsets[order] = np.cumsum(sorted_sizes) - sorted_sizes
        chunk = np.empty(int(sorted_sizes.sum()), dtype=np.uint8)
        done = 0
        for rows, size, count in zip(several, sizes, counts, strict=True):
            places = offsets[done : done + count]
            chunk[places[:, None] + np.arange(size)] = self._records(rows, size)
            entries = np.empty((count, 2), dtype='<u8')
            entries[:, 0], entries[:, 1] = rows.log_ns, places
            in_time = entries[np.argsort(entries[:, 0], kind='stable')]
            self._entries.setdefault(rows.topic, []).append(in_time.tobytes())
            done += count
        self._extend(int(log_ns.min()), int(log_ns.max()))
        self._parts, self._filled = [chunk.tobytes()], chunk.size
        self.flush()

    def _records(self, rows: Rows, size: int) -> NDArray[np.uint8]:
        """Return the message records of rows, one in each row of bytes."""
        kind = np.dtype(
            [('op', 'u1'), ('length', '<u8'), ('topic', '<u2'), ('sequence', '<u4'),
             ('log', '<u8'), ('publish', '<u8'), ('message', 'u1', rows.messages.shape[1:])]
        )  # fmt: skip
        table = np.empty(rows.log_ns.size, dtype=kind)
        table['op'], table['length'], table['topic'] = fmt.MESSAGE, size - 9, rows.topic
        first = self.counts[rows.topic]
        table['sequence'] = (first + np.arange(rows.log_ns.size)) & 0xFFFFFFFF
        table['log'] = table['publish'] = rows.log_ns
        table['message'] = rows.messages
        return table.view(np.uint8).reshape(-1, size)

    def _extend(self, first_ns: int, last_ns: int) -> None:
        before = self._span or (first_ns, last_ns)
        self._span = (min(before[0], first_ns), max(before[1], last_ns))

    def flush(self) -> None:
        """Close the chunk at hand and hand it to the operating system."""
        if self._span is None:
            return
        raw = b''.join(self._parts)
        stored = compress(raw, self.compression)
        first, last = self._span
        head = (
            fmt.CHUNK_HEAD.pack(first, last, len(raw), zlib.crc32(raw), len(self.compression))
            + self.compression.encode()
        )
        chunk = fmt.record(fmt.CHUNK, head, struct.pack('<Q', len(stored)), stored)
        offsets: dict[int, int] = {}
        indexes: list[bytes] = []
        position = self.size + len(chunk)
        for topic, entries in self._entries.items():
            body = b''.join(entries)
            index = fmt.record(fmt.MESSAGE_INDEX, struct.pack('<HI', topic, len(body)), body)
            offsets[topic] = position
            indexes.append(index)
            position += len(index)
        before = self._chunk_index.tell()
        self._add_chunk(
            fmt.ChunkIndex(
                first, last, self.size, len(chunk), offsets, position - self.size - len(chunk),
                self.compression, len(stored), len(raw),
            )
        )  # fmt: skip
        try:
            self._put(chunk + b''.join(indexes))
        except OSError:
            self._chunk_index.truncate(before)
            self._chunk_index.seek(before)
            raise
        self._chunk_count += 1
        for topic, entries in self._entries.items():
            self.counts[topic] += sum(len(part) for part in entries) // _ENTRY.size
        self.first_ns = first if self.first_ns is None else min(self.first_ns, first)
        self.last_ns = max(self.last_ns, last)
        self._parts, self._filled, self._entries, self._span = [], 0, {}, None

    def _add_chunk(self, chunk: fmt.ChunkIndex) -> None:
        """Note a chunk for the summary; where the disk refuses, nothing of it."""
        before = self._chunk_index.tell()
        _write(self._chunk_index, fmt.chunk_index_record(chunk), before)

    @property
    def pending_bytes(self) -> int:
        """Bytes that are in the chunk at hand and not yet in the file."""
        return self._filled

    @property
    def span_ns(self) -> int:
        """Log time from the first message to the last, the chunk at hand included, ns."""
        firsts = [value for value in (self.first_ns, self._span and self._span[0]) if value]
        last = max(self.last_ns, self._span[1] if self._span else 0)
        return last - min(firsts) if firsts else 0

    def sync(self) -> None:
        """See what is in the file on the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Write what is left, the summary and the footer, and see them on the disk."""
        self.flush()
        self._put(fmt.record(fmt.DATA_END, struct.pack('<I', 0)))
        start = self.size
        self._chunk_index.seek(0)
        groups = [
            (fmt.SCHEMA, [fmt.schema_record(schema) for schema in self._schemas.values()]),
            (fmt.CHANNEL, [fmt.channel_record(channel) for channel in self._channels.values()]),
            (fmt.STATISTICS, [fmt.statistics_record(self._statistics())]),
            (fmt.CHUNK_INDEX, [self._chunk_index.read()]),
            (fmt.METADATA_INDEX, [_metadata_index(*place) for place in self._metadata]),
        ]
        summary, offsets = b'', b''
        for opcode, records in groups:
            body = b''.join(records)
            if body:
                place = struct.pack('<BQQ', opcode, start + len(summary), len(body))
                offsets += fmt.record(fmt.SUMMARY_OFFSET, place)
            summary += body
        offset_start = start + len(summary)
        summary += offsets + fmt.RECORD.pack(fmt.FOOTER, 20)
        summary += struct.pack('<QQ', start, offset_start)
        self._put(summary + struct.pack('<I', zlib.crc32(summary)) + fmt.MAGIC)
        os.fsync(self._file.fileno())
        self.abandon()

    def _statistics(self) -> fmt.Statistics:
        return fmt.Statistics(
            sum(self.counts.values()),
            len(self._schemas),
            len(self._channels),
            0,
            len(self._metadata),
            self._chunk_count,
            self.first_ns or 0,
            self.last_ns,
            {key: self.counts[key] for key in sorted(self._channels)},
        )

    def abandon(self) -> None:
        """Close the file as it is, without an index."""
        self._file.close()
        self._chunk_index.close()

    def _put(self, raw: bytes) -> None:
        """Write all of it, or, where the disk refuses, leave nothing of it."""
        _write(self._file, raw, self.size)
        self.size += len(raw)


def _write(file: IO[bytes] | FileIO, raw: bytes, end: int) -> None:
    """Write all of it at the end of a file, or, where the disk refuses, leave nothing of it."""
    view = memoryview(raw)
    try:
        while view:
            view = view[file.write(view) :]
    except OSError:
        file.truncate(end)
        file.seek(end)
        raise


def _metadata_index(offset: int, length: int, name: str) -> bytes:
    return fmt.record(fmt.METADATA_INDEX, struct.pack('<QQ', offset, length), fmt.text(name))
