"""Sensor hosts whose clocks are not that of the detector: estimated, said, and survived."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from fed import Fed
from made import PAPER, SECOND

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, detect, health
from hunt_ros.detection.door import Block
from hunt_ros.detection.estimates import Estimator
from hunt_ros.detection.words.status import DetectorStatus
from hunt_ros.samples import Record, Series

TICK = 50_000_000
#: From a sensor to the detector, ns.
DELAY = 3_000_000
#: What a fault of a sensor begins and ends with.
FAULT = ('sensor_fault', 'sensor_recovered')

#: How far the clock of a host is behind that of the detector, s, at the times given, s.
Behind = Callable[[np.ndarray], np.ndarray]


def _always(offset_s: float) -> Behind:
    return lambda t: np.full(t.shape, offset_s)


def _from(begin_s: float, offset_s: float) -> Behind:
    return lambda t: np.where(t < begin_s, 0.0, offset_s)


class Run(Fed):
    """A record as it comes to a detector, a tick at a time, from hosts with other clocks."""

    def __init__(
        self,
        record: Record,
        behind: Mapping[str, Behind],
        config: DetectorConfig | None = None,
        node: Behind = lambda t: np.zeros(t.shape),
    ) -> None:
        super().__init__(HuntingDetector(config or DetectorConfig(), PAPER))
        self.statuses: list[DetectorStatus] = []
        told, arrival = {}, {}
        for name, one in record.items():
            offset_s = behind.get(name, _always(0.0))(one.stamps_ns * 1e-9)
            told[name] = Series(one.stamps_ns - np.round(offset_s * 1e9).astype(int), one.values)
            arrival[name] = one.stamps_ns + DELAY

        def clock(now: int) -> int:
            return now - round(float(node(np.array([now * 1e-9]))[0]) * 1e9)

        for _ in self.play(told, range(TICK, record.end_ns, TICK), arrival, clock):
            self.statuses.append(self.detector.status)

    def levels(self, begin_s: float, end_s: float) -> set[Level]:
        """Return the levels that were published between two times of the detector's clock."""
        return {s.level for s in self.statuses[int(begin_s * 20) : int(end_s * 20)]}


@pytest.mark.parametrize('offset_s', [0.6, -0.6, 9.99])
def test_all_sensors_away_from_the_detectors_clock_are_estimated_said_and_survived(
    offset_s: float, recorded
) -> None:
    record = recorded(6.0, 10.0)
    run = Run(record, dict.fromkeys(record, _always(offset_s)))
    # The correction is a step of time, 2 s after the start.
    assert run.levels(6.0, 10.0) == {Level.WARN}
    status = run.detector.status
    for name in record:
        assert f'{name}: clocks differ by {abs(offset_s):.1f} s' in status.reasons
        assert status.clock_offsets_s[name] == pytest.approx(offset_s, abs=0.02)
    assert run.statuses[-1].stamp_ns > record.end_ns - 150_000_000
    assert len(run.output.journal) <= 25
    assert sum(status.dropped.values()) < 0.2 * sum(map(len, run.record.values()))
    run.assert_replayed()


def test_clocks_that_drift_are_followed_for_a_minute(recorded) -> None:
    record = recorded(6.0, 61.0)
    drifting = {name: lambda t: 9.9 + 100e-6 * t for name in ('lateral', 'yaw')}
    run = Run(record, drifting, DetectorConfig(output_rate_hz=20.0))
    assert run.levels(5.0, 61.0) == {Level.WARN}
    assert run.detector.status.clock_offsets_s['yaw'] == pytest.approx(9.906, abs=0.01)
    assert run.detector.status.clock_offsets_s['speed'] == pytest.approx(0.0, abs=0.02)
    assert len(run.output.journal) <= 20


def test_channels_from_hosts_with_other_clocks_are_put_on_one_time(recorded) -> None:
    record = recorded(7.2, 14.0, kicks=[(8.0, 330e-6)])
    right = Run(record, {})
    behind = {'lateral': 0.6, 'yaw': 0.61, 'roller': -3.0}
    run = Run(record, {name: _always(offset) for name, offset in behind.items()})
    shifts = next(e for e in run.output.journal if e.kind == 'offset').offsets
    assert shifts['lateral'] == shifts['yaw'], 'one host, whatever the way of its messages'
    words = {e.event: e.stamp_ns for e in right.output.events}
    found = {e.event: e.stamp_ns for e in run.output.events}
    assert abs(found['escaping'] - words['escaping']) < 300_000_000
    for column in ('lateral_amplitude', 'yaw_amplitude', 'lateral_roughness'):
        expected = np.median(right.output.estimates[column][-200:])
        assert np.median(run.output.estimates[column][-200:]) == pytest.approx(expected, rel=0.05)
    run.assert_replayed()


