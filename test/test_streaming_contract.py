"""
The contract of every streaming class, tested in one place.

- A stream cut into blocks anywhere gives the numbers of the whole, bit for bit.
- After `reset` an object is as new.
- Bad input (a value that is not finite, a stamp that goes backwards) is answered as the
  class documents, and what comes after it is as good as before.

To add a class, append a `Stream` to `STREAMS`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made import BUSY, rig_settings

from hunt_ros.criteria import CRITERIA, make_criterion
from hunt_ros.detection import CompanionConfig, Companions, DetectorConfig, HuntingDetector
from hunt_ros.detection.output import MOTION_DTYPE
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import (
    RollerRig,
)
from hunt_ros.errors import ConfigError, HuntError
from hunt_ros.estimation.hilbert import HilbertEnvelope
from hunt_ros.estimation.kalman import HuntingTracker
from hunt_ros.forecast import CriticalSpeedForecast

Outputs = Sequence[np.ndarray]


@dataclass(frozen=True)
class Stream:
    """
    How to run one streaming class.

    make() gives a new object; record(seed) everything it is to be fed, a row a piece, or a tuple
    of columns; feed(object, record, begin, end) feeds the pieces begin..end and returns the
    arrays that came out. `finish` closes a stream that holds something back. `bad_input(make)`
    asserts the documented answers.
    """

    name: str
    make: Callable[[], Any]
    record: Callable[[int], Any]
    feed: Callable[[Any, Any, int, int], Outputs]
    bad_input: Callable[[Callable[[], Any]], None]
    finish: Callable[[Any], Outputs] | None = None

    def length(self, record: Any) -> int:
        """Return the number of pieces that a record can be cut into."""
        return len(record[0] if isinstance(record, tuple) else record)

    def run(self, target: Any, record: Any, cuts: Sequence[int]) -> list[bytes]:
        """Feed a record cut at `cuts`; return each output's bytes, blocks joined."""
        edges = [0, *sorted(cuts), self.length(record)]
        blocks = [self.feed(target, record, a, b) for a, b in itertools.pairwise(edges)]
        if self.finish is not None:
            blocks.append(self.finish(target))
        return [np.concatenate(parts).tobytes() for parts in zip(*blocks, strict=True)]


# --- estimation ---------------------------------------------------------------------------


def _hunting(seed: int) -> tuple[np.ndarray, ...]:
    """Two sensors with a kick, gaps, a glitch, a change of rate; stamps shared by both."""
    rng = np.random.default_rng(seed)
    steps = np.concatenate([np.full(500, 2_000_000), rng.integers(1, 9_000_000, 300)])
    stamps = np.cumsum(steps).astype(np.int64)
    t = stamps * 1e-9
    amplitude = np.where(t < 1.2, 2e-5, 2e-4)
    theta = 2 * np.pi * 7.6 * t
    y = amplitude * np.cos(17.8 * t) + 5e-5 * np.cos(theta) + 5e-6 * rng.normal(size=t.size)
    psi = 4.7 * amplitude * np.cos(17.8 * t + 2.6) + 2e-5 * rng.normal(size=t.size)
    y[rng.integers(0, t.size, 20)] = np.nan
    psi[600] = 1.0
    sensor = np.tile(np.array([0, 1], dtype=np.int8), t.size)
    values = np.stack([y, psi], axis=1).ravel()
    outputs = np.arange(10_000_000, int(stamps[-1]), 10_000_000, dtype=np.int64)
    speed = np.full(2 * t.size, 7.2)
    return np.repeat(stamps, 2), sensor, values, np.repeat(theta, 2), speed, outputs


def _feed_tracker(tracker: Any, record: Any, begin: int, end: int) -> Outputs:
    *samples, outputs = record
    stamps = samples[0]
    if begin == end:
        return [tracker.update(*(column[:0] for column in record))]
    start = np.iinfo(np.int64).min if begin == 0 else stamps[begin]
    stop = np.iinfo(np.int64).max if end == stamps.size else stamps[end]
    due = outputs[(outputs >= start) & (outputs < stop)]
    return [tracker.update(*(column[begin:end] for column in samples), due)]


