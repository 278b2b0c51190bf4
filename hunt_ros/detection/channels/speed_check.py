"""
Do speed and roller angle tell the same story?

A speed sensor that sticks at a plausible value looks well by itself; the roller's angle
tells on it. The ratio of roller rate and speed, 2 / D, is learnt while both move, so that
no diameter need be known.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, I1, R1, compiled, compiled_part
from hunt_ros.detection.channels import health
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.regions import HELD, hold
from hunt_ros.samples import GAP_STEPS, NANOSECONDS

#: Speed and roller may differ by so much, m/s, and by this share of the speed: a scale that is
#: off by a few per cent, a filter in the drive and a wheel that slips are no contradiction.
TOLERANCE_MPS, _TOLERANCE_SHARE = 0.3, 0.05
#: A contradiction counts after this time, s: a slip while the drive accelerates is over by then.
CONTRADICTED_S = 2.0
#: Rate and speed are compared as means over cells of this length.
_CELL_NS = NANOSECONDS // 2
#: Less of a cell than this is not compared, s.
_COVERED_S = 0.3
#: A ratio is believed from this many cells.
_CELLS = 2.0
#: ... and not to its last digit before some more of them.
_YOUNG = 4.0
#: Both have moved together where the speed has changed by this many tolerances.
_MOVED = 2.0
#: A roller that turns faster does not stand still, whatever its diameter, rad/s.
_TURNING = 4.0 * math.pi
#: ... and one that turns slower than this part of that may be an encoder that dithers.
_DITHER = 0.05
#: Share of the rows that must agree on the direction; the others are leaps of the encoder.
_ONE_WAY = 0.75

#: What is known of a ratio: sums of rate x speed and speed^2 over `cells`, range of the speed.
_RATIO: np.dtype[np.void] = np.dtype(
    [(name, np.float64) for name in ('cross', 'square', 'cells', 'low', 'high')], align=True
)
_MEMORY: np.dtype[np.void] = np.dtype(
    [
        ('cell', np.int64),
        ('stamp', np.int64),
        ('angle', np.float64),
        ('forward', np.float64),  # turned in the cell, rad, and the time it took, s
        ('forward_s', np.float64),
        ('backward', np.float64),
        ('backward_s', np.float64),
        ('still_s', np.float64),
        ('speed', np.float64),  # sum over the rows
        ('rows', np.float64),
        ('before', np.float64),  # roller rate of the cell before, rad/s
        ('ratio', _RATIO),
        ('rival', _RATIO),  # as it has been since the contradiction
        ('contradicted', HELD),
    ],
    align=True,
)


class _Limits(NamedTuple):
    """Settings as the kernel reads them: m/s, -, cells, cells, m/s, rad/m (NaN: learnt), s."""

    speed: float
    fraction: float
    hold: int
    recovery: int
    standstill: float
    ratio: float
    period_s: float


class SpeedCheck:
    """
    Compares the running speed with the roller's rate.

    The two contradict each other when the speeds they tell differ by more than the
    tolerance `TOLERANCE_MPS` + `_TOLERANCE_SHARE` x speed, widened
    by what the roller's speed changes in half a second (filters are late) and, where the
    ratio was learnt at a lower speed or just now, in proportion. A contradiction that lasts for
    `CONTRADICTED_S` is told until they have agreed for `health.FAULT_HOLD_S`. A
    ratio that has never been seen to hold at two speeds gives way to one that does.
    At standstill it is forgotten: another roller may be mounted.

    Parameters
    ----------
    config : DetectorConfig
        `roller_diameter_m`, where given, takes the place of the learnt ratio.
    """

    def __init__(self, config: DetectorConfig) -> None:
        cells = NANOSECONDS / _CELL_NS
        diameter = config.roller_diameter_m
        self._limits = _Limits(
            TOLERANCE_MPS,
            _TOLERANCE_SHARE,
            round(CONTRADICTED_S * cells),
            round(health.FAULT_HOLD_S * cells),
            health.STANDSTILL_MPS,
            2.0 / diameter if diameter > 0.0 else math.nan,
            config.period_ns * 1e-9,
        )
        self._memory = np.zeros(1, dtype=_MEMORY)
        self._memory['angle'] = self._memory['before'] = math.nan

    @property
    def ratio(self) -> float:
        """Roller rate over speed, rad/m, given or learnt; NaN where unknown."""
        if not math.isnan(self._limits.ratio):
            return self._limits.ratio
        known = self._memory['ratio'][0]
        return float(known['cross'] / known['square']) if known['cells'] >= _CELLS else math.nan

    def update(
        self, rows_ns: NDArray[np.int64], angle: NDArray[np.float64], speed: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """
        Take rows; tell at which of them the two contradict each other.

        Parameters
        ----------
        rows_ns : ndarray of int64, shape (m,)
            Stamps, increasing.
        angle, speed : ndarray, shape (m,)
            Roller angle, rad, and running speed, m/s; NaN where unknown.

        Returns
        -------
        ndarray of bool, shape (m,)
        """
        found = np.zeros(rows_ns.size, dtype=np.bool_)
        if self._limits.speed > 0.0:
            _check(rows_ns, angle, speed, self._limits, self._memory, found)
        return found


@compiled
def _check(
    stamps: I1,
    angle: R1,
    speed: Annotated[NDArray[np.float64], 1, 'A'],
    limits: _Limits,
    memory: Annotated[NDArray[np.void], 1, _MEMORY],
    found: B1,
) -> None:
    """Run `SpeedCheck.update`."""
    m = memory[0]
    for k in range(stamps.size):
        cell = stamps[k] // _CELL_NS
        if cell != m['cell']:
            _judge(limits, m)
            m['cell'] = cell
            m['forward'] = m['forward_s'] = m['backward'] = m['backward_s'] = 0.0
            m['still_s'] = m['speed'] = m['rows'] = 0.0
        dt = (stamps[k] - m['stamp']) * 1e-9
        step = angle[k] - m['angle']
        if np.isfinite(step) and dt <= GAP_STEPS * limits.period_s:
            if step > 0.0:
                m['forward'] += step
                m['forward_s'] += dt
            elif step < 0.0:
                m['backward'] -= step
                m['backward_s'] += dt
            else:  # a coarse encoder
                m['still_s'] += dt
        m['stamp'] = stamps[k]
        m['angle'] = angle[k]
        if np.isfinite(speed[k]):
            m['speed'] += speed[k]
            m['rows'] += 1.0
        found[k] = m['contradicted']['word'] > 0


@compiled_part
def _rate(m: Any) -> float:
    """Return the roller's rate in the cell, rad/s, without a sign; NaN where unknown."""
    turned, time = m['forward'], m['forward_s']
    if m['backward_s'] > time:
        turned, time = m['backward'], m['backward_s']
    whole = m['forward_s'] + m['backward_s'] + m['still_s']
    if whole < _COVERED_S:
        return math.nan
    time += m['still_s']
    if time < _ONE_WAY * whole:
        turned, time = abs(m['forward'] - m['backward']), whole
    return float(turned / time)


