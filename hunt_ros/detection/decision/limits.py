"""
The limits of the lab: WARN and ERROR by how large the motion is, whatever it is.

They need no normal form and no noise floor, and change no state: a level by a limit is its own
cause. What is compared is the largest of the amplitude of the hunting motion, that of a stronger
motion outside the frequencies that are followed, and the displacement as the sensor reads it, its
mean included; the acceleration is A (2 pi f)^2 of the lateral motion.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F1, compiled_part
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.regions import hold
from hunt_ros.samples import NORMAL_95, Uncertain


class Limit(NamedTuple):
    """One limit: its name in `DetectorConfig`, what is limited, and in which units of SI."""

    setting: str
    severity: str  # 'warn' or 'alarm'
    what: str
    unit: str
    scale: float


_QUANTITIES = (
    ('lateral_mm', 'lateral amplitude', 'mm', 1e3),
    ('yaw_mrad', 'yaw amplitude', 'mrad', 1e3),
    ('acceleration_mps2', 'lateral acceleration', 'm/s^2', 1.0),
)
_COUNT = len(_QUANTITIES)
#: All limits; that of number k has bit k of the column `limits`.
LIMITS: tuple[Limit, ...] = tuple(
    Limit(f'{severity}_{name}', severity, what, unit, scale)
    for severity in ('warn', 'alarm')
    for name, what, unit, scale in _QUANTITIES
)
#: Bits of the limits that make the level ERROR and latch the alarm.
ALARMS = sum(1 << k for k, limit in enumerate(LIMITS) if limit.severity == 'alarm')

#: A limit is kept again below this part of it: what a filter lets through of noise is less.
BELOW = 0.9
#: Exceeded, and kept again, after so many periods of the hunting: as long as an escape is held,
#: and so long that a motion that beats does not chatter.
_HOLD, _BACK = 0.3, 3.0


@compiled_part
def watch(limits: F1, period_rows: float, memory: Any, trusted: bool, out: Any) -> int:
    """
    Return the limits that are exceeded in a row, and fill them in.

    A limit is exceeded where in 19 of 20 cases the motion is above it: right after a kick the
    amplitude is hardly known.

    Parameters
    ----------
    limits : ndarray, shape (6,)
        In SI; 0: off.
    period_rows : float
        Rows in a period of the hunting.
    memory
        A record with `limits`, HELD of shape (6,), and `limit_since_ns`.
    trusted : bool
        There is a motion sensor to trust; without, the amplitudes count for nothing.
    out
        The row.
    """
    least, most = np.full(_COUNT, math.nan), np.full(_COUNT, math.nan)
    if trusted:
        least[0] = out['lateral_amplitude'] - NORMAL_95 * out['lateral_amplitude_std']
        least[1] = out['yaw_amplitude'] - NORMAL_95 * out['yaw_amplitude_std']
        most[0], most[1] = out['lateral_amplitude'], out['yaw_amplitude']
        turn = (2.0 * math.pi * out['frequency_hz']) ** 2
        least[2], most[2] = turn * least[0], turn * most[0]
    turn = (2.0 * math.pi * out['outside_hz']) ** 2
    _widen(least, most, 0, out['lateral_measured'])
    _widen(least, most, 1, out['yaw_measured'])
    _widen(least, most, 0, out['outside_lateral'])
    _widen(least, most, 1, out['outside_yaw'])
    _widen(least, most, 2, turn * out['outside_lateral'])
    bits = 0
    for i in range(limits.size):
        held, wanted, wait = memory['limits'][i], 0, 0.0
        if limits[i] > 0.0:
            wanted = held['word']
            if least[i % _COUNT] > limits[i]:
                wanted = 1
            elif most[i % _COUNT] < BELOW * limits[i]:
                wanted = 0
            wait = _HOLD if wanted > 0 else _BACK
        if hold(held, wanted, round(wait * period_rows), out['stamp_ns']):
            memory['limit_since_ns'] = held['since_ns']
        if held['word'] > 0:
            bits |= 1 << i
    out['limits'] = bits
    out['limit_since_ns'] = memory['limit_since_ns']
    return bits


@compiled_part
def _widen(least: NDArray[np.float64], most: NDArray[np.float64], i: int, outside: float) -> None:
    """Count a motion that is not followed, or not followed yet, where there is one."""
    least[i], most[i] = np.fmax(least[i], outside), np.fmax(most[i], outside)


def limit_cause(row: np.void, number: int, config: DetectorConfig) -> str:
    """Compare a row (ESTIMATE_DTYPE) with one of `LIMITS`, by the limit in force."""
    limit = LIMITS[number]
    value = float(getattr(config, limit.setting))
    if value <= 0.0:
        return f'the {limit.severity} limit of the {limit.what} is off ({limit.setting})'
    channel = 'yaw' if limit.what.startswith('yaw') else 'lateral'
    size, std = (float(row[f'{channel}_amplitude{end}']) for end in ('', '_std'))
    hz, outside = float(row['frequency_hz']), float(row[f'outside_{channel}'])
    if outside > size or math.isnan(size):
        size, std, hz = outside, math.nan, float(row['outside_hz'])
    turn = limit.scale * (1.0 if limit.unit != 'm/s^2' else (2.0 * math.pi * hz) ** 2)
    what, measured = limit.what, float(row[f'{channel}_measured'])
    if limit.unit != 'm/s^2' and (measured > size or math.isnan(size)):
        size, std, what = measured, math.nan, f'measured {channel} displacement'
    told = f'{turn * size:.3g}'
    if std > 0.0:
        told = Uncertain(turn * size, turn * std).text(' +/- ')
    over = int(row['limits']) & (1 << number)
    words = 'is above' if over else f'is below {100.0 * BELOW:g} % of'
    return (
        f'the {what} {told} {limit.unit} {words} the {limit.severity}'
        f' limit of {value:g} {limit.unit} ({limit.setting})'
    )
