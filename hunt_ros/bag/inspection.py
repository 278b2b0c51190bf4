"""
What is in a recording, and what is wrong with it.

Opening a recording shows whether it was closed and has its index. The inspection
goes on: it reads everything, checks every chunk, and looks at the time of every topic.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.blocks import Problem, by_topic
from hunt_ros.bag.clocks import span_of
from hunt_ros.bag.columns import find_topic, read_record
from hunt_ros.bag.plausible import possible_readings, wrong_unit
from hunt_ros.bag.reader import Bag
from hunt_ros.bursts import bursts_of
from hunt_ros.errors import BagError, MessageError
from hunt_ros.samples import CHANNELS, NANOSECONDS, Record
from hunt_ros.sensors import lacking

#: A pause longer than so many sample intervals, and than `GAP_S`, is a gap.
GAP_STEPS = 20.0
GAP_S = 0.1
#: Of a topic with a steady rate: fewer messages than this say nothing about it.
STEADY_COUNT = 50
#: A steady topic that ends so long before the recording does has stopped.
STOPPED_S = 2.0


@dataclass
class TopicReport:
    """A topic: how many messages, how often, from when to when (s since the start)."""

    name: str
    type: str
    messages: int
    rate_hz: float | None
    first_s: float | None
    last_s: float | None


@dataclass
class Inspection:
    """What `inspect` found."""

    path: Path
    size_bytes: int
    files: list[str]
    start_ns: int | None
    duration_s: float
    notes: dict[str, str]
    topics: list[TopicReport] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """Readable messages on all topics."""
        return sum(topic.messages for topic in self.topics)

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types."""
        return {**asdict(self), 'path': str(self.path), 'messages': self.messages}


def inspect(
    path: str | Path, advance: Callable[[float], None] = lambda fraction: None
) -> Inspection:
    """
    Read a recording from end to end, and say what is in it and what is wrong.

    Parameters
    ----------
    path : str or Path
        Folder or file.
    advance : callable, optional
        Told the fraction that is done.

    Raises
    ------
    BagError
        If it cannot be opened at all.
    """
    with Bag(path, tolerant=True) as bag:
        times = _read_times(bag, advance)
        record, found = _measured(bag)
        span = span_of([*times.values()])
        start, end = span or (0, 0)
        report = Inspection(
            bag.path,
            sum(file.path.stat().st_size for file in bag.files),
            [file.path.name for file in bag.files],
            start if span else None,
            (end - start) / NANOSECONDS,
            bag.notes,
            problems=bag.problems,
        )
        # The channels of a rig are judged by the stamps that every command reads them by.
        read = {find_topic(bag, name, name): name for name in record}
        for name, summary in sorted(bag.topics.items()):
            stamps = times.get(name, np.zeros(0, np.int64))
            topic = TopicReport(name, summary.type, int(stamps.size), None, None, None)
            report.topics.append(topic)
            stamps = stamps[(stamps >= start) & (stamps <= end)]
            if lost := topic.messages - stamps.size:
                text = f'{name}: {lost} messages of an impossible time'
                report.problems.append(Problem('damaged_message', text))
            if stamps.size:
                first, last = int(stamps.min()), int(stamps.max())
                if last > first:
                    topic.rate_hz = (stamps.size - 1) / ((last - first) / NANOSECONDS)
                topic.first_s, topic.last_s = ((at - start) / NANOSECONDS for at in (first, last))
                seen: list[Problem] = []
                if name in read:
                    by_header = record[read[name]].stamps_ns
                    seen = _in_time(name, by_header, record.start_ns, record.end_ns)
                report.problems += seen or _in_time(name, stamps, start, end)
        report.problems += found
    names = {name.rpartition('/')[2] for name, stamps in times.items() if stamps.size}
    if names & set(CHANNELS):
        for either in lacking(names):
            text = f'no topic {" or ".join(either)} with messages'
            report.problems.append(Problem('missing_channel', text))
    return report


def _measured(bag: Bag) -> tuple[Record, list[Problem]]:
    """Read the measurements as every other command would, and say what is wrong with them."""
    try:
        record = read_record(bag)
    except MessageError as error:
        return Record({}), [Problem('damaged_message', str(error))]
    except BagError:
        return Record({}), []  # not those of a rig
    found = [Problem('damaged_message', text) for text in possible_readings(record)[1]]
    for name, series in record.items():
        if not len(series.finite()):
            text = f'channel {name}: none of {len(series)} readings is a number'
            found.append(Problem('damaged_message', text))
        if text := wrong_unit(name, series):
            found.append(Problem('wrong_unit', text))
    if bursts := record.notes.get('bursts'):
        found.append(Problem('bursts', bursts))
    return record, found


def _read_times(bag: Bag, advance: Callable[[float], None]) -> dict[str, NDArray[np.int64]]:
    """Return the log times of every topic in the order of the files."""
    parts: dict[str, list[NDArray[np.int64]]] = {}
    total = max(1, sum(topic.messages for topic in bag.topics.values()))
    done = 0
    for topics, block in bag.blocks(bag.topics.keys()):
        for topic, places in by_topic(topics, block.places):
            parts.setdefault(topic.name, []).append(places.log_ns)
            done += places.log_ns.size
        advance(min(1.0, done / total))
    return {name: np.concatenate(several) for name, several in parts.items()}


def _in_time(name: str, stamps: NDArray[np.int64], start: int, end: int) -> list[Problem]:
    """Look for jumps of the clock, gaps, and an end before the end of the recording."""
    steps = np.diff(stamps)
    told = [
        ('clock_jump', row, f'the clock jumps back by {-int(steps[row]) / NANOSECONDS:.3f} s')
        for row in np.flatnonzero(steps < 0)[:10].tolist()
    ]
    step = float(np.median(steps)) if stamps.size >= STEADY_COUNT else 0.0
    # A topic that comes in bursts or by chance has no gaps.
    steady = step > 0.0 and float(np.percentile(steps, 90)) < 3.0 * step
    if steady and bursts_of(stamps) is None:
        longest = max(GAP_STEPS * step, GAP_S * NANOSECONDS)
        for row in np.flatnonzero(steps > longest)[:10].tolist():
            told.append(('gap', row, f'nothing for {int(steps[row]) / NANOSECONDS:.3f} s'))
        left = end - int(stamps.max())
        if left > max(longest, STOPPED_S * NANOSECONDS):
            text = f'stops {left / NANOSECONDS:.3f} s before the end'
            told.append(('stopped', int(stamps.argmax()), text))
    return [
        Problem(kind, f'{name}: {text}', (int(stamps[row]) - start) / NANOSECONDS)
        for kind, row, text in told
    ]
