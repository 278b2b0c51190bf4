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

from hunt_ros.bag.blocks import Topic

VERSION = 8
#: MCAP metadata record and metadata.yaml key under which rig, operator and notes stand.
NOTES = 'hunt_ros'
#: "For ever", as rosbag2 writes it.
_FOREVER = QosTime(9223372036, 854775807)


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
    Return an offered QoS as version 8 has it, whatever version wrote it; '' where there is none.

    What is made up here would contradict the file: rosbags then reads no message of the topic.
    """
    try:
        return dump_qos_v8(parse_qos(text)) if text else ''
    except (ReaderError, AttributeError, KeyError, TypeError, ValueError):
        return ''


class _PlainDumper(yaml.SafeDumper):  # type: ignore[misc]
    """Without anchors: rosbag2's parser reads none."""

    def ignore_aliases(self, data: Any) -> bool:
        del data
        return True


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
    text: str = yaml.dump(
        {'rosbag2_bagfile_information': info}, Dumper=_PlainDumper, sort_keys=False
    )
    return text


def _times(first_ns: int, last_ns: int) -> dict[str, Any]:
    return {
        'duration': {'nanoseconds': max(0, last_ns - first_ns)},
        'starting_time': {'nanoseconds_since_epoch': first_ns},
    }
