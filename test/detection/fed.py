"""A detector that is fed piece by piece, and its replay: what several tests share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType

import numpy as np
from made import PAPER, record_of, words

from hunt_ros.detection import DetectorConfig, HuntingDetector, JournalEntry
from hunt_ros.detection.output import Output
from hunt_ros.detection.replay import detect
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.samples import Record, Series


class Fed:
    """What a detector was fed, whether it heard it or not, and what it gave out."""

    def __init__(self, detector: HuntingDetector) -> None:
        self.detector = detector
        self.outputs: list[Output] = []
        self._parts: dict[str, list[Series]] = {}

    @property
    def output(self) -> Output:
        return Output.joined(self.outputs)

    @property
    def record(self) -> Record:
        """What was fed, in the order in which it came."""
        return Record(
            {
                name: Series(
                    np.concatenate([part.stamps_ns for part in parts]),
                    np.concatenate([part.values for part in parts]),
                )
                for name, parts in self._parts.items()
            }
        )

    def feed(self, name: str, series: Series, heard: bool = True) -> None:
        """Take samples of a channel; with `heard` false they are recorded alone."""
        self._parts.setdefault(name, []).append(series)
        if heard:
            self.outputs.append(self.detector.update(name, series.stamps_ns, series.values))

    def play(
        self,
        record: Mapping[str, Series],
        times: Iterable[int],
        arrival: Mapping[str, np.ndarray] = MappingProxyType({}),
        clock: Callable[[int], int | None] = lambda now: now,
    ) -> Iterator[int]:
        """
        Feed what has come at each of the times, ns, then tick, and yield the time.

        Samples come at their stamps where no `arrival` is given; `clock` is what the clock of
        the detector shows at a time, None without a tick.
        """
        done = dict.fromkeys(record, 0)
        for now in times:
            for name, one in record.items():
                end = int(np.searchsorted(arrival.get(name, one.stamps_ns), now, side='right'))
                part = slice(done[name], end)
                self.feed(name, Series(one.stamps_ns[part], one.values[part]))
                done[name] = end
            if (shown := clock(now)) is not None:
                self.outputs.append(self.detector.tick(shown))
            yield now

    def assert_replayed(self) -> HuntingDetector:
        """Repeat it bit for bit, by its journal as it goes through a bag; return who did."""
        live = self.output
        journal = [JournalEntry.from_text(entry.to_text()) for entry in live.journal]
        again = HuntingDetector(self.detector.config)
        output = detect(again, self.record, journal)
        assert output.estimates.tobytes() == live.estimates.tobytes()
        assert list(map(repr, output.events)) == list(map(repr, live.events))
        assert repr(again.history.alarms) == repr(self.detector.history.alarms)
        assert again.history.hunting_hours == self.detector.history.hunting_hours
        return again


class Moving(Fed):
    """A wheelset that moves at the hunting frequency of the paper's form, and its speed."""

    def __init__(
        self, form: IdentifiedNormalForm | None = PAPER, seed: int = 1, **settings: object
    ) -> None:
        config = DetectorConfig(**{'channels': ('lateral', 'speed'), **settings})
        super().__init__(HuntingDetector(config, form))
        self.seconds = 0.0
        self._random = np.random.default_rng(seed)

    def move(
        self,
        amplitude_m: np.ndarray,
        speed: float | np.ndarray = 7.2,
        rate_hz: float = 200.0,
        start_s: float | None = None,
        yaw: float | None = None,
    ) -> list[str]:
        """
        Move with an amplitude per sample; return the words of the events.

        It goes on from where it was if no start is given; `yaw` is the ratio of a second sensor.
        """
        begin = self.seconds if start_s is None else start_s
        t = begin + (np.arange(amplitude_m.size) + 1) / rate_hz
        self.seconds = float(t[-1])
        lateral = amplitude_m * np.cos(2.0 * np.pi * PAPER_NORMAL_FORM.frequency_hz * t)
        lateral += 2e-6 * self._random.standard_normal(t.size)
        turned = {} if yaw is None else {'yaw': yaw * lateral}
        begun = len(self.outputs)
        for name, series in record_of(t, lateral=lateral, **turned, speed=speed).items():
            self.feed(name, series)
        return words(Output.joined(self.outputs[begun:]))
