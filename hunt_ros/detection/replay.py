"""A record through the detector: as it comes, or a live run repeated from its journal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.detector import HuntingDetector
from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.output import Output
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.samples import NANOSECONDS, Record, Series

#: Not acted on at their position: they say which samples the run was made of. Which of these came
#: too late, 0.2.0 wrote down; it follows from the rest.
_ABOUT_SAMPLES = ('start', 'heard', 'late_from', 'late_to')
#: A longer step of a channel is a clock that was set, and no silence.
_LEAP_NS = 600 * NANOSECONDS


class Playback:
    """
    A record through a detector, as far as is asked for.

    Its time is 0 at the first sample of the record. A step of a channel that goes back, or leaps
    by more than `_LEAP_NS`, is a clock that was set: no time passes there.

    Parameters
    ----------
    detector : HuntingDetector
        Without a journal it goes on as it is. With one it is started as the journal says, with its
        settings and its normal form; its own settings count where an earlier recording does
        not have them.
    record : Record
        Each channel in the order of its arrival.
    journal : sequence of JournalEntry, optional
        That of the live run, in order, to repeat it bit for bit: a detector that was started
        several times had several runs, which are repeated one after the other.

    Attributes
    ----------
    length_ns : int
        Time of the last sample, ns.
    finished : bool
        Whether all has been fed. Without a journal the detector has finished then.
    """

    def __init__(
        self, detector: HuntingDetector, record: Record, journal: Sequence[JournalEntry] = ()
    ) -> None:
        self.finished = False
        self._detector = detector
        start_ns = record.start_ns
        self.times_ns = {name: _times(series, start_ns) for name, series in record.items()}
        self.length_ns = max((int(x[-1]) for x in self.times_ns.values() if x.size), default=0)
        self._until_ns = -1
        self._steps = self._play(list(_runs(record, journal)), bool(journal))

    def advance(self, until_ns: int) -> Output:
        """
        Feed all that came up to a time; the rows and events are the same for any steps.

        Parameters
        ----------
        until_ns : int
            On the time of the playback, ns, not before the last one.

        Returns
        -------
        Output
            What was added.

        Raises
        ------
        HuntError
            If a normal form or the settings in the journal cannot be read.
        """
        self._until_ns = until_ns
        outputs: list[Output] = []
        for output in self._steps:
            if output is None:  # the rest comes later
                return Output.joined(outputs)
            outputs.append(output)
        self.finished = True
        return Output.joined(outputs)

    def _play(self, runs: Sequence[_Run], repeats: bool) -> Iterator[Output | None]:
        """Yield what is added; None where it is to wait until more is asked for."""
        detector = self._detector
        for run in runs:
            entries = run.entries
            if entries and entries[0].kind == 'start':
                first = entries[0]
                config = DetectorConfig.from_recorded(first.config) if first.config else None
                form = IdentifiedNormalForm.from_yaml(first.text) if first.text else None
                if first.kept and run is not runs[0]:
                    detector.restart()
                else:
                    detector.set_normal_form(form)
                    detector.reset(config)
            elif repeats:
                detector.reset()
            for number, entry in enumerate(entries):
                if entry.kind in _ABOUT_SAMPLES:
                    continue
                yield detector.hold_at(entry)
                yield from self._feed(run, number)
                yield detector.repeat(entry)
            yield detector.hold_at(None)
            yield from self._feed(run, len(entries))
        if not repeats:
            yield detector.finish()

    def _feed(self, run: _Run, number: int) -> Iterator[Output | None]:
        """Feed what may have come before entry `number`; of silent channels less."""
        named = run.entries[number].received if number < len(run.entries) else {}
        while True:
            waits = False
            for name in self._detector.channels:
                if (part := run.parts.get(name)) is None or (
                    name in self._detector.silent and name not in named
                ):
                    continue
                stop = max(part.done, part.until(number))
                reached = int(np.searchsorted(self.times_ns[name], self._until_ns, 'right'))
                span = slice(part.done, max(part.done, min(stop, reached)))
                part.done = span.stop
                waits |= part.done < stop
                if span.start < span.stop:
                    series = part.series
                    stamps, values = series.stamps_ns[span], series.values[span]
                    yield self._detector.update(name, stamps, values)
            if not waits:
                return
            yield None


def _times(series: Series, start_ns: int) -> NDArray[np.int64]:
    """Return when each sample came, ns since the start of the record."""
    if not len(series):
        return np.zeros(0, dtype=np.int64)
    steps = np.diff(series.stamps_ns)
    steps[(steps < 0) | (steps > _LEAP_NS)] = 0
    first = max(0, int(series.stamps_ns[0]) - start_ns)
    times: NDArray[np.int64] = np.concatenate(([first], first + np.cumsum(steps)))
    return times


def detect(
    detector: HuntingDetector, record: Record, journal: Sequence[JournalEntry] = ()
) -> Output:
    """
    Run a whole record through a detector, or repeat a live run: the same rows, bit for bit.

    Parameters
    ----------
    detector, record, journal
        As for `Playback`.

    Returns
    -------
    Output
        Rows and events of every run, up to its last complete row; without a journal all of them.

    Raises
    ------
    HuntError
        If a normal form or the settings in the journal cannot be read.
    """
    playback = Playback(detector, record, journal)
    output = playback.advance(playback.length_ns)
    assert playback.finished
    return output


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
    for run in _runs(record, journal):
        for name, part in run.parts.items():
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
        Place behind the samples of the run before.
    entries : sequence of JournalEntry
        Of the run.
    ending : JournalEntry or None
        Beginning of the run after it.
    """

    def __init__(
        self,
        name: str,
        series: Series,
        begin: int,
        entries: Sequence[JournalEntry],
        ending: JournalEntry | None,
    ) -> None:
        self.series = series
        self.missing = 0
        self.unheard = 0
        self.done = begin
        heard = next((e for e in entries if e.kind == 'heard' and name in e.channels), None)
        if heard is not None:
            place = self._place(heard.channels[name], begin, begin)
            if place is None:
                self.missing = 1
            self.done = begin if place is None else place
        self._begin = self.done
        #: Number of an entry, and the place behind the last sample received before it.
        self._stops = [
            (number, self._behind(name, entry))
            for number, entry in enumerate(entries)
            if entry.kind != 'start' and name in entry.received
        ]
        self.end = len(series)
        if heard is None and any(entry.kind == 'heard' for entry in entries):
            self.end = begin  # what is recorded of it did not reach this run
        elif ending is not None and name in ending.channels:
            self.end = self._behind(name, ending)

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
        count = entry.received.get(name)
        expected = self._begin if count is None else self._begin + count - 1
        place = self._place(stamp, expected, self._begin)
        if place is None:
            return self._begin
        if count is not None:
            self.missing = max(self.missing, expected - place)
            self.unheard = max(self.unheard, place - expected)
        return place + 1

    def _place(self, stamp: int | None, expected: int, begin: int) -> int | None:
        """Return the place of a stamp; of several, where a clock was set, the one expected."""
        places: NDArray[np.int64] = np.flatnonzero(self.series.stamps_ns[begin:] == stamp) + begin
        if not places.size:
            return None
        return int(places[np.argmin(np.abs(places - expected))])


class _Run(NamedTuple):
    """One run of the detector: its journal, and the samples of each channel."""

    entries: Sequence[JournalEntry]
    parts: dict[str, _Part]


def _runs(record: Record, journal: Sequence[JournalEntry]) -> Iterator[_Run]:
    """Give the runs of a journal, in order."""
    starts = [k for k, entry in enumerate(journal) if entry.kind == 'start'] or [0]
    begin = dict.fromkeys(record, 0)
    for start, stop in zip(starts, [*starts[1:], len(journal)], strict=True):
        entries = journal[start:stop]
        ending = journal[stop] if stop < len(journal) else None
        parts = {
            name: _Part(name, series, begin[name], entries, ending)
            for name, series in record.items()
        }
        begin = {name: part.end for name, part in parts.items()}
        yield _Run(entries, parts)
