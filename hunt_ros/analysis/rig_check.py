"""
Is a rig fit for monitoring? What some seconds of its channels show, and what to do about it.

For `hunt check`: before the first run on a rig, or from a recording of it. The roller should
turn, and the wheelset be quiet.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bursts import bursts_of, evened
from hunt_ros.rig import Rig
from hunt_ros.samples import (
    CLOCK_OFFSET_NS,
    GAP_STEPS,
    NANOSECONDS,
    Record,
    Series,
    plain,
    smallest_step,
)
from hunt_ros.sensors import MOTION, SENSORS, saturated_from

OK, WARN, FAIL, UNKNOWN = 'ok', 'warn', 'fail', 'unknown'

#: Fewer samples tell nothing.
_FEWEST = 50
#: Nominal and highest hunting frequency where the rig does not tell them, Hz.
_NOMINAL_HZ, _HIGHEST_OF_NOMINAL = 2.84, 2.1
#: Samples in a period of the fastest hunting; a speed changes in seconds.
_IN_A_PERIOD, _SPEED_HZ = 10.0, 5.0
#: A stamp that is off by dt makes an error of 2 pi f dt of the amplitude: this much is allowed.
_JITTER_SHARE = 0.01
#: This share of missing samples is allowed.
_MISSING_SHARE = 1e-3
#: A stamp so much before the one before is that of a clock that was set, s.
_SET_S = 1.0
#: Stamps this far from the arrival are another clock's, s.
_OFFSET_S = 0.05
#: The tracker follows a roller whose diameter is given with this error; the speed check allows
#: the second.
_DIAMETER_SHARE, _DIAMETER_FAILS = 0.01, 0.05
#: Below this a roller does not turn, m/s.
_TURNING_MPS = 0.2
#: Unit -> factor and unit in which noise and steps are told.
_SMALL_UNITS = {'m': (1e6, 'um'), 'rad': (1e6, 'urad'), 'm/s': (1e3, 'mm/s')}
#: A noise of this share of the flange clearance hides the motion that matters.
_NOISE_SHARE = 0.01
#: Roller of the built-in rig, and the smallest one of any, m.
_ROLLER_M, _SMALLEST_M = 0.3, 0.05
#: Steps of an angle of more than this are a wrap, rad.
_WRAP = math.pi


@dataclass(frozen=True)
class Finding:
    """
    One thing that was looked at.

    Parameters
    ----------
    check : str
        'rate', 'jitter', 'gaps', 'noise', 'resolution', 'range', 'unit', 'clock', 'encoder',
        'diameter', 'speed', 'motion', 'filter', 'publishers', 'damage', 'disk', 'alarm', 'drive'.
    channel : str
        Of the rig; '' where it is none.
    state : str
        'ok', 'warn', 'fail', or 'unknown' where the samples cannot tell.
    text : str
        What was found, with its number.
    advice : str
        What to do; '' where nothing is to be done.
    value : float or None
        The number, in `unit`.
    unit : str
        SI.
    """

    check: str
    channel: str
    state: str
    text: str
    advice: str = ''
    value: float | None = None
    unit: str = ''


def check_rig(
    record: Record, sound: Record, arrivals: Mapping[str, NDArray[np.int64]], rig: Rig
) -> list[Finding]:
    """
    Look at every channel of a rig.

    Parameters
    ----------
    record : Record
        Some seconds of it.
    sound : Record
        The same without the readings that are none: by it the noise is told.
    arrivals : mapping of str to ndarray of int64, shape (n,)
        When the samples of a channel came, ns; a channel that is absent is not compared.
    rig : Rig
        What is expected.

    Returns
    -------
    list of Finding
    """
    found: list[Finding] = []
    for channel in rig.channels:
        series = record.get(channel)
        if series is None or len(series) < _FEWEST:
            found.append(_absent(channel, 0 if series is None else len(series), rig))
            continue
        found += _times(channel, series, rig)
        if channel in arrivals:
            found.append(_clock(channel, series, arrivals[channel]))
        found += _readings(channel, series, sound[channel], rig)
    found += check_roller(replace(record, channels=evened(record)[0]), rig)
    return found


def _small(value: float, unit: str) -> str:
    """Return a small number in a unit in which it has no exponent."""
    scale, small = _SMALL_UNITS.get(unit, (1.0, unit))
    return f'{float(f"{scale * value:.3g}"):.7g} {small}'


def judged(
    check: str,
    channel: str,
    bad: bool,
    text: str,
    advice: str,
    value: float,
    unit: str = '',
    state: str = FAIL,
) -> Finding:
    """Return a finding that is ok, with no advice, or bad."""
    state, advice = (state, advice) if bad else (OK, '')
    return Finding(check, channel, state, text, advice, value, unit)


def _absent(channel: str, count: int, rig: Rig) -> Finding:
    start = 'listen, or record, for longer' if count else f'start what publishes {channel}'
    advice = f'{start}, or leave {channel} out of "channels" of the rig file'
    text, state = f'{count or "no"} samples', WARN if channel in rig.optional_channels else FAIL
    return Finding('rate', channel, state, text, advice, 0.0, 'Hz')


def _highest_hz(rig: Rig) -> float:
    return _HIGHEST_OF_NOMINAL * (rig.hunting_frequency_hz or _NOMINAL_HZ)


def _times(channel: str, series: Series, rig: Rig) -> Iterator[Finding]:
    """Rate, jitter, and what is missing, by the stamps."""
    bursts = bursts_of(series.stamps_ns)
    if bursts is not None:
        advice = 'stamp each sample by the clock of the converter, in a message with a header'
        apart_s = bursts.apart_ns / NANOSECONDS
        yield Finding('jitter', channel, FAIL, str(bursts), advice, apart_s, 's')
        return
    steps = np.diff(series.stamps_ns) / NANOSECONDS
    step = float(np.median(steps))
    backward = int(np.count_nonzero(steps <= 0.0))
    if backward or step <= 0.0:
        text = f'{backward} stamps are not after the one before'
        if float(steps.min()) < -_SET_S:
            text += f', the clock jumps back by {-float(steps.min()):.3f} s'
        advice = 'stamp each sample once, when it was taken, on a clock that is not set'
        yield Finding('gaps', channel, FAIL, text, f'{advice} while it runs', float(backward))
        return
    regular = steps < GAP_STEPS * step
    apart = steps[~regular]
    missing = float(np.sum(np.rint(apart / step) - 1.0))
    least = _IN_A_PERIOD * _highest_hz(rig) if channel in MOTION else _SPEED_HZ
    text, advice = f'{plain(1.0 / step, 4)} samples/s', f'sample it at {plain(least)} Hz or more'
    yield judged('rate', channel, 1.0 / step < least, text, advice, 1.0 / step, 'Hz')
    jitter = float(np.std(steps[regular])) / math.sqrt(2.0)
    most = _JITTER_SHARE / (2.0 * math.pi * _highest_hz(rig))
    text = f'stamps are off by {1e3 * jitter:.3f} ms (standard deviation)'
    advice = (
        'stamp the samples by the clock of the converter, not when a program reads them'
        f' (expected at most {1e3 * most:.2g} ms)'
    )
    loose = channel in MOTION and jitter > most
    yield judged('jitter', channel, loose, text, advice, jitter, 's')
    share = missing / (len(series) + missing)
    text = f'{missing:.0f} samples are missing, the longest gap is {plain(float(steps.max()))} s'
    advice = 'look for lost messages: the network, the depth of the queues, the load of the host'
    yield judged('gaps', channel, share > _MISSING_SHARE, text, advice, share)


def _clock(channel: str, series: Series, arrivals: NDArray[np.int64]) -> Finding:
    """Return how far the stamps are from the arrival."""
    late = (arrivals - series.stamps_ns) / NANOSECONDS
    # What is under way comes late, never early: the quickest message tells the clocks' offset.
    offset = float(np.quantile(late, 0.05))
    side = 'before' if offset >= 0 else 'after'
    text = f'stamps are {plain(1e3 * abs(offset))} ms {side} arrival'
    advice = 'synchronise the clocks of the hosts (PTP: docs/lab-pc.md)'
    state = FAIL if abs(offset) > CLOCK_OFFSET_NS / NANOSECONDS else WARN
    apart = not -1e-3 <= offset <= _OFFSET_S
    return judged('clock', channel, apart, text, advice, offset, 's', state)


def _readings(channel: str, series: Series, sound: Series, rig: Rig) -> Iterator[Finding]:
    """Noise, resolution, range, by the values."""
    values = series.values[np.isfinite(series.values)]
    lost = len(series) - values.size
    if lost:
        state = FAIL if lost > _MISSING_SHARE * len(series) else WARN
        advice = 'look at the sensor: it reports that it cannot measure'
        yield Finding(
            'gaps', channel, state, f'{lost} readings are no numbers', advice, float(lost)
        )
    if values.size < _FEWEST:
        return
    unit = next((s.unit for s in SENSORS if s.name == channel), '')
    unit = unit or {'roller': 'rad', 'speed': 'm/s'}[channel]
    if float(np.ptp(values)) == 0.0:
        text = f'every reading is {float(values[0]):.4g} {unit}'
        advice = 'the sensor is stuck or not connected: move it, and look again'
        yield judged('noise', channel, channel in MOTION, text, advice, 0.0, unit)
        return
    noise = _noise(sound.finite().values)
    if channel in MOTION:
        most = _NOISE_SHARE * rig.flange_clearance_m if channel == 'lateral' else 0.0
        text = f'white noise of {_small(noise, unit)} (standard deviation)'
        advice = (
            f'expected at most {_small(most, unit)}, {_NOISE_SHARE:.0%} of the flange clearance:'
            ' look at cables, shielding, range of the sensor'
        )
        yield judged('noise', channel, 0.0 < most < noise, text, advice, noise, unit)
    if channel != 'roller':
        step = smallest_step(values)
        text = f'the smallest step of the readings is {_small(step, unit)}'
        # Noise of a step and more is averaged out; below it what is smaller is not seen at all.
        coarse = channel in MOTION and noise < 0.5 * step
        advice = 'coarser than the noise: motion below one step is not seen; use a smaller range'
        yield judged('resolution', channel, coarse, text, advice, step, unit, WARN)
    limit = saturated_from(rig, channel)
    largest = float(np.abs(values).max())
    if 0.0 < limit <= largest:
        text = f'readings reach {plain(largest, 4)} {unit}'
        advice = (
            f'they are saturated from {limit:.4g} {unit} on: centre the sensor, or take one with'
            ' a larger range'
        )
        yield Finding('range', channel, FAIL, text, advice, largest, unit)


def _noise(values: NDArray[np.float64]) -> float:
    """Standard deviation of the white noise, from second differences (Rice, 1984)."""
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    return float(np.sqrt(np.mean(second**2) / 6.0))


def check_roller(record: Record, rig: Rig) -> Iterator[Finding]:
    """
    Look at speed and encoder, and at whether they contradict each other.

    Parameters
    ----------
    record : Record
        Its samples evenly spaced (`bursts.evened`).
    rig : Rig
        Its channels, and the diameter of the roller.

    Yields
    ------
    Finding
        'speed': the direction; 'encoder': direction and wrap; 'diameter': that by both.
    """
    speed, roller = record.get('speed'), record.get('roller')
    speeds = np.zeros(0) if speed is None else speed.values[np.isfinite(speed.values)]
    if speeds.size >= _FEWEST:
        mean = float(np.mean(speeds))
        reverse = mean < -_TURNING_MPS
        text = f'{mean:.3f} m/s on average' + ': the rig runs in reverse' * reverse
        advice = 'where it does not, change the sign of the channel (factor -1)'
        yield judged('speed', 'speed', reverse, text, advice, mean, 'm/s', WARN)
    if 'roller' not in rig.channels or roller is None or len(roller) < _FEWEST:
        return
    distinct = np.diff(roller.stamps_ns, prepend=-1) != 0
    roller = Series(roller.stamps_ns[distinct], roller.values[distinct])
    steps, times = np.diff(roller.values), np.diff(roller.stamps_ns) / NANOSECONDS
    # How far it turned in a gap, or while a clock was set, is not known.
    regular = np.isfinite(steps) & (times > 0.0) & (times < GAP_STEPS * np.median(times))
    if not regular.any():
        return
    steps, times = steps[regular], times[regular]
    leaps = np.abs(steps) > _WRAP
    span = float(np.sum(times))
    # Second by second: a run that reverses has turned, though it may end where it began.
    middle = 0.5 * (roller.stamps_ns[:-1] + roller.stamps_ns[1:])[regular]
    second = np.unique((middle - middle[0]) // NANOSECONDS, return_inverse=True)[1]
    turns = np.bincount(second, weights=(steps + math.pi) % (2.0 * math.pi) - math.pi)
    told = None if speed is None else speed.in_order().finite()
    ran = np.zeros(times.size)
    if told is not None and speeds.size >= _FEWEST:
        ran = np.interp(middle, told.stamps_ns, told.values)
    ways = np.bincount(second, weights=ran * times)
    running = float(np.sum(np.abs(ways))) / span
    rate = float(np.sum(np.abs(turns))) / span
    if rate < 0.1:
        state, text, advice = UNKNOWN, 'the roller does not turn', 'let it turn, and look again'
        if running > _TURNING_MPS:
            state, text = FAIL, f'the angle stands still at {running:.3g} m/s'
            advice = 'look at the encoder and its cable'
        yield Finding('encoder', 'roller', state, text, advice, rate, 'rad/s')
        return
    net = float(np.sum(turns)) / span
    way = 'both ways' if abs(net) < 0.9 * rate else 'forwards' if net > 0.0 else 'backwards'
    wraps = f', and wraps every turn ({int(leaps.sum())} times)' if leaps.any() else ''
    quick = float(np.quantile(np.abs(steps[~leaps]), 0.99)) if not leaps.all() else math.inf
    if leaps.any():
        # What wraps between two readings looks slower than it is: the speed says how fast it is.
        diameter_m = rig.roller_diameter_m or _ROLLER_M
        quick = max(quick, 2.0 * running / diameter_m * span / len(times))
    text = f'the angle runs {way} at {plain(rate, 4)} rad/s{wraps}'
    advice = 'it turns by more than a quarter from reading to reading: read it more often'
    seldom = quick > 0.5 * _WRAP
    yield judged('encoder', 'roller', seldom, text, advice, math.copysign(rate, net), 'rad/s')
    if speeds.size >= _FEWEST and not seldom:
        yield _diameter(np.abs(ways), np.abs(turns), running, rate, rig)


def _diameter(
    ways: NDArray[np.float64], turns: NDArray[np.float64], running: float, rate: float, rig: Rig
) -> Finding:
    """Return the diameter that way and turning of each second tell, 2 v / omega."""
    if running < _TURNING_MPS:
        state, text = UNKNOWN, f'{running:.2f} m/s are too slow to tell the diameter'
        advice = 'let the roller turn faster, and look again'
        if 0.5 * (rig.roller_diameter_m or _SMALLEST_M) * rate > _TURNING_MPS:
            state, text = FAIL, f'{running:.2f} m/s while the encoder turns at {plain(rate)} rad/s'
            advice = 'look at the tachometer and its cable'
        return Finding('diameter', 'roller', state, text, advice)
    measured = 2.0 * float(np.sum(ways) / np.sum(turns))
    text = f'speed and encoder tell a roller of {measured:.4f} m'
    apart = float(np.quantile(np.abs(ways - 0.5 * measured * turns), 0.9) / np.max(ways))
    if apart > _DIAMETER_FAILS:
        text += f', and are {apart:.1%} apart in a tenth of the time'
        advice = 'one of the two does not measure: look at the tachometer and at the encoder'
        return Finding('diameter', 'roller', FAIL, text, advice, measured, 'm')
    given = rig.roller_diameter_m
    if given == 0.0:
        advice = (
            f'write roller_diameter_m: {measured:.4g} into the rig file, if that is what it is'
        )
        return Finding('diameter', 'roller', WARN, text, advice, measured, 'm')
    off = abs(measured / given - 1.0)
    state = WARN if off <= _DIAMETER_FAILS else FAIL
    advice = (
        f'the rig file says {given:.4g} m, {off:.1%} apart: one of diameter, scale of the speed'
        ' and counts of the encoder is wrong'
    )
    wrong = off > _DIAMETER_SHARE
    return judged('diameter', 'roller', wrong, text, advice, measured, 'm', state)
