"""
A recording, whatever it is: a rosbag2 folder, one of its files, or what a recorder left.

`Bag(path)` opens a folder with `metadata.yaml` (versions 1 to 9), a folder without
it (`.active`, left by a recorder that was killed), a bare `.mcap` or `.db3`, and
files compressed as a whole (`.zstd`). The description is read here and not by
`rosbags.rosbag2.Reader`: that opens no folder without it, and none with a file that is damaged.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import yaml
import zstandard

from hunt_ros.bag.blocks import Block, Problem, Stored, Topic, expand_messages
from hunt_ros.bag.clocks import LONGEST_NS, span_of
from hunt_ros.bag.mcap.file import McapFile
from hunt_ros.bag.sqlite_file import SqliteFile
from hunt_ros.errors import BagError

#: A recording has this ending until it is closed properly.
ACTIVE = '.active'
NEWEST_VERSION = 9
#: MCAP metadata record and metadata.yaml key under which rig, operator and notes stand.
NOTES = 'hunt_ros'
ROS_1 = '.bag'
STORAGES: dict[str, type[McapFile] | type[SqliteFile]] = {'.mcap': McapFile, '.db3': SqliteFile}

#: Left free where a compressed file is expanded, bytes.
_RESERVE = 1 << 28
#: Name of a clip: recording, time, code of the alarm (a letter, where files of recordings count).
CLIP = re.compile(r'clip_(.+)_(?:\d{8}_\d{6}|-?\d+s)_[^\W\d]\w*\.mcap')
_Loader: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


class TopicSummary(NamedTuple):
    """A topic over all files: its type and its number of messages."""

    type: str
    messages: int


class Bag(Stored):
    """
    A recording opened for reading; a context manager.

    Parameters
    ----------
    path : str or Path
        Folder or file. A recording that is not closed yet is found under its final
        name as well.
    tolerant : bool
        Pass over what is damaged, and note it.

    Attributes
    ----------
    path : Path
    files : list of McapFile or SqliteFile
        In the order in which they were recorded.
    topics : dict of str to TopicSummary
    notes : dict of str to str
        Rig, operator, remarks, as recorded.
    left_out : list of str
        Names of the files that cannot be opened.
    problems : list of Problem
        What is wrong with it, as far as opening and reading it have shown.

    Raises
    ------
    BagError
        If there is nothing there, or it is no recording.
    """

    def __init__(self, path: str | Path, tolerant: bool = False) -> None:
        super().__init__(existing(Path(path)))
        self.tolerant = tolerant
        self.files: list[McapFile | SqliteFile] = []
        self.left_out: list[str] = []
        self.metadata: dict[str, Any] = {}
        self._stack = ExitStack()
        try:
            self._open()
        except BaseException:
            self.close()
            raise
        custom = self.metadata.get('custom_data')
        told = custom if isinstance(custom, dict) else {}
        self.notes = {str(key): str(value) for key, value in told.items()} | self.strings(NOTES)
        self.notes.pop('problems', None)  # of the recording that this one was made of
        self.topics: dict[str, TopicSummary] = {}
        for file in self.files:
            for topic in file.topics.values():
                before = self.topics.get(topic.name)
                count = file.counts.get(topic.id, 0) + (before.messages if before else 0)
                self.topics[topic.name] = TopicSummary(topic.type, count)

    def _open(self) -> None:
        unread = f'{self.path}: no recording in it, expected .mcap or .db3 files'
        for name in self._listed() if self.path.is_dir() else [self.path]:
            scratch = self.path
            if name.suffix == '.zstd':
                folder = tempfile.TemporaryDirectory(prefix='hunt_ros_bag_')
                scratch = Path(self._stack.enter_context(folder))
            try:
                file = self._opened(name, scratch)
            except BagError as error:  # the others are there all the same
                unread = str(error)
                self.note('damaged_file', unread)
                self.left_out.append(name.name)
                continue
            self._stack.callback(file.close)
            self.files.append(file)
        if not self.files:
            raise BagError(unread)
        claimed = self.metadata.get('message_count')
        there = sum(sum(file.counts.values()) for file in self.files)
        if isinstance(claimed, int) and claimed != there and not self.problems:
            text = f'{there} messages are in it, {claimed} by its metadata.yaml'
            self.note('damaged_file', text)

    def _opened(self, name: Path, scratch: Path) -> McapFile | SqliteFile:
        """Open a file; what can be expanded of one that is compressed as a whole, to a place."""
        kind = storage_kind(name)
        if kind not in STORAGES:
            how = '"hunt import" makes one of a CSV, MATLAB, NumPy or TDMS file'
            if kind == ROS_1:
                how = f'"rosbags-convert --src {name.name} --dst OUT" makes one of a bag of ROS 1'
            raise BagError(f'{name}: not a recording, expected a folder, .mcap or .db3; {how}')
        if not name.is_file():  # a pipe would be waited for without end
            raise BagError(f'{name}: not a file, expected a recording')
        if name.suffix != '.zstd':
            return STORAGES[kind](name)
        expanded = scratch / name.stem
        if damage := _expand(name, expanded):
            self.note('damaged_file', damage)
        try:
            opened = STORAGES[kind](expanded)
        except BagError as error:
            raise BagError(str(error).replace(str(expanded), str(name))) from error
        opened.path = name
        return opened

    def _listed(self) -> list[Path]:
        """Return the files of a folder, by metadata.yaml where it can be used."""
        description = self.path / 'metadata.yaml'
        present = folder_files(self.path)
        try:
            if description.exists():
                self.metadata = read_metadata(description)
                named = [self._place(Path(name)) for name in self.metadata['relative_file_paths']]
                stems, known = {*map(_stem, named)}, {*map(_base, named)}
                more = [f for f in present if {_stem(f)} == stems and _base(f) not in known]
                for file in more:  # its recorder died after it had begun another file
                    self.note('not_closed', f'{file.name} is not named in metadata.yaml')
                return named + more
            self.note('not_closed', 'it was not closed: there is no metadata.yaml')
        except BagError as error:
            if not present:
                raise
            self.note('damaged_file', str(error))
        if not present:
            raise BagError(
                f'{self.path}: no .mcap or .db3 file in it, expected a rosbag2 recording'
                f'{_recordings_below(self.path)}'
            )
        if len({*map(_stem, present)}) > 1:
            raise BagError(
                f'{self.path}: {present[0].name} and {present[-1].name} are not of one recording'
                ' by their names, and no metadata.yaml says so: name them one by one'
            )
        return present

    def _place(self, name: Path) -> Path:
        """Return where a file that metadata.yaml names is, in the folder or below it."""
        # Versions before 4 put the folder's name in front: there the last part holds.
        below = self.path / name
        inside = '..' not in name.parts and not name.is_absolute()
        found = below if inside and below.exists() else self.path / name.name
        if not found.exists():
            raise BagError(f'{self.path}: {name.name} is named in metadata.yaml and missing')
        return found

    @property
    def problems(self) -> list[Problem]:
        """What is wrong with it, and with each of its files."""
        return super().problems + [
            replace(problem, text=f'{file.path.name}: {problem.text}')
            for file in self.files
            for problem in file.problems
        ]

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """First and last log time over all files, ns; None for an empty recording."""
        ends = [end for file in self.files for end in file.span_ns or ()]
        span = (min(ends), max(ends)) if ends else None
        if span and span[1] - span[0] > LONGEST_NS:  # all of them tell a clock from damage
            parts = []
            with suppress(BagError):  # what is damaged its reading says
                for _, block in self.blocks(self.topics):
                    parts += [part.log_ns for part in block.places.values()]
            span = span_of(parts) or span
        return span

    def strings(self, name: str) -> dict[str, str]:
        """
        Return the strings that were written beside the messages under a name.

        'parameters' holds the parameter file of each node, by its name.
        """
        found: dict[str, str] = {}
        for file in self.files:
            for written, strings in file.metadata:
                if written == name:
                    found |= strings
        return found

    def blocks(self, names: Collection[str]) -> Iterator[tuple[dict[int, Topic], Block]]:
        """
        Yield the messages of topics.

        Parameters
        ----------
        names : collection of str
            Full names.

        Yields
        ------
        topics : dict of int to Topic
            What the ids in the block mean; they differ from file to file.
        block : Block

        Raises
        ------
        BagError
            If a part of the recording that is asked for is damaged, and it is not `tolerant`.
        """
        for file in self.files:
            topics = {key: topic for key, topic in file.topics.items() if topic.name in names}
            if not topics:
                continue
            file.tolerant = self.tolerant
            for block in file.blocks(topics.keys()):
                yield topics, expand_messages(block, topics, file)

    def close(self) -> None:
        """Let go of the files."""
        self._stack.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def storage_kind(name: Path) -> str:
    """Return '.mcap' or '.db3', looking behind '.zstd'; another ending as it is."""
    return Path(name.stem).suffix if name.suffix == '.zstd' else name.suffix


def opened(bag: str | Path | Bag) -> AbstractContextManager[Bag]:
    """Return a recording that is closed behind the block, unless it was open before."""
    return nullcontext(bag) if isinstance(bag, Bag) else Bag(bag)


def folder_files(folder: Path) -> list[Path]:
    """Return the files of the recording in a folder as they were begun; clips are of others."""
    try:
        found = [
            name
            for name in folder.iterdir()
            if storage_kind(name) in STORAGES and not CLIP.fullmatch(name.name)
            if name.is_file()
        ]
    except OSError as error:
        raise BagError(f'{folder}: cannot be read ({error.strerror})') from error
    return sorted(found, key=_natural)


def _expand(name: Path, target: Path) -> str:
    """Expand a file that is compressed as a whole; return what is wrong with it behind that."""
    free = shutil.disk_usage(target.parent).free - _RESERVE
    machine = zstandard.ZstdDecompressor()
    try:
        with open(name, 'rb') as packed, open(target, 'wb') as out:
            for part in machine.read_to_iter(packed):
                free -= len(part)
                if free < 0:
                    raise BagError(f'{name}: no space in {target.parent} to expand it')
                out.write(part)
    except (zstandard.ZstdError, MemoryError) as error:
        return f'{name}: cannot be expanded to its end ({error})'
    except OSError as error:
        raise BagError(f'{name}: cannot be expanded ({error})') from error
    return ''


def _stem(file: Path) -> str:
    """Return what the names of the files of one recording share."""
    return re.sub(r'[-_]?\d+\.\w+(\.zstd)?$', '', file.name)


def _base(file: Path) -> str:
    """Return the name of a file whatever it is stored in."""
    return Path(file.name.removesuffix('.zstd')).stem


def _natural(name: Path) -> list[tuple[int, str]]:
    """Sort bag_2 before bag_10."""
    parts = re.split(r'(\d+)', name.name)
    return [(int(part), '') if part.isdigit() else (0, part) for part in parts]


def read_metadata(path: Path) -> dict[str, Any]:
    """
    Read a rosbag2 `metadata.yaml`.

    Raises
    ------
    BagError
        If it cannot be read, or is of a version newer than this reader.
    """
    try:
        document = yaml.load(path.read_text(encoding='utf-8'), Loader=_Loader)
        info = dict(document['rosbag2_bagfile_information'])
        version = int(info['version'])
        info['relative_file_paths'] = [str(name) for name in info['relative_file_paths']]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        raise BagError(f'{path}: cannot be read ({str(error).splitlines()[0]})') from error
    except (KeyError, TypeError, ValueError) as error:
        raise BagError(f'{path}: not a rosbag2 description, it has no version or files') from error
    if version > NEWEST_VERSION:
        raise BagError(f'{path}: version {version}, expected at most {NEWEST_VERSION}')
    return info


def existing(path: Path) -> Path:
    """Return where a recording is: it may not be closed yet."""
    if path.exists():
        return path
    active = path.with_name(path.name + ACTIVE)
    if active.is_dir():
        return active
    raise BagError(f'{path}: no such recording, expected a bag folder, .mcap or .db3')


def _recordings_below(folder: Path) -> str:
    """Return '; it holds ...' with the names of recordings in a folder of such; '' without."""
    names = sorted(path.name for path in folder.iterdir() if is_recording(path))
    if not names:
        return ''
    more = f' and {len(names) - 3} more' if len(names) > 3 else ''
    return f'; it holds {", ".join(names[:3])}{more}: name them one by one'


def is_recording(path: Path) -> bool:
    """Return True for a folder with the files of a recording."""
    try:
        return path.is_dir() and bool(folder_files(path))
    except BagError:  # it cannot be read
        return False
