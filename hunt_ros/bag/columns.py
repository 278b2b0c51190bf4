"""
Columns out of a recording.

Stamps and values of any numeric field as arrays, and the record of a rig.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag import clocks
from hunt_ros.bag.blocks import Topic, by_topic
from hunt_ros.bag.cdr.gather import Gathered, Wanted, gather
from hunt_ros.bag.cdr.layout import PathError, joint_of, parse_path, stamp_path, usual_field
from hunt_ros.bag.cdr.message_types import definitions_of
from hunt_ros.bag.channels import Channels, ChannelSource, channel_map
from hunt_ros.bag.reader import Bag, opened
from hunt_ros.bursts import evened
from hunt_ros.errors import BagError, MessageError
from hunt_ros.samples import CHANNELS, NANOSECONDS, Record, Series
from hunt_ros.sensors import JOINT_STATE

#: Which stamp a column has: that in the message's header (log time where it has none
#: or left it zero), or the time it was recorded at.
Stamps = Literal['header', 'log']

#: A replay runs so much faster than the clock of its recorder at most.
_FASTEST = 50.0
#: How much later than it was stamped a message may be recorded, ns.
_LATE_NS = 3600 * NANOSECONDS
#: So many reasons are told why messages of a topic are passed over.
_TOLD = 3
#: Spacing of the samples that stand for a constant channel, ns.
CONSTANT_STEP_NS = NANOSECONDS // 100


def read_columns(
    bag: str | Path | Bag, channels: Channels, *, stamps: Stamps = 'header'
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
    stamps : str
        'header' (default) or 'log': see `Stamps`.

    Returns
    -------
    dict of str to Series
        Values in SI by the sources' scales, in the order of log time, file after file; where
        the recorder's clock was set back, in the order in which they were written. A constant
        is sampled at 100 Hz over the time of the others.

    Raises
    ------
    BagError
        If a topic or a field is not there, is no number, or the recording is damaged
        where it is read.
    """
    sources = channel_map(channels, allowed=None)
    with opened(bag) as recording:
        columns, logged = _Reader(recording, sources).columns()
        if stamps == 'log':
            columns = {name: Series(logged[name], one.values) for name, one in columns.items()}
        return with_constants(columns, sources, str(recording.path))


