"""Whatever is wrong with channels, stamps and clocks: the level does not stay OK on doubt."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from fed import Fed
from made import PAPER, changed, record_of

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level
from hunt_ros.samples import Record, Series

CHANNELS = ('lateral', 'yaw', 'roller', 'speed')
MOTION, TICK = ('lateral', 'yaw'), 100_000_000
LEAST, MOST = np.iinfo(np.int64).min, np.iinfo(np.int64).max
#: Of the first sample, ns; when the doubt begins, and when it must be said, ns after it.
START, BEGIN, SAID = 1_700_000_000_000_000_000, 4_000_000_000, 5_200_000_000
END = 6_500_000_000

#: From the stamps of a channel to those that are told; what is left out is silence.
Told = Callable[[np.ndarray], np.ndarray]


def _never(stamps: np.ndarray) -> np.ndarray:
    return stamps[:0]


def _falls_silent(stamps: np.ndarray) -> np.ndarray:
    return stamps[stamps < START + BEGIN]


def _all(stamp_ns: int) -> Told:
    return lambda stamps: np.full_like(stamps, stamp_ns)


def _then(stamp_ns: int) -> Told:
    return lambda stamps: np.where(stamps < START + BEGIN, stamps, stamp_ns)


def _away(offset_s: float) -> Told:
    return lambda stamps: stamps + int(offset_s * 1e9)


def _leaps(stamps: np.ndarray) -> np.ndarray:
    """Return stamps of a clock that is set back and forth every half second."""
    steps = (stamps - START) // 500_000_000
    return stamps + np.where(stamps < START + BEGIN, 0, (steps % 3 - 1) * 3_000_000_000)


def sound(duration_ns: int) -> Record:
    """Return noise of the sensors and a roller that turns evenly, 100 samples a second."""
    seconds = np.arange(0, duration_ns, 10_000_000) * 1e-9
    lateral, yaw = 1e-5 * np.random.default_rng(1).standard_normal((2, seconds.size))
    record = record_of(seconds, lateral=lateral, yaw=yaw, roller=40.0 * seconds, speed=6.0)
    return Record({n: Series(START + one.stamps_ns, one.values) for n, one in record.items()})


@dataclass
class Case:
    """What is told of the stamps; the detector's clock, None where it does not tick."""

    told: Mapping[str, Told] = field(default_factory=dict)
    clock: Callable[[int], int | None] = lambda now: now
    since: int = SAID

    def levels(self) -> list[tuple[int, Level]]:
        """Return the level published at each tick, ns after the start."""
        true, told, arrival = sound(END), {}, {}
        for name, one in true.items():
            # A channel that falls silent leaves out the end.
            stamps = self.told.get(name, lambda x: x)(one.stamps_ns)
            told[name] = Series(stamps, one.values[: stamps.size])
            arrival[name] = one.stamps_ns[: stamps.size]
        rig, levels = Fed(HuntingDetector(DetectorConfig(), PAPER)), []
        for now in rig.play(told, range(START + TICK, START + END, TICK), arrival, self.clock):
            status = rig.detector.status
            assert status.level is not Level.STALE or status.values['causes'], 'it has a code'
            levels.append((now - START, status.level))
        return levels


def _no_tick(now: int) -> int | None:
    return None


def _no_more_ticks(now: int) -> int | None:
    return now if now < START + BEGIN else None


def _stands(now: int) -> int | None:
    return min(now, START + BEGIN)


def _set_by(offset_s: float) -> Callable[[int], int | None]:
    """Return a clock that is set while a channel is silent, before that could be noticed."""
    return lambda now: now if now <= START + BEGIN else now + int(offset_s * 1e9)


CLOCKS: dict[str, Callable[[int], int | None]] = {
    'the clock goes on': lambda now: now,
    **{f'the clock is set by {offset:+g} s': _set_by(offset) for offset in (-3600, -3, 3600)},
}