def _bad_tracker_input(make: Callable[[], Any]) -> None:
    *samples, outputs = _hunting(3)
    clean = make()
    expected = clean.update(*samples, outputs)
    # Each bad sample between good ones is left out, and changes nothing.
    stamps, sensor, values, theta, speed = (list(column) for column in samples)
    at = 900
    for value, stamp in ((np.inf, stamps[at]), (np.nan, stamps[at]), (1.0, stamps[at - 50])):
        stamps.insert(at, stamp)
        sensor.insert(at, 0)
        values.insert(at, value)
        theta.insert(at, theta[at])
        speed.insert(at, speed[at])
    spoiled = make()
    result = spoiled.update(stamps, sensor, values, theta, speed, outputs)
    assert result.tobytes() == expected.tobytes()
    empty = np.zeros(0)
    with pytest.raises(HuntError, match='must increase'):
        spoiled.update(empty, empty, empty, empty, empty, outputs[-1:])


def _wave(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(400) / 100.0
    wave = np.exp(0.2 * t) * np.cos(17.8 * t) + 0.05 * rng.normal(size=t.size)
    wave[[50, 51, 200]] = np.nan
    return wave


def _bad_envelope_input(make: Callable[[], Any]) -> None:
    wave = np.cos(17.8 * np.arange(600) / 100.0)
    wave[300:320] = np.inf  # longer than is bridged
    envelope = make().update(wave)
    # The gap is NaN from where the bridge ends until it has left the filter; then all is well.
    assert np.isfinite(envelope[81:305]).all()
    assert np.isnan(envelope[305:400]).all()
    assert np.allclose(envelope[401:], envelope[250], rtol=0.03)


# --- the simulated rig ----------------------------------------------------------------------


def _make_rig() -> Any:
    return RollerRig(paper_rig(), BUSY, seed=3)


def _feed_rig(rig: Any, targets: np.ndarray, begin: int, end: int) -> Outputs:
    return list(vars(rig.advance(end - begin, targets[begin:end])).values())


def _bad_rig_input(make: Callable[[], Any]) -> None:
    rig = make()
    expected = make().advance(50).lateral
    for refused in (lambda: rig.advance(-1), lambda: rig.kick(lateral_m=np.nan)):
        with pytest.raises(ConfigError):
            refused()
    assert np.array_equal(rig.advance(50).lateral, expected, equal_nan=True)


# --- detection --------------------------------------------------------------------------------


def _criterion(name: str) -> Stream:
    def make() -> Any:
        return make_criterion(name, rate_hz=500.0, scale=0.01)

    def feed(criterion: Any, record: Any, begin: int, end: int) -> Outputs:
        return [criterion.update(*(column[begin:end] for column in record))]

    def bad_input(make: Callable[[], Any]) -> None:
        stamps, y, speed = _displacement(0)
        expected = make().update(stamps, y, speed)
        holes = y.copy()
        holes[500] = np.inf
        rows = make().update(stamps, holes, speed)
        assert np.array_equal(np.isfinite(rows['index']), np.isfinite(expected['index']))

    return Stream(f'criterion {name}', make, _displacement, feed, bad_input)


def _displacement(seed: int) -> tuple[np.ndarray, ...]:
    """8 s of lateral displacement and speed; samples are missing, and the clock is set."""
    rng = np.random.default_rng(seed)
    t = np.arange(1, 4001) / 500.0
    y = 3e-4 * np.cos(17.8 * t) + 5e-6 * rng.normal(size=t.size)
    y[rng.integers(1000, t.size, 10)] = np.nan
    stamps = (t * 1e9).round().astype(np.int64)
    stamps[2500:] += 200_000_000  # a hole
    stamps[3200:] -= 5_000_000_000  # a clock that is set back
    return stamps, y, np.full(t.size, 7.2)


def _make_detector() -> Any:
    form = IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([1e-4, 1e-6, 1.0, 1e-4, 10.0, 1e8]))
    return HuntingDetector(DetectorConfig(), form)


