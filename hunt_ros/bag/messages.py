"""
Low-rate topics as messages.

Texts (normal form, marks, journal), statuses (events), and raw messages.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from hunt_ros.bag.blocks import in_order
from hunt_ros.bag.cdr.message_types import standard_types
from hunt_ros.bag.columns import find_topic
from hunt_ros.bag.reader import Bag, opened
from hunt_ros.errors import BagError, one_line
from hunt_ros.samples import NANOSECONDS

STRING = 'std_msgs/msg/String'
DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'


class RawMessage(NamedTuple):
    """One message as it was on the wire."""

    topic: str
    type: str
    log_ns: int
    data: bytes


def read_raw(bag: str | Path | Bag, topics: Collection[str]) -> Iterator[RawMessage]:
    """
    Yield messages as they were on the wire, in the order in which they were written.

    Parameters
    ----------
    bag : str or Path or Bag
        Folder, file, or an opened recording.
    topics : collection of str
        Full names, or last names that occur once.

    Raises
    ------
    BagError
        If a topic is not there, or the recording is damaged where it is read.
    """
    with opened(bag) as recording:
        names = {find_topic(recording, name, name) for name in topics}
        for described, block in recording.blocks(names):
            for start, length, log_ns, key in in_order(block.places):
                topic = described[key]
                data = block.data[start : start + length].tobytes()
                yield RawMessage(topic.name, topic.type, log_ns, data)


def read_texts(bag: str | Path | Bag, topic: str) -> list[str]:
    """
    Read a std_msgs/String topic: `hunting/normal_form`, `recording/mark`, a journal.

    Returns
    -------
    list of str
        Empty where the recording has no such topic.

    Raises
    ------
    BagError
        If the topic is of another type, or the recording damaged where it is read; of a message
        that cannot be read its `problems` tell.
    """
    return [message.data for message in _read(bag, topic, STRING)]


def read_statuses(bag: str | Path | Bag, topic: str) -> list[dict[str, str]]:
    """
    Read the first status of each diagnostic_msgs/DiagnosticArray: `hunting/events`.

    Returns
    -------
    list of dict of str to str
        Its values, `message`, `level` (0 to 3), and `stamp_ns` of the header; empty where the
        recording has no such topic.

    Raises
    ------
    BagError
        If the topic is of another type, or the recording damaged where it is read; of a message
        that cannot be read its `problems` tell.
    """
    found = []
    for message in _read(bag, topic, DIAGNOSTIC_ARRAY):
        stamp = message.header.stamp
        for status in message.status[:1]:
            texts = {pair.key: pair.value for pair in status.values}
            texts |= {'level': str(int(status.level)), 'message': status.message}
            found.append(texts | {'stamp_ns': str(stamp.sec * NANOSECONDS + stamp.nanosec)})
    return found


def _read(bag: str | Path | Bag, topic: str, kind: str) -> Iterator[Any]:
    """Yield the messages of a topic of one type; nothing where there is no such topic."""
    with opened(bag) as recording:
        wanted = topic.lstrip('/')
        if not any(name == topic or name.endswith('/' + wanted) for name in recording.topics):
            return
        lost: list[str] = []
        for raw in read_raw(recording, [topic]):
            if raw.type != kind:
                raise BagError(f'topic {raw.topic} is {raw.type}, expected {kind}')
            try:
                message: Any = standard_types().deserialize_cdr(raw.data, kind)
            except Exception as error:  # whatever generated code meets in damaged bytes
                lost.append(f'not a {kind}: {one_line(error):.80}')
                continue
            yield message
        if lost:
            what = f'{len(lost)} messages cannot be read ({lost[0]}), and are passed over'
            recording.note('damaged_message', f'topic {raw.topic}: {what}')
