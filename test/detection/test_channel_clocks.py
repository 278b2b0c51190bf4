"""Clocks of sensor hosts and stamps of channels: what is off is estimated, said and survived."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from fed import Fed
from hypothesis import given, settings
from hypothesis import strategies as st
from made import PAPER, SECOND

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, detect, health
from hunt_ros.detection.door import Block
from hunt_ros.detection.estimates import Estimator
from hunt_ros.detection.stamps import AHEAD, BACKWARD, Channel
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


# --- stamps of one channel: what is believed does not depend on how they arrive in blocks ------


def _fed(stamps: list[int], cuts: list[int]) -> Channel:
    channel = Channel(SECOND)
    array = np.array(stamps, dtype=np.int64)
    for begin, end in itertools.pairwise([0, *sorted(cuts), len(stamps)]):
        if end > begin:
            channel.push(array[begin:end], np.arange(begin, end, dtype=np.float64))
    channel.finish()
    return channel


def _content(channel: Channel) -> list[list[tuple[int, float, int]]]:
    found = []
    for queue in channel.queues:
        stamps, values, marks, _ = queue.take(2**62)
        found.append(list(zip(stamps.tolist(), values.tolist(), marks.tolist(), strict=True)))
    return found


#: Steps as they should be, and every kind that should not: repeated, back, ahead, reset.
_STEPS = st.lists(
    st.sampled_from([10, 10, 10, 10, 0, -15, 700, 1500, 5000, -1500, -4000]), max_size=300
)


@settings(deadline=None)
@given(steps=_STEPS, data=st.data())
def test_any_blocks_give_the_same_samples_epochs_and_counts(steps, data) -> None:
    stamps = (20 * SECOND + np.cumsum(steps) * 1_000_000).tolist() if steps else []
    cuts = data.draw(st.lists(st.integers(0, len(stamps)), max_size=20))
    whole, cut = _fed(stamps, []), _fed(stamps, cuts)
    assert whole.refused == cut.refused
    assert _content(whole) == _content(cut)


@settings(deadline=None)
@given(steps=_STEPS)
def test_believed_stamps_increase_and_every_sample_is_believed_or_counted(steps) -> None:
    stamps = (20 * SECOND + np.cumsum(steps) * 1_000_000).tolist() if steps else []
    channel = _fed(stamps, [])
    content = _content(channel)
    for epoch in content:
        assert all(a[0] < b[0] for a, b in itertools.pairwise(epoch))
    assert sum(map(len, content)) + channel.refused.total() == len(stamps)


@pytest.mark.parametrize(('gap_ms', 'behind_ms'), [(1050, 60), (1500, 600), (2000, 1200)])
def test_after_a_gap_one_stamp_that_is_behind_is_refused_alone(gap_ms, behind_ms) -> None:
    """It goes on as if there had been no gap: one stamp is no evidence of that."""
    steps = [10] * 300 + [gap_ms] + [10] * 300
    stamps = (20 * SECOND + np.cumsum(steps) * 1_000_000).tolist()
    late = stamps[500] - behind_ms * 1_000_000
    channel = _fed([*stamps[:501], late, *stamps[501:]], [])
    assert channel.refused.total() == channel.refused['backward'] == 1
    assert [stamp for stamp, _, _ in _content(channel)[0]] == stamps


def test_a_short_excursion_into_the_past_is_refused_and_a_lasting_one_is_a_new_epoch() -> None:
    step = SECOND // 100
    forward = [20 * SECOND + k * step for k in range(100)]
    short = [10 * SECOND + k * step for k in range(50)]
    lasting = [10 * SECOND + k * step for k in range(150)]
    again = [forward[-1] + k * step for k in range(1, 50)]
    one = _fed([*forward, *short, *again], [])
    assert len(one.queues) == 1
    assert one.refused['backward'] == 50
    two = _fed([*forward, *lasting], [])
    assert [len(queue.stamps) for queue in two.queues] == [100, 150]


def _leap(by_s: int) -> list[int]:
    """Stamps of a clock that leaps by some seconds for two, and comes back."""
    step = SECOND // 100
    stamps = [20 * SECOND + k * step for k in range(600)]
    return [s + by_s * SECOND if 200 <= k < 400 else s for k, s in enumerate(stamps)]


@settings(deadline=None, max_examples=30)
@given(by_s=st.sampled_from([-3600, -5, 3, 3600]), cuts=st.lists(st.integers(0, 600), max_size=6))
def test_a_clock_that_leaps_and_comes_back_goes_on_without_the_leap(by_s, cuts) -> None:
    channel = _fed(_leap(by_s), cuts)
    assert channel.returned_ns() == 24 * SECOND
    channel.rejoin()
    [content] = _content(channel)
    expected = [20 * SECOND + k * SECOND // 100 for k in (*range(200), *range(400, 600))]
    assert [stamp for stamp, _, _ in content] == expected
    assert content[200][2] & (AHEAD if by_s > 0 else BACKWARD)
    assert channel.refused.total() == 200


def test_a_clock_that_is_set_back_or_a_channel_that_was_off_has_not_leapt() -> None:
    step = SECOND // 100
    forward = [20 * SECOND + k * step for k in range(200)]
    back = [5 * SECOND + k * step for k in range(400)]
    assert _fed(forward + back, []).returned_ns() is None
    after_a_pause = [100 * SECOND + k * step for k in range(600)]
    back = [50 * SECOND + k * step for k in range(400)]
    assert _fed(forward + after_a_pause + back, []).returned_ns() is None
