"""
What can be saved of one damaged MCAP file, copied into a sound one.

Only what is proven is copied: chunks whose CRC fits, as they are. Behind a damaged place it goes
on at the next chunk that the summary names.
"""

from __future__ import annotations

import mmap
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap import records as peer
from mcap.opcode import Opcode

from hunt_ros.bag.compression import expand_zstd, is_compressed
from hunt_ros.bag.mcap import records as rec
from hunt_ros.bag.mcap.walk import read_summary
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.errors import BagError


@dataclass
class Salvage:
    """
    What became of a file.

    Attributes
    ----------
    lost_bytes : int
        Bytes of the damaged file that hold nothing provable.
    lost_spans_ns : list of (int, int)
        Log times that lost chunks claim to have held.
    problems : list of str
        What was found, in the order of the file.
    """

    lost_bytes: int = 0
    lost_spans_ns: list[tuple[int, int]] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def salvage_mcap(path: Path, target: Path) -> Salvage:
    """
    Copy what is sound of an MCAP file into a new one.

    Parameters
    ----------
    path : Path
        The damaged file; it is not touched.
    target : Path
        The file to make.

    Raises
    ------
    BagError
        If the file is no MCAP file at all.
    OSError
        If the new one cannot be written.
    """
    view = _opened(path)
    writer = McapWriter(target)
    try:
        saver = _Saver(view, writer)
        saver.run()
        writer.close()
    finally:
        writer.abandon()
    return saver.result


def is_complete(path: Path) -> bool:
    """Return True for an MCAP file with a summary that can be trusted."""
    try:
        read_summary(_opened(path))
    except ValueError:
        return False
    return True


def _opened(path: Path) -> memoryview:
    try:
        with open(path, 'rb') as file:
            view = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except (OSError, ValueError) as error:
        raise BagError(f'{path}: nothing to save ({error})') from error
    if bytes(view[: len(rec.MAGIC)]) != rec.MAGIC:
        raise BagError(f'{path}: not an MCAP file, it does not begin with its magic bytes')
    return view


