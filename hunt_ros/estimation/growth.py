"""
Growth rate: its sign, and a second estimate of it from the envelope.

The first estimate is a state of the Kalman filter (`growth_rate` of the tracker). The
second is the slope of the logarithm of the Hilbert envelope over a sliding window.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.compiled import compiled
from hunt_ros.errors import ConfigError

_F = NDArray[np.float64]


def growth_sign(growth_rate: ArrayLike, std: ArrayLike, sigmas: float = 3.0) -> NDArray[np.int8]:
    """
    Sign of a growth rate where it is known, 0 where it is not.

    Parameters
    ----------
    growth_rate, std : array_like
        Growth rate and its standard deviation, 1/s, of one shape.
    sigmas : float
        How many standard deviations off zero are asked for.

    Returns
    -------
    ndarray of int8
        +1 grows, -1 decays, 0 not known (also where either is NaN).
    """
    rate, spread = np.asarray(growth_rate, np.float64), np.asarray(std, np.float64)
    with np.errstate(invalid='ignore'):
        sure = np.abs(rate) > sigmas * spread
        return np.where(sure, np.sign(rate), 0.0).astype(np.int8)


class EnvelopeGrowth:
    """
    Slope of ln(envelope) over a sliding window, by least squares.

    Parameters
    ----------
    rate_hz : float
        Rate of the envelope, Hz.
    window_s : float
        Length of the window, s.
    correlation_s : float
        Time over which successive envelope values share their error, s: about the
        length of the envelope's filter over two. The standard deviation is that of a
        fit to window_s / correlation_s independent values.

    Raises
    ------
    ConfigError
        If the window holds fewer than five values or three correlation times.

    Notes
    -----
    NaN until the window is full, and while it holds a value that is not positive and
    finite. Blocks of any size give the same numbers, bit for bit.

    References
    ----------
    Draper and Smith, Applied Regression Analysis, 1998, sec. 1.4.
    """

    def __init__(self, rate_hz: float, window_s: float = 2.0, correlation_s: float = 0.4) -> None:
        if not (rate_hz > 0.0 and window_s * rate_hz >= 5.0 and window_s >= 3.0 * correlation_s):
            raise ConfigError(
                f'growth: window_s {window_s} must hold five values at {rate_hz} Hz and three'
                f' times correlation_s {correlation_s}'
            )
        self.rate_hz = rate_hz
        self._count = round(window_s * rate_hz)
        self._independent = min(max(correlation_s * rate_hz, 1.0), self._count / 3.0)
        self.reset()

    def reset(self) -> None:
        """Forget everything seen."""
        self._ring = np.full(self._count, math.nan)
        self._place = np.zeros(1, dtype=np.int64)

    @property
    def delay_s(self) -> float:
        """How late the slope is, s: it belongs to the middle of the window."""
        return 0.5 * (self._count - 1) / self.rate_hz

    def update(self, envelope: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Take the next values of the envelope.

        Parameters
        ----------
        envelope : array_like, shape (n,)
            In any unit; not positive or not finite: missing.

        Returns
        -------
        growth_rate, std : ndarray, shape (n,)
            1/s; NaN where not known.
        """
        block = np.asarray(envelope, dtype=np.float64)
        with np.errstate(divide='ignore', invalid='ignore'):
            logs = np.where(block > 0.0, np.log(block), math.nan)
        slopes = np.empty((2, logs.size))
        _slide(np.ascontiguousarray(logs), self._ring, self._place, slopes)
        scale = math.sqrt(self._independent * self._count / max(self._count - 2.0, 1.0))
        return slopes[0] * self.rate_hz, slopes[1] * self.rate_hz * scale


@compiled
def _slide(logs: _F, ring: _F, place: NDArray[np.int64], out: _F) -> None:
    """Slope a value, and its standard error with independent errors, after each value."""
    count = ring.size
    middle = 0.5 * (count - 1.0)
    spread = count * (count * count - 1.0) / 12.0
    for i in range(logs.size):
        at = place[0]
        ring[at] = logs[i]
        place[0] = at = at + 1 if at + 1 < count else 0
        mean, slope = 0.0, 0.0
        for j in range(count):  # anew each time: running sums would drift
            k = at + j
            value = ring[k if k < count else k - count]
            mean += value
            slope += (j - middle) * value
        mean /= count
        slope /= spread
        rest = 0.0
        for j in range(count):
            k = at + j
            off = ring[k if k < count else k - count] - mean - slope * (j - middle)
            rest += off * off
        out[0, i] = slope
        out[1, i] = math.sqrt(rest / count / spread)
