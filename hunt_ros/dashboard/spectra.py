"""
The spectrum of the last seconds with its lines named, and the waterfall over the run.

It is computed once for all viewers. The known lines are those of the roller and of the wheel
(parameter `lines`, in turns of the roller); the hunting line is where the detector sees it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dashboard.traces import short
from hunt_ros.dashboard.view import Row, Rows
from hunt_ros.samples import NANOSECONDS

#: A spectrum needs so much of the signal, and takes no more, s.
_LEAST_S, _MOST_S = 5.0, 10.0
#: Spacing of the frequencies of the waterfall, Hz.
_STEP_HZ = 0.2
#: Rows of the waterfall; when it is full, two become one.
_ROWS = 240


def spectrum(
    stamps_ns: NDArray[np.int64], values: NDArray[np.float64], highest_hz: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """
    Amplitude spectrum of the last seconds: of a sinusoid the peak is its amplitude.

    Parameters
    ----------
    stamps_ns, values : ndarray, shape (n,)
        The signal; samples may be missing, the rest is put on an even grid.
    highest_hz : float
        Frequencies above it are left out.

    Returns
    -------
    frequency_hz, amplitude : ndarray
        Hz and the unit of the signal; None where there is too little signal.

    References
    ----------
    Harris 1978, Proc. IEEE 66, 51-83: Hann window, scaled by its coherent gain.
    """
    if stamps_ns.size < 64:
        return None
    recent = stamps_ns >= stamps_ns[-1] - round(_MOST_S * NANOSECONDS)
    stamps_ns, values = stamps_ns[recent], values[recent]
    seconds = (stamps_ns - stamps_ns[0]) / NANOSECONDS
    step = float(np.median(np.diff(seconds))) if seconds.size > 1 else 0.0
    if step <= 0.0 or seconds[-1] < _LEAST_S:
        return None
    grid = np.arange(0.0, seconds[-1], step)
    even = np.interp(grid, seconds, values)
    window = np.hanning(even.size)
    amplitude = np.abs(np.fft.rfft(window * (even - even.mean()))) * 2.0 / window.sum()
    frequency = np.fft.rfftfreq(even.size, step).astype(np.float64)
    shown = (frequency > 0.0) & (frequency <= highest_hz)
    return frequency[shown], amplitude[shown]


def named_lines(
    speed_mps: float,
    hunting_hz: float,
    orders: Sequence[float],
    roller_diameter_m: float,
    wheel_diameter_m: float,
) -> list[tuple[str, float]]:
    """
    Return names and frequencies (Hz) of the lines that are to be expected.

    Parameters
    ----------
    speed_mps, hunting_hz : float
        NaN: not known, its lines are left out.
    orders : sequence of float
        Known lines, in turns of the roller; 0 is none.
    roller_diameter_m, wheel_diameter_m : float
        0: no wheel.

    References
    ----------
    The paper, Eq. (1): f = v / (pi D).
    """
    lines = [('hunting', hunting_hz)] if math.isfinite(hunting_hz) and hunting_hz > 0.0 else []
    if math.isfinite(speed_mps) and speed_mps > 0.0:
        turn_hz = speed_mps / (math.pi * roller_diameter_m)
        lines += [
            ('roller' if order == 1.0 else f'{order:g} x roller', order * turn_hz)
            for order in orders
            if order > 0.0
        ]
        if wheel_diameter_m > 0.0:
            lines.append(('wheel', speed_mps / (math.pi * wheel_diameter_m)))
    return lines


class Waterfall:
    """
    Spectra over the whole run: always at most `_ROWS` rows, each the greatest of its time.

    Parameters
    ----------
    highest_hz : float
        Highest frequency.
    """

    def __init__(self, highest_hz: float) -> None:
        self.rows = Rows(_ROWS)
        self._edges = np.arange(0.0, highest_hz + _STEP_HZ, _STEP_HZ)
        self._each = 1  # spectra a row
        self._waiting: list[NDArray[np.float64]] = []

    @property
    def highest_hz(self) -> float:
        """Upper end of the frequencies of a row, Hz; the lower end is 0."""
        return float(self._edges[-1])

    def clear(self) -> None:
        """Forget everything: a clock was set back."""
        self.rows.replace(())
        self._each, self._waiting = 1, []

    def append(
        self, second: float, frequency_hz: NDArray[np.float64], amplitude: NDArray[np.float64]
    ) -> None:
        """
        Add a spectrum.

        Parameters
        ----------
        second : float
            Its time, s.
        frequency_hz, amplitude : ndarray
            As `spectrum` gives them.
        """
        place = np.clip(np.digitize(frequency_hz, self._edges) - 1, 0, self._edges.size - 2)
        cells = np.zeros(self._edges.size - 1)
        np.maximum.at(cells, place, amplitude)
        self._waiting.append(cells)
        if len(self._waiting) < self._each:
            return
        cells = np.max(self._waiting, axis=0)
        self._waiting = []
        if len(self.rows) == _ROWS:
            self._halve()
        self.rows.append([(round(second, 2), *_decibels(cells))])

    def _halve(self) -> None:
        """Make one row of two."""
        old: list[Row] = list(self.rows)
        pairs = zip(old[0::2], old[1::2], strict=True)
        self.rows.replace([(b[0], *map(max, a[1:], b[1:])) for a, b in pairs])
        self._each *= 2


def _decibels(amplitude: NDArray[np.float64]) -> list[int]:
    """Return amplitudes in dB over 1 um (1 urad): whole numbers are enough for a colour."""
    return np.rint(20.0 * np.log10(np.maximum(amplitude, 1e-9) / 1e-6)).astype(int).tolist()  # type: ignore[no-any-return]


def section(
    frequency_hz: NDArray[np.float64],
    amplitude: NDArray[np.float64],
    lines: Sequence[tuple[str, float]],
    channel: str,
) -> Mapping[str, Any]:
    """Return the spectrum as the page gets it: amplitudes in mm or mrad."""
    return {
        'channel': channel,
        'frequency_hz': [round(float(value), 3) for value in frequency_hz],
        'amplitude': [short(1e3 * float(value)) for value in amplitude],
        'lines': [{'name': name, 'hz': round(hertz, 3)} for name, hertz in lines],
    }
