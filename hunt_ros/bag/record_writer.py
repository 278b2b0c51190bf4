"""
Writing a whole record as a recording.

One message of each topic is serialised by rosbags; all others differ from it in
stamp and value only, and are made by putting these into copies of it, a column at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from heapq import merge
from itertools import repeat
from operator import itemgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.bag_writer import BagWriter
from hunt_ros.bag.cdr.layout import locate, parse_path
from hunt_ros.bag.cdr.message_types import standard_definitions, standard_types
from hunt_ros.bag.clocks import going_on
from hunt_ros.errors import BagError
from hunt_ros.samples import NANOSECONDS, Record, Series
from hunt_ros.sensors import CHANNEL_FIELDS, JOINT_STATE

#: Messages of a channel that are made together.
_ROWS = 10_000


def write_record(
    path: str | Path,
    record: Record,
    *,
    namespace: str = 'rig',
    notes: Mapping[str, str] | None = None,
) -> Path:
    """
    Write a record as a recording with the topics of a live rig.

    The sensors of the motion and `roller` become sensor_msgs/JointState, `speed` becomes
    geometry_msgs/TwistStamped; log time and header stamp are the sample's stamp. Where a clock
    was set back the samples stay in their order, and the log time goes on.

    Parameters
    ----------
    path : str or Path
        Folder to make.
    record : Record
        Samples as they are; NaN stays NaN.
    namespace : str
        Of the topics; '' for none.
    notes : mapping of str to str, optional
        Added to the record's own.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    BagError
        If the record is empty, a stamp is negative, or the folder cannot be written.
    """
    if not any(len(series) for series in record.values()):
        raise BagError(f'{path}: the record of {record.source or "no source"} has no samples')
    if record.start_ns < 0:
        raise BagError(f'{path}: a stamp of {record.start_ns} ns, expected none before 1970')
    together = {**record.notes, **(notes or {})}
    if problems := together.pop('problems', ''):  # those of another recording, not of this one
        together['source_problems'] = problems
    with BagWriter(path, notes=together) as bag:
        for message in messages_of(record, bag.topic, namespace):
            bag.write(*message)
    return Path(path)


def messages_of(
    record: Record, topic: Callable[[str, str], int], namespace: str
) -> Iterator[tuple[int, int, bytes]]:
    """
    Return the messages of a record in the order of their stamps, as `BagWriter.write` takes them.

    Where a clock was set back, what was measured first stays first, and the time goes on.

    Parameters
    ----------
    record : Record
        In SI.
    topic : callable
        Gives the number of a topic from its name and type.
    namespace : str
        In front of the topics' names.
    """
    prefix = f'/{namespace.strip("/")}' if namespace.strip('/') else ''
    keys = {
        name: topic(f'{prefix}/{name}', kind)
        for name, (kind, _) in CHANNEL_FIELDS.items()
        if name in record
    }
    each = (_messages(key, name, record[name]) for name, key in keys.items())
    return merge(*each, key=itemgetter(1))


def _messages(key: int, channel: str, series: Series) -> Iterator[tuple[int, int, bytes]]:
    times = going_on(series.stamps_ns)
    order = np.argsort(times, kind='stable')
    # As messages a series is ten times as large: some at a time.
    for begin in range(0, len(series), _ROWS):
        rows = order[begin : begin + _ROWS]
        part = Series(series.stamps_ns[rows], series.values[rows])
        yield from zip(
            repeat(key),
            times[rows].tolist(),
            map(bytes, serialise(channel, part)),
            strict=False,
        )


def serialise(channel: str, series: Series) -> NDArray[np.uint8]:
    """
    Serialise every sample of a channel.

    Returns
    -------
    ndarray of uint8, shape (n, bytes)
        Messages of equal length.
    """
    kind, field = CHANNEL_FIELDS[channel]
    template = _template(channel)
    rows = np.tile(np.frombuffer(template, dtype=np.uint8), (len(series), 1))
    definitions = standard_definitions()
    seconds, rest = np.divmod(series.stamps_ns, NANOSECONDS)
    columns = {'header.stamp.sec': seconds, 'header.stamp.nanosec': rest, field: series.values}
    for path, values in columns.items():
        place = locate(definitions, kind, template, parse_path(path))
        raw = values.astype(place.kind).view(np.uint8).reshape(-1, place.size)
        rows[:, place.offset : place.offset + place.size] = raw
    return rows


def _template(channel: str) -> bytes:
    """Return the message of a channel with zeros in it, serialised."""
    kind, _ = CHANNEL_FIELDS[channel]
    store = standard_types()
    types = store.types
    stamp = types['builtin_interfaces/msg/Time'](sec=0, nanosec=0)
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='')
    if kind == JOINT_STATE:
        one, none = np.zeros(1), np.zeros(0)
        message = types[kind](
            header=header, name=[channel], position=one, velocity=none, effort=none
        )
    else:
        vector = types['geometry_msgs/msg/Vector3']
        twist = types['geometry_msgs/msg/Twist'](
            linear=vector(x=0.0, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0)
        )
        message = types[kind](header=header, twist=twist)
    return bytes(store.serialize_cdr(message, kind, little_endian=True))