def _arrivals(seed: int) -> list[tuple[str, int, float]]:
    """Samples of all channels in the order of their stamps, some of them bad."""
    stamps, sensor, values, theta, speed, _ = _hunting(seed)
    theta[500:540] = np.nan
    theta[600:640] = theta[600]  # a coarse encoder repeats its readings
    names = np.array(['lateral', 'yaw'])[sensor]
    found = list(zip(names, stamps, values, strict=True))
    every = slice(0, None, 10)
    found += [('roller', s, a) for s, a in zip(stamps[every], theta[every], strict=True)]
    found += [('speed', s, v) for s, v in zip(stamps[every], speed[every], strict=True)]
    found = sorted(found, key=lambda arrival: int(arrival[1]))
    found[700] = (found[700][0], int(found[600][1]), 0.0)  # a stamp that goes back
    return found


def _feed_detector(detector: Any, record: Any, begin: int, end: int) -> Outputs:
    rows = []
    for channel in ('lateral', 'yaw', 'roller', 'speed'):  # one after the other, as it may be
        part = [arrival for arrival in record[begin:end] if arrival[0] == channel]
        stamps, values = [a[1] for a in part], [a[2] for a in part]
        rows.append(detector.update(channel, stamps, values).estimates)
    return [np.concatenate(rows)]


def _bad_detector_input(make: Callable[[], Any]) -> None:
    detector = make()
    _feed_detector(detector, _arrivals(1), 0, 1500)
    last = int(detector.status.stamp_ns)
    stamps = last + np.arange(1, 400) * 2_000_000
    for channel in ('lateral', 'yaw'):
        detector.update(channel, stamps, np.full(stamps.size, np.nan))
    for channel, value in (('roller', 1.0), ('speed', 7.2)):
        detector.update(channel, stamps, np.full(stamps.size, value))
    status = detector.status
    assert status.stamp_ns > last
    assert status.level.name != 'OK'
    assert status.reasons


def _climb(seed: int) -> tuple[np.ndarray, ...]:
    """44 s of quiet response at four speeds, and a short blow of hunting."""
    settings_ = rig_settings(100.0, 2e-5, initial_speed=4.0)
    targets = np.repeat([4.0, 5.0, 6.0, 7.0], 1100)
    block = RollerRig(paper_rig(), settings_, seed=seed).advance(targets.size, targets)
    quiet = np.ones(targets.size, dtype=np.bool_)
    quiet[3000:3010] = False
    values = block.lateral.copy()
    values[[500, 501, 2600]] = np.nan
    return block.stamps_ns, values, block.speed, block.roller_angle, quiet


def _feed_forecast(forecast: Any, record: Any, begin: int, end: int) -> Outputs:
    forecast.update(*(column[begin:end] for column in record))
    return [np.zeros(0)]


def _numbers_of(forecast: Any) -> np.ndarray:
    critical = forecast.critical_speed
    numbers = (np.nan, np.nan, np.nan) if critical is None else (critical.value, critical.std, 0.0)
    return np.array([forecast.stamp_ns, forecast.levels, forecast.misfit, *numbers])


def _spoilt_climb(seed: int) -> tuple[np.ndarray, ...]:
    """The climb with a sample that is not finite."""
    columns = _climb(seed)
    nothing = (columns[0][2000] - 1000, np.inf, 6.0, 0.0, True)
    return tuple(np.insert(c, 2000, one) for c, one in zip(columns, nothing, strict=True))


def _bad_forecast_input(make: Callable[[], Any]) -> None:
    clean, spoilt = make(), make()
    clean.update(*_climb(0))
    spoilt.update(*_spoilt_climb(0))
    expected, found = _numbers_of(clean.finish()), _numbers_of(spoilt.finish())
    assert np.isfinite(expected[2])  # there is a fit
    assert np.array_equal(found, expected, equal_nan=True)


