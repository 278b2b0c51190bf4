"""The live run that a recording holds: the detector's settings, its journal and its events."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hunt_ros.detection import CompanionConfig, DetectorConfig, Event, JournalEntry, Level

_DETECTOR = 'hunting_detector'
_JOURNAL = 'hunting/journal'
#: Parameters of the node by which no row changes.
_OF_THE_NODE = ('frame_id', 'autostart', 'use_sim_time', 'start_type_description_service')


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


def recorded_run(path: Path) -> RecordedRun | None:
    """
    Read the live run of a recording.

    Parameters
    ----------
    path : Path
        The recording.

    Returns
    -------
    RecordedRun or None
        None where no detector was running, or its start is not in the recording.

    Raises
    ------
    HuntError
        If its journal or its parameters are there but cannot be read.
    """
    from hunt_ros.bag import Bag
    from hunt_ros.bag.messages import read_texts
    from hunt_ros.rig import parameters_of

    with Bag(path) as bag:
        texts_of_journal = [entry.text for entry in read_texts(bag, _JOURNAL)]
        texts = bag.strings('parameters')
    journal = [JournalEntry.from_text(t) for text in texts_of_journal for t in text.splitlines()]
    starts = [k for k, entry in enumerate(journal) if entry.kind == 'start']
    if not starts:
        return None
    detectors = [text for node, text in texts.items() if node.rsplit('/', 1)[-1] == _DETECTOR]
    parameters: dict[str, object] = {}
    if detectors:
        source = f'{path}: recorded parameters of {_DETECTOR}'
        parameters = parameters_of(_DETECTOR, detectors[-1], source)
    start = journal[starts[-1]]
    if not start.config and not detectors:
        return None
    told = [entry.config for entry in journal] + [entry.companions for entry in journal]
    told = [values for values in told if values] or [parameters]
    return RecordedRun(
        DetectorConfig.from_recorded(start.config or parameters),
        CompanionConfig.from_recorded(start.companions or parameters),
        journal[starts[0] :],
        sorted(set().union(*map(_unknown, told))),
    )


def recorded_events(path: Path) -> list[Event] | None:
    """
    Read what detector and interlock said live, in the order of time.

    Parameters
    ----------
    path : Path
        The recording.

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
    from hunt_ros.bag import Bag
    from hunt_ros.bag.messages import read_statuses

    with Bag(path) as bag:
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


def _unknown(values: Mapping[str, object]) -> set[str]:
    """Return the names that are settings of nothing that a replay runs, and once were."""
    names = DetectorConfig.unknown(values) & CompanionConfig.unknown(values)
    names -= set(_OF_THE_NODE)
    return {name for name in names if '.' not in name}  # normal_form.v_c, qos_overrides. ...
