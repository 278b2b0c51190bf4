"""
The limits of the lab: WARN and ERROR by how large the motion is, whatever it is.

They need no normal form and no noise floor, and change no state: a level by a limit is its own
cause. What is compared is the largest of the amplitude of the hunting motion, that of a stronger
motion outside the frequencies that are followed, and the displacement as the sensor reads it, its
mean included; the acceleration is A (2 pi f)^2 of the lateral motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, F1, compiled, compiled_part
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.output import ESTIMATE_DTYPE
from hunt_ros.detection.regions import HELD, acknowledge, hold, latch
from hunt_ros.samples import Uncertain


class Limit(NamedTuple):
    """
    One limit.

    Parameters
    ----------
    setting : str
        Name in `DetectorConfig`.
    severity : str
        'warn' or 'alarm'.
    what : str
        What is limited, in words.
    unit : str
        Of the setting.
    scale : float
        Units of the setting in one of SI.
    """

    setting: str
    severity: str
    what: str
    unit: str
    scale: float


_QUANTITIES = (
    ('lateral_mm', 'lateral amplitude', 'mm', 1e3),
    ('yaw_mrad', 'yaw amplitude', 'mrad', 1e3),
    ('acceleration_mps2', 'lateral acceleration', 'm/s^2', 1.0),
)
#: All limits; that of number k has bit k of the column `limits`.
LIMITS: tuple[Limit, ...] = tuple(
    Limit(f'{severity}_{name}', severity, what, unit, scale)
    for severity in ('warn', 'alarm')
    for name, what, unit, scale in _QUANTITIES
)
#: Bits of the limits that make the level ERROR and latch the alarm.
ALARMS = sum(1 << k for k, limit in enumerate(LIMITS) if limit.severity == 'alarm')

_COUNT = len(_QUANTITIES)
#: A limit is exceeded where the amplitude less this many standard deviations is above it: in 19
#: of 20 cases at least it is. Right after a kick the amplitude is hardly known.
_SURE = 1.96
#: It is kept again below this part of it: what a filter lets through of noise is less.
BELOW = 0.9
#: Exceeded after this time, in periods of the hunting: as long as an escape is held.
_HOLD_PERIODS = 0.3
#: Kept again after this time, in periods: a motion that beats does not chatter.
_BACK_PERIODS = 3.0

_LATCH: np.dtype[np.void] = np.dtype(
    [('since_ns', np.int64), ('alarm', np.bool_), ('acknowledged', np.bool_)], align=True
)


class AmplitudeLimits:
    """
    Compares the rows with the limits, with hysteresis and hold times, and latches the alarm.

    Parameters
    ----------
    config : DetectorConfig
        Settings, with numbers for the frequencies (`frequencies.with_frequencies`).
    """

    def __init__(self, config: DetectorConfig) -> None:
        #: Of each limit whether it is exceeded; and the latched alarm.
        self._over = np.zeros(len(LIMITS), dtype=HELD)
        self._latch = np.zeros(1, dtype=_LATCH)
        self.reconfigure(config)

    def reconfigure(self, config: DetectorConfig) -> None:
        """Use other limits from the next row on."""
        settings = [getattr(config, limit.setting) / limit.scale for limit in LIMITS]
        self._limits = np.array(settings, dtype=np.float64)
        period_rows = config.output_rate_hz / config.hunting_frequency_hz
        self._hold, self._back = (
            round(periods * period_rows) for periods in (_HOLD_PERIODS, _BACK_PERIODS)
        )

    @property
    def alarm(self) -> bool:
        """The latched alarm."""
        return bool(self._latch['alarm'][0])

    def acknowledge(self) -> None:
        """Take the alarm back: at once, or once the limit is kept again."""
        acknowledge(self._latch[0], bool(self._over['word'][_COUNT:].any()))

    def lasting(self) -> dict[str, float]:
        """Return what a pause does not end."""
        bits = sum(1 << k for k in range(len(LIMITS)) if self._over['word'][k])
        return {
            'limits': float(bits),
            'limit_alarm': float(self._latch['alarm'][0]),
            'limit_acknowledged': float(self._latch['acknowledged'][0]),
        }

    def remember(self, lasting: Mapping[str, float]) -> None:
        """Go on with what `lasting` gave; an earlier recording does not have it."""
        bits = int(lasting.get('limits', 0.0))
        words = [int(bool(bits & (1 << k))) for k in range(len(LIMITS))]
        self._over['word'] = self._over['wanted'] = words
        self._latch['alarm'] = bool(lasting.get('limit_alarm', 0.0))
        self._latch['acknowledged'] = bool(lasting.get('limit_acknowledged', 0.0))

    def watch(self, rows: NDArray[np.void], trusted: NDArray[np.bool_]) -> None:
        """
        Fill in `limits` and `limit_since_ns`, and latch `alarm`.

        Parameters
        ----------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
            With estimates and alarm.
        trusted : ndarray of bool, shape (m,)
            Rows with a motion sensor to trust; the others change nothing.
        """
        if self._limits.any() or self._over['word'].any() or self.alarm:
            waits = self._hold, self._back
            _watch(self._limits, *waits, self._over, self._latch, trusted, rows)


@compiled_part
def _above(least: float, most: float, limit: float, over: int) -> int:
    """Return whether a limit is exceeded: not before it is sure, and until it is well below."""
    if limit <= 0.0:
        return 0
    if least > limit:
        return 1
    if most < BELOW * limit:
        return 0
    return over


@compiled
def _watch(
    limits: F1,
    hold_rows: int,
    back_rows: int,
    over: Annotated[NDArray[np.void], 1, HELD],
    latched: Annotated[NDArray[np.void], 1, _LATCH],
    trusted: B1,
    rows: Annotated[NDArray[np.void], 1, ESTIMATE_DTYPE],
) -> None:
    """Run `AmplitudeLimits.watch`; limits in SI, hold times in rows."""
    m = latched[0]
    least, most = np.empty(_COUNT), np.empty(_COUNT)
    for k in range(rows.size):
        out = rows[k]
        _sizes(out, trusted[k], least, most)
        bits, alarm = 0, False
        for i in range(limits.size):
            held = over[i]
            wanted = _above(least[i % _COUNT], most[i % _COUNT], limits[i], held['word'])
            wait = hold_rows if wanted > 0 else back_rows
            if limits[i] <= 0.0:
                wait = 0
            if hold(held, wanted, wait, out['stamp_ns']):
                m['since_ns'] = held['since_ns']
            if held['word'] > 0:
                bits |= 1 << i
                alarm = alarm or i >= _COUNT
        latch(m, alarm)
        out['limits'] = bits
        out['limit_since_ns'] = m['since_ns']
        if m['alarm']:
            out['alarm'] = True


@compiled_part
def _sizes(out: Any, trusted: bool, least: NDArray[np.float64], most: NDArray[np.float64]) -> None:
    """Fill in lateral and yaw amplitude and acceleration, for sure and at best; NaN: unknown."""
    for i in range(_COUNT):
        least[i] = most[i] = math.nan
    if trusted:
        least[0] = out['lateral_amplitude'] - _SURE * out['lateral_amplitude_std']
        most[0] = out['lateral_amplitude']
        least[1] = out['yaw_amplitude'] - _SURE * out['yaw_amplitude_std']
        most[1] = out['yaw_amplitude']
        turn = (2.0 * math.pi * out['frequency_hz']) ** 2
        least[2], most[2] = turn * least[0], turn * most[0]
    turn = (2.0 * math.pi * out['outside_hz']) ** 2
    _widen(least, most, 0, out['lateral_measured'])
    _widen(least, most, 1, out['yaw_measured'])
    _widen(least, most, 0, out['outside_lateral'])
    _widen(least, most, 1, out['outside_yaw'])
    _widen(least, most, 2, turn * out['outside_lateral'])


@compiled_part
def _widen(least: NDArray[np.float64], most: NDArray[np.float64], i: int, outside: float) -> None:
    """Count a motion that is not followed, or not followed yet, where there is one."""
    if not math.isnan(outside):
        least[i] = outside if math.isnan(least[i]) else max(least[i], outside)
        most[i] = outside if math.isnan(most[i]) else max(most[i], outside)


def limit_cause(row: np.void, number: int, config: DetectorConfig) -> str:
    """
    Compare a row with one of `LIMITS`.

    Parameters
    ----------
    row : void of ESTIMATE_DTYPE
        The row.
    number : int
        Place in `LIMITS`.
    config : DetectorConfig
        With the limit in force.
    """
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