@compiled_part
def _judge(limits: _Limits, m: Any) -> None:
    """Compare the rate and the speed of the cell that is complete."""
    rate, before = _rate(m), m['before']
    m['before'] = rate
    if m['rows'] * limits.period_s < _COVERED_S:
        return
    v = m['speed'] / m['rows']
    stands = v <= limits.standstill
    ratio, learnt_at = _known(limits, m['ratio'])
    if stands and not rate > _DITHER * _TURNING:  # an encoder at rest tells no rate
        _forget(m['ratio'])
        _forget(m['rival'])
        contrary = False
    elif math.isnan(rate):
        return
    elif math.isnan(ratio):
        contrary = stands and rate > _TURNING
    else:
        late = abs(rate - before) / ratio if not math.isnan(before) else 0.0
        contrary = _differ(limits, v, rate / ratio, learnt_at, late)
    told = m['contradicted']
    rows = limits.recovery if told['word'] > 0 else limits.hold
    hold(told, 1 if contrary else 0, rows, m['stamp'])
    if stands or not rate > 0.0:
        return
    if not contrary:
        _learn(m['ratio'], v, rate)
        _forget(m['rival'])
    elif told['word'] > 0:
        _consider(limits, m, v, rate)


@compiled_part
def _tolerance(limits: _Limits, v: float) -> float:
    return limits.speed + limits.fraction * v


@compiled_part
def _known(limits: _Limits, known: Any) -> tuple[float, float]:
    """Return a ratio, rad/m (NaN: unknown), and the speed it was learnt at (0: given)."""
    if not math.isnan(limits.ratio):
        return limits.ratio, 0.0
    if known['cells'] < _CELLS:
        return math.nan, 0.0
    settled = known['cells'] / (known['cells'] + _YOUNG)
    return known['cross'] / known['square'], settled * math.sqrt(known['square'] / known['cells'])


@compiled_part
def _differ(limits: _Limits, v: float, told: float, learnt_at: float, late: float) -> bool:
    """Return True if a speed, m/s, is not that of the roller."""
    larger = max(v, told)
    beyond = max(1.0, larger / learnt_at) if learnt_at > 0.0 else 1.0
    tolerance = beyond * limits.speed + limits.fraction * larger + late
    return bool(abs(told - v) > tolerance)


@compiled_part
def _forget(known: Any) -> None:
    known['cross'] = known['square'] = known['cells'] = known['low'] = known['high'] = 0.0


@compiled_part
def _learn(known: Any, v: float, rate: float) -> None:
    """Take a cell into a ratio: least squares, so that high speeds count."""
    if known['cells'] == 0.0:
        known['low'] = known['high'] = v
    known['low'] = min(known['low'], v)
    known['high'] = max(known['high'], v)
    known['cross'] += v * rate
    known['square'] += v * v
    known['cells'] += 1.0


@compiled_part
def _moved(limits: _Limits, known: Any) -> bool:
    """Return True if the ratio has held at two speeds."""
    return bool(known['high'] - known['low'] > _MOVED * _tolerance(limits, known['high']))


@compiled_part
def _consider(limits: _Limits, m: Any, v: float, rate: float) -> None:
    """Give way to the ratio seen since the contradiction, where it alone has held."""
    if _moved(limits, m['ratio']):
        return
    ratio, learnt_at = _known(limits, m['rival'])
    if not math.isnan(ratio) and _differ(limits, v, rate / ratio, learnt_at, 0.0):
        _forget(m['rival'])
    _learn(m['rival'], v, rate)
    if m['rival']['cells'] >= _CELLS and _moved(limits, m['rival']):
        m['ratio']['cross'] = m['rival']['cross']
        m['ratio']['square'] = m['rival']['square']
        m['ratio']['cells'] = m['rival']['cells']
        m['ratio']['low'] = m['rival']['low']
        m['ratio']['high'] = m['rival']['high']
        _forget(m['rival'])