class _Saver:
    """Goes through a file once, from the front to the end."""

    def __init__(self, view: memoryview, writer: McapWriter) -> None:
        self.view = view
        self.writer = writer
        self.result = Salvage()
        self._chunks = _named_chunks(view)
        self._left_out: Counter[str] = Counter()

    def run(self) -> None:
        """Save what is in the file."""
        position, end = len(rec.MAGIC), len(self.view)
        finished = False
        while position < end and not finished:
            try:
                for opcode, offset, length in rec.records(self.view, position, end):
                    following = bisect_right(self._chunks, offset)
                    if any(at < offset + 9 + length for at in self._chunks[following:][:1]):
                        raise ValueError(f'the record at byte {offset} reaches into a chunk')
                    if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                        finished = True
                        break
                    self._record(opcode, offset, length)
                    position = offset + 9 + length
                else:
                    break
            except ValueError as error:
                position = self._beyond_damage(position, str(error))
        if not finished:
            self.result.problems.append('the end of the recording is missing')
        for what, count in self._left_out.items():
            self.result.problems.append(f'{count} {what} are left out')

    def _beyond_damage(self, position: int, reason: str) -> int:
        """Find the next chunk that the summary names, or the end."""
        following = bisect_right(self._chunks, position)
        after = self._chunks[following] if following < len(self._chunks) else len(self.view)
        self._lose(position, after, reason)
        return after

    def _lose(self, start: int, end: int, reason: str) -> None:
        self.result.lost_bytes += end - start
        self.result.problems.append(f'bytes {start} to {end}: {reason}')

    def _record(self, opcode: int, offset: int, length: int) -> None:
        """Save what one record holds, or note that it is lost."""
        raw = self.view[offset : offset + 9 + length]
        payload = raw[9:]
        if opcode == Opcode.CHUNK:
            chunk = rec.unpack_chunk(self.view, offset, length)
            try:
                self._save_chunk(chunk, bytes(raw))
            except ValueError as error:
                self.result.lost_spans_ns.append((chunk.first_ns, chunk.last_ns))
                self._lose(offset, offset + 9 + length, f'a chunk: {error}')
        elif opcode == Opcode.MESSAGE:
            self._save_messages(raw)
        elif opcode == Opcode.METADATA:
            # That of rosbag2 holds counts of the whole recording, which no longer hold.
            if rec.unpack(peer.Metadata, payload).name != 'rosbag2':
                self.writer.add_beside(opcode, bytes(raw))
        elif opcode == Opcode.ATTACHMENT:
            self.writer.add_beside(opcode, bytes(raw))
        elif opcode > Opcode.DATA_END or not opcode:
            if opcode < 0x80:  # reserved: nobody writes it
                raise ValueError(f'the record at byte {offset} is of no known kind')
            self._left_out['private records'] += 1
        else:
            self._describe(opcode, payload)

    def _save_chunk(self, chunk: rec.Chunk, record: bytes) -> None:
        """Copy a sound chunk as it is; message by message where one in it must not be copied."""
        raw = memoryview(rec.expand_chunk(self.view, chunk))
        for opcode, offset, length in list(rec.records(raw, 0, len(raw))):  # whole, or not at all
            if opcode != rec.MESSAGE:
                self._describe(opcode, raw[offset + 9 : offset + 9 + length])
        rows: dict[int, list[tuple[int, int]]] = {}
        as_it_is = True
        for channel, log_ns, offset, _ in rec.message_records(raw):
            start = offset + rec.MESSAGE_PREFIX
            packed = self._is_packed(channel, bytes(raw[start : start + 4]))
            as_it_is = as_it_is and not packed and not self._refused(channel, log_ns)
            rows.setdefault(channel, []).append((log_ns, offset))
        times = [log_ns for several in rows.values() for log_ns, _ in several]
        if not times:
            return
        if as_it_is and (min(times), max(times)) == (chunk.first_ns, chunk.last_ns):
            entries = {key: np.array(row, dtype='<u8').tobytes() for key, row in rows.items()}
            self.writer.add_chunk(record, entries)
        else:
            self._save_messages(raw)

    def _save_messages(self, raw: memoryview) -> None:
        """Save messages one by one."""
        ready = []
        for channel, log_ns, offset, length in rec.message_records(raw):
            if why := self._refused(channel, log_ns):
                self._left_out[why] += 1
                continue
            start = offset + rec.MESSAGE_PREFIX
            head, message = bytes(raw[offset + 9 : start]), bytes(raw[start : offset + 9 + length])
            if self._is_packed(channel, message):
                message = expand_zstd(message)
            ready.append((head, message))
        for head, message in ready:
            self.writer.add_record(head, message)

    def _refused(self, channel: int, log_ns: int) -> str:
        """Say why a message must not be in a sound file; '' where it may."""
        if channel not in self.writer.channels:
            return 'messages whose topic is described nowhere'
        return 'messages of an impossible time' if log_ns >= rec.IMPOSSIBLE_NS else ''

    def _is_packed(self, channel: int, message: bytes) -> bool:
        """Return True for a message that was compressed alone: the copy says nothing of that."""
        known = self.writer.channels.get(channel)
        return known is not None and known.message_encoding == 'cdr' and is_compressed(message)

    def _describe(self, opcode: int, payload: memoryview) -> None:
        """Write a schema or a channel that is new."""
        if opcode == Opcode.SCHEMA:
            schema = rec.unpack_schema(payload)
            if schema.id not in self.writer.schemas:
                self.writer.describe(schema)
        elif opcode == Opcode.CHANNEL:
            channel = rec.unpack(peer.Channel, payload)
            if channel.id not in self.writer.channels:
                self.writer.describe(channel)


def _named_chunks(view: memoryview) -> list[int]:
    """Return where chunks are by the summary, if there is a sound one."""
    try:
        found = rec.summary_records(view) or []
        return sorted(
            rec.unpack(peer.ChunkIndex, payload).chunk_start_offset
            for opcode, payload in found
            if opcode == Opcode.CHUNK_INDEX
        )
    except ValueError:
        return []
