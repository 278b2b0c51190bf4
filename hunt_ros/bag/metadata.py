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

VERSION = 8
#: "For ever", as rosbag2 writes it.
_FOREVER = {'sec': 9223372036, 'nsec': 854775807}


class TopicEntry(NamedTuple):
    """A topic as the description lists it."""

    name: str
    type: str
    type_hash: str
    latched: bool
    messages: int


class FileEntry(NamedTuple):
    """A file as the description lists it; `first_ns` is None for one with no message."""

    name: str
    first_ns: int | None
    last_ns: int
    messages: int


def quality_of_service(latched: bool) -> str:
    """Return the offered QoS of a topic as rosbag2 stores it: reliable, volatile or latched."""
    profile = {
        'history': 1,
        'depth': 1 if latched else 1000,
        'reliability': 1,
        'durability': 1 if latched else 2,
        'deadline': _FOREVER,
        'lifespan': _FOREVER,
        'liveliness': 1,
        'liveliness_lease_duration': _FOREVER,
        'avoid_ros_namespace_conventions': False,
    }
    text: str = yaml.dump([profile], Dumper=_PlainDumper, sort_keys=False)
    return text.strip()


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
            'serialization_format': 'cdr',
            'offered_qos_profiles': quality_of_service(entry.latched),
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
