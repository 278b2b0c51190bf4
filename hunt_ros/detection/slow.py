"""
The slow channels, speed and roller angle: what they say at any stamp, and whether they agree.

A speed sensor that sticks at a plausible value looks well by itself; the roller's angle
tells on it. The ratio of roller rate and speed, 2 / D, is learnt while both move, so that
no diameter need be known.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, F1, I1, R1, compiled, compiled_part
from hunt_ros.detection import health
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.regions import HELD, hold
from hunt_ros.samples import GAP_STEPS, NANOSECONDS

_Stamps = NDArray[np.int64]
_Values = NDArray[np.float64]

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

#: Stands for the stamp of a sample that there is not.
_NEVER = -(2**62)


class SlowChannel:
    """
    Value of a slow channel (speed, roller angle) at any stamp.

    Straight lines between neighbouring samples that are valid and not further
    apart than the timeout; otherwise the last valid value, moved on by the last
    slope if `rising`. NaN once it is older than the timeout.

    Parameters
    ----------
    timeout_ns : int
        Of the channel.
    rising : bool
        True for an angle, which goes on at its last rate. A reading that repeats the one
        before says nothing then: the encoder is coarse, or it is stuck.

    Attributes
    ----------
    within : ndarray of float64, shape (n,)
        How far the values of the last call may be off, since the change of a reading that was
        repeated lies anywhere between two samples; 0 where no reading is repeated.
    """

    def __init__(self, timeout_ns: int, rising: bool) -> None:
        self._timeout = timeout_ns
        self._rising = rising
        self._whole = np.zeros(3, dtype=np.int64)
        self._real = np.array([math.nan, math.nan, 0.0, 0.0])
        self.within = np.zeros(0)

    def at(
        self,
        wanted_ns: _Stamps,
        stamps_ns: _Stamps,
        values: _Values,
        following: tuple[int, float] | None,
    ) -> _Values:
        """
        Evaluate, and take the samples in.

        Parameters
        ----------
        wanted_ns : ndarray of int64, shape (n,)
            Sorted stamps, none before those of earlier calls.
        stamps_ns, values : ndarray, shape (m,)
            New samples up to the last wanted stamp; invalid ones as NaN.
        following : tuple of (int, float), optional
            The sample after these.

        Returns
        -------
        ndarray of float64, shape (n,)
        """
        found, self.within = np.empty(wanted_ns.size), np.zeros(wanted_ns.size)
        after_ns, after = (_NEVER, math.nan) if following is None else following
        _evaluate(
            wanted_ns,
            stamps_ns,
            values,
            after_ns,
            after,
            self._timeout,
            self._rising,
            self._whole,
            self._real,
            found,
            self.within,
        )
        return found


@compiled
def _evaluate(
    wanted: I1,
    stamps: I1,
    values: R1,
    after_stamp: int,
    after: float,
    timeout: int,
    rising: bool,
    whole: I1,
    real: F1,
    found: F1,
    within: F1,
) -> None:
    """
    Run `SlowChannel.at`.

    whole = [stamp of the last sample, of the last valid one, and of the last repeat]; real =
    [value of the last sample (NaN: invalid), and of the last valid one, rate of the last line,
    how far its end may be off].
    """
    n = 0
    for k in range(wanted.size):
        stamp = wanted[k]
        while n < stamps.size and stamps[n] <= stamp:
            _take(stamps[n], values[n], timeout, rising, whole, real)
            n += 1
        within[k] = real[3]
        end, value = after_stamp, after
        if n < stamps.size:
            end, value = stamps[n], values[n]
        step = end - whole[0]
        known = np.isfinite(value) and np.isfinite(real[0]) and not (rising and value == real[0])
        if known and 0 < step <= timeout:
            slope = (value - real[0]) / (step * 1e-9)
            found[k] = real[0] + slope * ((stamp - whole[0]) * 1e-9)
            continue
        age = stamp - whole[1]
        found[k] = np.nan
        if age <= timeout:
            found[k] = real[1] + (real[2] * (age * 1e-9) if rising else 0.0)
    while n < stamps.size:
        _take(stamps[n], values[n], timeout, rising, whole, real)
        n += 1


@compiled_part
def _take(
    stamp: int, value: float, timeout: int, rising: bool, whole: _Stamps, real: _Values
) -> None:
    """Take one sample."""
    if rising and value == real[0]:
        whole[2] = stamp
        return
    if not np.isfinite(value):
        whole[0], real[0] = stamp, np.nan
        return
    step = stamp - whole[0]
    if 0 < step <= timeout and np.isfinite(real[0]):
        real[2] = (value - real[0]) / (step * 1e-9)
        late = stamp - whole[2] if whole[2] > whole[0] else 0
        real[3] = abs(real[2]) * (late * 1e-9)
    whole[0] = whole[1] = stamp
    real[0] = real[1] = value


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
        diameter = config.roller_diameter_m
        self._ratio = 2.0 / diameter if diameter > 0.0 else math.nan
        self._period_s = config.period_ns * 1e-9
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
        _check(rows_ns, angle, speed, self._ratio, self._period_s, self._memory, found)
        return found


@compiled
def _check(
    stamps: I1,
    angle: R1,
    speed: Annotated[NDArray[np.float64], 1, 'A'],
    ratio: float,
    period_s: float,
    memory: Annotated[NDArray[np.void], 1, _MEMORY],
    found: B1,
) -> None:
    """Run `SpeedCheck.update`; the ratio in rad/m, NaN: it is learnt."""
    m = memory[0]
    for k in range(stamps.size):
        cell = stamps[k] // _CELL_NS
        if cell != m['cell']:
            _judge(ratio, period_s, m)
            m['cell'] = cell
            m['turned'] = m['covered'] = m['speed'] = m['rows'] = 0.0
        dt = (stamps[k] - m['stamp']) * 1e-9
        step = angle[k] - m['angle']
        if np.isfinite(step) and dt <= GAP_STEPS * period_s:
            m['turned'] += step
            m['covered'] += dt
        m['stamp'] = stamps[k]
        m['angle'] = angle[k]
        if np.isfinite(speed[k]):
            m['speed'] += speed[k]
            m['rows'] += 1.0
        found[k] = m['contradicted']['word'] > 0


@compiled_part
def _judge(given: float, period_s: float, m: Any) -> None:
    """Compare the rate and the speed of the cell that is complete."""
    rate, before = math.nan, m['before']
    if m['covered'] >= _COVERED_S:
        rate = abs(m['turned']) / m['covered']
    m['before'] = rate
    if m['rows'] * period_s < _COVERED_S:
        return
    v = m['speed'] / m['rows']
    stands = v <= health.STANDSTILL_MPS
    ratio, learnt_at = given, 0.0  # given at any speed
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
    wait_s = health.FAULT_HOLD_S if told['word'] > 0 else CONTRADICTED_S
    hold(told, int(contrary), round(wait_s * NANOSECONDS / _CELL_NS), m['stamp'])
    if not (stands or contrary) and rate > 0.0:  # least squares, so that high speeds count
        m['cross'] += v * rate
        m['square'] += v * v
        m['cells'] += 1.0