class _Reader:
    """Gathers fields of a recording."""

    def __init__(self, bag: Bag, sources: Mapping[str, ChannelSource]) -> None:
        self.bag = bag
        self.sources = {name: one for name, one in sources.items() if one.constant is None}
        self.topics = {
            name: find_topic(bag, one.topic, name) for name, one in self.sources.items()
        }

    def columns(self) -> tuple[dict[str, Series], dict[str, NDArray[np.int64]]]:
        """Return the columns, scaled, and when their messages were logged."""
        found = self._read()
        columns, logged = {}, {}
        for name, source in self.sources.items():
            parts = found.pop(name)
            # Of several publishers on one topic the joint named as the channel is meant.
            if len({joint for part in parts for joint in part.joints}) > 1:
                parts = [part.of_name() for part in parts]
            others = {joint for part in parts for joint in part.others}
            passed = sum((part.passed for part in parts), Counter[str]())
            log_ns, series = _series(parts, source)
            del parts  # as numbers they need as much room again
            where = f'topic {self.topics[name]}'
            if (others or passed) and not len(series):
                _, wanted = joint_of(source.field) or ('position', name)
                what = f'there is no joint {wanted!r}, it has {", ".join(sorted(others))}'
                what = f'its messages {max(passed, key=passed.__getitem__)}' if passed else what
                raise MessageError(f'{self.bag.path}: {where}: {what}')
            possible = clocks.possible(series.stamps_ns)
            if not possible.all():
                log_ns = log_ns[possible]
                series = Series(series.stamps_ns[possible], series.values[possible])
            passed['are of an impossible time'] += int(np.count_nonzero(~possible))
            for what, count in (+passed).most_common(_TOLD):
                text = f'{where}: {count} messages {what}, and are passed over'
                self.bag.note('damaged_message', text)
            columns[name], logged[name] = series, log_ns
        if told := clocks.set_back(columns) or clocks.apart(columns, logged):
            self.bag.note('clock_jump', told)
        return columns, logged

    def _read(self) -> dict[str, list[Gathered]]:
        """Gather the fields, block by block."""
        found: dict[str, list[Gathered]] = {name: [] for name in self.topics}
        plans: dict[tuple[str, str, str, str], Wanted] = {}
        for described, block in self.bag.blocks(set(self.topics.values())):
            for topic, places in by_topic(described, block.places):
                for name, wanted in self.topics.items():
                    if wanted != topic.name:
                        continue
                    plan = name, topic.type, topic.definition_encoding, topic.definition
                    if plan not in plans:
                        plans[plan] = self._wanted(topic, name)
                    try:
                        found[name].append(gather(block, places, plans[plan]))
                    except PathError as error:
                        raise BagError(f'{self.bag.path}: topic {topic.name}: {error}') from error
        return found

    def _wanted(self, topic: Topic, name: str) -> Wanted:
        """Find the field that a source means in messages of a topic."""
        source = self.sources[name]
        definitions = definitions_of(topic, str(self.bag.path))
        text = source.field or usual_field(definitions, topic.type)
        stamp = stamp_path(definitions, topic.type)
        joint = joint_of(text) if source.field else ('position', source.channel)
        if joint is None or topic.type != JOINT_STATE:
            try:
                return Wanted(definitions, topic.type, parse_path(text), stamp)
            except ValueError as error:
                raise BagError(f'{self.bag.path}: topic {topic.name}: {error}') from error
        # Where no field is named the only joint of a message is taken, whatever its name.
        alone = not source.field
        return Wanted(definitions, topic.type, parse_path(joint[0]), stamp, joint[1], alone)


def _series(parts: Sequence[Gathered], source: ChannelSource) -> tuple[NDArray[np.int64], Series]:
    """Return what was found in blocks, scaled, in the order of log time, and these times."""
    if not parts:
        return np.zeros(0, np.int64), Series(np.zeros(0, np.int64), np.zeros(0))
    log_ns = np.concatenate([part.log_ns for part in parts])
    values = np.concatenate([part.values for part in parts])
    stamps = np.concatenate([part.stamps_ns for part in parts])
    if not stamps.all():  # a header that nobody filled: the log time stands in
        stamps = np.where(stamps == 0, log_ns, stamps)
    if (log_ns[1:] < log_ns[:-1]).any():
        lost = ~clocks.possible(log_ns)  # in the place of the one before
        log_ns = log_ns[np.maximum.accumulate(np.where(lost, lost.argmin(), np.arange(lost.size)))]
        order = np.argsort(clocks.going_on(log_ns), kind='stable')
        log_ns, stamps, values = log_ns[order], stamps[order], values[order]
    if source.scale != 1.0:
        values *= source.scale
    if source.offset:
        values += source.offset
    return log_ns, Series(stamps, values)


