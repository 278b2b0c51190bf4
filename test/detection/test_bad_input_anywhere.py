"""
Any fault on any channel or two, at any rate, however stamps and samples come.

Each is named in the status while it lasts, the level is not OK then, and some seconds
after it all is as it was before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from fed import Fed
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from made import PAPER, SECOND, held, rig_settings

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, detect
from hunt_ros.detection.output import Event
from hunt_ros.detection.words.reasons import Basis, reasons_of
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import simulate
from hunt_ros.samples import CHANNELS, Record, Series

BEGIN, END, DURATION = 6 * SECOND, 8 * SECOND, 13 * SECOND
#: After the fault begins it must be named within this time, ns.
NOTICED = 600_000_000
CONFIG = DetectorConfig(channels=CHANNELS, lateral_range_m=2e-3, yaw_range_rad=2e-3)
BASIS = Basis(CONFIG)
_MOTION = ('lateral', 'yaw')


@dataclass(frozen=True)
class Fault:
    """
    How a channel is spoilt: spoil(stamps, values, places) in place; the words expected.

    `event` begins the words of the events that say that the channel is not to be trusted, and
    that it is again; '': it is trusted on.
    """

    words: tuple[str, ...]
    spoil: Callable[[np.ndarray, np.ndarray, np.ndarray], None]
    channels: tuple[str, ...] = CHANNELS
    event: str = ''


def _value(number: float, every: int = 1) -> Callable[..., None]:
    def spoil(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> None:
        x[bad[::every]] = number

    return spoil


def _stuck(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> None:
    x[bad] = x[bad[0]]


def _moved(by_ns: int, every: int = 1, first: int = 0) -> Callable[..., None]:
    def spoil(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> None:
        t[bad[first::every]] += by_ns

    return spoil


def _repeated(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> None:
    t[bad[3::5]] = t[bad[3::5] - 1]


def _halted(t: np.ndarray, x: np.ndarray, bad: np.ndarray) -> None:
    t[bad] = t[bad[0] - 1]


SILENT = Fault(('silent',), lambda t, x, bad: None, event='input')
_ENDS = {'sensor': ('fault', 'recovered'), 'input': ('stale', 'recovered')}
_BACK, _AHEAD = 'stamps that jump back', 'stamps that jump ahead'
FAULTS: dict[str, Fault] = {
    'nan': Fault(('only NaN or infinite',), _value(np.nan), event='sensor'),
    'inf': Fault(('only NaN or infinite',), _value(-np.inf), event='sensor'),
    'some nan': Fault(('NaN or infinite',), _value(np.nan, every=7)),
    'stuck': Fault(('stuck',), _stuck, ('lateral', 'yaw', 'roller'), event='sensor'),
    'saturated': Fault(('saturated',), _value(1.9985e-3), _MOTION, event='sensor'),
    'zero': Fault(('zero',), _value(0.0), ('speed',)),
    'negative': Fault(('negative',), _value(-6.0), ('speed',)),
    'repeated': Fault(('repeated stamps',), _repeated),
    'clock stands': Fault(('silent', 'repeated stamps'), _halted, event='input'),
    'some back': Fault((_BACK,), _moved(-300_000_000, every=20, first=5)),
    'some far back': Fault((_BACK,), _moved(-3600 * SECOND, every=20, first=5)),
    'some ahead': Fault((_AHEAD,), _moved(3600 * SECOND, every=20, first=5)),
    'clock back': Fault(('silent', _BACK), _moved(-3600 * SECOND), event='input'),
    'clock ahead': Fault(('silent', _AHEAD), _moved(3600 * SECOND), event='input'),
    'clock a little ahead': Fault(('silent', _AHEAD), _moved(3 * SECOND), event='input'),
    'silent': SILENT,
}


@cache
def _recorded(rate_hz: int, seed: int) -> Record:
    settings_ = rig_settings(float(rate_hz), roughness=(50e-6, 20e-6))
    # Below v_n: all is OK but for the faults.
    record = simulate(paper_rig(), settings_, held(6.0), DURATION / SECOND, (), seed)
    lateral = record['lateral']
    noise = 5e-3 * np.random.default_rng(seed).standard_normal(len(lateral))
    moved = np.convolve(lateral.values, np.ones(rate_hz // 20) / (rate_hz // 20), 'same')
    acceleration = np.gradient(np.gradient(moved)) * rate_hz**2 + noise
    return Record({**record, 'axle_box': Series(lateral.stamps_ns, acceleration)})


def _timed(series: Series, timing: str, seed: int) -> Series:
    """Take the samples at other times: jittered, or ten at once and then none for a while."""
    stamps = series.stamps_ns
    if timing == 'jittered':
        step = float(np.median(np.diff(stamps)))
        moved = np.random.default_rng(seed).uniform(-0.4, 0.4, stamps.size) * step
        at = stamps + moved.astype(np.int64)
    elif timing == 'bursty':
        bursts = stamps // 20_000_000
        place = np.arange(stamps.size) - np.searchsorted(bursts, bursts)
        at = bursts * 20_000_000 + place * 100_000
    else:
        return series
    return Series(at, np.interp(at, stamps, series.values))


def _spoilt(series: Series, fault: Fault) -> Series:
    stamps, values = series.stamps_ns.copy(), series.values.copy()
    bad = np.flatnonzero((stamps >= BEGIN) & (stamps < END))
    if fault is SILENT:
        return Series(np.delete(stamps, bad), np.delete(values, bad))
    fault.spoil(stamps, values, bad)
    return Series(stamps, values)


@st.composite
def _cases(draw: st.DrawFn) -> list[tuple[str, str]]:
    channels = draw(st.lists(st.sampled_from(CHANNELS), min_size=1, max_size=2, unique=True))
    return [
        (name, draw(st.sampled_from([f for f, one in FAULTS.items() if name in one.channels])))
        for name in channels
    ]


def _check(
    faults: list[tuple[str, str]],
    rate_hz: int = 500,
    timing: str = 'even',
    step_ns: int | None = 100_000_000,
    form: bool = True,
    seed: int = 1,
) -> tuple[np.ndarray, list[Event]]:
    """Spoil a record, feed it (step_ns None: whole), and look at every row; return the fault's."""
    record = {
        name: _timed(series, timing if name in _MOTION else 'even', seed)
        for name, series in _recorded(rate_hz, seed).items()
    }
    chosen = {name: FAULTS[fault] for name, fault in faults}
    spoilt = record | {name: _spoilt(record[name], fault) for name, fault in chosen.items()}
    detector = HuntingDetector(CONFIG, PAPER if form else None)
    if step_ns is None:
        output = detect(detector, Record(spoilt))
    else:
        arrival = {
            name: spoilt[name].stamps_ns if chosen.get(name) is SILENT else one.stamps_ns
            for name, one in record.items()
        }
        rig = Fed(detector)
        list(rig.play(spoilt, range(step_ns, DURATION + step_ns, step_ns), arrival))
        output = rig.output
    rows = output.estimates
    stamps = rows['stamp_ns']
    during = rows[(stamps >= BEGIN + NOTICED) & (stamps < END)]
    assert during.size >= 138
    assert (during['level'] != Level.OK).all()
    for row in during[::6]:
        reasons = reasons_of(row, BASIS)
        for name, fault in chosen.items():
            assert any(
                reason.startswith(f'{name}: ') and word in reason
                for reason in reasons
                for word in fault.words
            ), (name, fault.words, reasons)
    [before] = rows[stamps == BEGIN - SECOND]
    after = rows[stamps > END + 4 * SECOND]
    assert after.size >= 98
    usual = set(reasons_of(before, BASIS))
    assert all(set(reasons_of(row, BASIS)) <= usual for row in after[::7]), reasons_of(
        after[-1], BASIS
    )
    assert set(detector.status.reasons) <= usual
    assert not form or detector.status.level is Level.OK
    assert not detector.status.alarm
    return during, [event for event in output.events if event.stamp_ns > BEGIN]


