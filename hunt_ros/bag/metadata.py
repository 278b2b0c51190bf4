"""
The `metadata.yaml` of a rosbag2 folder.

Version 8 is the newest that Humble still reads (rosbag2 #2013). The Writer of rosbags makes such a
text too, but only of a bag that it has written itself.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import yaml
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import dump_qos_v8, parse_qos

VERSION = 8
#: MCAP metadata record and metadata.yaml key under which rig, operator and notes stand.
NOTES = 'hunt_ros'
#: "For ever", as rosbag2 writes it.
_FOREVER = QosTime(9223372036, 854775807)


class TopicEntry(NamedTuple):
    """A topic as the description lists it."""

    name: str
    type: str
    type_hash: str
    qos: str
    messages: int
    encoding: str = 'cdr'


class FileEntry(NamedTuple):
    """A file as the description lists it; `first_ns` is None for one with no message."""

    name: str
    first_ns: int | None
    last_ns: int
    messages: int


def quality_of_service(latched: bool) -> str:
    """Return the offered QoS of a topic as rosbag2 stores it: reliable, volatile or latched."""
    profile = Qos(
        QosHistory.KEEP_LAST,
        1 if latched else 1000,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )
    return dump_qos_v8([profile])


def offered_qos(text: str) -> str:
    """
    Return an offered QoS as version 8 has it, whatever version wrote it.

    One that is missing or cannot be read becomes that of a stream.
    """
    try:
        return dump_qos_v8(parse_qos(text)) or quality_of_service(False)
    except (ReaderError, AttributeError, KeyError, TypeError, ValueError):
        return quality_of_service(False)


class _PlainDumper(yaml.SafeDumper):  # type: ignore[misc]
    """Without anchors: rosbag2's parser reads none."""

    def ignore_aliases(self, data: Any) -> bool:
        del data
        return True


def folder_metadata(
    topics: Sequence[TopicEntry], files: Sequence[FileEntry], notes: Mapping[str, str]
) -> str:
    """
    Return the text of `metadata.yaml`.

    Parameters
    ----------
    topics, files : sequences
        What the folder holds.
    notes : mapping of str to str
        Goes into `custom_data`.
    """
    filled = [entry for entry in files if entry.first_ns is not None]
    start = min((entry.first_ns or 0 for entry in filled), default=0)
    end = max((entry.last_ns for entry in filled), default=0)
    info = {
        'version': VERSION,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': end - start},
        'starting_time': {'nanoseconds_since_epoch': start},
        'message_count': sum(entry.messages for entry in files),
        'topics_with_message_count': [_topic(entry) for entry in topics],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [entry.name for entry in files],
        'files': [_file(entry) for entry in files],
        'custom_data': {str(key): str(value) for key, value in notes.items()} or None,
        'ros_distro': os.environ.get('ROS_DISTRO') or 'jazzy',
    }
    text: str = yaml.dump(
        {'rosbag2_bagfile_information': info}, Dumper=_PlainDumper, sort_keys=False
    )
    return text


def _topic(entry: TopicEntry) -> dict[str, Any]:
    return {
        'topic_metadata': {
            'name': entry.name,
            'type': entry.type,
            'serialization_format': entry.encoding,
            'offered_qos_profiles': entry.qos,
            'type_description_hash': entry.type_hash,
        },
        'message_count': entry.messages,
    }


def _file(entry: FileEntry) -> dict[str, Any]:
    first = entry.first_ns or 0
    return {
        'path': entry.name,
        'starting_time': {'nanoseconds_since_epoch': first},
        'duration': {'nanoseconds': max(0, entry.last_ns - first)},
        'message_count': entry.messages,
    }
