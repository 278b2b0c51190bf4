"""
Low-rate topics as messages.

Texts (normal form, marks, journal), events and statuses.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hunt_ros.bag.cdr.message_types import standard_types
from hunt_ros.bag.channels import ChannelSource
from hunt_ros.bag.reader import Bag
from hunt_ros.bag.topic_fields import find_topic
from hunt_ros.errors import BagError
from hunt_ros.samples import NANOSECONDS

STRING = 'std_msgs/msg/String'
DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'

#: Levels of diagnostic_msgs/DiagnosticStatus, as the design names them.
LEVELS: tuple[str, ...] = ('OK', 'WARN', 'ERROR', 'STALE')


class RawMessage(NamedTuple):
    """One message as it was on the wire."""

    topic: str
    type: str
    log_ns: int
    data: bytes


class Text(NamedTuple):
    """A std_msgs/String and when it was recorded, ns."""

    log_ns: int
    text: str


@dataclass(frozen=True)
class Status:
    """
    One diagnostic_msgs/DiagnosticStatus, with the stamp of its array.

    `level` is one of `LEVELS`; `values` holds the key-value pairs as text.
    """

    log_ns: int
    stamp_ns: int
    name: str
    level: str
    message: str
    values: dict[str, str] = field(default_factory=dict)


def read_raw(
    bag: str | Path | Bag,
    topics: Collection[str],
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Iterator[RawMessage]:
    """
    Yield messages as they were on the wire, in the order of log time within each block.

    Parameters
    ----------
    bag : str or Path or Bag
        Folder, file, or an opened recording.
    topics : collection of str
        Full names, or last names that occur once.
    start_ns, end_ns : int, optional
        Only start_ns <= log time < end_ns.

    Raises
    ------
    BagError
        If a topic is not there, or the recording is damaged where it is read.
    """
    if not isinstance(bag, Bag):
        with Bag(bag) as opened:
            yield from read_raw(opened, topics, start_ns, end_ns)
        return
    names = {find_topic(bag, ChannelSource(name, name)) for name in topics}
    for described, block in bag.blocks(names, start_ns, end_ns):
        rows: list[tuple[int, int, int, int]] = []
        for key, places in block.places.items():
            columns = (part.tolist() for part in places)
            rows += [
                (log, start, length, key) for log, start, length in zip(*columns, strict=True)
            ]
        rows.sort(key=lambda row: row[0])
        for log_ns, start, length, key in rows:
            topic = described[key]
            data = block.data[start : start + length].tobytes()
            yield RawMessage(topic.name, topic.type, log_ns, data)


def read_messages(
    bag: str | Path | Bag,
    topic: str,
    message_type: str,
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Iterator[tuple[int, Any]]:
    """
    Yield (log time, message) of one topic of a standard type, deserialised by rosbags.

    Raises
    ------
    BagError
        If the topic is not there, is of another type, or a message cannot be read.
    """
    for raw in read_raw(bag, [topic], start_ns, end_ns):
        if raw.type != message_type:
            raise BagError(f'topic {raw.topic} is {raw.type}, expected {message_type}')
        yield raw.log_ns, deserialise(raw)


def deserialise(raw: RawMessage) -> Any:
    """
    Deserialise one message of a standard type.

    Raises
    ------
    BagError
        If it is no message of its type.
    """
    try:
        return standard_types().deserialize_cdr(raw.data, raw.type)
    except Exception as error:  # whatever generated code meets in damaged bytes
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BagError(
            f'topic {raw.topic} at {raw.log_ns} ns: not a {raw.type} ({reason:.80})'
        ) from error


def read_texts(bag: str | Path | Bag, topic: str) -> list[Text]:
    """
    Read a std_msgs/String topic: `hunting/normal_form`, `recording/mark`, a journal.

    Returns
    -------
    list of Text
        Empty where the recording has no such topic.

    Raises
    ------
    BagError
        If the topic is of another type or damaged.
    """
    if not _has(bag, topic):
        return []
    return [Text(log_ns, message.data) for log_ns, message in read_messages(bag, topic, STRING)]


def read_statuses(bag: str | Path | Bag, topic: str) -> list[Status]:
    """
    Read a diagnostic_msgs/DiagnosticArray topic: `hunting/events`, `hunting/status`.

    Returns
    -------
    list of Status
        In the order in which they were recorded; empty where there is no such topic.

    Raises
    ------
    BagError
        If the topic is of another type or damaged.
    """
    if not _has(bag, topic):
        return []
    statuses: list[Status] = []
    for log_ns, array in read_messages(bag, topic, DIAGNOSTIC_ARRAY):
        stamp_ns = array.header.stamp.sec * NANOSECONDS + array.header.stamp.nanosec
        for status in array.status:
            values = {pair.key: pair.value for pair in status.values}
            level = _level(status.level)
            statuses.append(Status(log_ns, stamp_ns, status.name, level, status.message, values))
    return statuses


def _level(value: Any) -> str:
    """Name a level; the byte comes as a number, bytes or a numpy scalar."""
    number = value[0] if isinstance(value, bytes) else int(np.asarray(value).ravel()[0])
    return LEVELS[number] if 0 <= number < len(LEVELS) else 'STALE'


def _has(bag: str | Path | Bag, topic: str) -> bool:
    if not isinstance(bag, Bag):
        with Bag(bag) as opened:
            return _has(opened, topic)
    return any(name == topic or name.endswith('/' + topic.lstrip('/')) for name in bag.topics)