@pytest.mark.parametrize('fault', FAULTS)
def test_each_fault_on_each_channel(fault: str) -> None:
    for channel in FAULTS[fault].channels:
        during, events = _check([(channel, fault)])
        event = FAULTS[fault].event
        assert (during['level'] == Level.STALE).all() == bool(event)
        said = [one.event for one in events if one.cause.startswith(channel)]
        assert bool(said) == bool(event), said
        assert not said or (said[0], said[-1]) == tuple(
            f'{event}_{end}' for end in _ENDS[event]
        ), said


@pytest.mark.slow
@settings(
    max_examples=24,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    phases=[Phase.explicit, Phase.generate],
)
@given(
    faults=_cases(),
    rate_hz=st.sampled_from([100, 500, 2000]),
    timing=st.sampled_from(['even', 'jittered', 'bursty']),
    step_ns=st.sampled_from([10_000_000, 50_000_000, 100_000_000, None]),
    form=st.booleans(),
    seed=st.integers(1, 2),
)
def test_faults_on_one_or_two_channels_at_any_rate(
    faults: list[tuple[str, str]],
    rate_hz: int,
    timing: str,
    step_ns: int | None,
    form: bool,
    seed: int,
) -> None:
    if ('roller', 'stuck') in faults and ('speed', 'zero') in faults:
        return  # a rig that stands still: its roller does not turn
    _check(faults, rate_hz, timing, step_ns, form, seed)
