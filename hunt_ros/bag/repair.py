"""Sound copies of damaged recordings, and what was lost on the way."""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hunt_ros.bag.blocks import expand_messages
from hunt_ros.bag.cdr.message_types import definition_text
from hunt_ros.bag.mcap.salvage import Salvage, salvage_mcap
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.bag.metadata import FileEntry, TopicEntry, folder_metadata
from hunt_ros.bag.reader import ACTIVE, read_metadata
from hunt_ros.bag.sqlite_file import SALVAGE_HINT, SqliteFile
from hunt_ros.bag.storage_files import expand_file, folder_files
from hunt_ros.errors import BagError


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
        Bytes of the damaged recording that hold nothing provable.
    lost_spans_ns : list of (int, int)
        Log times that lost chunks claim to have held.
    problems : list of str
        What was wrong, file by file.
    """

    path: Path
    saved: Counter[str] = field(default_factory=Counter)
    lost_bytes: int = 0
    lost_spans_ns: list[tuple[int, int]] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """Messages saved on all topics."""
        return sum(self.saved.values())

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
    source, target = Path(path), Path(out)
    if not source.exists() and source.with_name(source.name + ACTIVE).exists():
        source = source.with_name(source.name + ACTIVE)
    active = target.with_name(target.name + ACTIVE)
    for name in (target, active):
        if name.exists():
            raise BagError(f'{name}: exists already, expected a name for the repaired recording')
    files = folder_files(source) if source.is_dir() else [source]
    if not source.exists() or not files:
        raise BagError(f'{source}: no recording there, expected .mcap or .db3 files')
    compressed = _messages_compressed(source)
    try:
        active.mkdir(parents=True)
    except OSError as error:
        raise BagError(f'{active}: cannot be made ({error.strerror})') from error
    try:
        report = _repair_files(files, active, target, compressed)
        if not report.messages:
            reason = report.problems[0] if report.problems else 'no message is whole'
            raise BagError(f'{source}: nothing to save ({reason})')
        active.rename(target)
    except BaseException:
        shutil.rmtree(active, ignore_errors=True)
        raise
    return report


def _repair_files(files: Sequence[Path], active: Path, target: Path, compressed: bool) -> Repair:
    """Save what is sound in each file of a recording into a file of the new one."""
    report = Repair(target)
    parts: list[tuple[str, Salvage]] = []
    for number, file in enumerate(files):
        name = f'{target.name}_{number}.mcap'
        try:
            part = _salvage(file, active / name, compressed)
        except BagError as error:
            report.problems.append(str(error))
            (active / name).unlink(missing_ok=True)
            continue
        parts.append((name, part))
        report.saved.update(part.saved)
        report.lost_bytes += part.lost_bytes
        report.lost_spans_ns += part.lost_spans_ns
        report.problems += [f'{file.name}: {problem}' for problem in part.problems]
    (active / 'metadata.yaml').write_text(description(parts), encoding='utf-8')
    return report


def _salvage(file: Path, target: Path, compressed: bool) -> Salvage:
    """Save what is sound in one file, whatever its format."""
    with tempfile.TemporaryDirectory(prefix='hunt_ros_repair_') as scratch:
        if file.suffix == '.zstd':
            file = expand_file(file, Path(scratch), partial=True)
        if file.suffix == '.mcap':
            return salvage_mcap(file, target, messages_compressed=compressed)
        if file.suffix != '.db3':
            raise BagError(f'{file}: not a recording, expected .mcap or .db3')
        storage = SqliteFile(_whole_pages(file, Path(scratch)), cut_short=True)
        try:
            return _copy(storage, target, compressed)
        finally:
            storage.close()


def _whole_pages(file: Path, scratch: Path) -> Path:
    """
    Return an SQLite file without its last page, where that was cut.

    SQLite would fill it up with zeros, and SQLite knows no checksum: a message that
    reached into it would be read with zeros at its end.
    """
    with open(file, 'rb') as whole:
        head = whole.read(18)
        page = int.from_bytes(head[16:18], 'big')
        page = 65536 if page == 1 else page
        size = file.stat().st_size
        if not head.startswith(b'SQLite format 3') or page < 512 or size % page == 0:
            return file
        if shutil.disk_usage(scratch).free < size:
            raise BagError(f'{file}: no space in {scratch} for a copy of it')
        copy = scratch / file.name
        whole.seek(0)
        with open(copy, 'wb') as out:
            shutil.copyfileobj(whole, out)
            out.truncate(size - size % page)
    return copy


def _copy(storage: SqliteFile, target: Path, compressed: bool) -> Salvage:
    """Copy the messages of an SQLite file, as far as it can be read."""
    result = Salvage()
    try:
        writer = McapWriter(target)
        topics = {topic.id: topic for topic in storage.topics}
        keys = {topic: number for number, topic in enumerate(topics, 1)}
        for topic in topics.values():
            writer.add_topic(
                keys[topic.id], topic.name, topic.type, topic.definition, {},
                encoding=topic.encoding, definition_encoding=topic.definition_encoding,
            )  # fmt: skip
            result.types[topic.name] = topic.type
        try:
            for block in storage.blocks(topics.keys(), order='id'):
                whole = expand_messages(block, storage.path) if compressed else block
                for key, places in whole.places.items():
                    for log_ns, start, length in zip(*(p.tolist() for p in places), strict=True):
                        writer.add(keys[key], log_ns, whole.data[start : start + length].tobytes())
                        result.saved[topics[key].name] += 1
        except BagError as error:
            # The name of the file is put in front by whoever has its own, not the copy's.
            text = str(error).removeprefix(f'{storage.path}: ').removesuffix(SALVAGE_HINT)
            result.problems.append(text)
        writer.close()
    except OSError as error:
        raise BagError(f'{target}: cannot write the recording ({error.strerror})') from error
    result.first_ns, result.last_ns = writer.first_ns, writer.last_ns
    return result


def _messages_compressed(source: Path) -> bool:
    try:
        description = read_metadata(source / 'metadata.yaml')
    except BagError:
        return False
    return str(description.get('compression_mode') or '').lower() == 'message'


def description(parts: Sequence[tuple[str, Salvage]]) -> str:
    """Return the `metadata.yaml` of a folder of salvaged files, (name, what is in it)."""
    counts: Counter[str] = Counter()
    types: dict[str, str] = {}
    latched: set[str] = set()
    notes: dict[str, str] = {}
    for _, part in parts:
        counts.update(part.saved)
        types |= part.types
        latched |= part.latched
        notes |= part.notes
    topics = [
        TopicEntry(name, kind, definition_text(kind)[1], name in latched, counts[name])
        for name, kind in types.items()
    ]
    files = [FileEntry(name, part.first_ns, part.last_ns, part.messages) for name, part in parts]
    return folder_metadata(topics, files, notes)