_BESIDE = ('cfr_213_333', 'ten_peaks')


def _make_companions() -> Any:
    return Companions(CompanionConfig(criteria=_BESIDE, criteria_scale=2e-4))


def _feed_companions(companions: Any, record: Any, begin: int, end: int) -> Outputs:
    columns = [column[begin:end] for column in record]
    verdicts = companions.update(np.rec.fromarrays(columns, dtype=MOTION_DTYPE))
    return [
        np.array([[v.stamp_ns, v.exceeded, v.index] for v in verdicts if v.criterion == name])
        .reshape(-1, 3)
        .ravel()
        for name in _BESIDE
    ] + [np.zeros(0)]


def _bad_companions_input(make: Callable[[], Any]) -> None:
    clean, spoilt = make(), make()
    record, bad = _climb(0), _spoilt_climb(0)
    expected = _feed_companions(clean, record, 0, record[0].size)
    found = _feed_companions(spoilt, bad, 0, bad[0].size)
    assert expected[0].size
    assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
    assert np.array_equal(
        _numbers_of(spoilt.finish()), _numbers_of(clean.finish()), equal_nan=True
    )


STREAMS: list[Stream] = [
    Stream('hunting tracker', HuntingTracker, _hunting, _feed_tracker, _bad_tracker_input),
    Stream(
        'hilbert envelope',
        lambda: HilbertEnvelope(100.0),
        _wave,
        lambda target, wave, a, b: [target.update(wave[a:b])],
        _bad_envelope_input,
    ),
    Stream(
        'simulated rig',
        _make_rig,
        lambda seed: np.linspace(7.2, 8.0 + seed, 800),
        _feed_rig,
        _bad_rig_input,
    ),
    Stream(
        'detector',
        _make_detector,
        _arrivals,
        _feed_detector,
        _bad_detector_input,
        lambda detector: [detector.finish().estimates],
    ),
    Stream(
        'forecast of v_c',
        CriticalSpeedForecast,
        _climb,
        _feed_forecast,
        _bad_forecast_input,
        lambda forecast: [_numbers_of(forecast.finish())],
    ),
    Stream(
        'companions',
        _make_companions,
        _climb,
        _feed_companions,
        _bad_companions_input,
        lambda companions: [np.zeros(0), np.zeros(0), _numbers_of(companions.finish())],
    ),
    *map(_criterion, CRITERIA),
]


# --- the contract -----------------------------------------------------------------------------

each_stream = pytest.mark.parametrize('stream', STREAMS, ids=lambda stream: stream.name)


@cache
def _whole(stream: Stream, seed: int) -> list[bytes]:
    """Return what a stream gives where the record is fed in one block."""
    return stream.run(stream.make(), stream.record(seed), [])


@each_stream
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data(), seed=st.integers(1, 2))
def test_any_cut_into_blocks_gives_the_numbers_of_the_whole(
    stream: Stream, data: st.DataObject, seed: int
) -> None:
    record = stream.record(seed)
    cuts = data.draw(st.lists(st.integers(0, stream.length(record)), max_size=6))
    assert stream.run(stream.make(), record, cuts) == _whole(stream, seed)


@each_stream
def test_sample_by_sample_gives_the_numbers_of_the_whole(stream: Stream) -> None:
    record = stream.record(1)
    pieces = range(1, stream.length(record))
    assert stream.run(stream.make(), record, pieces) == _whole(stream, 1)


@each_stream
def test_reset_equals_fresh(stream: Stream) -> None:
    used = stream.make()
    stream.run(used, stream.record(2), [])
    used.reset()
    assert stream.run(used, stream.record(1), []) == _whole(stream, 1)


@each_stream
def test_bad_input_is_answered_as_documented(stream: Stream) -> None:
    stream.bad_input(stream.make)
