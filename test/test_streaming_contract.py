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
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

Outputs = Sequence[np.ndarray]


@dataclass(frozen=True)
class Stream:
    """
    How to run one streaming class.

    make() gives a new object; record(seed) everything it is to be fed; length(record)
    the number of pieces it can be cut into; feed(object, record, begin, end) feeds the
    pieces begin..end and returns the arrays that came out. `finish` closes a stream that
    holds something back. `bad_input(make)` asserts the documented answers.
    """

    name: str
    make: Callable[[], Any]
    record: Callable[[int], Any]
    length: Callable[[Any], int]
    feed: Callable[[Any, Any, int, int], Outputs]
    bad_input: Callable[[Callable[[], Any]], None]
    finish: Callable[[Any], Outputs] | None = None

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
    from hunt_ros.errors import HuntError

    *samples, outputs = _hunting(3)
    clean = make()
    expected = clean.update(*samples, outputs)
    # Each bad sample between good ones is left out and counted, and changes nothing.
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
    assert spoiled.dropped['not_finite'] == clean.dropped['not_finite'] + 2
    assert spoiled.dropped['backwards'] == clean.dropped['backwards'] + 1
    empty = np.zeros(0)
    with pytest.raises(HuntError, match='must increase'):
        spoiled.update(empty, empty, empty, empty, empty, outputs[-1:])


def _make_tracker() -> Any:
    from hunt_ros.estimation.kalman import HuntingTracker

    return HuntingTracker()


def _wave(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(400) / 100.0
    wave = np.exp(0.2 * t) * np.cos(17.8 * t) + 0.05 * rng.normal(size=t.size)
    wave[[50, 51, 200]] = np.nan
    return wave


def _make_envelope() -> Any:
    from hunt_ros.estimation.hilbert import HilbertEnvelope

    return HilbertEnvelope(100.0)


def _bad_envelope_input(make: Callable[[], Any]) -> None:
    wave = np.cos(17.8 * np.arange(600) / 100.0)
    wave[300:320] = np.inf  # longer than is bridged
    envelope = make().update(wave)
    # The gap is NaN from where the bridge ends until it has left the filter; then all is well.
    assert np.isfinite(envelope[81:305]).all()
    assert np.isnan(envelope[305:400]).all()
    assert np.allclose(envelope[401:], envelope[250], rtol=0.03)


def _make_envelope_growth() -> Any:
    from hunt_ros.estimation.growth import EnvelopeGrowth

    return EnvelopeGrowth(100.0, window_s=1.5)


def _bad_growth_input(make: Callable[[], Any]) -> None:
    envelope = np.exp(0.3 * np.arange(600) / 100.0)
    envelope[300], envelope[310] = -1.0, np.nan
    growth, std = make().update(envelope)
    assert np.isnan(growth[300:460]).all()
    assert np.isnan(std[300:460]).all()
    assert np.allclose(growth[460:], 0.3, rtol=1e-6)


STREAMS: list[Stream] = [
    Stream(
        'hunting tracker',
        _make_tracker,
        _hunting,
        lambda record: int(record[0].size),
        _feed_tracker,
        _bad_tracker_input,
    ),
    Stream(
        'hilbert envelope',
        _make_envelope,
        _wave,
        len,
        lambda target, wave, a, b: [target.update(wave[a:b])],
        _bad_envelope_input,
    ),
    Stream(
        'envelope growth',
        _make_envelope_growth,
        lambda seed: np.abs(_wave(seed)) + 0.5,
        len,
        lambda target, wave, a, b: list(target.update(wave[a:b])),
        _bad_growth_input,
    ),
]


# --- the contract -----------------------------------------------------------------------------

each_stream = pytest.mark.parametrize('stream', STREAMS, ids=lambda stream: stream.name)


@each_stream
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data(), seed=st.integers(0, 3))
def test_any_cut_into_blocks_gives_the_numbers_of_the_whole(
    stream: Stream, data: st.DataObject, seed: int
) -> None:
    record = stream.record(seed)
    cuts = data.draw(st.lists(st.integers(0, stream.length(record)), max_size=6))
    whole = stream.run(stream.make(), record, [])
    assert stream.run(stream.make(), record, cuts) == whole


@each_stream
def test_sample_by_sample_gives_the_numbers_of_the_whole(stream: Stream) -> None:
    record = stream.record(1)
    pieces = range(1, stream.length(record))
    assert stream.run(stream.make(), record, pieces) == stream.run(stream.make(), record, [])


@each_stream
def test_reset_equals_fresh(stream: Stream) -> None:
    used = stream.make()
    stream.run(used, stream.record(2), [])
    used.reset()
    record = stream.record(1)
    assert stream.run(used, record, []) == stream.run(stream.make(), record, [])


@each_stream
def test_bad_input_is_answered_as_documented(stream: Stream) -> None:
    stream.bad_input(stream.make)
