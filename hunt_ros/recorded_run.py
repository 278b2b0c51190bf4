"""The live run that a recording holds: the detector's settings, its journal and its events."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.detection import CompanionConfig, DetectorConfig, Event, JournalEntry, Level

if TYPE_CHECKING:
    from hunt_ros.bag import Bag

_JOURNAL = 'hunting/journal'


@dataclass(frozen=True)
class RecordedRun:
    """
    What a replay needs beside the samples to repeat a live run bit for bit.

    Parameters
    ----------
    config : DetectorConfig
        Settings of the live detector when it was last started.
    companions : CompanionConfig
        Of what ran beside it.
    journal : list of JournalEntry
        From the detector's first start in the recording on.
    unknown : list of str
        Settings of the recording that this version does not have: they are left out.
    """

    config: DetectorConfig
    companions: CompanionConfig
    journal: list[JournalEntry]
    unknown: list[str]


def recorded_run(path: Path | Bag) -> RecordedRun | None:
    """
    Read the live run of a recording.

    Parameters
    ----------
    path : Path or Bag
        The recording; of messages that cannot be read its `problems` tell.

    Returns
    -------
    RecordedRun or None
        None where no detector was running, or its start is not in the recording.

    Raises
    ------
    HuntError
        If its journal is there but cannot be read.
    """
    from hunt_ros.bag.messages import read_texts

    texts = read_texts(path, _JOURNAL)
    journal = [JournalEntry.from_text(t) for text in texts for t in text.splitlines()]
    starts = [k for k, entry in enumerate(journal) if entry.kind == 'start' and entry.config]
    if not starts:
        return None
    unknown: set[str] = set()
    for entry in journal:
        unknown |= DetectorConfig.unknown(entry.config)
        unknown |= CompanionConfig.unknown(entry.companions)
    last = journal[starts[-1]]
    return RecordedRun(
        DetectorConfig.from_recorded(last.config),
        CompanionConfig.from_recorded(last.companions),
        journal[starts[0] :],
        sorted(unknown),
    )


def recorded_events(path: Path | Bag) -> list[Event] | None:
    """
    Read what detector and interlock said live, in the order of time.

    Parameters
    ----------
    path : Path or Bag
        The recording; of messages that cannot be read its `problems` tell.

    Returns
    -------
    list of Event
        Without their numbers, and as if each began when it was said; None where no detector
        was heard.

    Raises
    ------
    HuntError
        If the events are there but cannot be read.
    """
    from hunt_ros.bag.messages import read_statuses
    from hunt_ros.bag.reader import opened

    with opened(path) as bag:
        heard = any(name.endswith('hunting/status') for name in bag.topics)
        told = read_statuses(bag, 'hunting/events')
    if not (heard or told):
        return None
    return sorted(
        (
            Event(
                int(each['stamp_ns']),
                each.get('event', ''),
                Level(int(each['level'])),
                int(each['stamp_ns']),
                each.get('test', ''),
                each.get('cause', each['message']),
            )
            for each in told
        ),
        key=lambda event: event.stamp_ns,
    )
