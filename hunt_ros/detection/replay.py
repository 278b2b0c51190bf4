"""A record through the detector: as it comes, or a live run repeated from its journal."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.detector import HuntingDetector
from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.output import Output
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.samples import Record, Series

#: Not acted on at their position: they say which samples the run was made of. Which of these came
#: too late, 0.2.0 wrote down; it follows from the rest.
_ABOUT_SAMPLES = ('start', 'heard', 'late_from', 'late_to')
#: Samples of the longest channel that are fed at once, and of each other one the same share: the
#: channels wait for each other for ten seconds at 500 Hz, longer where one is of a part alone.
_STRETCH = 5000


def watch(
    record: Record,
    detector: HuntingDetector,
    progress: Callable[[float], None] = lambda fraction: None,
    journal: Sequence[JournalEntry] = (),
) -> Iterator[Output]:
    """
    Feed a record to a detector, to its end, or repeat a live run bit for bit.

    The channels are fed side by side, a share of each in turn; the numbers are the same for any
    shares.

    Parameters
    ----------
    record : Record
        Each channel in the order of its arrival; they must be those of the detector's config.
    detector : HuntingDetector
        Without a journal it goes on as it is. With one it is started as the journal says, with its
        settings and its normal form.
    progress : callable
        Told which fraction is done.
    journal : sequence of JournalEntry, optional
        That of the live run, in order: a detector that was started several times had several
        runs, which are repeated one after the other.

    Yields
    ------
    Output
        Stretch after stretch; without a journal the detector has finished at the end.

    Raises
    ------
    HuntError
        If a normal form or the settings in the journal cannot be read.
    """
    longest = max(map(len, record.values()), default=0)
    share, shares = 1, max(1, math.ceil(longest / _STRETCH))
    added: list[Output] = []
    for entries, parts in _runs(record, journal):
        if journal:
            first = entries[0]
            form = IdentifiedNormalForm.from_yaml(first.text) if first.text else None
            detector.set_normal_form(form)
            detector.reset(DetectorConfig.from_recorded(first.config))
        for number, entry in enumerate([*entries, None]):
            if entry is not None and entry.kind in _ABOUT_SAMPLES:
                continue
            added.append(detector.hold_at(entry))
            named = () if entry is None else entry.received
            while True:
                output, waits = _feed(detector, parts, number, named, share / shares)
                added.append(output)
                if not waits:
                    break
                yield Output.joined(added)
                progress(share / shares)
                added, share = [], share + 1
            if entry is not None:
                added.append(detector.repeat(entry))
    if not journal:
        added.append(detector.finish())
    yield Output.joined(added)
    progress(1.0)


def _feed(
    detector: HuntingDetector,
    parts: Mapping[str, _Part],
    number: int,
    named: Container[str],
    share: float,
) -> tuple[Output, bool]:
    """
    Feed what may have come before entry `number`, up to a share; of silent channels less.

    Returns what was added, and True where more comes before that entry.
    """
    waits, samples = False, {}
    for name in detector.channels:
        part = parts.get(name)
        if part is None or (name in detector.silent and name not in named):
            continue
        stop = max(part.done, part.until(number))
        reached = math.ceil(share * len(part.series))
        span = slice(part.done, max(part.done, min(stop, reached)))
        part.done = span.stop
        waits |= part.done < stop
        samples[name] = part.series.stamps_ns[span], part.series.values[span]
    # All at once: a clock that leaps ahead lets the others pass until it is seen to be back.
    return detector.feed(samples), waits


def detect(
    detector: HuntingDetector, record: Record, journal: Sequence[JournalEntry] = ()
) -> Output:
    """
    Run a whole record through a detector, or repeat a live run: the same rows, bit for bit.

    Parameters
    ----------
    detector, record, journal
        As for `watch`.

    Returns
    -------
    Output
        Rows and events of every run, up to its last complete row; without a journal all of them.

    Raises
    ------
    HuntError
        If a normal form or the settings in the journal cannot be read.
    """
    return Output.joined(list(watch(record, detector, journal=journal)))


def samples_apart(
    record: Record, journal: Sequence[JournalEntry]
) -> tuple[dict[str, int], dict[str, int]]:
    """
    Count by what samples a recording differs from those that the live detector had.

    With any, a replay cannot give the live numbers. What was lost after the last entry of
    the journal that counts is not seen.

    Returns
    -------
    missing : dict of str to int
        Channel -> least number of samples that were received and are not in the recording; only
        those that lack any.
    unheard : dict of str to int
        Likewise those that the middleware lost on the way to the detector, within a run.
    """
    missing: Counter[str] = Counter()
    unheard: Counter[str] = Counter()
    for _, parts in _runs(record, journal):
        for name, part in parts.items():
            missing[name] += part.missing
            unheard[name] += part.unheard
    return dict(+missing), dict(+unheard)


class _Part:
    """
    Samples of one channel that a run was made of.

    Parameters
    ----------
    name : str
        Channel.
    series : Series
        All of the record.
    begin : int
        Place behind the last sample that is known to be of the run before.
    entries : sequence of JournalEntry
        Of the run.
    """

    def __init__(
        self, name: str, series: Series, begin: int, entries: Sequence[JournalEntry]
    ) -> None:
        self.series = series
        self.missing = 0
        self.unheard = 0
        self.end = len(series)
        heard = [entry.channels for entry in entries if entry.kind == 'heard']
        stamp = next((channels[name] for channels in heard if name in channels), None)
        place = self._place(stamp, begin, begin)
        if heard and stamp is None:
            self.end = begin  # what is recorded of it did not reach this run
        elif heard and place is None:
            self.missing = 1
        self.done = self._begin = begin if place is None else place
        #: Number of an entry, and the place behind the last sample received before it.
        self._stops = [
            (number, self._behind(name, entry))
            for number, entry in enumerate(entries)
            if name in entry.received
        ]
        self.known = max([self._begin, *(place for _, place in self._stops)])

    def until(self, number: int) -> int:
        """Return the place behind the last sample received before entry `number`."""
        for at, place in self._stops:
            if at >= number:
                return place
        return self.end

    def _behind(self, name: str, entry: JournalEntry) -> int:
        """Return the place behind the last sample received before an entry."""
        stamp = entry.channels[name]
        if stamp is None:
            return self._begin
        expected = self._begin + entry.received[name] - 1
        place = self._place(stamp, expected, self._begin)
        if place is None:
            return self._begin
        self.missing = max(self.missing, expected - place)
        self.unheard = max(self.unheard, place - expected)
        return place + 1

    def _place(self, stamp: int | None, expected: int, begin: int) -> int | None:
        """Return the place of a stamp; of several, where a clock was set, the one expected."""
        places: NDArray[np.int64] = np.flatnonzero(self.series.stamps_ns[begin:] == stamp) + begin
        if not places.size:
            return None
        return int(places[np.argmin(np.abs(places - expected))])


def _runs(
    record: Record, journal: Sequence[JournalEntry]
) -> list[tuple[Sequence[JournalEntry], dict[str, _Part]]]:
    """Return the runs of a journal, in order: its entries, and the samples of each channel."""
    starts = [k for k, entry in enumerate(journal) if entry.kind == 'start'] or [0]
    runs: list[tuple[Sequence[JournalEntry], dict[str, _Part]]] = []
    for start, stop in itertools.pairwise([*starts, len(journal)]):
        before = runs[-1][1] if runs else {}
        parts = {}
        for name, series in record.items():
            begin = before[name].known if before else 0
            parts[name] = _Part(name, series, begin, journal[start:stop])
            if before:  # where it ended is not told: with the first sample of the next one
                before[name].end = min(before[name].end, parts[name].done)
        runs.append((journal[start:stop], parts))
    return runs
