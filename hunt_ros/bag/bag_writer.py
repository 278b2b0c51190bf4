"""
Writing a recording: a rosbag2 folder, which has its final name only when it is complete.

Version 8 of its `metadata.yaml` is the newest that Humble still reads (rosbag2 #2013). The Writer
of rosbags makes such a text too, but only of a bag that it has written itself.
"""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import dump_qos_v8, parse_qos

from hunt_ros.bag.blocks import Topic
from hunt_ros.bag.cdr.message_types import definition_text
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.bag.reader import ACTIVE, NOTES
from hunt_ros.errors import BagError
from hunt_ros.files import write_whole

VERSION = 8


class FileEntry(NamedTuple):
    """A file as the description lists it; `first_ns` is None for one with no message."""

    name: str
    first_ns: int | None
    last_ns: int
    messages: int


class BagWriter:
    """
    A recording being written: MCAP files in the layout of rosbag2, metadata version 8.

    It is written under `<path>.active`, and renamed to `path` by `close`. As a context
    manager it closes where all went well, and removes what it wrote where not.

    Parameters
    ----------
    path : str or Path
        Folder to make; it must not exist.
    notes : mapping of str to str
        Rig, operator, remarks: into every file and into metadata.yaml.

    Raises
    ------
    BagError
        If the folder exists, or cannot be made or written.
    """

    def __init__(self, path: str | Path, *, notes: Mapping[str, str] | None = None) -> None:
        self.path = Path(path)
        self.active = self.path.with_name(self.path.name + ACTIVE)
        self.notes = {str(key): str(value) for key, value in (notes or {}).items()}
        self._topics: dict[str, Topic] = {}
        self._metadata: dict[str, dict[str, str]] = {NOTES: self.notes}
        self._counts: Counter[int] = Counter()
        self._files: list[FileEntry] = []
        for name in (self.path, self.active):
            if name.exists():
                raise BagError(f'{name}: exists already, expected a name for a new recording')
        with self._writing():
            self.active.mkdir(parents=True)
            try:
                self._file = self._open()
            except OSError:
                self.active.rmdir()
                raise

    def _open(self) -> McapWriter:
        path = self.active / f'{self.path.name}_{len(self._files)}.mcap'
        try:
            file = McapWriter(path)
            for name, strings in self._metadata.items():
                if strings:
                    file.add_metadata(name, strings)
            for topic in self._topics.values():
                file.add_topic(topic)
        except OSError:
            path.unlink(missing_ok=True)  # on a full disk: a file with no message, or empty
            raise
        return file

    def topic(self, name: str, message_type: str, *, latched: bool = False) -> int:
        """
        Describe a topic once; asking again returns the same number.

        Parameters
        ----------
        name, message_type : str
            '/rig/lateral', 'sensor_msgs/msg/JointState'.
        latched : bool
            Offered as transient local.

        Returns
        -------
        int
            The topic's number, for `write`.

        Raises
        ------
        BagError
            If the topic is known with another type.
        """
        if (known := self._topics.get(name)) is not None:
            if known.type != message_type:
                raise BagError(f'{self.path}: {name} is {known.type}, expected not {message_type}')
            return known.id
        text, type_hash = definition_text(message_type)
        topic = Topic(
            len(self._topics) + 1, name, message_type, 'cdr', 'ros2msg', text,
            quality_of_service(latched), type_hash,
        )  # fmt: skip
        with self._writing():
            self._file.add_topic(topic)
        self._topics[name] = topic
        return topic.id

    def write(self, topic: int, log_ns: int, message: bytes | memoryview) -> None:
        """Write one message as it was on the wire (CDR with its encapsulation)."""
        try:  # not by `_writing`, which takes as long as the writing
            self._file.add(topic, log_ns, bytes(message))
        except OSError as error:
            raise self._refused(error) from error

    def note(self, name: str, strings: Mapping[str, str]) -> None:
        """
        Write named strings beside the messages; every later file repeats the newest.

        The name 'hunt_ros' adds to `notes`.

        """
        merged = {**self._metadata.get(name, {}), **strings}
        self._metadata[name] = merged
        if name == NOTES:
            self.notes = merged
        with self._writing():
            self._file.add_metadata(name, merged)

    def flush(self) -> None:
        """Hand everything written so far to the operating system: it survives a kill."""
        with self._writing():
            self._file.flush()

    def split(self) -> None:
        """Close the file at hand and go on in the next one."""
        with self._writing():
            self._finish_file()
            self._file = self._open()

    def _finish_file(self) -> None:
        file = self._file
        file.finish()
        self._counts.update(file.counts)
        count = sum(file.counts.values())
        self._files.append(FileEntry(file.path.name, file.first_ns, file.last_ns, count))

    @property
    def file_bytes(self) -> int:
        """Size of the file at hand, with what is still to be flushed."""
        return self._file.size + self._file.pending_bytes

    def sync(self) -> None:
        """See what was flushed on the disk itself: it survives a power cut."""
        with self._writing():
            self._file.sync()

    @property
    def file_count(self) -> int:
        """Number of files begun."""
        return len(self._files) + 1

    def close(self) -> Path:
        """
        Finish the recording, and give it its final name.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        HuntError
            If the disk refuses; what is written stays under the `.active` name.
        """
        with self._writing():
            self._finish_file()
            topics = [(topic, self._counts[topic.id]) for topic in self._topics.values()]
            text = folder_metadata(topics, self._files, self.notes)
            write_whole(self.active / 'metadata.yaml', text, 'description')
            self.active.rename(self.path)
        return self.path

    def abandon(self) -> None:
        """Let go of the file; what is written stays under the `.active` name."""
        self._file.close()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        try:
            if kind is None:
                self.close()
        finally:  # nothing is there any more where it was closed
            self.abandon()
            shutil.rmtree(self.active, ignore_errors=True)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Say in one line what the disk refuses."""
        try:
            yield
        except OSError as error:
            raise self._refused(error) from error

    def _refused(self, error: OSError) -> BagError:
        reason = error.strerror or error
        return BagError(f'{self.active}: cannot write the recording ({reason})')


def quality_of_service(latched: bool) -> str:
    """Return the offered QoS of a topic as rosbag2 stores it: reliable, volatile or latched."""
    depth, durability = (1, 1) if latched else (1000, 2)
    ever = '{sec: 9223372036, nsec: 854775807}'
    return (
        f'- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n'
        f'  deadline: {ever}\n  lifespan: {ever}\n'
        f'  liveliness: 1\n  liveliness_lease_duration: {ever}\n'
        '  avoid_ros_namespace_conventions: false'
    )


def offered_qos(text: str) -> str:
    """
    Return an offered QoS as version 8 has it, whatever version wrote it; '' where there is none.

    What is made up here would contradict the file: rosbags then reads no message of the topic.
    """
    try:
        return dump_qos_v8(parse_qos(text)) if text else ''
    except (ReaderError, AttributeError, KeyError, TypeError, ValueError):
        return ''


def folder_metadata(
    topics: Sequence[tuple[Topic, int]], files: Sequence[FileEntry], notes: Mapping[str, str]
) -> str:
    """
    Return the text of `metadata.yaml`.

    Parameters
    ----------
    topics : sequence of (Topic, int)
        What the folder holds, and how many messages of it.
    files : sequence of FileEntry
        Its files.
    notes : mapping of str to str
        Goes into `custom_data`.
    """
    filled = [entry for entry in files if entry.first_ns is not None]
    start = min((entry.first_ns or 0 for entry in filled), default=0)
    end = max((entry.last_ns for entry in filled), default=0)
    info = {
        'version': VERSION,
        'storage_identifier': 'mcap',
        **_times(start, end),
        'message_count': sum(entry.messages for entry in files),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type,
                    'serialization_format': topic.encoding,
                    'offered_qos_profiles': topic.qos,
                    'type_description_hash': topic.type_hash,
                },
                'message_count': count,
            }
            for topic, count in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [entry.name for entry in files],
        'files': [
            {
                'path': entry.name,
                **_times(entry.first_ns or 0, entry.last_ns),
                'message_count': entry.messages,
            }
            for entry in files
        ],
        'custom_data': {str(key): str(value) for key, value in notes.items()} or None,
        'ros_distro': os.environ.get('ROS_DISTRO') or 'jazzy',
    }
    text: str = yaml.safe_dump({'rosbag2_bagfile_information': info}, sort_keys=False)
    return text


def _times(first_ns: int, last_ns: int) -> dict[str, Any]:
    return {
        'duration': {'nanoseconds': max(0, last_ns - first_ns)},
        'starting_time': {'nanoseconds_since_epoch': first_ns},
    }
