"""
What can be saved of one damaged MCAP file: copied into a sound one, or finished in place.

Only what is proven is copied: chunks whose CRC fits, and the complete messages at
the beginning of a last chunk that was cut off. Between damaged places the next
sound chunk is searched for byte by byte.
"""

from __future__ import annotations

import mmap
import re
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hunt_ros.bag.compression import expand, expand_partial, expand_zstd
from hunt_ros.bag.mcap import format as fmt
from hunt_ros.bag.mcap.places import indexed_chunk
from hunt_ros.bag.mcap.walk import Walk, read_summary, records, walk_file
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.errors import BagError

#: What may stand from the last sound chunk of a killed writer on, bytes.
_TAIL_BYTES = 1 << 26
#: A chunk record begins like this: opcode, length, times, size, CRC, compression.
_CHUNK_BEGIN = re.compile(
    rb'\x06.{36}(?:\x00\x00\x00\x00|\x03\x00\x00\x00lz4|\x04\x00\x00\x00zstd)', re.DOTALL
)


@dataclass
class Salvage:
    """
    What became of a file.

    Attributes
    ----------
    saved : Counter of str
        Messages by topic.
    lost_bytes : int
        Bytes of the damaged file that hold nothing provable.
    lost_spans_ns : list of (int, int)
        Log times that lost chunks claim to have held.
    problems : list of str
        What was found, in the order of the file.
    """

    saved: Counter[str] = field(default_factory=Counter)
    types: dict[str, str] = field(default_factory=dict)
    latched: set[str] = field(default_factory=set)
    notes: dict[str, str] = field(default_factory=dict)
    lost_bytes: int = 0
    lost_spans_ns: list[tuple[int, int]] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    first_ns: int | None = None
    last_ns: int = 0

    @property
    def messages(self) -> int:
        """Messages saved on all topics."""
        return sum(self.saved.values())

    def introduce(self, channel: fmt.Channel, schemas: Mapping[int, fmt.Schema]) -> None:
        """Take note of a topic of which a message is saved."""
        if channel.topic not in self.types:
            schema = schemas.get(channel.schema)
            self.types[channel.topic] = schema.name if schema else ''
            if 'durability: 1' in channel.metadata.get('offered_qos_profiles', ''):
                self.latched.add(channel.topic)


def salvage_mcap(path: Path, target: Path, *, messages_compressed: bool = False) -> Salvage:
    """
    Copy what is sound of an MCAP file into a new one.

    Parameters
    ----------
    path : Path
        The damaged file; it is not touched.
    target : Path
        The file to make.
    messages_compressed : bool
        True where the messages themselves are zstd frames (rosbag2 mode MESSAGE);
        they are expanded.

    Raises
    ------
    BagError
        If the file is no MCAP file at all, or the new one cannot be written.
    """
    view = _opened(path)
    try:
        writer = McapWriter(target)
        saver = _Saver(view, writer, messages_compressed)
        saver.run()
        writer.close()
    except OSError as error:
        raise BagError(f'{target}: cannot write the recording ({error.strerror})') from error
    saver.result.first_ns, saver.result.last_ns = writer.first_ns, writer.last_ns
    return saver.result


def finish_mcap(path: Path) -> Salvage:
    """
    Give an MCAP file whose writer was killed its end, in place.

    What stands in front of the last chunk stays as it is, and is only checked; the last
    chunk, whole or cut, is written again, and the summary behind it. So an hour takes no
    second copy on the disk, and seconds outside of the interpreter's lock.

    Parameters
    ----------
    path : Path
        A complete file is only described.

    Raises
    ------
    ValueError
        If the damage is not at the end alone: then nothing was changed.
    BagError
        If the file is no MCAP file at all, or the disk refuses.
    """
    view = _opened(path)
    try:
        return _described(read_summary(view))
    except ValueError:
        walk = walk_file(view)
    last = walk.chunks[-1].offset if walk.chunks else walk.end
    tail = bytes(view[last : last + _TAIL_BYTES])
    kept = walk_file(view[:last])
    if last + len(tail) < len(view) or kept.problem or kept.loose:
        raise ValueError('more is damaged than the end')
    whole = np.frombuffer(view, dtype=np.uint8)
    for chunk in kept.chunks:
        raw = np.frombuffer(expand_checked(view, chunk), dtype=np.uint8)
        index = kept.indexes.get(chunk.offset)
        if index is None or indexed_chunk(raw, index, whole, set(index)) is None:
            raise ValueError(f'the chunk at byte {chunk.offset} has no sound message index')
    result = _described(kept)
    try:
        writer = McapWriter.resume(path, kept, last)
        saver = _Saver(memoryview(tail), writer, False, result)
        saver.know(kept)
        saver.run(0)
        writer.close()
    except OSError as error:
        raise BagError(f'{path}: cannot close the recording ({error.strerror})') from error
    result.first_ns, result.last_ns = writer.first_ns, writer.last_ns
    return result


