"""Bad input is named, never leaves the level at OK, and is recovered from without help."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State, detect
from hunt_ros.detection.output import Output
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.samples import Record, Series

PAPER = IdentifiedNormalForm(PAPER_NORMAL_FORM)
BEGIN, END = 5_000_000_000, 6_500_000_000  # of the fault
CONFIG = DetectorConfig(lateral_range_m=2e-3)

Spoil = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def _value(number: float) -> Spoil:
    def spoil(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return t, np.where(bad, number, x)

    return spoil


def _some_nan(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = x.copy()
    x[np.flatnonzero(bad)[::7]] = np.nan
    return t, x


def _repeated(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    t = t.copy()
    places = np.flatnonzero(bad)[::5]
    t[places] = t[places - 1]
    return t, x


def _one_back(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    t = t.copy()
    t[np.flatnonzero(bad)[50::50]] -= 300_000_000
    return t, x


def _one_ahead(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    t = t.copy()
    t[np.flatnonzero(bad)[50::50]] += 3_600_000_000_000
    return t, x


def _silent(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return t[~bad], x[~bad]


def _clipped(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    limit = 0.6 * float(np.abs(x).max())  # the range of the sensor, all the time
    return t, np.clip(x, -limit, limit)


def _run(record: Record, channel: str, spoil: Spoil, config: DetectorConfig = CONFIG):
    """Feed a record with one spoilt channel, 50 ms at a time; return rows and all reasons."""
    series = record[channel]
    bad = (series.stamps_ns >= BEGIN) & (series.stamps_ns < END)
    spoilt = Series(*spoil(series.stamps_ns, series.values, bad))
    channels = {**record, channel: spoilt}
    places = dict.fromkeys(channels, 0)
    detector = HuntingDetector(config, PAPER)
    outputs, reasons = [], []
    for now in range(50_000_000, record.end_ns + 50_000_000, 50_000_000):
        for name, one in channels.items():
            # By the place in the record, as it would arrive: stamps may be wrong.
            if name == channel and spoil is not _silent:
                end = int(np.searchsorted(series.stamps_ns, now, side='right'))
            else:
                end = int(np.searchsorted(one.stamps_ns, now, side='right'))
            part = slice(places[name], end)
            outputs.append(detector.update(name, one.stamps_ns[part], one.values[part]))
            places[name] = end
        outputs.append(detector.tick(now))
        if BEGIN + 600_000_000 <= now < END:
            reasons.append(' '.join(detector.status.reasons))
    outputs.append(detector.finish())
    return Output.joined(outputs), reasons, detector


#: channel, how it is spoilt, the word in the status, whether it ends trust (STALE) or not.
CASES = [
    ('lateral', _value(np.nan), 'lateral: only NaN', True),
    ('yaw', _value(np.inf), 'yaw: only NaN or infinite', True),
    ('lateral', _value(-np.inf), 'lateral: only NaN or infinite', True),
    ('lateral', _some_nan, 'lateral: NaN', False),
    ('lateral', _value(3e-5), 'lateral: stuck', True),
    ('yaw', _value(0.0), 'yaw: stuck', True),
    ('roller', _value(7.0), 'roller: stuck', True),
    ('lateral', _value(2e-3), 'lateral: saturated', True),
    ('lateral', _silent, 'lateral: silent', True),
    ('yaw', _silent, 'yaw: silent', True),
    ('roller', _silent, 'roller: silent', True),
    ('speed', _silent, 'speed: silent', True),
    ('lateral', _repeated, 'lateral: repeated stamps', False),
    ('yaw', _one_back, 'yaw: stamps that jump back', False),
    ('lateral', _one_ahead, 'lateral: stamps that jump ahead', False),
    ('speed', _value(np.nan), 'speed: only NaN', True),
    ('speed', _value(-6.0), 'speed: negative', False),
    ('speed', _value(0.0), 'speed: zero', False),
]


@pytest.mark.parametrize(('channel', 'spoil', 'word', 'severe'), CASES)
def test_each_fault_is_named_and_recovered_from(
    channel: str, spoil: Spoil, word: str, severe: bool, recorded
) -> None:
    record = recorded(6.0, 10.0)  # below v_n, where all is OK otherwise
    output, reasons, detector = _run(record, channel, spoil)
    assert all(word in reason for reason in reasons), reasons[:2]
    rows = output.estimates
    stamps = rows['stamp_ns']
    during = rows[(stamps >= BEGIN + 600_000_000) & (stamps < END)]
    assert during.size >= 89
    assert (during['level'] != Level.OK).all()
    assert (during['level'] == Level.STALE).all() == severe
    before = rows[(stamps > 3_500_000_000) & (stamps < BEGIN)]
    assert (before['level'] == Level.OK).all()
    after = rows[stamps > END + 2_500_000_000]
    assert (after['level'] == Level.OK).all()
    assert detector.status.level is Level.OK
    assert not detector.status.alarm
    words = [event.event for event in output.events if event.cause.startswith(channel)]
    pair = ['input_stale', 'input_recovered'] if spoil is _silent else []
    if severe and not pair:
        pair = ['sensor_fault', 'sensor_recovered']
    # A saturated reading is stuck as well, and says so when it is known.
    assert words[:1] + words[-1:] == pair
    assert len(words) == len(pair) + (word == 'lateral: saturated')


def test_a_clipped_limit_cycle_is_saturated_and_still_an_alarm(recorded, true_form) -> None:
    record = recorded(7.2, 10.0, kicks=[(1.5, 500e-6)])
    output, reasons, detector = _run(record, 'lateral', _clipped, DetectorConfig())
    assert any('lateral: saturated' in reason for reason in reasons)
    stamps = output.estimates['stamp_ns']
    during = output.estimates[(stamps > BEGIN + 600_000_000) & (stamps < END)]
    assert np.isin(during['state'], [State.ESCAPING, State.LIMIT_CYCLE]).all()
    assert detector.status.alarm


def test_one_dead_sensor_leaves_the_other_to_detect(recorded, true_form) -> None:
    record = recorded(7.2, 20.0, kicks=[(9.0, 330e-6)])
    series = record['lateral']
    values = np.where(series.stamps_ns > 3_000_000_000, np.nan, series.values)
    channels = {**record, 'lateral': Series(series.stamps_ns, values)}
    detector = HuntingDetector(normal_form=true_form)
    for name, one in channels.items():
        detector.update(name, one.stamps_ns, one.values)
    detector.finish()
    assert detector.status.level is Level.STALE
    assert detector.status.state is State.LIMIT_CYCLE
    assert detector.status.alarm


def test_a_rig_that_runs_in_reverse_hunts_as_it_does_ahead_and_the_status_says_so(
    recorded, true_form
) -> None:
    record = recorded(7.2, 20.0, kicks=[(9.0, 330e-6)])
    backward = {
        name: Series(one.stamps_ns, -one.values if name in ('speed', 'roller') else one.values)
        for name, one in record.items()
    }
    detector = HuntingDetector(normal_form=true_form)
    reverse = detect(detector, Record(backward))
    ahead = detect(HuntingDetector(normal_form=true_form), record)
    assert 'speed: negative: the rig runs in reverse' in detector.status.reasons
    assert detector.status.speed == pytest.approx(7.2, abs=0.05)
    assert Level.STALE not in reverse.estimates['level']
    for name in ('speed', 'lateral_amplitude', 'lateral_roughness', 'margin'):
        assert np.allclose(
            reverse.estimates[name], ahead.estimates[name], rtol=1e-3, atol=1e-7, equal_nan=True
        ), name
    events = [[(event.event, event.stamp_ns) for event in one.events] for one in (reverse, ahead)]
    assert events[0] == events[1]


def test_clocks_set_back_begin_a_new_epoch_and_keep_the_alarm(recorded, true_form) -> None:
    record = recorded(7.2, 20.0, kicks=[(3.0, 330e-6)])
    shift = np.int64(15_000_000_000)
    detector = HuntingDetector(normal_form=true_form)
    outputs = []
    for name, one in record.items():
        stamps = np.where(one.stamps_ns > 12_000_000_000, one.stamps_ns - shift, one.stamps_ns)
        outputs.append(detector.update(name, stamps + 20_000_000_000, one.values))
    outputs.append(detector.finish())
    rows = Output.joined(outputs).estimates
    assert np.sum(np.diff(rows['stamp_ns']) < 0) == 1
    assert rows.size == pytest.approx(2000, abs=5)
    assert detector.status.state is State.LIMIT_CYCLE


def test_data_from_a_wrong_clock_never_look_fresh(recorded) -> None:
    record = recorded(6.0, 6.0)
    detector = HuntingDetector(normal_form=PAPER)
    ahead = 20_000_000_000  # the node's clock is twenty seconds ahead of the sensors'
    for now in range(50_000_000, 6_000_000_000, 50_000_000):
        for name, one in record.items():
            part = one.between(now - 50_000_000, now)
            detector.update(name, part.stamps_ns, part.values)
        detector.tick(now + ahead)
        assert detector.status.level is Level.STALE
    assert 'lateral: clocks differ by 20.0 s, more than' in ' '.join(detector.status.reasons)
