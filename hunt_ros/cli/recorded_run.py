"""The live run that a recording holds: the detector's settings and its journal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hunt_ros.detection import CompanionConfig, DetectorConfig, JournalEntry

_DETECTOR = 'hunting_detector'
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
    """

    config: DetectorConfig
    companions: CompanionConfig
    journal: list[JournalEntry]


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
    from hunt_ros.cli.settings_file import settings_from_text

    with Bag(path) as bag:
        texts_of_journal = [entry.text for entry in read_texts(bag, _JOURNAL)]
        texts = bag.strings('parameters')
    journal = [JournalEntry.from_text(t) for text in texts_of_journal for t in text.splitlines()]
    starts = [k for k, entry in enumerate(journal) if entry.kind == 'start']
    if not starts:
        return None
    detectors = [text for node, text in texts.items() if node.rsplit('/', 1)[-1] == _DETECTOR]
    parameters = detectors[-1] if detectors else '{}'
    source = f'{path}: recorded parameters of {_DETECTOR}'
    settings = journal[starts[-1]].config
    if settings:
        config = DetectorConfig.from_values(settings)
    elif detectors:
        config = settings_from_text(DetectorConfig, _DETECTOR, parameters, source)
    else:
        return None
    companions = settings_from_text(CompanionConfig, _DETECTOR, parameters, source)
    return RecordedRun(config, companions, journal[starts[0] :])