def _opened(path: Path) -> memoryview:
    try:
        with open(path, 'rb') as file:
            view = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except (OSError, ValueError) as error:
        raise BagError(f'{path}: nothing to save ({error})') from error
    if bytes(view[: len(fmt.MAGIC)]) != fmt.MAGIC:
        raise BagError(f'{path}: not an MCAP file, it does not begin with its magic bytes')
    return view


def _described(walk: Walk) -> Salvage:
    """Return what is in a file, or in a part of it."""
    result = Salvage()
    for channel in walk.channels.values():
        if walk.counts[channel.id]:
            result.saved[channel.topic] += walk.counts[channel.id]
            result.introduce(channel, walk.schemas)
    for name, strings in walk.metadata:
        if name == 'hunt_ros':
            result.notes |= strings
    if walk.span_ns is not None:
        result.first_ns, result.last_ns = walk.span_ns
    return result


def expand_checked(view: memoryview, chunk: fmt.Chunk) -> bytes:
    """
    Return the records of a chunk.

    Raises
    ------
    ValueError
        If it cannot be expanded, or its CRC or its times are wrong.
    """
    raw = bytes(expand(view[chunk.data : chunk.end], chunk.compression, chunk.size))
    if chunk.crc and zlib.crc32(raw) != chunk.crc:
        raise ValueError('its CRC does not fit its bytes')
    if chunk.last_ns >= 1 << 63:
        raise ValueError('its time is impossible')
    return raw


