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
from hunt_ros.bag.reader import Bag
from hunt_ros.bag.topic_fields import find_topic
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
    if not isinstance(bag, Bag):
        with Bag(bag) as opened:
            return read_texts(opened, topic)
    if not any(name == topic or name.endswith('/' + topic.lstrip('/')) for name in bag.topics):
        return []
    found = []
    for raw in read_raw(bag, [topic]):
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
