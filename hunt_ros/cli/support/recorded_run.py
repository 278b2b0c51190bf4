"""The live run that a recording holds: the detector's settings, its journal and its events."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from hunt_ros.bag import Bag
from hunt_ros.bag.messages import read_statuses, read_texts
from hunt_ros.detection import CompanionConfig, DetectorConfig, Event, JournalEntry, Level


class RecordedRun(NamedTuple):
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


def recorded_run(bag: Path | Bag) -> RecordedRun | None:
    """
    Read the live run of a recording.

    Parameters
    ----------
    bag : Bag
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
    texts = read_texts(bag, 'hunting/journal')
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


def recorded_events(bag: Bag) -> list[Event] | None:
    """
    Read what detector and interlock said live, in the order of time.

    Parameters
    ----------
    bag : Bag
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
    told = read_statuses(bag, 'hunting/events')
    if not (told or any(name.endswith('hunting/status') for name in bag.topics)):
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