class _Saver:
    """Goes through a file once, from the front to the end."""

    def __init__(
        self,
        view: memoryview,
        writer: McapWriter,
        messages_compressed: bool,
        result: Salvage | None = None,
    ) -> None:
        self.view = view
        self.writer = writer
        self.result = result or Salvage()
        self._messages_compressed = messages_compressed
        self._schemas: dict[int, fmt.Schema] = {}
        self._channels: dict[int, fmt.Channel] = {}
        self._written: dict[int, fmt.Channel] = {}
        self._homeless = 0

    def know(self, walk: Walk) -> None:
        """Take over what the writer has described already."""
        self._schemas |= walk.schemas
        self._channels |= walk.channels
        self._written |= walk.channels

    def run(self, start: int = len(fmt.MAGIC)) -> None:
        """Save what is in the file from a record on."""
        position, end = start, len(self.view)
        finished = False
        while position < end and not finished:
            try:
                for opcode, offset, length in records(self.view, position, end):
                    position = offset
                    if opcode in (fmt.DATA_END, fmt.FOOTER):
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
        if self._homeless:
            self.result.problems.append(
                f'{self._homeless} messages whose topic is described nowhere are left out'
            )

    def _beyond_damage(self, position: int, reason: str) -> int:
        """Find the next sound chunk; without one, save the beginning of the one at hand."""
        found = self._next_chunk(position + 1)
        if found is not None:
            self._lose(position, found, reason)
            return found
        end = len(self.view)
        kept, left = self._save_cut_chunk(position)
        if kept:
            reason = f'{reason}; {kept} whole messages of the chunk that was cut are saved'
        self._lose(position, end, reason)
        if kept:
            self.result.lost_bytes -= end - position - left
        return end

    def _lose(self, start: int, end: int, reason: str) -> None:
        self.result.lost_bytes += end - start
        self.result.problems.append(f'bytes {start} to {end}: {reason}')

    def _next_chunk(self, start: int) -> int | None:
        """Offset of the next chunk whose CRC proves it, or None."""
        for match in _CHUNK_BEGIN.finditer(self.view, start):
            offset = match.start()
            _, length = fmt.RECORD.unpack_from(self.view, offset)
            if offset + 9 + length > len(self.view):
                continue
            try:
                chunk = fmt.parse_chunk(self.view[offset + 9 : offset + 73], offset, length)
                if chunk.crc and expand_checked(self.view, chunk) is not None:
                    return offset
            except ValueError:
                continue
        return None

    def _record(self, opcode: int, offset: int, length: int) -> None:
        """Save what one record holds, or note that it is lost."""
        payload = self.view[offset + 9 : offset + 9 + length]
        if opcode == fmt.CHUNK:
            chunk = fmt.parse_chunk(payload[:64], offset, length)
            try:
                self._save_chunk(expand_checked(self.view, chunk))
            except ValueError as error:
                self.result.lost_spans_ns.append((chunk.first_ns, chunk.last_ns))
                self._lose(offset, offset + 9 + length, f'a chunk: {error}')
        elif opcode == fmt.MESSAGE:
            self._save_messages(self.view[offset : offset + 9 + length])
        elif opcode == fmt.METADATA:
            name, strings = fmt.parse_metadata(payload)
            if name == 'hunt_ros':
                self.result.notes |= strings
            if name != 'rosbag2':
                self.writer.add_metadata(name, strings)
        else:
            self._describe(opcode, payload)

    def _save_chunk(self, raw: bytes) -> None:
        # Walked to the end first: a chunk is saved whole or not at all.
        for _ in records(raw, 0, len(raw)):
            pass
        self._save_messages(raw)

    def _save_cut_chunk(self, position: int) -> tuple[int, int]:
        """
        Save the whole messages of a chunk that reaches behind the end of the file.

        Returns how many, and how many bytes behind them are lost.
        """
        before = self.result.messages
        nothing = (0, len(self.view) - position)
        if position + 9 > len(self.view) or self.view[position] != fmt.CHUNK:
            return nothing
        _, length = fmt.RECORD.unpack_from(self.view, position)
        try:
            chunk = fmt.parse_chunk(self.view[position + 9 : position + 73], position, length)
            if chunk.end <= len(self.view) or chunk.last_ns >= 1 << 63:
                return nothing
            raw = expand_partial(self.view[chunk.data :], chunk.compression, chunk.size)
            whole = 0
            try:
                for _, offset, size in records(raw, 0, len(raw)):
                    whole = offset + 9 + size
            except ValueError:
                pass  # where it was cut
            self._save_messages(raw[:whole], (chunk.first_ns, chunk.last_ns))
        except ValueError:
            return nothing
        return self.result.messages - before, len(raw) - whole

    def _save_messages(
        self, raw: bytes | memoryview, span_ns: tuple[int, int] | None = None
    ) -> None:
        """Save the messages of an expanded chunk; `span_ns`: their times by its head."""
        view = memoryview(raw)
        for opcode, offset, length in records(view, 0, len(view)):
            payload = view[offset + 9 : offset + 9 + length]
            if opcode != fmt.MESSAGE:
                self._describe(opcode, payload)
                continue
            if length < fmt.MESSAGE_HEAD.size:
                raise ValueError(f'the message at byte {offset} has no head')
            channel, _, log_ns, _ = fmt.MESSAGE_HEAD.unpack_from(payload)
            if span_ns is not None and not span_ns[0] <= log_ns <= span_ns[1]:
                raise ValueError(f'the message at byte {offset} is not of its chunk')
            self._save_message(channel, log_ns, bytes(payload[fmt.MESSAGE_HEAD.size :]))

    def _save_message(self, channel: int, log_ns: int, message: bytes) -> None:
        """Save one message, unless it is of a channel that nothing describes."""
        described = self._channels.get(channel)
        if described is None or log_ns >= 1 << 63:
            self._homeless += 1
            return
        if self._messages_compressed:
            message = expand_zstd(message)
        if channel not in self._written:
            self._introduce(described)
        self.writer.add(channel, log_ns, message)
        self.result.saved[described.topic] += 1
        self.result.introduce(described, self._schemas)

    def _introduce(self, channel: fmt.Channel) -> None:
        """Describe a topic in the new file, before its first message."""
        none = fmt.Schema(0, '', '', '')
        schema = self._schemas.get(channel.schema, none)
        self.writer.add_topic(
            channel.id, channel.topic, schema.name, schema.text, channel.metadata,
            encoding=channel.encoding, definition_encoding=schema.encoding,
        )  # fmt: skip
        self._written[channel.id] = channel

    def _describe(self, opcode: int, payload: bytes | memoryview) -> None:
        if opcode == fmt.SCHEMA:
            schema = fmt.parse_schema(payload)
            self._schemas.setdefault(schema.id, schema)
        elif opcode == fmt.CHANNEL:
            channel = fmt.parse_channel(payload)
            self._channels.setdefault(channel.id, channel)
