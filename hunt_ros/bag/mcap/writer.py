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
from collections.abc import Mapping
from io import FileIO
from pathlib import Path
from typing import IO

import numpy as np
import zstandard
from mcap import records as peer
from mcap.opcode import Opcode

from hunt_ros.bag.blocks import Topic
from hunt_ros.bag.mcap import records as rec

_ENTRY = struct.Struct('<QQ')
_HEAD = struct.Struct(rec.RECORD.format + rec.MESSAGE_HEAD.format[1:])


class McapWriter:
    """
    An MCAP file being written.

    Parameters
    ----------
    path : str or Path
        Must not exist.

    Raises
    ------
    OSError
        Any method, where the disk refuses. A chunk is in the file whole or, after
        an error, cut off again.
    """

    #: Chunks are closed at this many bytes, before compression; and their compression, as MCAP
    #: names it.
    chunk_bytes = 1 << 20
    compression = 'zstd'

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.size = 0
        self.counts: Counter[int] = Counter()
        self.first_ns: int | None = None
        self.last_ns = 0
        self._file = open(self.path, 'xb', buffering=0)  # noqa: SIM115 - closed by close()
        # Held while the file is written, and let go by the system when the process dies:
        # so a later start can tell what a dead recorder left from what a live one writes.
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            pass  # a file system without locks
        self.schemas: dict[int, peer.Schema] = {}
        self.channels: dict[int, peer.Channel] = {}
        # As it goes into the summary, on the same disk, without a name: in memory it would grow
        # by 4 MB and more an hour, and to read it back from the chunks takes seconds.
        self._chunk_index = tempfile.TemporaryFile(buffering=0, dir=self.path.parent)  # noqa: SIM115
        self._chunk_count = 0
        self._metadata: list[peer.MetadataIndex] = []
        self._attachments: list[peer.AttachmentIndex] = []
        self._parts: list[bytes] = []
        self._filled = 0
        self._entries: dict[int, list[bytes]] = {}
        self._put(rec.MAGIC + rec.pack(peer.Header('ros2', 'hunt_ros')))

    def add_topic(self, topic: Topic) -> None:
        """Describe a topic, before its first message; its id is its number in this file."""
        form = topic.definition_encoding if topic.definition else ''
        told = topic.type, form, topic.definition.encode()
        known = {(one.name, one.encoding, one.data): one.id for one in self.schemas.values()}
        if told not in known and any(told):
            known[told] = max(self.schemas, default=0) + 1
            self.describe(peer.Schema(known[told], told[2], form, topic.type))
        strings = {'offered_qos_profiles': topic.qos, 'topic_type_hash': topic.type_hash}
        self.describe(
            peer.Channel(topic.id, topic.name, topic.encoding, strings, known.get(told, 0))
        )

    def describe(self, *records: peer.Schema | peer.Channel) -> None:
        """Write schemas and channels, as they are; they are repeated in the summary."""
        self.schemas |= {one.id: one for one in records if isinstance(one, peer.Schema)}
        self.channels |= {one.id: one for one in records if isinstance(one, peer.Channel)}
        self._put(rec.pack(*records))

    def add_metadata(self, name: str, strings: Mapping[str, str]) -> None:
        """Write named strings, such as notes, at once."""
        self.add_beside(rec.pack(peer.Metadata(name, dict(strings))))

    def add_beside(self, record: bytes) -> None:
        """Write a metadata, an attachment or a private record, as it is."""
        at = self.size, len(record)
        payload = record[rec.RECORD.size :]
        self._put(record)
        if record[0] == Opcode.METADATA:
            name = rec.unpack(peer.Metadata, payload).name
            self._metadata.append(peer.MetadataIndex(*at, name))
        elif record[0] == Opcode.ATTACHMENT:
            one = rec.unpack(peer.Attachment, payload)
            self._attachments.append(
                peer.AttachmentIndex(
                    *at, one.log_time, one.create_time, len(one.data), one.name, one.media_type
                )
            )

    def add(self, topic: int, log_ns: int, message: bytes) -> None:
        """Add one message to the chunk at hand; a full chunk is written out."""
        sequence = (self.counts[topic] + len(self._entries.get(topic, ()))) & 0xFFFFFFFF
        self.add_record(message, topic, sequence, log_ns, log_ns)

    def add_record(
        self, message: bytes, topic: int, sequence: int, log_ns: int, publish_ns: int
    ) -> None:
        """Add one message as MCAP has it."""
        self._entries.setdefault(topic, []).append(_ENTRY.pack(log_ns, self._filled))
        size = rec.MESSAGE_HEAD.size + len(message)
        head = _HEAD.pack(rec.MESSAGE, size, topic, sequence, log_ns, publish_ns)
        self._parts += (head, message)
        self._filled += _HEAD.size + len(message)
        if self._filled >= self.chunk_bytes:
            self.flush()

    @staticmethod
    def compress(raw: bytes) -> bytes:
        """Compress a chunk."""
        return zstandard.ZstdCompressor(level=1).compress(raw)

    def flush(self) -> None:
        """Close the chunk at hand and hand it to the operating system."""
        if not self._parts:
            return
        raw = b''.join(self._parts)
        stored = self.compress(raw)
        entries = {topic: b''.join(several) for topic, several in self._entries.items()}
        times = np.frombuffer(b''.join(entries.values()), '<u8')[::2]
        first, last = int(times.min()), int(times.max())
        chunk = peer.Chunk(self.compression, stored, last, first, zlib.crc32(raw), len(raw))
        self._put_chunk(rec.pack(chunk), entries)
        self._parts, self._filled, self._entries = [], 0, {}

    def add_chunk(self, raw: bytes, entries: Mapping[int, bytes]) -> None:
        """
        Write a chunk record as it is.

        Parameters
        ----------
        raw : bytes
            The record; what it holds is sound.
        entries : mapping of int to bytes
            By topic: (log time, offset) of each message in it, 8 bytes each.
        """
        self.flush()
        self._put_chunk(raw, entries)

    def _put_chunk(self, raw: bytes, entries: Mapping[int, bytes]) -> None:
        """Write a chunk with its message indexes, or nothing of it."""
        offsets: dict[int, int] = {}
        indexes: list[bytes] = []
        position = self.size + len(raw)
        for topic, body in entries.items():
            head = rec.RECORD.pack(Opcode.MESSAGE_INDEX, 6 + len(body))
            indexes.append(head + struct.pack('<HI', topic, len(body)) + body)
            offsets[topic] = position
            position += len(indexes[-1])
        chunk = rec.unpack_chunk(raw, 0, len(raw) - rec.RECORD.size)
        index = peer.ChunkIndex(
            chunk_length=len(raw),
            chunk_start_offset=self.size,
            compression=chunk.compression,
            compressed_size=chunk.stored,
            message_end_time=chunk.last_ns,
            message_index_length=position - self.size - len(raw),
            message_index_offsets=offsets,
            message_start_time=chunk.first_ns,
            uncompressed_size=chunk.size,
        )
        before = self._chunk_index.tell()
        _write(self._chunk_index, rec.pack(index), before)
        try:
            self._put(raw + b''.join(indexes))
        except OSError:
            self._chunk_index.truncate(before)
            self._chunk_index.seek(before)
            raise
        self._chunk_count += 1
        if self.first_ns is None or chunk.first_ns < self.first_ns:
            self.first_ns = chunk.first_ns
        self.last_ns = max(self.last_ns, chunk.last_ns)
        for topic, body in entries.items():
            self.counts[topic] += len(body) // _ENTRY.size

    @property
    def pending_bytes(self) -> int:
        """Bytes that are in the chunk at hand and not yet in the file."""
        return self._filled

    def sync(self) -> None:
        """See what is in the file on the disk."""
        os.fsync(self._file.fileno())

    def finish(self) -> None:
        """Write what is left, the summary and the footer, and see them on the disk."""
        self.flush()
        self._put(rec.pack(peer.DataEnd(0)))
        start = self.size
        self._chunk_index.seek(0)
        statistics = peer.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self.channels),
            channel_message_counts={key: self.counts[key] for key in sorted(self.channels)},
            chunk_count=self._chunk_count,
            message_count=self.counts.total(),
            message_end_time=self.last_ns,
            message_start_time=self.first_ns or 0,
            metadata_count=len(self._metadata),
            schema_count=len(self.schemas),
        )
        groups = {
            Opcode.SCHEMA: rec.pack(*self.schemas.values()),
            Opcode.CHANNEL: rec.pack(*self.channels.values()),
            Opcode.STATISTICS: rec.pack(statistics),
            Opcode.CHUNK_INDEX: self._chunk_index.read(),
            Opcode.ATTACHMENT_INDEX: rec.pack(*self._attachments),
            Opcode.METADATA_INDEX: rec.pack(*self._metadata),
        }
        summary, offsets = b'', b''
        for opcode, body in groups.items():
            if body:
                place = peer.SummaryOffset(opcode, start + len(summary), len(body))
                offsets += rec.pack(place)
            summary += body
        offset_start = start + len(summary)
        summary += offsets + rec.RECORD.pack(Opcode.FOOTER, 20)
        summary += struct.pack('<QQ', start, offset_start)
        self._put(summary + struct.pack('<I', zlib.crc32(summary)) + rec.MAGIC)
        os.fsync(self._file.fileno())
        self.close()

    def close(self) -> None:
        """Close the file as it is: without an index, where it was not finished."""
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
