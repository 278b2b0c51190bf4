"""
Sound copies of damaged recordings, and what was lost on the way.

Only what is proven is copied: chunks whose CRC fits, as they are. What a dead recorder left behind
is closed after the fact. A recorder holds a lock on the file it writes, and the system lets go of
it when the process dies: so a recording that is running is never taken for a leftover.
"""

from __future__ import annotations

import fcntl
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np
from mcap import records as peer
from mcap.opcode import Opcode

from hunt_ros.bag.bag_writer import FileEntry, folder_metadata, offered_qos
from hunt_ros.bag.blocks import Block, Topic, expand_zstd, in_order, packed_topics
from hunt_ros.bag.cdr.layout import extent
from hunt_ros.bag.cdr.message_types import Definitions, definition_text, definitions_of
from hunt_ros.bag.mcap import records as rec
from hunt_ros.bag.mcap.file import McapFile
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.bag.reader import ACTIVE, Bag, folder_files
from hunt_ros.bag.sqlite_file import SALVAGE_HINT
from hunt_ros.errors import BagError, HuntError
from hunt_ros.files import write_whole


@dataclass
class Repair:
    """
    What a repair did.

    Attributes
    ----------
    path : Path
        The sound recording.
    saved : Counter of str
        Messages by topic.
    lost_bytes : int
        Bytes of the damaged files that hold nothing provable.
    lost_spans_ns : list of (int, int)
        Log times that lost chunks claim to have held.
    problems : list of str
        What was found, in the order of the files.
    left_out : list of str
        Files of which nothing could be read.
    """

    path: Path
    saved: Counter[str] = field(default_factory=Counter)
    lost_bytes: int = 0
    lost_spans_ns: list[tuple[int, int]] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """Messages saved on all topics."""
        return self.saved.total()

    def __str__(self) -> str:
        lost = sum(last - first for first, last in self.lost_spans_ns) / 1e9
        text = f'{self.path}: {self.messages} messages saved'
        if self.lost_bytes or not self.problems:
            text += f', {self.lost_bytes} bytes lost'
        return f'{text} ({lost:.2f} s in lost chunks)' if lost else text


def repair(path: str | Path, out: str | Path) -> Repair:
    """
    Copy what is sound of a recording into a new rosbag2 folder.

    Parameters
    ----------
    path : str or Path
        Folder or file, damaged in any way; it is not touched.
    out : str or Path
        Folder to make.

    Raises
    ------
    BagError
        If there is nothing to save, or `out` exists or cannot be written.
    """
    target = Path(out)
    active = target.with_name(target.name + ACTIVE)
    for name in (target, active):
        if name.exists():
            raise BagError(f'{name}: exists already, expected a name for the repaired recording')
    report = Repair(target)
    try:
        with Bag(path, tolerant=True) as bag:
            active.mkdir(parents=True)
            report.left_out += bag.left_out
            span_ns = bag.span_ns
            for number, file in enumerate(bag.files):
                if isinstance(file, McapFile):
                    copy = active / f'{target.name}_{number}.mcap'
                    _copy(file, copy, report, span_ns)
                else:
                    report.left_out.append(file.path.name)
                    text = f'{file.path}: is SQLite, expected MCAP ({SALVAGE_HINT})'
                    report.problems.append(text)
            report.problems[:0] = map(str, bag.problems)
        if any(active.iterdir()):
            report.saved = _describe(active)
        if not report.messages:
            reason = report.problems[0] if report.problems else 'no message is whole'
            raise BagError(f'{bag.path}: nothing to save ({reason})')
        active.rename(target)
    except BaseException as error:
        shutil.rmtree(active, ignore_errors=True)
        if isinstance(error, OSError):
            raise BagError(f'{target}: cannot be written ({error.strerror or error})') from error
        raise
    return report


