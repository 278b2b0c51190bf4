"""
Columns out of a recording.

Stamps and values of any numeric field as arrays, and the record of a rig.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Literal

import numpy as np

from hunt_ros.bag.cdr.gather import Wanted, gather
from hunt_ros.bag.cdr.layout import joint_of
from hunt_ros.bag.channels import Channels, ChannelSource, channel_map
from hunt_ros.bag.column_buffer import ColumnBuffer
from hunt_ros.bag.reader import Bag
from hunt_ros.bag.replay_schedule import FASTEST
from hunt_ros.bag.topic_fields import find_topic, listed, wanted_field
from hunt_ros.errors import BagError, MessageError
from hunt_ros.samples import CHANNELS, NANOSECONDS, Record, Series

#: Which stamp a column has: that in the message's header (log time where it has none
#: or left it zero), or the time it was recorded at.
Stamps = Literal['header', 'log']

#: How much later than it was stamped a message may be recorded, ns.
_LATE_NS = 3600 * NANOSECONDS

#: Spacing of the samples that stand for a constant channel, ns.
CONSTANT_STEP_NS = NANOSECONDS // 100


def read_columns(
    bag: str | Path | Bag,
    channels: Channels,
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
    stamps: Stamps = 'header',
) -> dict[str, Series]:
    """
    Read numeric fields of a recording as arrays.

    Parameters
    ----------
    bag : str, Path or Bag
        Folder, file, or an opened recording.
    channels : mapping or sequence
        Any names: `{'a': '/imu.linear_acceleration.y', 'b': '/daq.data[3]*0.001'}`, or a list
        as on the command line, `['a=/imu.linear_acceleration.y']`.
    start_ns, end_ns : int, optional
        Only messages with start_ns <= log time < end_ns; the rest is not read.
    stamps : str
        'header' (default) or 'log': see `Stamps`.

    Returns
    -------
    dict of str to Series
        Values in SI by the sources' scales, in the order of log time (file after
        file, as rosbags reads them). A constant has two samples, at the ends of the
        others.

    Raises
    ------
    BagError
        If a topic or a field is not there, is no number, or the recording is damaged
        where it is read.
    """
    sources = channel_map(channels, allowed=None)
    if not isinstance(bag, Bag):
        with Bag(bag) as opened:
            return read_columns(opened, sources, start_ns=start_ns, end_ns=end_ns, stamps=stamps)
    fields = {name: source for name, source in sources.items() if source.constant is None}
    buffers = _read_fields(bag, fields, start_ns, end_ns, stamps)
    with_log = any(buffer.needs_log for buffer in buffers.values())
    # Joints of several publishers on one topic: the one that is named as the channel is meant.
    shared = {name for name, buffer in buffers.items() if len(buffer.joints) > 1}
    if with_log or shared:
        buffers = _read_fields(bag, fields, start_ns, end_ns, stamps, with_log, shared)
    for name, buffer in buffers.items():
        if buffer.others and not len(buffer):
            wanted = (joint_of(fields[name].field) or ('', name))[1]
            raise MessageError(
                f'{bag.path}: topic {find_topic(bag, fields[name])}: there is no joint {wanted!r},'
                f' it has {", ".join(sorted(buffer.others))}'
            )
    columns = {
        name: buffer.series(fields[name].scale, fields[name].offset)
        for name, buffer in buffers.items()
    }
    return columns | _constants(sources, columns)


def _read_fields(
    bag: Bag,
    fields: Mapping[str, ChannelSource],
    start_ns: int | None,
    end_ns: int | None,
    stamps: Stamps,
    with_log: bool = False,
    shared: Collection[str] = (),
) -> dict[str, ColumnBuffer]:
    """Gather the fields; see `ColumnBuffer` for `with_log`, `wanted_field` for `shared`."""
    topics = {name: find_topic(bag, source) for name, source in fields.items()}
    sliced = start_ns is not None or end_ns is not None
    columns = {
        name: ColumnBuffer(0 if sliced else bag.topics[topic].messages, with_log)
        for name, topic in topics.items()
    }
    plans: dict[tuple[str, str, str, str], Wanted] = {}
    for described, block in bag.blocks(set(topics.values()), start_ns, end_ns):
        for key, places in block.places.items():
            topic = described[key]
            for name in (name for name, wanted in topics.items() if wanted == topic.name):
                plan_key = (name, topic.type, topic.definition_encoding, topic.definition)
                if plan_key not in plans:
                    alone = name not in shared
                    plans[plan_key] = wanted_field(topic, fields[name], bag, alone)
                try:
                    found = gather(block, places, plans[plan_key])
                except ValueError as error:
                    raise MessageError(f'{bag.path}: topic {topic.name}: {error}') from error
                chosen = found.log_ns if stamps == 'log' else found.stamps_ns
                columns[name].extend(found.log_ns, chosen, found.values)
                columns[name].joints |= found.joints
                columns[name].others |= found.others
    return columns


def read_record(
    path: str | Path | Bag,
    channels: Channels = (),
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
    require: Collection[str] = (),
    namespace: str | None = None,
) -> Record:
    """
    Read the measurements of a rig out of a recording.

    The topics named as the channels (`lateral`, `yaw`, `roller`, `speed`, further sensors of the
    motion) are taken, under any namespace.
    `channels` replaces or adds them one by one; the others are still found by name.

    Parameters
    ----------
    path : str or Path or Bag
        Folder, file, or an opened recording.
    channels : mapping or sequence, optional
        `{'lateral': '/daq/ch0.data[3]*0.001', 'speed': 16.3}`, or a list as on the command line.
    start_ns, end_ns : int, optional
        As `read_columns`.
    require : collection of str
        Channels without which the record is of no use.
    namespace : str, optional
        Of the rig, where the recording holds several.

    Returns
    -------
    Record
        Stamps are those of the headers. `notes` holds rig, operator and remarks, and
        under 'problems' what opening showed to be wrong with the recording. A constant
        channel is sampled at 100 Hz over the time of the others.

    Raises
    ------
    BagError
        If nothing or not what is required is found, or as `read_columns`.
    """
    if not isinstance(path, Bag):
        with Bag(path) as opened:
            return read_record(
                opened, channels, start_ns=start_ns, end_ns=end_ns, require=require,
                namespace=namespace,
            )  # fmt: skip
    given = channel_map(channels)
    sources = {**_named_channels(path, set(CHANNELS) - given.keys(), namespace), **given}
    measured = [name for name, source in sources.items() if source.constant is None]
    if not measured:
        raise BagError(
            f'{path.path}: no channel found, expected topics named {", ".join(CHANNELS)}'
            f' or a mapping such as --channel lateral=/topic.field; it has {listed(path)}'
        )
    columns = read_columns(
        path, {name: sources[name] for name in measured}, start_ns=start_ns, end_ns=end_ns
    )
    filled = {name: columns[name] for name in CHANNELS if name in columns and len(columns[name])}
    _check_span(path, filled)
    for name in require:
        if name in filled or (name in sources and name not in measured):
            continue
        if name in columns:
            raise BagError(f'{path.path}: channel {name} holds no messages')
        raise BagError(
            f'{path.path}: channel {name} is not in it, expected a topic named {name}'
            f' or --channel {name}=...; it has {listed(path)}'
        )
    if not filled:
        raise BagError(f'{path.path}: its topics {", ".join(measured)} hold no messages')
    return with_constants(Record(filled, str(path.path), _notes(path)), sources)


def _check_span(bag: Bag, columns: Mapping[str, Series]) -> None:
    """Refuse stamps that are no times: the record would last for years, nearly all of it empty."""
    first, last = bag.span_ns or (0, 0)
    # A replay runs so much faster than the clock of its recorder at most.
    longest = FASTEST * (last - first) + _LATE_NS
    ends = [(int(end), name) for name, one in columns.items()
            for end in (one.stamps_ns.min(), one.stamps_ns.max())]  # fmt: skip
    if not ends or max(ends)[0] - min(ends)[0] <= longest:
        return
    middle = float(np.median(np.concatenate([one.stamps_ns for one in columns.values()])))
    odd, name = max(ends, key=lambda end: abs(end[0] - middle))
    raise MessageError(
        f'{bag.path}: {name}: a stamp of {odd / NANOSECONDS:.10g} s,'
        f' {abs(odd - middle) / NANOSECONDS:.3g} s from the others, in a recording that took'
        f' {(last - first) / NANOSECONDS:.4g} s: its clock was not set'
    )


def _constants(
    sources: Mapping[str, ChannelSource], columns: Mapping[str, Series]
) -> dict[str, Series]:
    """Return the channels that are constants, at the first and the last stamp of the others."""
    constants = {
        name: source.constant for name, source in sources.items() if source.constant is not None
    }
    if not constants:
        return {}
    filled = [series.stamps_ns for series in columns.values() if len(series)]
    ends = [min(int(s.min()) for s in filled), max(int(s.max()) for s in filled)] if filled else []
    stamps = np.array(ends, dtype=np.int64)
    return {name: Series(stamps, np.full(stamps.size, value)) for name, value in constants.items()}


def with_constants(record: Record, sources: Mapping[str, ChannelSource]) -> Record:
    """Return a record with its constant channels, at 100 Hz over the time of the others."""
    constants = {
        name: source.constant for name, source in sources.items() if source.constant is not None
    }
    if not constants:
        return record
    stamps = np.arange(record.start_ns, record.end_ns + 1, CONSTANT_STEP_NS, dtype=np.int64)
    if stamps[-1] != record.end_ns:
        stamps = np.append(stamps, np.int64(record.end_ns))
    added = {
        name: Series(stamps, np.full(stamps.size, value)) for name, value in constants.items()
    }
    return Record({**record, **added}, record.source, record.notes)


def _named_channels(
    bag: Bag, wanted: Collection[str], namespace: str | None
) -> dict[str, ChannelSource]:
    """Return the topics whose last part is the name of a channel that is wanted."""
    found: dict[str, ChannelSource] = {}
    for channel in CHANNELS:
        ends = [name for name in bag.topics if name.rpartition('/')[2] == channel]
        if channel in wanted and ends:
            topic = find_topic(bag, ChannelSource(channel, channel), namespace)
            found[channel] = ChannelSource(channel, topic)
    return found


def _notes(bag: Bag) -> dict[str, str]:
    notes = dict(bag.notes)
    if bag.problems:
        notes['problems'] = '; '.join(bag.problems)
    return notes
