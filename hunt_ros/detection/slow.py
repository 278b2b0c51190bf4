"""
The slow channels, speed and roller angle: what they say at any stamp, and whether they agree.

A speed sensor that sticks at a plausible value looks well by itself; the roller's angle
tells on it. The ratio of roller rate and speed, 2 / D, is learnt while both move, so that
no diameter need be known.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import health
from hunt_ros.detection.configuration import DetectorConfig
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
        #: The last valid reading, the last that repeats none, and the last.
        self._stamps, self._values = np.full(3, _NEVER), np.full(3, math.nan)
        #: Rate of the last line, and how far its end may be off.
        self._rate = self._off = 0.0
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
        count = 3 + stamps_ns.size
        if following is not None:
            stamps_ns, values = np.append(stamps_ns, following[0]), np.append(values, following[1])
        stamps = np.concatenate([self._stamps, stamps_ns])
        values = np.concatenate([self._values, values])
        place = np.arange(stamps.size)
        repeats = (np.diff(values, prepend=math.nan) == 0.0) & self._rising
        told = np.maximum.accumulate(np.where(repeats, 0, place))
        valid = np.maximum.accumulate(np.where(repeats | np.isnan(values), 0, place))
        # The line to each sample, from the last one before it that repeats none.
        before = np.maximum(place - 1, 0)
        begin = told[before]
        step, rise = stamps - stamps[begin], values - values[begin]
        known = ~repeats & np.isfinite(rise) & (step > 0) & (step <= self._timeout)
        rate = rise / np.where(known, step * 1e-9, math.nan)
        late = np.where(stamps[before] > stamps[begin], stamps - stamps[before], 0)
        off = np.abs(rate) * (late * 1e-9)
        rate[0], off[0] = self._rate, self._off
        line = np.maximum.accumulate(np.where(known, place, 0))

        at = np.searchsorted(stamps[:count], wanted_ns, 'right') - 1
        after = np.minimum(at + 1, place[-1])
        age_s = (wanted_ns - stamps[valid[at]]) * 1e-9
        found = values[valid[at]] + (rate[line[at]] * age_s if self._rising else 0.0)
        found[wanted_ns - stamps[valid[at]] > self._timeout] = math.nan
        between = values[told[at]] + rate[after] * ((wanted_ns - stamps[told[at]]) * 1e-9)
        self.within = off[line[at]]

        last = count - 1
        self._rate, self._off = rate[line[last]], off[line[last]]
        self._stamps, self._values = (x[[valid[last], told[last], last]] for x in (stamps, values))
        return np.where((after > at) & known[after], between, found)


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
        self._given = 2.0 / diameter if diameter > 0.0 else math.nan
        self._period_s = config.period_ns * 1e-9
        #: Stamps, angles and speeds of the cell that is not complete, and of the row before it.
        unknown = np.full(1, math.nan)
        self._open = np.full(1, _NEVER), unknown, unknown
        self._before = math.nan  # roller rate of the cell before, rad/s
        self._forget()
        self._contradicted, self._waited = False, 0

    def _forget(self) -> None:
        """Learn the ratio anew: sums of rate x speed and of speed^2 over so many cells."""
        self._cross = self._square = self._cells = 0.0

    def update(self, rows_ns: _Stamps, angle: _Values, speed: _Values) -> NDArray[np.bool_]:
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
        before = self._open
        stamps, angle, speed = (
            np.concatenate(both) for both in zip(before, (rows_ns, angle, speed), strict=True)
        )
        found, begin = np.full(rows_ns.size, self._contradicted), 1
        for end in (np.flatnonzero(np.diff(stamps[1:] // _CELL_NS)) + 2).tolist():
            self._judge(stamps[begin - 1 : end], angle[begin - 1 : end], speed[begin:end])
            found[end - before[0].size :] = self._contradicted
            begin = end
        self._open = stamps[begin - 1 :], angle[begin - 1 :], speed[begin - 1 :]
        return found

    def _judge(self, stamps: _Stamps, angle: _Values, speed: _Values) -> None:
        """Compare the rate and the speed of a cell: the former with the row before it."""
        steps, seconds = np.diff(angle), np.diff(stamps) * 1e-9
        good = np.isfinite(steps) & (seconds <= GAP_STEPS * self._period_s)
        covered_s, speed = float(seconds[good].sum()), speed[np.isfinite(speed)]
        before, rate = self._before, math.nan
        if covered_s >= _COVERED_S:
            rate = abs(float(steps[good].sum())) / covered_s
        self._before = rate
        if speed.size * self._period_s < _COVERED_S:
            return
        v = float(speed.mean())
        stands = v <= health.STANDSTILL_MPS
        ratio, learnt_at = self._given, 0.0  # given at any speed
        if math.isnan(ratio) and self._cells >= _CELLS:
            ratio = self._cross / self._square
            learnt_at = self._cells / (self._cells + _MORE) * math.sqrt(self._square / self._cells)
        if stands and not rate > _DITHER * _TURNING:  # an encoder at rest tells no rate
            self._forget()
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
        wait_s = health.FAULT_HOLD_S if self._contradicted else CONTRADICTED_S
        self._waited = self._waited + 1 if contrary != self._contradicted else 0
        if self._waited > wait_s * NANOSECONDS / _CELL_NS:
            self._contradicted, self._waited = contrary, 0
        if not (stands or contrary) and rate > 0.0:  # least squares, so that high speeds count
            self._cross += v * rate
            self._square += v * v
            self._cells += 1.0
