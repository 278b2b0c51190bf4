"""
Do speed and roller angle agree?

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
#: A ratio is believed from this many cells, and not to its last digit before some more of them.
_CELLS, _MORE = 2.0, 4.0
#: A roller that turns faster does not stand still, whatever its diameter, rad/s.
_TURNING = 4.0 * math.pi
#: ... and one that turns slower than this part of that may be an encoder that dithers.
_DITHER = 0.05

_MEMORY: np.dtype[np.void] = np.dtype(
    [
        ('cell', np.int64),
        ('stamp', np.int64),
        ('angle', np.float64),
        ('turned', np.float64),  # in the cell, rad, and the time it took, s
        ('covered', np.float64),
        ('speed', np.float64),  # sum over the rows
        ('rows', np.float64),
        ('before', np.float64),  # roller rate of the cell before, rad/s
        ('cross', np.float64),  # sums of rate x speed and speed^2 over the cells of the ratio
        ('square', np.float64),
        ('cells', np.float64),
        ('contradicted', HELD),
    ],
    align=True,
)


class _Limits(NamedTuple):
    """Hold and recovery in cells; rad/m (NaN: learnt); s."""

    hold: int
    recovery: int
    ratio: float
    period_s: float


class SpeedCheck:
    """
    Compares the running speed with the roller's rate.

    The two contradict each other when the speeds they tell differ by more than the
    tolerance `TOLERANCE_MPS` + `_TOLERANCE_SHARE` x speed, widened
    by what the roller's speed changes in half a second (filters are late) and, where the
    ratio was learnt at a lower speed or just now, in proportion. A contradiction that lasts for
    `CONTRADICTED_S` is told until they have agreed for `health.FAULT_HOLD_S`. At standstill the
    ratio is forgotten: another roller may be mounted.

    Parameters
    ----------
    config : DetectorConfig
        `roller_diameter_m`, where given, takes the place of the learnt ratio.
    """

    def __init__(self, config: DetectorConfig) -> None:
        cells = NANOSECONDS / _CELL_NS
        diameter = config.roller_diameter_m
        self._limits = _Limits(
            round(CONTRADICTED_S * cells),
            round(health.FAULT_HOLD_S * cells),
            2.0 / diameter if diameter > 0.0 else math.nan,
            config.period_ns * 1e-9,
        )
        self._memory = np.zeros(1, dtype=_MEMORY)
        self._memory['angle'] = self._memory['before'] = math.nan

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
            m['turned'] = m['covered'] = m['speed'] = m['rows'] = 0.0
        dt = (stamps[k] - m['stamp']) * 1e-9
        step = angle[k] - m['angle']
        if np.isfinite(step) and dt <= GAP_STEPS * limits.period_s:
            m['turned'] += step
            m['covered'] += dt
        m['stamp'] = stamps[k]
        m['angle'] = angle[k]
        if np.isfinite(speed[k]):
            m['speed'] += speed[k]
            m['rows'] += 1.0
        found[k] = m['contradicted']['word'] > 0


@compiled_part
def _judge(limits: _Limits, m: Any) -> None:
    """Compare the rate and the speed of the cell that is complete."""
    rate, before = math.nan, m['before']
    if m['covered'] >= _COVERED_S:
        rate = abs(m['turned']) / m['covered']
    m['before'] = rate
    if m['rows'] * limits.period_s < _COVERED_S:
        return
    v = m['speed'] / m['rows']
    stands = v <= health.STANDSTILL_MPS
    ratio, learnt_at = limits.ratio, 0.0  # given at any speed
    if math.isnan(ratio) and m['cells'] >= _CELLS:
        ratio = m['cross'] / m['square']
        learnt_at = m['cells'] / (m['cells'] + _MORE) * math.sqrt(m['square'] / m['cells'])
    if stands and not rate > _DITHER * _TURNING:  # an encoder at rest tells no rate
        m['cross'] = m['square'] = m['cells'] = 0.0
        contrary = False
    elif math.isnan(rate):
        return
    elif math.isnan(ratio):
        contrary = stands and rate > _TURNING
    else:
        larger = max(v, rate / ratio)
        tolerance = TOLERANCE_MPS * (max(1.0, larger / learnt_at) if learnt_at > 0.0 else 1.0)
        tolerance += _TOLERANCE_SHARE * larger
        if not math.isnan(before):
            tolerance += abs(rate - before) / ratio
        contrary = abs(rate / ratio - v) > tolerance
    told = m['contradicted']
    rows = limits.recovery if told['word'] > 0 else limits.hold
    hold(told, int(contrary), rows, m['stamp'])
    if not (stands or contrary) and rate > 0.0:  # least squares, so that high speeds count
        m['cross'] += v * rate
        m['square'] += v * v
        m['cells'] += 1.0
