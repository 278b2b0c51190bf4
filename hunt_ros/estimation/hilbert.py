"""
The Hilbert envelope: the second, independent estimate of the amplitude.

It knows no model: a linear-phase band-pass of complex taps turns the roughness-free
signal (`lateral_clean` of the tracker) into its analytic signal, the modulus of which
is the envelope, late by half the length of the filter.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import firwin

from hunt_ros.compiled import compiled
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
        Band, Hz: half power at its ends, zero at 0 Hz.
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
    Processing, sec. 7.5 (window method).
    """

    def __init__(
        self,
        rate_hz: float,
        low_hz: float = 1.0,
        high_hz: float = 6.0,
        length_s: float = 0.8,
        bridge_s: float = 0.05,
    ) -> None:
        if not 0.0 < low_hz < high_hz < 0.5 * rate_hz:
            raise ConfigError(
                f'envelope: the band {low_hz}..{high_hz} Hz must lie inside 0..{0.5 * rate_hz} Hz'
            )
        if not length_s * low_hz >= 0.5:
            raise ConfigError(
                f'envelope: length_s {length_s} s holds less than half a period of {low_hz} Hz'
            )
        self.rate_hz = rate_hz
        self._half = max(round(0.5 * length_s * rate_hz), 1)
        self._taps = _analytic_taps(2 * self._half + 1, rate_hz, low_hz, high_hz)
        self._longest = round(bridge_s * rate_hz)
        self.reset()

    def reset(self) -> None:
        """Forget everything seen."""
        self._ring = np.full(self._taps.shape[1], math.nan)
        # Place in the ring, values missing in a row, last value, its slope.
        self._memory = np.array([0.0, 0.0, math.nan, 0.0])

    @property
    def delay_s(self) -> float:
        """How late the envelope is, s: value k belongs to this long before value k."""
        return self._half / self.rate_hz

    @property
    def noise_gain(self) -> float:
        """Standard deviation of the envelope of a strong signal over that of white noise in it."""
        return math.sqrt(0.5 * float(np.sum(self._taps**2)))

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
        taps = self._taps[0] + 1j * self._taps[1]
        steps = np.arange(taps.size) - self._half
        gain: NDArray[np.float64] = (
            np.abs(np.sum(taps * np.exp(-1j * turn * steps), axis=-1)) / 2.0
        )
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
        block = np.ascontiguousarray(values, dtype=np.float64)
        envelope = np.empty(block.size)
        _filter_block(block, self._taps, self._ring, self._memory, self._longest, envelope)
        return envelope


def _analytic_taps(count: int, rate_hz: float, low_hz: float, high_hz: float) -> _F:
    """Real and imaginary taps, shape (2, count): one-sided band-pass, no gain at 0 Hz."""
    centre, width = 0.5 * (low_hz + high_hz), 0.5 * (high_hz - low_hz)
    window = firwin(count, width, fs=rate_hz, window=('kaiser', 3.0))
    steps = np.arange(count) - (count - 1) // 2
    taps = 2.0 * window * np.exp(2j * math.pi * centre / rate_hz * steps)
    # A bias must not show: take out what is left at 0 Hz with the window's own shape.
    shape = np.kaiser(count, 3.0)
    taps -= shape * (taps.sum() / shape.sum())
    middle = np.sum(taps * np.exp(-2j * math.pi * centre / rate_hz * steps)) / 2.0
    taps /= abs(middle)
    return np.ascontiguousarray(np.stack([taps.real, taps.imag]))


@compiled
def _filter_block(values: _F, taps: _F, ring: _F, memory: _F, longest: int, out: _F) -> None:
    size = ring.size
    place = int(memory[0])
    for i in range(values.size):
        value = values[i]
        if math.isfinite(value):
            missing = memory[1]
            slope = (value - memory[2]) / (missing + 1.0)
            memory[3] = slope if math.isfinite(slope) else 0.0
            memory[1], memory[2] = 0.0, value
        else:
            memory[1] += 1.0
            value = memory[2] + memory[1] * memory[3] if memory[1] <= longest else math.nan
        ring[place] = value
        place = place + 1 if place + 1 < size else 0
        re, im = 0.0, 0.0
        for j in range(size):  # ring[place] is the oldest value
            k = place + j
            old = ring[k if k < size else k - size]
            re += taps[0, size - 1 - j] * old
            im += taps[1, size - 1 - j] * old
        out[i] = math.sqrt(re * re + im * im)
    memory[0] = place
