"""
Where the strongest line is: the check that the motion is the one that is tracked.

A bank of resonators over a range wider than the tracker's. The tracker cannot say this
itself: kept within its range, it follows a motion outside it by turning its phase, and a motion
inside it, far from where it began, it may take for a level that drifts, or for noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.compiled import F1, F2, R1, compiled

_F = NDArray[np.float64]

#: Distance of the resonators, and their bandwidth, as shares of the frequency.
_STEP, _BAND = 0.12, 0.12
#: How far beyond the range lines are looked for, and how far the range itself is stretched.
_BEYOND, _EDGE = 3.0, 1.1
#: A line stands this many times above the noise in the bank (its median), and this many times
#: above what is followed (outside the range: above the strongest line inside), for this many
#: periods of the lowest frequency.
_CLEAR, _STRONGER, _PERIODS = 5.0, 2.0, 3.0
#: It goes on while it is this many times lower, and is over after so many of those times.
_RELAXED, _GONE = 1.5, 2.0
#: Power of a resonator over its average below which it only rings on, and nothing drives it.
_DRIVEN = 0.6
#: Width of a line that is known not to be of interest, as a share of its frequency.
_KNOWN = 0.1
#: Periods over which frequency and amplitude of a line are averaged.
_AVERAGED = 2.0
# Of each resonator: its state, the averages of its power and of its turning; its pole, its gain,
# the gain of the averages, its frequency, and whether that is inside the range (0 or 1).
_RE, _IM, _POWER, _COS, _SIN, _POLE_RE, _POLE_IM, _INTO, _AVERAGE, _HZ, _INSIDE = range(11)
# What is remembered: two running means; rows for which a line has stood out, rows seen; a
# line is on (0 or 1), rows since it stood out, its resonator. Behind them the gain of the means,
# and for how many rows a line has to stand.
_M_MEAN, _M_SLOW, _M_STOOD, _M_SEEN, _M_ON, _M_ABSENT, _M_PLACE, _M_DRIFT, _M_HOLD = range(9)


class LineSearch:
    """
    The strongest line that is not followed.

    That is one outside a range of frequencies, where it is the strongest of all, or one inside,
    where it is larger than what is followed there.

    Parameters
    ----------
    rate_hz : float
        Rate of the values, Hz.
    low_hz, high_hz : float
        The range, Hz, inside (0, rate/2).
    orders : sequence of float
        Known lines, in multiples of the frequency given with the values.

    Notes
    -----
    Values that are not finite are bridged by zero; blocks of any size give the same
    numbers, bit for bit.
    """

    def __init__(
        self, rate_hz: float, low_hz: float, high_hz: float, orders: Sequence[float] = (1.0, 2.0)
    ) -> None:
        top = min(_BEYOND * high_hz, 0.4 * rate_hz)
        count = max(3, math.ceil(math.log(top * _BEYOND / low_hz) / _STEP))
        hz = np.geomspace(low_hz / _BEYOND, top, count)
        turn = 2.0 * math.pi * hz / rate_hz
        width = np.exp(-0.5 * _BAND * turn)
        self._bank = np.zeros((count, _INSIDE + 1))
        self._bank[:, _POLE_RE], self._bank[:, _POLE_IM] = (
            width * np.cos(turn),
            width * np.sin(turn),
        )
        self._bank[:, _INTO], self._bank[:, _HZ] = 1.0 - width, hz
        self._bank[:, _AVERAGE] = 1.0 - np.exp(-turn / (2.0 * math.pi * _AVERAGED))
        self._bank[:, _INSIDE] = (hz > low_hz / _EDGE) & (hz < high_hz * _EDGE)
        self._memory = np.zeros(_M_HOLD + 1)
        self._memory[_M_MEAN] = math.nan
        slowest = 2.0 * math.pi * low_hz / (2.0 * _BEYOND) / rate_hz
        self._memory[_M_DRIFT] = 1.0 - math.exp(-slowest)
        self._memory[_M_HOLD] = round(_PERIODS * rate_hz / low_hz)
        #: Values after which a line that was there from the first one has been found.
        self.looks_for = math.ceil((_PERIODS + _AVERAGED * _BEYOND) * rate_hz / low_hz)
        self._rate = rate_hz
        self._orders = np.array(orders, dtype=np.float64)

    def update(
        self, values: ArrayLike, known_hz: ArrayLike = math.nan, followed: ArrayLike = math.nan
    ) -> _F:
        """
        Take the next values.

        Parameters
        ----------
        values : array_like, shape (n,)
            The signal, in any unit.
        known_hz : array_like, shape (n,) or ()
            What the orders are multiples of; a line there is passed over. NaN: none.
        followed : array_like, shape (n,) or ()
            Amplitude that is followed inside the range, in the unit of the values. NaN: all.

        Returns
        -------
        ndarray, shape (2, n)
            Frequency (Hz) and amplitude (in the unit of the values) of the strongest line
            where that is not followed; else NaN.
        """
        block = np.ascontiguousarray(values, dtype=np.float64)
        known = np.ascontiguousarray(np.broadcast_to(known_hz, block.shape), dtype=np.float64)
        amplitude = np.ascontiguousarray(np.broadcast_to(followed, block.shape), dtype=np.float64)
        found = np.full((3, block.size), math.nan)
        _search(block, known, amplitude, self._orders, self._bank, self._memory, found)
        place, turn, size = found
        line = np.full((2, block.size), math.nan)
        there = np.isfinite(place)
        if not there.any():
            return line
        line[0, there] = turn[there] * self._rate / (2.0 * math.pi)
        line[1, there] = 2.0 * size[there] / self._gain(place[there].astype(np.intp), turn[there])
        return line

    def _gain(self, place: NDArray[np.intp], turn: _F) -> _F:
        """Gain of resonators, and of what is before them, at a turning in rad per value."""
        re, im, into = self._bank[place, _POLE_RE : _INTO + 1].T
        back = np.exp(-1j * turn)
        resonator = into / (1.0 - (re + 1j * im) * back)
        keep = 1.0 - self._memory[_M_DRIFT]
        drift = keep * (1.0 - back) / (1.0 - keep * back)
        gain: _F = np.abs(resonator * drift * drift)
        return gain


@compiled
def _search(
    values: R1, known: R1, followed: R1, orders: R1, bank: F2, memory: F1, found: F2
) -> None:
    """Follow the power of each frequency; fill in the line that stands out, at each sample."""
    slow, hold, count = memory[_M_DRIFT], memory[_M_HOLD], bank.shape[0]
    frequencies = bank[:, _HZ].copy()
    power = np.zeros(count)
    for i in range(values.size):
        x = values[i]
        if not math.isfinite(x):
            x = 0.0
        else:  # its slow drift taken off twice
            if math.isnan(memory[_M_MEAN]):
                memory[_M_MEAN] = x
            memory[_M_MEAN] += slow * (x - memory[_M_MEAN])
            x -= memory[_M_MEAN]
            memory[_M_SLOW] += slow * (x - memory[_M_SLOW])
            x -= memory[_M_SLOW]
        memory[_M_SEEN] += 1.0
        best_in = 0.0
        for j in range(count):
            own = bank[j]
            re, im = own[_RE], own[_IM]
            own[_RE] = own[_POLE_RE] * re - own[_POLE_IM] * im + own[_INTO] * x
            own[_IM] = own[_POLE_IM] * re + own[_POLE_RE] * im
            square = own[_RE] ** 2 + own[_IM] ** 2
            own[_POWER] += own[_AVERAGE] * (square - own[_POWER])
            own[_COS] += own[_AVERAGE] * (own[_RE] * re + own[_IM] * im - own[_COS])
            own[_SIN] += own[_AVERAGE] * (own[_IM] * re - own[_RE] * im - own[_SIN])
            power[j] = square / frequencies[j]  # white noise: alike in all
            if own[_INSIDE] > 0.0:
                best_in = max(best_in, square)
        # Of a cosine a resonator has half the amplitude.
        tracked = math.inf if math.isnan(followed[i]) else 0.25 * followed[i] * followed[i]
        easier = _RELAXED if memory[_M_ON] > 0.0 else 1.0
        best, place = 0.0, -1
        for j in range(1, count - 1):  # at either end it is the flank of something further out
            square = power[j] * frequencies[j]
            if square <= best or square < _DRIVEN * bank[j, _POWER]:
                continue
            least = tracked if bank[j, _INSIDE] > 0.0 else best_in
            if square * easier**2 <= _STRONGER**2 * least:
                continue
            beside = max(bank[j - 1, _POWER], bank[j + 1, _POWER])
            if square < beside and bank[j, _POWER] < beside:
                continue
            forced = False
            for order in orders:
                forced |= abs(frequencies[j] - order * known[i]) < _KNOWN * order * known[i]
            if forced:
                continue
            best, place = square, j
        stands = place > 0
        if stands:
            below = 0  # a sort for the median would take half of the compilation
            for j in range(count):
                if power[place] * easier**2 > _CLEAR**2 * power[j]:
                    below += 1
            stands = below > count // 2
        if stands:
            memory[_M_STOOD] = min(memory[_M_STOOD] + 1.0, 1.5 * _BEYOND * hold)
            memory[_M_ABSENT] = 0.0
            memory[_M_PLACE] = place
        else:
            memory[_M_STOOD] = max(memory[_M_STOOD] - 2.0, 0.0)
            memory[_M_ABSENT] += 1.0
        # A slow line has to stand for as many of its own periods: a blow rings on for some.
        slowest = frequencies[0] * _BEYOND
        enough = hold * max(slowest / frequencies[int(memory[_M_PLACE])], 1.0)
        if memory[_M_STOOD] > enough and memory[_M_SEEN] > 2.0 * enough:
            memory[_M_ON] = 1.0
        elif memory[_M_ABSENT] > _GONE * hold:
            memory[_M_ON] = 0.0
        if memory[_M_ON] > 0.0:
            j = int(memory[_M_PLACE])
            found[0, i] = j
            found[1, i] = math.atan2(bank[j, _SIN], bank[j, _COS])
            found[2, i] = math.sqrt(bank[j, _POWER])
