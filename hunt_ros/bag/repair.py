"""
Sound copies of damaged recordings, and what was lost on the way.

What a dead recorder left behind is closed after the fact. A recorder holds a lock on the file
it writes, and the system lets go of it when the process dies: so a recording that is running
is never taken for a leftover.
"""

from __future__ import annotations

import fcntl
import shutil
import tempfile
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from hunt_ros.bag.blocks import expand_messages
from hunt_ros.bag.cdr.message_types import definition_text
from hunt_ros.bag.mcap.salvage import Salvage, is_complete, salvage_mcap
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.bag.metadata import FileEntry, TopicEntry, folder_metadata, offered_qos
from hunt_ros.bag.reader import ACTIVE, Bag
from hunt_ros.bag.sqlite_file import SALVAGE_HINT, SqliteFile
from hunt_ros.bag.storage_files import expand_file, folder_files
from hunt_ros.errors import BagError


@dataclass(kw_only=True)
class Repair(Salvage):
    """
    What a repair did; of all files what `Salvage` says of one, and the following.

    Attributes
    ----------
    path : Path
        The sound recording.
    saved : Counter of str
        Messages by topic.
    left_out : list of str
        Files of which nothing could be read.
    """

    path: Path
    saved: Counter[str] = field(default_factory=Counter)
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
    try:
        active.mkdir(parents=True)
    except OSError as error:
        raise BagError(f'{active}: cannot be made ({error.strerror})') from error
    try:
        report = _repair_files(files, active, target)
        if not report.messages:
            reason = report.problems[0] if report.problems else 'no message is whole'
            raise BagError(f'{source}: nothing to save ({reason})')
        active.rename(target)
    except BaseException as error:
        shutil.rmtree(active, ignore_errors=True)
        if isinstance(error, OSError):
            raise BagError(f'{target}: cannot be written ({error.strerror or error})') from error
        raise
    return report


def _repair_files(files: Sequence[Path], active: Path, target: Path) -> Repair:
    """Save what is sound in each file of a recording into a file of the new one."""
    report = Repair(path=target)
    for number, file in enumerate(files):
        copy = active / f'{target.name}_{number}.mcap'
        try:
            part = _salvage(file, copy)
        except BagError as error:
            report.problems.append(str(error))
            report.left_out.append(file.name)
            copy.unlink(missing_ok=True)
            continue
        report.lost_bytes += part.lost_bytes
        report.lost_spans_ns += part.lost_spans_ns
        report.problems += [f'{file.name}: {problem}' for problem in part.problems]
    if len(report.left_out) < len(files):
        report.saved = _describe(active)
    return report


def _salvage(file: Path, target: Path) -> Salvage:
    """Save what is sound in one file, whatever its format."""
    with tempfile.TemporaryDirectory(prefix='hunt_ros_repair_') as scratch:
        if file.suffix == '.zstd':
            file = expand_file(file, Path(scratch), partial=True)
        if file.suffix == '.mcap':
            return salvage_mcap(file, target)
        if file.suffix != '.db3':
            raise BagError(f'{file}: not a recording, expected .mcap or .db3')
        storage = SqliteFile(_whole_pages(file, Path(scratch)), cut_short=True)
        try:
            return _copy(storage, target)
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


def _copy(storage: SqliteFile, target: Path) -> Salvage:
    """Copy the messages of an SQLite file, as far as it can be read."""
    result = Salvage(problems=list(storage.problems))
    writer = McapWriter(target)
    topics = {topic.id: topic for topic in storage.topics}
    keys = {topic: number for number, topic in enumerate(topics, 1)}
    try:
        for topic in topics.values():
            strings = {
                'offered_qos_profiles': offered_qos(topic.qos),
                'topic_type_hash': definition_text(topic.type)[1],
            }
            writer.add_topic(
                keys[topic.id], topic.name, topic.type, topic.definition, strings,
                encoding=topic.encoding, definition_encoding=topic.definition_encoding,
            )  # fmt: skip
        try:
            for block in storage.blocks(topics.keys(), order='id'):
                whole = expand_messages(block, topics, storage.path)
                for key, places in whole.places.items():
                    for log_ns, start, length in zip(*(p.tolist() for p in places), strict=True):
                        writer.add(keys[key], log_ns, whole.data[start : start + length].tobytes())
        except BagError as error:
            result.problems.append(str(error))
        # The name of the file is put in front by whoever has its own, not the copy's.
        told = (text.removeprefix(f'{storage.path}: ') for text in result.problems)
        result.problems = list(dict.fromkeys(text.removesuffix(SALVAGE_HINT) for text in told))
        writer.close()
    finally:
        writer.abandon()
    return result


def _describe(active: Path) -> Counter[str]:
    """Write the `metadata.yaml` of a folder of sound files; return its messages by topic."""
    topics: dict[str, TopicEntry] = {}
    files: list[FileEntry] = []
    saved: Counter[str] = Counter()
    with Bag(active) as bag:
        for file in bag.files:
            for topic in file.topics:
                if count := file.counts.get(topic.id, 0):
                    saved[topic.name] += count
                    topics[topic.name] = TopicEntry(
                        topic.name,
                        topic.type,
                        topic.type_hash or definition_text(topic.type)[1],
                        offered_qos(topic.qos),
                        saved[topic.name],
                        topic.encoding,
                    )
            first_ns, last_ns = file.span_ns or (None, 0)
            count = sum(file.counts.values())
            files.append(FileEntry(Path(file.path).name, first_ns, last_ns, count))
        text = folder_metadata(list(topics.values()), files, bag.notes)
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
    BagError
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
    if is_complete(file):
        return
    repaired = file.with_suffix('.mcap.part')
    repaired.unlink(missing_ok=True)
    try:
        salvage_mcap(file, repaired)
        repaired.replace(file)
    finally:
        repaired.unlink(missing_ok=True)


def finalise_left(directory: Path) -> list[str]:
    """
    Close every recording in a directory whose recorder died.

    Returns
    -------
    list of str
        One line for each, on what was done or why not; recordings that are running
        are passed over in silence.
    """
    lines = []
    for active in sorted(directory.glob(f'*{ACTIVE}')):
        try:
            lines.append(f'{finalise(active)}: closed, its recorder had ended without doing so')
        except BeingRecorded:
            continue
        except BagError as error:
            lines.append(str(error))
    return lines
