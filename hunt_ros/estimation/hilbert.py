"""
The Hilbert envelope: the second, independent estimate of the amplitude.

It knows no model: a linear-phase band-pass of complex taps turns the roughness-free
signal (`lateral_clean` of the tracker) into its analytic signal, the modulus of which
is the envelope, late by half the length of the filter.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.errors import ConfigError

_F = NDArray[np.float64]


class HilbertEnvelope:
    """
    Streaming envelope of a signal within a band.

    Parameters
    ----------
    rate_hz : float
        Rate of the values, Hz.
    low_hz, high_hz : float
        Band, Hz: gain 1 within it, 0 at 0 Hz.
    length_s : float
        Length of the filter, s; the envelope is half of this late.
    bridge_s : float
        A gap of values that are not finite is bridged by a straight line for this long,
        s; beyond it the envelope is NaN until the gap has left the filter.

    Raises
    ------
    ConfigError
        If the band is not inside (0, rate/2) or the filter is too short for it.

    Notes
    -----
    The first `length_s` give NaN. Blocks of any size give the same numbers, bit for bit.

    References
    ----------
    Gabor, J. IEE 93, 1946 (analytic signal). Oppenheim and Schafer, Discrete-Time Signal
    Processing, sec. 7.9 (least squares), 12.4 (analytic signal).
    """

    def __init__(
        self,
        rate_hz: float,
        low_hz: float = 1.4,
        high_hz: float = 5.0,
        length_s: float = 0.8,
        bridge_s: float = 0.05,
    ) -> None:
        if not 0.0 < low_hz < high_hz < 0.5 * rate_hz:
            raise ConfigError(
                f'envelope: the band {low_hz}..{high_hz} Hz must lie inside 0..{0.5 * rate_hz} Hz'
            )
        if not length_s * low_hz >= 1.0:
            raise ConfigError(
                f'envelope: length_s {length_s} s holds less than a period of {low_hz} Hz'
            )
        self.rate_hz = rate_hz
        self._half = max(round(0.5 * length_s * rate_hz), 1)
        self._taps = _analytic_taps(2 * self._half + 1, rate_hz, low_hz, high_hz)
        self._longest = round(bridge_s * rate_hz)
        self.reset()

    def reset(self) -> None:
        """Forget everything seen."""
        self._before = np.full(self._taps.size - 1, math.nan)  # the last values, gaps bridged
        self._missing, self._last, self._slope = 0, math.nan, 0.0

    @property
    def delay_s(self) -> float:
        """How late the envelope is, s: value k belongs to this long before value k."""
        return self._half / self.rate_hz

    @property
    def noise_gain(self) -> float:
        """Standard deviation of the envelope of a strong signal over that of white noise in it."""
        return math.sqrt(0.5 * float(np.sum(np.abs(self._taps) ** 2)))

    def gain(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """
        Gain of the envelope at a frequency.

        Parameters
        ----------
        frequency_hz : array_like, any shape
            Hz.

        Returns
        -------
        ndarray
            1 in the band.
        """
        turn = 2.0 * math.pi * np.asarray(frequency_hz, dtype=np.float64)[..., None] / self.rate_hz
        steps = np.arange(self._taps.size) - self._half
        gain: _F = np.abs(np.sum(self._taps * np.exp(-1j * turn * steps), axis=-1)) / 2.0
        return gain

    def update(self, values: ArrayLike) -> NDArray[np.float64]:
        """
        Take the next values and return the envelope.

        Parameters
        ----------
        values : array_like, shape (n,)
            At `rate_hz`, in any unit; not finite: missing.

        Returns
        -------
        ndarray, shape (n,)
            Envelope `delay_s` before each value, in the unit of the values; NaN where
            the filter is not full or spans a gap too long to bridge.
        """
        block = np.asarray(values, dtype=np.float64)
        if not block.size:
            return block
        filled = self._bridged(block)
        signal = np.concatenate([self._before, filled])
        self._before = signal[filled.size :]
        envelope: _F = np.abs(np.convolve(signal, self._taps, 'valid'))
        return envelope

    def _bridged(self, values: _F) -> _F:
        """Go on along the slope where values are missing; NaN in longer gaps."""
        told = np.flatnonzero(np.isfinite(values))
        place = np.concatenate([[-1 - self._missing], told])
        level = np.concatenate([[self._last], values[told]])
        slope = np.concatenate([[self._slope], np.diff(level) / np.diff(place)])
        slope[~np.isfinite(slope)] = 0.0
        newest = np.cumsum(np.isfinite(values))
        missing = np.arange(values.size) - place[newest]
        filled = np.where(
            missing <= self._longest, level[newest] + missing * slope[newest], math.nan
        )
        self._missing, self._last, self._slope = int(missing[-1]), level[-1], slope[-1]
        return filled


@cache  # every detector has two of the same
def _analytic_taps(
    count: int, rate_hz: float, low_hz: float, high_hz: float
) -> NDArray[np.complex128]:
    """
    Taps, shape (count,), of the best one-sided band-pass.

    Weighted least squares for gain 1 in the band and 0 at negative frequencies, at 0 Hz and
    above the band, with a transition as wide as the length of the filter allows.
    """
    half = (count - 1) // 2
    width = 1.5 * rate_hz / count
    grid = np.linspace(-0.5 * rate_hz, 0.5 * rate_hz, 40 * half + 1)
    passed = (grid >= low_hz) & (grid <= high_hz)
    stopped = (grid <= 0.0) | (grid >= high_hz + width)
    used = passed | stopped
    # The image of a sine in the band beats with it, and a bias is large: weigh both.
    image = (grid <= -low_hz) & (grid >= -high_hz)
    weights = np.where(passed, 3.0, np.where(image, 10.0, 1.0))
    weights[np.argmin(np.abs(grid))] = 1e4
    # Taps h(-n) = conj h(n) make the gain real: c + 2 sum a cos + b sin.
    turn = 2.0 * math.pi / rate_hz * np.outer(grid[used], np.arange(1, half + 1))
    design = np.hstack([np.ones((turn.shape[0], 1)), 2.0 * np.cos(turn), 2.0 * np.sin(turn)])
    weight = weights[used]
    found: _F = np.linalg.lstsq(design * weight[:, None], passed[used] * weight, rcond=1e-9)[0]
    side = np.asarray(found[1 : half + 1] + 1j * found[half + 1 :], dtype=np.complex128)
    taps = np.concatenate([np.conj(side[::-1]), [complex(found[0])], side])
    return np.asarray(2.0 * taps, dtype=np.complex128)