def _copy(
    file: McapFile, path: Path, report: Repair, span_ns: tuple[int, int] | None = None
) -> None:
    """Copy what is sound of an MCAP file; of its messages those of these log times."""
    name = file.path.name
    left_out: Counter[str] = Counter()
    report.lost_bytes += file.lost_bytes
    with closing(McapWriter(path)) as writer:
        writer.describe(*file.schemas.values(), *file.channels.values())
        for offset, length in file.beside:
            record = bytes(file.view[offset : offset + length])
            # The metadata of rosbag2 holds counts of the whole recording, which no longer hold.
            if record[0] != Opcode.METADATA or (
                rec.unpack(peer.Metadata, record[9:]).name != 'rosbag2'
            ):
                writer.add_beside(record)
        for chunk in file.chunks:
            try:
                left_out += copy_chunk(file, chunk, writer, span_ns)
            except ValueError as error:
                report.lost_spans_ns.append((chunk.first_ns, chunk.last_ns))
                report.lost_bytes += chunk.end - chunk.offset
                text = f'{name}: bytes {chunk.offset} to {chunk.end}: a chunk: {error}'
                report.problems.append(text)
        loose = Block(np.frombuffer(file.view, np.uint8), file.loose)
        left_out += _copy_messages(file, loose, writer, span_ns)
        writer.finish()
    if not file.ended:
        report.problems.append(f'{name}: the end of the recording is missing')
    report.problems += [f'{name}: {n} {what} are left out' for what, n in left_out.items()]
    missing = sum((file.claimed or {}).values()) - writer.counts.total()
    if missing > left_out.total() + file.unproven:
        report.problems.append(f'{name}: {missing} messages of its summary are not there')


def copy_chunk(
    file: McapFile, chunk: rec.Chunk, writer: McapWriter, span_ns: tuple[int, int] | None = None
) -> Counter[str]:
    """
    Copy a chunk as it is; message by message without a CRC, or where one must be left out.

    Returns
    -------
    Counter of str
        What is left out.
    """
    data, found = file.opened(chunk)
    times = [(int(part.log_ns.min()), int(part.log_ns.max())) for part in found.values()]
    if not times:
        return Counter()
    first, last = min(first for first, _ in times), max(last for _, last in times)
    block = Block(data, found)
    if (
        chunk.crc
        and (first, last) == (chunk.first_ns, chunk.last_ns)
        and (span_ns is None or span_ns[0] <= first <= last <= span_ns[1])
        and found.keys() <= file.channels.keys()
        and not packed_topics(block, file.topics)
    ):
        entries = {
            key: np.stack([part.log_ns, part.starts - rec.MESSAGE_PREFIX], axis=1).tobytes()
            for key, part in found.items()
        }
        writer.add_chunk(bytes(file.view[chunk.offset : chunk.end]), entries)
        return Counter()
    return _copy_messages(file, block, writer, span_ns)


def _copy_messages(
    file: McapFile, block: Block, writer: McapWriter, span_ns: tuple[int, int] | None
) -> Counter[str]:
    """Copy those as their types say, in their order, what was compressed alone expanded."""
    left_out: Counter[str] = Counter()
    packed = packed_topics(block, file.topics)
    types = {key: (_definitions(topic), topic.type) for key, topic in file.topics.items()}
    for start, length, log_ns, key in in_order(block.places):
        if key not in types:
            continue
        message = block.data[start : start + length].tobytes()
        if key in packed:
            try:
                message = expand_zstd(message)
            except ValueError:
                left_out['messages that cannot be expanded'] += 1
                continue
        if span_ns is not None and not span_ns[0] <= log_ns <= span_ns[1]:
            left_out['messages of an impossible time'] += 1
        elif not _is_of(*types[key], message):
            left_out['messages that are not as their type says'] += 1
        else:
            head = rec.MESSAGE_HEAD.unpack_from(block.data.data, start - rec.MESSAGE_HEAD.size)
            writer.add_record(message, *head)
    return left_out


