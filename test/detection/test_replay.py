"""A live run - ticks, silence, late samples, an operator - repeated from its journal."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from unittest.mock import patch

import numpy as np
import pytest
from fed import Fed
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from made import PAPER, words

from hunt_ros.detection import DetectorConfig, HuntingDetector, JournalEntry, Level
from hunt_ros.detection.acceptance import rolled_back
from hunt_ros.detection.offline import collect
from hunt_ros.detection.replay import detect, samples_apart, watch
from hunt_ros.errors import HuntError
from hunt_ros.samples import Record, Series

_TICK_NS = 50_000_000


def _live(
    record: Record,
    stalls: list[tuple[str, float, float]],
    losses: list[tuple[str, float, float]],
    operator: list[tuple[float, str]],
    seed: int,
    behind: Mapping[str, float] = MappingProxyType({}),
    rig: Fed | None = None,
) -> Fed:
    """
    Play a record as it would come over a network.

    Each sample arrives a few ms after its stamp; in a stall (channel, from, to; s) the
    samples are held up and come together at its end; in a loss they never come. The
    clock of a channel may be `behind` by so many seconds.
    """
    rng = np.random.default_rng(seed)
    queue: list[tuple[int, int, str, int, float]] = []
    number = 0
    for name, series in record.items():
        arrival = 0
        for stamp, value in zip(series.stamps_ns.tolist(), series.values.tolist(), strict=True):
            if any(c == name and a <= stamp * 1e-9 < b for c, a, b in losses):
                continue
            arrival = max(arrival, stamp + int(rng.integers(500_000, 8_000_000)))
            for channel, begin, end in stalls:
                if channel == name and begin <= stamp * 1e-9 < end:
                    arrival = max(arrival, int(end * 1e9))
            told = stamp - round(behind.get(name, 0.0) * 1e9)
            queue.append((arrival, number, name, told, value))
            number += 1
    end = max(item[0] for item in queue) + 1_500_000_000
    for now in range(_TICK_NS, end, _TICK_NS):
        queue.append((now, -1, 'tick', now, 0.0))
    for time, action in operator:
        queue.append((int(time * 1e9), -2, action, int(time * 1e9), 0.0))
    rig = rig or Fed(HuntingDetector(DetectorConfig(), PAPER))
    detector = rig.detector
    for _, _, what, stamp, value in sorted(queue):
        if what == 'tick':
            rig.outputs.append(detector.tick(stamp))
        elif what == 'acknowledge':
            rig.outputs.append(detector.acknowledge(stamp))
        elif what == 'form':
            rig.outputs.append(detector.set_normal_form(None))
        elif what == 'back':
            rig.outputs.append(detector.set_normal_form(rolled_back(PAPER)))
        else:
            rig.feed(what, Series(np.array([stamp]), np.array([value])))
    return rig


def test_a_stalled_channel_is_let_go_and_its_late_samples_dropped(recorded) -> None:
    record = recorded(7.2, 6.0, kicks=[(2.0, 400e-6)])
    rig = _live(record, [('yaw', 3.0, 4.5)], [], [], seed=1)
    live = rig.output
    kinds = [entry.kind for entry in live.journal]
    assert kinds[0] == 'start'
    assert 'released' in kinds
    assert 'resumed' in kinds
    assert 'offset' not in kinds, 'it was held up, its clock is well'
    assert {'input_stale', 'input_recovered'} <= set(words(live))
    stale = live.estimates[live.estimates['level'] == Level.STALE]['stamp_ns'] * 1e-9
    assert stale[(stale > 1.0) & (stale < 3.1)].size == 0
    assert stale[(stale > 3.25) & (stale < 3.9)].size > 50
    rig.assert_replayed()


@settings(
    max_examples=5,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    phases=[Phase.explicit, Phase.generate],
)
@given(seed=st.integers(0, 10_000))
def test_any_live_run_is_repeated_bit_for_bit(seed: int, recorded) -> None:
    rng = np.random.default_rng(seed)
    record = recorded(7.2, 6.0, kicks=[(2.0, 400e-6)])

    def spans(count: int) -> list[tuple[str, float, float]]:
        names = rng.choice(['lateral', 'yaw', 'roller', 'speed'], count)
        begins, lengths = rng.uniform(0.0, 5.5, count), rng.uniform(0.02, 1.2, count)
        return [
            (str(n), float(a), float(a + d))
            for n, a, d in zip(names, begins, lengths, strict=True)
        ]

    operator = [(float(rng.uniform(0.5, 6.0)), 'acknowledge'), (float(rng.uniform(1, 6)), 'form')]
    rig = _live(
        record, spans(int(rng.integers(0, 4))), spans(int(rng.integers(0, 3))), operator, seed
    )
    rig.assert_replayed()
    with patch('hunt_ros.detection.replay._STRETCH', int(rng.integers(50, 500))):
        rig.assert_replayed()


@pytest.mark.parametrize('what', ['all channels are silent', 'the clock is set back'])
def test_all_time_that_passed_is_on_some_level(what, recorded) -> None:
    channels = {}
    for name, one in recorded(6.8, 30.0).items():
        stamps, values = one.stamps_ns, one.values
        if what == 'the clock is set back':
            stamps = stamps - np.where(stamps < 20_000_000_000, 0, 8_000_000_000)
        else:
            there = (stamps < 10_000_000_000) | (stamps > 16_000_000_000)
            stamps, values = stamps[there], values[there]
        channels[name] = Series(stamps, values)
    detector = HuntingDetector(DetectorConfig(), PAPER)
    found = collect(watch(Record(channels), detector), detector)
    for rows in (found.level_rows, found.region_rows):
        assert rows.total() * found.period_ns / 1e9 == pytest.approx(30.0, abs=0.1)
    silent = found.reason_rows['all channels are silent'] * found.period_ns / 1e9
    assert silent == pytest.approx(5.5 if what == 'all channels are silent' else 0.0, abs=0.5)
    assert found.level_rows['STALE'] * found.period_ns / 1e9 >= silent


def test_a_silence_in_which_the_clock_was_set_back_has_no_negative_length(recorded) -> None:
    channels = {}
    for name, one in recorded(6.8, 20.0).items():
        seconds = one.stamps_ns / 1e9
        there = (name != 'yaw') | (seconds < 10.0) | (seconds > 13.0)
        stamps = one.stamps_ns - np.where(seconds < 12.0, 0, 6_000_000_000)
        channels[name] = Series(stamps[there], one.values[there])
    detector = HuntingDetector(DetectorConfig(), PAPER)
    events = collect(watch(Record(channels), detector), detector).events
    causes = [event.cause for event in events if event.event == 'input_recovered']
    assert causes
    assert not [cause for cause in causes if 'after -' in cause], causes


@pytest.mark.parametrize('name', ['yaw', 'speed'])
@pytest.mark.parametrize('silent_s', [2.0, 3.0, 7.0])
def test_a_channel_silent_while_the_clock_was_set_back_is_back_with_the_others(
    recorded, name: str, silent_s: float
) -> None:
    """Its stamps go on ahead as if no clock had been set: all others have left that time."""
    channels = {}
    for each, one in recorded(6.0, 20.0).items():
        seconds = one.stamps_ns / 1e9
        there = (each != name) | (seconds < 10.0) | (seconds > 10.0 + silent_s)
        stamps = one.stamps_ns - np.where(seconds < 11.0, 0, 3_000_000_000)
        channels[each] = Series(stamps[there], one.values[there])
    detector = HuntingDetector(DetectorConfig(), PAPER)
    found = collect(watch(Record(channels), detector), detector)
    assert detector.status.level < Level.STALE, detector.status.reasons
    last = [e for e in found.events if e.event.startswith('input')][-1]
    assert (last.event, last.cause[: len(name)]) == ('input_recovered', name)
    assert found.level_rows.total() * found.period_ns / 1e9 == pytest.approx(20.0, abs=0.1)


@pytest.mark.parametrize('held_up_s', [0.0, 0.15, 0.6, 1.5])
@pytest.mark.parametrize('ahead_s', [3.0, 9.0])
def test_a_live_run_in_which_a_clock_leapt_ahead_for_a_while_is_repeated(
    recorded, ahead_s, held_up_s
) -> None:
    """Also where the detector was itself held up when that clock came back."""
    record = recorded(7.2, 14.0)
    stamps = record['yaw'].stamps_ns
    leaps = (stamps > 6_000_000_000) & (stamps < 8_000_000_000)
    moved = stamps + np.where(leaps, round(ahead_s * 1e9), 0)
    spoilt = {**record, 'yaw': Series(moved, record['yaw'].values)}
    rig = Fed(HuntingDetector(DetectorConfig(), PAPER))
    times = np.arange(_TICK_NS, 15_000_000_000, _TICK_NS)
    held_up = (times > 7_980_000_000) & (times < 7_980_000_000 + held_up_s * 1e9)
    for _ in rig.play(spoilt, times[~held_up].tolist(), {'yaw': stamps}):
        pass
    rig.assert_replayed()
    with patch('hunt_ros.detection.replay._STRETCH', 300):
        rig.assert_replayed()


@pytest.mark.parametrize('name', ['yaw', 'speed'])
def test_a_channel_whose_clock_alone_was_set_back_is_not_put_beside_the_others(
    recorded, name: str
) -> None:
    """It would be off by what it was set back by: that is left to a person, and STALE."""
    channels = dict(recorded(6.0, 20.0))
    one = channels[name]
    stamps = one.stamps_ns - np.where(one.stamps_ns < 11_000_000_000, 0, 3_000_000_000)
    channels[name] = Series(stamps, one.values)
    detector = HuntingDetector(DetectorConfig(), PAPER)
    rows = detect(detector, Record(channels)).estimates
    assert (rows['level'][rows['stamp_ns'] > 11_600_000_000] == Level.STALE).all()


@pytest.mark.parametrize('stretch', [650, 3250, 4200, 5000])
def test_a_clock_that_leapt_ahead_is_back_wherever_the_record_is_cut(recorded, stretch) -> None:
    channels = dict(recorded(6.0, 13.0))
    stamps = channels['speed'].stamps_ns
    leaps = (stamps > 6_000_000_000) & (stamps < 8_000_000_000)
    moved = stamps + np.where(leaps, 3600_000_000_000, 0)
    channels['speed'] = Series(moved, channels['speed'].values)
    with patch('hunt_ros.detection.replay._STRETCH', stretch):
        rows = detect(HuntingDetector(DetectorConfig(), PAPER), Record(channels)).estimates
    assert np.isfinite(rows['speed'][rows['stamp_ns'] > 9_500_000_000]).all()


def test_a_journal_line_that_is_none_is_refused() -> None:
    for text in ('', '{}', '{"kind":"guess","position_ns":null}', '[1]'):
        with pytest.raises(HuntError):
            JournalEntry.from_text(text)


def test_going_back_to_an_earlier_form_is_an_event_live_and_in_the_replay(recorded) -> None:
    record = recorded(7.2, 6.0, kicks=[(2.0, 400e-6)])
    rig = _live(record, [], [], [(3.0, 'form'), (4.0, 'back')], seed=1)
    live = rig.output
    said = words(live)
    assert said.index('normal_form_changed') < said.index('normal_form_reverted')
    reverted = live.events[said.index('normal_form_reverted')]
    assert reverted.cause.startswith('v_c 8.000 m/s, v_n 6.406 m/s')
    rig.assert_replayed()


@pytest.mark.parametrize('lag_s', [0.15, 0.195, 0.3, 0.6])
def test_a_clock_that_is_always_behind_keeps_the_journal_small(recorded, lag_s: float) -> None:
    record = recorded(7.2, 6.0, kicks=[(2.0, 400e-6)])
    rig = _live(record, [], [], [], seed=4, behind={'yaw': lag_s})
    assert sum(len(entry.to_text()) for entry in rig.output.journal) < 3000
    rig.assert_replayed()


def test_a_detector_that_joined_late_is_repeated_from_its_own_first_samples(recorded) -> None:
    record = recorded(7.2, 9.0, kicks=[(3.0, 400e-6)])
    rig = Fed(HuntingDetector(DetectorConfig(), PAPER))
    heard = {}
    for name, starts_s in {'lateral': 0.61, 'yaw': 0.18, 'roller': 0.14, 'speed': 0.14}.items():
        start_ns = int(starts_s * 1e9)
        rig.feed(name, record[name].between(0, start_ns), heard=False)
        heard[name] = record[name].between(start_ns, 2**62)
    silence = [('yaw', 6.0, 7.0)]
    _live(Record(heard), silence, silence, [(5.0, 'acknowledge')], 5, rig=rig)
    said = set(words(rig.output))
    assert {'escaping', 'acknowledged', 'input_stale', 'input_recovered'} <= said
    rig.assert_replayed()


def test_a_recorder_that_joined_late_is_told_of_what_it_lacks(recorded) -> None:
    record = recorded(7.2, 6.0, kicks=[(2.0, 400e-6)])
    rig = _live(record, [('lateral', 3.0, 4.0)], [], [], seed=6)
    arrived, journal = rig.record, list(rig.output.journal)
    assert samples_apart(arrived, journal) == ({}, {})
    later = {**arrived, 'lateral': arrived['lateral'].between(100_000_000, 2**62)}
    lost = len(arrived['lateral']) - len(later['lateral'])
    assert samples_apart(Record(later), journal)[0] == {'lateral': lost}
    doubled = np.repeat(arrived['lateral'].stamps_ns[:100], 2) + np.tile([0, 1], 100)
    lateral = Series(
        np.concatenate([doubled, arrived['lateral'].stamps_ns[100:]]),
        np.concatenate([np.zeros(200), arrived['lateral'].values[100:]]),
    )
    _, unheard = samples_apart(Record({**arrived, 'lateral': lateral}), journal)
    assert unheard == {'lateral': 100}


@pytest.mark.parametrize('pause_s', [0.0, 0.2])
def test_each_run_of_the_detector_is_repeated_with_the_settings_of_that_run(
    recorded, pause_s: float
) -> None:
    record = recorded(7.2, 6.0, kicks=[(2.0, 400e-6)])
    end, begin = 3_000_000_000, 3_000_000_000 + int(pause_s * 1e9)
    rig = Fed(HuntingDetector(DetectorConfig(output_rate_hz=50.0), PAPER))
    for name, one in record.items():
        rig.feed(name, one.between(0, end))
    # The process died, and another one was started.
    rig.detector = HuntingDetector(DetectorConfig(margin_in=2.5, output_rate_hz=20.0), PAPER)
    for name, one in record.items():
        rig.feed(name, one.between(end, begin), heard=False)
        rig.feed(name, one.between(begin, 2**62))
    live, journal = rig.output.estimates, rig.output.journal
    rows = detect(HuntingDetector(), rig.record, journal).estimates
    # When it died is not told: what came until the next one heard anything may be its.
    place = np.searchsorted(live['stamp_ns'], begin)
    own = np.append(rows[:place], rows[place - live.size :])
    assert own.tobytes() == live.tobytes()
    assert live.size <= rows.size <= live.size + 50.0 * pause_s
    assert samples_apart(rig.record, journal) == ({}, {})
