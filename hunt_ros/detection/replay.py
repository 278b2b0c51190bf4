"""Repeating a live run of the detector from its samples and its journal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from hunt_ros.detection.detector import HuntingDetector
from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.merge import LateRun
from hunt_ros.detection.output import Output
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.samples import Record, Series

_LATE = ('late_from', 'late_to', 'late')


def replay_journal(
    detector: HuntingDetector, record: Record, journal: Sequence[JournalEntry]
) -> Output:
    """
    Repeat a live run: the same rows and events, bit for bit.

    Parameters
    ----------
    detector : HuntingDetector
        Made with the settings of the live one; it is reset first.
    record : Record
        The samples of the live run, each channel in the order of its arrival.
    journal : sequence of JournalEntry
        The journal of the live run from its last 'start' on, in order; earlier
        entries are left out.

    Returns
    -------
    Output
        Rows and events of the whole run, up to its last complete row.

    Raises
    ------
    HuntError
        If a normal form in the journal cannot be read.
    """
    starts = [k for k, entry in enumerate(journal) if entry.kind == 'start']
    entries = list(journal[starts[-1] :] if starts else journal)
    if entries and entries[0].kind == 'start':
        text = entries.pop(0).text
        detector.set_normal_form(IdentifiedNormalForm.from_yaml(text) if text else None)
    detector.reset()
    for channel, run in _late_runs(entries):
        detector.expect_late(channel, run)
    feed = _Feed(detector, record, entries)
    outputs = []
    for entry in entries:
        if entry.kind in _LATE:
            continue
        outputs.append(detector.hold_at(entry))
        outputs += feed.run()
        outputs.append(detector.repeat(entry))
        if entry.kind == 'resumed':
            feed.resume(entry)
            outputs += feed.run()
    outputs.append(detector.let_go())
    outputs += feed.run()
    return Output.joined(outputs)


def _late_runs(entries: Sequence[JournalEntry]) -> Iterator[tuple[str, LateRun]]:
    """Give the runs of samples that came too late, by channel."""
    begun: dict[tuple[str, int], int] = {}
    for entry in entries:
        for channel, stamp in entry.channels.items():
            place = channel, entry.epoch
            if entry.kind == 'late':
                yield from ((channel, LateRun(entry.epoch, at, at)) for at in entry.stamps)
            elif entry.kind == 'late_from' and stamp is not None:
                begun[place] = stamp
            elif entry.kind == 'late_to' and place in begun:
                yield channel, LateRun(entry.epoch, begun.pop(place), stamp)
    for (channel, epoch), first in begun.items():
        yield channel, LateRun(epoch, first, None)


class _Feed:
    """Feeds each channel up to the sample after which the live detector let go of it."""

    def __init__(
        self, detector: HuntingDetector, record: Record, entries: Sequence[JournalEntry]
    ) -> None:
        self._detector = detector
        self._series: dict[str, Series] = {
            name: record[name] for name in detector.channels if name in record
        }
        self._done = dict.fromkeys(self._series, 0)
        self._stops: dict[str, list[int | None]] = {name: [] for name in self._series}
        for entry in entries:
            if entry.kind == 'released':
                for name, newest in entry.channels.items():
                    if name in self._stops:
                        self._stops[name].append(newest)

    def run(self) -> list[Output]:
        """Feed what the live detector may have had by now."""
        outputs = []
        for name, series in self._series.items():
            begin, end = self._done[name], len(series)
            if self._stops[name]:
                newest = self._stops[name][0]
                found = np.flatnonzero(series.stamps_ns[begin:] == newest)
                end = begin + int(found[0]) + 1 if found.size else begin
            if end > begin:
                part = slice(begin, end)
                outputs.append(
                    self._detector.update(name, series.stamps_ns[part], series.values[part])
                )
                self._done[name] = end
        return outputs

    def resume(self, entry: JournalEntry) -> None:
        """Go on with the channels that speak again."""
        for name in entry.channels:
            if self._stops.get(name):
                self._stops[name].pop(0)
