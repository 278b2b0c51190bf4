"""A detector that is fed piece by piece, and its replay: what several tests share."""

from __future__ import annotations

import numpy as np

from hunt_ros.detection import HuntingDetector, JournalEntry
from hunt_ros.detection.output import Output
from hunt_ros.detection.replay import detect
from hunt_ros.samples import Record, Series


class Fed:
    """What a detector was fed, whether it heard it or not, and what it gave out."""

    def __init__(self, detector: HuntingDetector) -> None:
        self.detector = detector
        self.outputs: list[Output] = []
        self._parts: dict[str, list[Series]] = {}

    def feed(self, name: str, series: Series, heard: bool = True) -> None:
        """Take samples of a channel; with `heard` false they are recorded alone."""
        self._parts.setdefault(name, []).append(series)
        if heard:
            self.outputs.append(self.detector.update(name, series.stamps_ns, series.values))

    def assert_replayed(self, history: bool = True) -> HuntingDetector:
        """Repeat it bit for bit, by its journal as it goes through a bag; return who did."""
        record = Record(
            {
                name: Series(
                    np.concatenate([part.stamps_ns for part in parts]),
                    np.concatenate([part.values for part in parts]),
                )
                for name, parts in self._parts.items()
            }
        )
        live = Output.joined(self.outputs)
        journal = [JournalEntry.from_text(entry.to_text()) for entry in live.journal]
        again = HuntingDetector(self.detector.config)
        output = detect(again, record, journal)
        assert output.estimates.tobytes() == live.estimates.tobytes()
        assert list(map(repr, output.events)) == list(map(repr, live.events))
        assert not history or again.history.to_text() == self.detector.history.to_text()
        return again
