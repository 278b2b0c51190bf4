"""
Low-rate topics as messages.

Texts (normal form, marks, journal), and raw messages.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from hunt_ros.bag.cdr.message_types import standard_types
from hunt_ros.bag.channels import ChannelSource
from hunt_ros.bag.columns import find_topic
from hunt_ros.bag.reader import Bag, opened
from hunt_ros.errors import BagError

STRING = 'std_msgs/msg/String'
DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'


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


def read_raw(bag: str | Path | Bag, topics: Collection[str]) -> Iterator[RawMessage]:
    """
    Yield messages as they were on the wire, in the order of log time within each block.

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
        names = {find_topic(recording, ChannelSource(name, name)) for name in topics}
        for described, block in recording.blocks(names):
            rows = sorted(
                (log_ns, start, length, key)
                for key, places in block.places.items()
                for log_ns, start, length in zip(*(p.tolist() for p in places), strict=True)
            )
            for log_ns, start, length, key in rows:
                topic = described[key]
                data = block.data[start : start + length].tobytes()
                yield RawMessage(topic.name, topic.type, log_ns, data)


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
    found = []
    with opened(bag) as recording:
        wanted = topic.lstrip('/')
        if not any(name == topic or name.endswith('/' + wanted) for name in recording.topics):
            return []
        for raw in read_raw(recording, [topic]):
            if raw.type != STRING:
                raise BagError(f'topic {raw.topic} is {raw.type}, expected {STRING}')
            try:
                message: Any = standard_types().deserialize_cdr(raw.data, STRING)
            except Exception as error:  # whatever generated code meets in damaged bytes
                reason = str(error).splitlines()[0] if str(error) else type(error).__name__
                raise BagError(
                    f'topic {raw.topic} at {raw.log_ns} ns: not a {STRING} ({reason:.80})'
                ) from error
            found.append(Text(raw.log_ns, message.data))
    return found