def _definitions(topic: Topic) -> Definitions | None:
    """Return what the messages of a topic are read by; None where that is not known."""
    try:
        return definitions_of(topic)
    except BagError:
        return None


def _is_of(definitions: Definitions | None, message_type: str, message: bytes) -> bool:
    """Return False for a message that is shorter than its type: no command could read it."""
    try:
        return definitions is None or extent(definitions, message_type, message)[0] <= len(message)
    except Exception:  # whatever the walk meets in damaged bytes
        return False


def _describe(active: Path) -> Counter[str]:
    """Write the `metadata.yaml` of a folder of sound files; return its messages by topic."""
    topics = {}
    files: list[FileEntry] = []
    saved: Counter[str] = Counter()
    with Bag(active) as bag:
        for file in bag.files:
            for topic in file.topics.values():
                if count := file.counts.get(topic.id, 0):
                    saved[topic.name] += count
                    kind = topic.type_hash or definition_text(topic.type)[1]
                    topics[topic.name] = topic._replace(qos=offered_qos(topic.qos), type_hash=kind)
            first_ns, last_ns = file.span_ns or (None, 0)
            count = sum(file.counts.values())
            files.append(FileEntry(file.path.name, first_ns, last_ns, count))
        rows = [(topic, saved[name]) for name, topic in topics.items()]
        text = folder_metadata(rows, files, bag.notes)
    (active / 'metadata.yaml').write_text(text, encoding='utf-8')
    return saved


class BeingRecorded(BagError):
    """The recording is not left over: its recorder is alive."""


def finalise(active: Path) -> Path:
    """
    Close a recording whose recorder died: index, description, final name.

    Nothing is lost that is in the folder whole; files that are complete stay as they
    are. The one that is not is copied, which takes room on the disk: without it the folder
    stays as it is, and can be read.

    Parameters
    ----------
    active : Path
        A folder ending in `.active`.

    Returns
    -------
    Path
        The closed recording.

    Raises
    ------
    HuntError
        If its recorder is still alive, nothing in it can be saved, or the disk refuses.
    """
    target = final = active.with_name(active.name.removesuffix(ACTIVE))
    number = 1
    while target.exists():
        target, number = final.with_name(f'{final.name}_{number}'), number + 1
    files = [name for name in folder_files(active) if name.suffix == '.mcap']
    try:
        with ExitStack() as held:
            for name in files:
                held.enter_context(_lock(name))
            filled = [name for name in files if name.stat().st_size]
            for name in filled:
                _finish_file(name)
        if not filled or not _describe(active).total():
            raise BagError(f'{active}: holds no whole message, nothing to close')
        active.rename(target)
    except OSError as error:
        raise BagError(f'{active}: cannot be closed ({error.strerror})') from error
    return target


def _lock(file: Path) -> IO[bytes]:
    """Lock a file as its writer does; `BeingRecorded` where a living process holds it."""
    held = open(file, 'rb')  # noqa: SIM115 - closed by who asked
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        held.close()
        raise BeingRecorded(f'{file.parent}: is being recorded') from error
    return held


def _finish_file(file: Path) -> None:
    """Put a complete file in the place of one that was not closed, with what is sound in it."""
    with closing(McapFile(file)) as left:
        if left.problems:
            write_whole(file, lambda path: _copy(left, path, Repair(file)), 'recording')


def finalise_left(directory: Path) -> Iterator[tuple[Path | None, str]]:
    """
    Close every recording in a directory whose recorder died.

    Yields
    ------
    Path or None
        The closed recording; None where it could not be closed.
    str
        What was done or why not. Recordings that are running are passed over in silence.
    """
    for active in sorted(directory.glob(f'*{ACTIVE}')):
        try:
            closed = finalise(active)
            yield closed, f'{closed}: closed, its recorder had ended without doing so'
        except BeingRecorded:
            continue
        except HuntError as error:
            yield None, str(error)