def read_record(
    path: str | Path | Bag,
    channels: Channels = (),
    *,
    require: Collection[str] = (),
    as_stamped: bool = False,
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
    require : collection of str
        Channels without which the record is of no use.
    as_stamped : bool
        The stamps are those of the headers in any case: to look at them, to copy them, or to
        repeat what was made of them.

    Returns
    -------
    Record
        Stamps are those of the headers; where a buffer was stamped when it was read, they are
        when its samples were taken (`hunt_ros.bursts`). `notes` holds rig, operator and remarks,
        under 'problems' what opening showed to be wrong with the recording, and under 'bursts'
        which channels are stamped in bursts. A constant channel is sampled at 100 Hz over the
        time of the others.

    Raises
    ------
    BagError
        If nothing or not what is required is found, or as `read_columns`.
    """
    with opened(path) as bag:
        given = channel_map(channels)
        sources = {**_named_channels(bag, set(CHANNELS) - given.keys()), **given}
        measured = [name for name, source in sources.items() if source.constant is None]
        if not measured:
            raise BagError(
                f'{bag.path}: no channel found, expected topics named {", ".join(CHANNELS)}'
                f' or a mapping such as --channel lateral=/topic.field; it has {listed(bag)}'
            )
        columns = read_columns(bag, {name: sources[name] for name in measured})
        filled = {
            name: columns[name] for name in CHANNELS if name in columns and len(columns[name])
        }
        clocks.refuse_still(filled, str(bag.path))
        first, last = bag.span_ns or (0, 0)
        clocks.refuse_years(filled, str(bag.path), _FASTEST * (last - first) + _LATE_NS)
        for name in require:
            if name in filled or (name in sources and name not in measured):
                continue
            if name in columns:
                raise BagError(f'{bag.path}: channel {name} holds no messages')
            raise BagError(
                f'{bag.path}: channel {name} is not in it, expected a topic named {name}'
                f' or --channel {name}=...; it has {listed(bag)}'
            )
        if not filled:
            raise BagError(f'{bag.path}: its topics {", ".join(measured)} hold no messages')
        path, notes = str(bag.path), dict(bag.notes)
        if bag.problems:
            notes['problems'] = '; '.join(map(str, bag.problems))
        if not as_stamped:
            filled, remarks = evened(filled)
            if remarks:
                notes['bursts'] = '; '.join(remarks)
        return Record(with_constants(filled, sources, path), path, notes)


def with_constants(
    columns: Mapping[str, Series], sources: Mapping[str, ChannelSource], where: str
) -> dict[str, Series]:
    """
    Return columns with the constant ones among the sources, at 100 Hz over the time of the others.

    Raises
    ------
    BagError
        If there are some, and the others last longer than any recording.
    """
    constants = {
        name: source.constant for name, source in sources.items() if source.constant is not None
    }
    stamps = np.zeros(0, np.int64)
    if constants and any(map(len, columns.values())):
        first, last = clocks.refuse_years(columns, where)
        stamps = np.append(np.arange(first, last, CONSTANT_STEP_NS, dtype=np.int64), last)
    added = {name: Series(stamps, np.full(stamps.size, one)) for name, one in constants.items()}
    return {**columns, **added}


def _named_channels(bag: Bag, wanted: Collection[str]) -> dict[str, ChannelSource]:
    """Return the topics whose last part is the name of a channel that is wanted."""
    last = {name.rpartition('/')[2] for name in bag.topics}
    return {
        channel: ChannelSource(channel, find_topic(bag, channel, channel))
        for channel in CHANNELS
        if channel in wanted and channel in last
    }


def find_topic(bag: Bag, topic: str, channel: str) -> str:
    """
    Find a topic by its full name, or by its last one.

    Raises
    ------
    BagError
        If there is none, or several, with the channel that it is meant for.
    """
    if topic in bag.topics:
        return topic
    ending = '/' + topic.strip('/')
    local = not topic.startswith('/')
    found = sorted(name for name in bag.topics if local and name.endswith(ending))
    if len(found) == 1:
        return found[0]
    why = (
        f'several topics end in {topic!r} ({", ".join(found)}), name the one'
        if found
        else f'no topic {topic!r}, it has {listed(bag)}'
    )
    raise BagError(f'{bag.path}: channel {channel}: {why}')


def listed(bag: Bag) -> str:
    """Return the first dozen topics of a recording, and what is wrong with it, for a message."""
    names = sorted(bag.topics)
    more = f' and {len(names) - 12} more' if len(names) > 12 else ''
    return ': '.join([', '.join(names[:12]) + more or 'no topics', *map(str, bag.problems[-1:])])