@pytest.mark.parametrize(
    ('step_s', 'channel'),
    [(0.6, 'lateral'), (5.0, 'lateral'), (-5.0, 'lateral'), (5.0, 'speed')],
)
def test_a_clock_that_is_set_and_stays_is_followed(step_s: float, channel: str, recorded) -> None:
    record = recorded(6.0, 14.0)
    run = Run(record, {channel: _from(5.0, step_s)})
    assert run.levels(4.0, 5.0) == {Level.OK}
    assert run.levels(11.0, 14.0) == {Level.WARN}
    assert f'{channel}: clocks differ by {abs(step_s):.1f} s' in run.detector.status.reasons
    assert run.statuses[-1].stamp_ns > record.end_ns - 150_000_000
    rows = run.output.estimates['stamp_ns']
    assert (np.diff(rows) == 10_000_000).all(), 'the others go on as they did'
    run.assert_replayed()


def test_what_waits_of_a_clock_that_leapt_and_came_back_is_not_given_out_late(recorded) -> None:
    record = recorded(6.0, 14.0)
    run = Run(record, {'lateral': lambda t: np.where((t >= 4.0) & (t < 10.0), -60.0, 0.0)})
    run.assert_replayed()
    assert run.levels(13.0, 14.0) == {Level.OK}


@pytest.mark.parametrize('step_s', [5.0, -5.0])
def test_a_clock_that_all_share_may_be_set(step_s: float, recorded) -> None:
    record = recorded(6.0, 12.0)
    run = Run(record, dict.fromkeys(record, _from(5.0, step_s)), node=_from(5.0, step_s))
    assert run.levels(11.0, 12.0) == {Level.OK}
    assert np.sum(np.diff(run.output.estimates['stamp_ns']) < 0) == (step_s > 0.0)
    assert not [entry for entry in run.output.journal if entry.kind == 'offset']
    run.assert_replayed()


def test_a_clock_that_is_far_away_and_stays_there_costs_no_memory_without_end() -> None:
    detector = HuntingDetector(DetectorConfig(channels=('lateral', 'speed')))
    stamps = 10_000 * SECOND + 500_000 * np.arange(2_000)  # 2 kHz
    values = 1e-5 * np.sin(np.arange(stamps.size))
    detector.update('speed', stamps[::10], np.full(200, 6.0))
    detector.update('lateral', stamps, values)
    for second in range(1, 121):
        detector.update('speed', stamps[::10] + second * SECOND, np.full(200, 6.0))
        detector.update('lateral', stamps + (second - 3600) * SECOND, values)
        detector.tick(int(stamps[-1]) + second * SECOND)
    assert detector.status.level is Level.STALE
    assert 'lateral: clocks differ by 3600.0 s' in ' '.join(detector.status.reasons)
    assert detector.status.dropped['lateral clock'] > 0.5 * 120 * 2_000


@pytest.mark.parametrize(
    ('how', 'back_s'), [('no value', 3.0), ('stuck', 10.0), ('stuck', 3600.0), ('silent', 3600.0)]
)
def test_a_clock_that_is_set_ends_no_fault(how: str, back_s: float) -> None:
    t = np.arange(0.0, 40.0, 0.005)
    noise = 1e-5 * np.random.default_rng(3).normal(size=(2, t.size))
    stamps = np.round((t - np.where(t < 24.0, 0.0, back_s) + 4000.0) * SECOND).astype(np.int64)
    bad = (t > 20.0) & (t < 30.0)
    values = {'lateral': noise[0].copy(), 'yaw': 6.0 * noise[1], 'speed': np.full(t.size, 6.0)}
    values['lateral'][bad] = 1e-5 if how == 'stuck' else np.nan
    record = Record({name: Series(stamps, each) for name, each in values.items()})
    if how == 'silent':
        record = Record({**record, 'lateral': Series(stamps[~bad], values['lateral'][~bad])})
    detector = HuntingDetector(DetectorConfig(channels=tuple(record)))
    events = [e for e in detect(detector, record).events if e.cause.startswith('lateral')]
    begun, over = ('input_stale', 'input_recovered') if how == 'silent' else FAULT
    assert [event.event for event in events] == [begun, over]
    well_s = events[1].since_ns / SECOND - 4000.0 + back_s
    assert well_s == pytest.approx(30.0, abs=0.05)
    assert ' after ' not in events[1].cause, 'how long it lasted is not known'


def test_what_is_told_on_after_a_new_beginning_is_the_same_in_any_blocks() -> None:
    """An optional channel that comes late is absent until it does, and no longer."""
    channels = ('lateral', 'yaw', 'speed')
    config = DetectorConfig(channels, optional_channels=('yaw',), hunting_frequency_hz=2.84)
    stamps = 10_000_000 * np.arange(150) + SECOND

    def told(size: int) -> list[int]:
        estimator, found = Estimator(config), []
        estimator.reset()
        for begin in range(0, stamps.size, size):
            rows = stamps[begin : begin + size]
            came = dict.fromkeys(channels, rows) | {'yaw': rows[rows > stamps[19]]}
            blocks = {
                name: Block(at, 1e-5 * np.sin(at * 1e-7), np.zeros(at.size, np.uint8), None, False)
                for name, at in came.items()
            }
            found += estimator.run(rows, blocks)[0]['yaw_wrong'].tolist()
        return found

    assert told(7) == told(150) == 20 * [health.ABSENT] + 130 * [0]