CASES: dict[str, Case] = {
    **{f'{name} never comes': Case({name: _never}, since=0) for name in CHANNELS},
    **{
        f'only {name} comes': Case({n: _never for n in CHANNELS if n != name}, since=0)
        for name in CHANNELS
    },
    'nothing comes': Case(dict.fromkeys(CHANNELS, _never), since=0),
    'no ticks, nothing of yaw': Case({'yaw': _never}, _no_tick, 0),
    **{
        f'{words}, {name} falls silent': Case({name: _falls_silent}, clock)
        for words, clock in {
            **CLOCKS,
            'no ticks': _no_tick,
            'ticks cease': _no_more_ticks,
            'the clock stands': _stands,
        }.items()
        for name in ('lateral', 'speed')
    },
    **{
        f'{words}, all fall silent': Case(dict.fromkeys(CHANNELS, _falls_silent), clock)
        for words, clock in CLOCKS.items()
    },
    **{
        f'{words} {offset:g} s away': Case(dict.fromkeys(names, _away(offset)))
        for words, names in {'lateral': ('lateral',), 'all': CHANNELS}.items()
        for offset in (3600.0, -16.0, -1.7e9)
    },
    **{
        f'{words} stamped {stamp}': Case(dict.fromkeys(names, _all(stamp)))
        for words, names in {'lateral': ('lateral',), 'all': CHANNELS}.items()
        for stamp in (0, LEAST, MOST)
    },
    **{
        f'{words} stamped {stamp} from some time on': Case(dict.fromkeys(names, _then(stamp)))
        for words, names in {'speed': ('speed',), 'all': CHANNELS}.items()
        for stamp in (0, LEAST, MOST)
    },
    'a clock that leaps again and again': Case({'lateral': _leaps}),
    'the detector at the end of time': Case({}, lambda now: MOST if now > START + BEGIN else now),
}


@pytest.mark.parametrize('name', CASES)
def test_the_level_does_not_stay_ok_on_doubt(name: str) -> None:
    case = CASES[name]
    ok = [at * 1e-9 for at, level in case.levels() if at >= case.since and level is Level.OK]
    assert not ok


def test_without_doubt_it_is_ok_also_after_one_stamp_that_is_none() -> None:
    def one(stamp: int) -> Told:
        return lambda stamps: np.where(np.arange(stamps.size) == 100, stamp, stamps)

    for told in ({}, *({'lateral': one(stamp)} for stamp in (0, LEAST, MOST))):
        levels = {level for at, level in Case(told).levels() if at >= SAID}
        assert levels == {Level.OK}, told


@pytest.mark.parametrize('name', MOTION)
@pytest.mark.parametrize('rate_hz', [6, 8, 12])
def test_samples_too_sparse_for_the_motion_are_a_doubt_while_they_are(
    name: str, rate_hz: int
) -> None:
    """At 12 Hz a motion of 6 Hz, the fastest that is followed, is told from none no more."""
    record = sound(14_000_000_000)
    few = np.arange(400, 900, 100 / rate_hz).astype(int)
    kept = np.concatenate((np.arange(400), few, np.arange(900, 1400)))
    sparse = Series(record[name].stamps_ns[kept], record[name].values[kept])
    rig, levels, reasons = Fed(HuntingDetector(DetectorConfig(), PAPER)), [], []
    ticks = range(START + TICK, START + 14_000_000_001, TICK)
    for _ in rig.play(changed(record, **{name: sparse}), ticks):
        levels.append(rig.detector.status.level)
        reasons.append(' '.join(rig.detector.status.reasons))
    assert set(levels[32:40]) == {Level.OK}
    assert set(levels[65:90]) == {Level.WARN}
    assert f'{name}: sampled too slowly' in reasons[85]
    assert set(levels[120:]) == {Level.OK}


def test_samples_with_room_for_the_motion_are_no_doubt() -> None:
    """At 20 Hz, a twentieth of them lost, or half of 100 Hz."""
    for rate_hz, lost in ((20, 0.05), (100, 0.5)):
        rng = np.random.default_rng(2)
        stamps = START + np.flatnonzero(rng.random(20 * rate_hz) >= lost) * (10**9 // rate_hz)
        detector = HuntingDetector(DetectorConfig(channels=('lateral', 'speed')), PAPER)
        levels = []
        for k in range(0, stamps.size, 5):
            part = stamps[k : k + 5]
            detector.update('lateral', part, 1e-5 * rng.standard_normal(part.size))
            detector.update('speed', part, np.full(part.size, 6.0))
            detector.tick(int(part[-1]))
            levels.append(detector.status.level)
        assert set(levels[len(levels) // 2 :]) == {Level.OK}
