"""
Where the strongest line is: the check that the motion is the one that is tracked.

Spectra of the last seconds over a range wider than the tracker's. The tracker cannot say this
itself: kept within its range, it follows a motion outside it by turning its phase, and a motion
inside it, far from where it began, it may take for a level that drifts, or for noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

_F = NDArray[np.float64]

#: A motion is what two windows in a row show, each of so many periods of the lowest frequency: a
#: blow, and what rings on after it, is in one of them. They move on by one of so many parts.
_PERIODS, _PARTS = 5.0, 5
#: Places of the spectrum in one of its own bins.
_FINER = 8
#: How far beyond the range lines are looked for, and how far the range itself is stretched.
_BEYOND, _EDGE = 3.0, 1.1
#: A line stands this many times above the noise about it (its median, from the first part of its
#: frequency to as many times that), and this many times above what is followed (outside the
#: range: above the strongest line inside).
_CLEAR, _AROUND, _STRONGER = 5.0, 3.0, 2.0
#: The side lobes of the window are smaller than this part of a line.
_LOBES = 0.03
#: It goes on while it is this many times lower.
_RELAXED = 1.5
#: Width of a line that is known not to be of interest, as a share of its frequency.
_KNOWN = 0.1


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

    Attributes
    ----------
    looks_for : int
        Values after which a line that was there from the first one has been found.

    Notes
    -----
    Values that are not finite are left out; blocks of any size give the same numbers, bit for bit.
    """

    def __init__(
        self, rate_hz: float, low_hz: float, high_hz: float, orders: Sequence[float] = (1.0, 2.0)
    ) -> None:
        self._every = math.ceil(_PERIODS / _PARTS * rate_hz / low_hz)
        size = _PARTS * self._every
        self._window = np.hanning(size + 2)[1:-1]
        self.looks_for = 2 * size + self._every
        hz = self._hz = np.fft.rfftfreq(_FINER * size, 1.0 / rate_hz)
        self._seen = (hz > low_hz / _BEYOND) & (hz < min(_BEYOND * high_hz, 0.4 * rate_hz))
        self._inside = (hz > low_hz / _EDGE) & (hz < high_hz * _EDGE)
        self._orders = orders
        #: Of as many values as both windows hold: value, known frequency, amplitude followed.
        self._last = np.full((3, 2 * size), math.nan)
        self._count = 0
        #: Of the windows up to one that begins where the first one ends; NaN: too few values.
        self._spectra = [np.full(hz.size, math.nan)] * (_PARTS + 1)
        self._line = np.full(2, math.nan)

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
        block = np.stack(np.broadcast_arrays(values, known_hz, followed))
        history = np.concatenate([self._last, block], axis=1)
        line = np.empty((2, block.shape[1]))
        line[:] = self._line[:, None]
        for place in range(-self._count % self._every, block.shape[1], self._every):
            self._line = self._look(history[:, place : place + self._last.shape[1]])
            line[:, place:] = self._line[:, None]
        self._count += block.shape[1]
        self._last = history[:, block.shape[1] :]
        return line

    def _spectrum(self, values: _F) -> _F:
        """Return the amplitudes in a window; NaN where it has too few values."""
        weight = self._window * np.isfinite(values)
        if weight.sum() < 0.5 * self._window.sum():
            return np.full(self._hz.size, math.nan)
        # Without its trend, by least squares.
        square = weight**2 / np.sum(weight**2)
        place = np.arange(values.size) - square @ np.arange(values.size)
        flat = np.nan_to_num(values)
        flat -= square @ flat
        flat -= (square @ (place * flat)) / (square @ place**2) * place
        size = np.abs(np.fft.rfft(weight * flat, _FINER * values.size))
        return np.asarray(2.0 * size / weight.sum())

    def _look(self, history: _F) -> _F:
        """Return frequency and amplitude of the strongest line in both windows; NaN: none."""
        hz = self._hz
        self._spectra = [*self._spectra[1:], self._spectrum(history[0, self._window.size :])]
        size = np.minimum(self._spectra[0], self._spectra[-1])
        tracked = history[2].reshape(2, -1).mean(axis=1).max()  # NaN: nothing is larger
        easier = 1.0 if math.isnan(self._line[0]) else _RELAXED
        peak = np.zeros(hz.size, dtype=np.bool_)
        peak[1:-1] = (size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])
        inside = size[peak & self._inside].max(initial=0.0)
        good = peak & self._seen & (size > _LOBES * size.max())
        good &= easier * size > _STRONGER * np.where(self._inside, tracked, inside)
        slowest = np.fmin.reduce(history[1], initial=math.inf)
        fastest = np.fmax.reduce(history[1], initial=0.0)
        for order in self._orders:
            slow, fast = (1.0 - _KNOWN) * order * slowest, (1.0 + _KNOWN) * order * fastest
            good &= ~((hz > slow) & (hz < fast))
        # As of its differences: the noise of a level that drifts is flat then.
        steep = size * hz
        for place in sorted(np.flatnonzero(good).tolist(), key=lambda k: -size[k]):
            around = (hz * _AROUND > hz[place]) & (hz < _AROUND * hz[place])
            if easier * steep[place] > _CLEAR * np.median(steep[around]):
                return np.array([hz[place], self._spectra[-1][place]])
        return np.full(2, math.nan)
