"""
Where the strongest line is: the check that the motion lies in the range that is tracked.

A bank of resonators over a range wider than the tracker's. The tracker cannot say this
itself: kept within its range, it follows a motion outside it by turning its phase.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.compiled import compiled
from hunt_ros.errors import ConfigError

_F = NDArray[np.float64]

#: Distance of the resonators, and their bandwidth, as shares of the frequency.
_STEP, _BAND = 0.12, 0.12
#: How far beyond the range lines are looked for, and how far the range itself is stretched.
_BEYOND, _EDGE = 3.0, 1.1
#: A line stands this many times above the noise in the bank (its median), and this many times
#: above the strongest one inside the range, for this many periods of the lowest frequency.
_CLEAR, _STRONGER, _PERIODS = 5.0, 2.0, 3.0


class LineSearch:
    """
    The strongest line outside a range of frequencies, where it is the strongest of all.

    Parameters
    ----------
    rate_hz : float
        Rate of the values, Hz.
    low_hz, high_hz : float
        The range, Hz.

    Raises
    ------
    ConfigError
        If the range is not inside (0, rate/2).

    Notes
    -----
    Values that are not finite are bridged by zero; blocks of any size give the same
    numbers, bit for bit.
    """

    def __init__(self, rate_hz: float, low_hz: float, high_hz: float) -> None:
        if not 0.0 < low_hz < high_hz < 0.5 * rate_hz:
            raise ConfigError(
                f'line search: {low_hz}..{high_hz} Hz must lie inside 0..{0.5 * rate_hz} Hz'
            )
        top = min(_BEYOND * high_hz, 0.4 * rate_hz)
        count = max(3, math.ceil(math.log(top * _BEYOND / low_hz) / _STEP))
        self.frequencies: _F = np.geomspace(low_hz / _BEYOND, top, count)
        turn = 2.0 * math.pi * self.frequencies / rate_hz
        width = np.exp(-0.5 * _BAND * turn)
        self._poles = np.stack([width * np.cos(turn), width * np.sin(turn), 1.0 - width], axis=1)
        inside = (self.frequencies > low_hz / _EDGE) & (self.frequencies < high_hz * _EDGE)
        self._inside = inside.astype(np.bool_)
        self._slow = 1.0 - math.exp(-2.0 * math.pi * low_hz / (2.0 * _BEYOND) / rate_hz)
        self._hold = float(round(_PERIODS * rate_hz / low_hz))
        self.reset()

    def reset(self) -> None:
        """Forget everything seen."""
        self._bank = np.zeros((self.frequencies.size, 2))
        # Two running means, rows for which a line has stood out, rows seen.
        self._memory = np.array([math.nan, 0.0, 0.0, 0.0])

    def update(self, values: ArrayLike) -> _F:
        """
        Take the next values.

        Parameters
        ----------
        values : array_like, shape (n,)
            The signal, in any unit.

        Returns
        -------
        ndarray, shape (n,)
            Frequency of the strongest line, Hz, where that lies outside the range; else NaN.
        """
        block = np.ascontiguousarray(values, dtype=np.float64)
        found = np.full(block.size, math.nan)
        _search(
            block,
            self._bank,
            self._memory,
            self._poles,
            self.frequencies,
            self._inside,
            self._slow,
            self._hold,
            found,
        )
        return found


@compiled
def _search(
    values: _F,
    bank: _F,
    memory: _F,
    poles: _F,
    frequencies: _F,
    inside: NDArray[np.bool_],
    slow: float,
    hold: float,
    found: _F,
) -> None:
    power = np.zeros(frequencies.size)
    for i in range(values.size):
        x = values[i]
        if not math.isfinite(x):
            x = 0.0
        else:  # its slow drift taken off twice
            if math.isnan(memory[0]):
                memory[0] = x
            memory[0] += slow * (x - memory[0])
            x -= memory[0]
            memory[1] += slow * (x - memory[1])
            x -= memory[1]
        memory[3] += 1.0
        best_in, best_out, place = 0.0, 0.0, 0
        for j in range(frequencies.size):
            re, im = bank[j, 0], bank[j, 1]
            bank[j, 0] = poles[j, 0] * re - poles[j, 1] * im + poles[j, 2] * x
            bank[j, 1] = poles[j, 1] * re + poles[j, 0] * im
            square = bank[j, 0] ** 2 + bank[j, 1] ** 2
            power[j] = square / frequencies[j]  # white noise: alike in all
            if inside[j]:
                best_in = max(best_in, square)
            elif square > best_out:
                best_out, place = square, j
        stands = best_out > _STRONGER**2 * best_in
        if stands:
            middle = np.sort(power)[frequencies.size // 2]
            stands = power[place] > _CLEAR**2 * middle
        memory[2] = memory[2] + 1.0 if stands else max(memory[2] - 2.0, 0.0)
        memory[2] = min(memory[2], 1.5 * hold)
        if memory[2] > hold and memory[3] > 2.0 * hold and stands:
            found[i] = frequencies[place]
