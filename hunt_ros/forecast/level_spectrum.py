"""One speed level reduced to its periodogram, without the roughness lines of Eq. (1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Harmonics of the roller's frequency that are fitted and removed.
HARMONICS = 3

#: Columns of a cell: count, sum of y, sum of v, then sums of cos and sin of each harmonic.
COLUMNS = 3 + 2 * HARMONICS

#: A signal that varies by less than this part of itself varies by rounding only.
STUCK = 1e-9


@dataclass(frozen=True, eq=False)
class SpeedLevel:
    """
    Periodogram of the quiet response at one speed.

    Parameters
    ----------
    speed : float
        Mean running speed, m/s.
    duration_s : float
        T, length of the window, s.
    omega : ndarray, shape (k,)
        Fourier frequencies, rad/s.
    periodogram : ndarray, shape (k,)
        |integral of y exp(-i omega t) dt|^2 / T, m^2 s (two-sided).
    weight : ndarray, shape (k,)
        Windows averaged in each bin; 0 where a roughness line lies.
    gain : ndarray, shape (k,)
        Power response of the averaging into cells.
    floor : float
        White level above the band, m^2 s; 0 for a sensor that is stuck.
    rms : float
        Of the response in the band, m.
    """

    speed: float
    duration_s: float
    omega: NDArray[np.float64]
    periodogram: NDArray[np.float64]
    weight: NDArray[np.float64]
    gain: NDArray[np.float64]
    floor: float
    rms: float

    def merged(self, other: SpeedLevel) -> SpeedLevel:
        """Return the average with a level of the same length at (nearly) the same speed."""
        weight = self.weight + other.weight
        total = self.periodogram * self.weight + other.periodogram * other.weight
        share = float(other.weight.max() / max(weight.max(), 1.0))
        return SpeedLevel(
            self.speed + share * (other.speed - self.speed),
            self.duration_s,
            self.omega,
            np.divide(total, weight, out=self.periodogram.copy(), where=weight > 0.0),
            weight,
            self.gain,
            self.floor + share * (other.floor - self.floor),
            math.sqrt(self.rms**2 + share * (other.rms**2 - self.rms**2)),
        )


def level_spectrum(
    cells: NDArray[np.float64],
    cell_s: float,
    band_hz: tuple[float, float],
    roller_diameter_m: float,
) -> SpeedLevel:
    """
    Periodogram of a stretch of cells, without trend and roughness lines.

    The lines are fitted by their phase, which the encoder gives; without a roller angle
    only the bins where the speed says they are can be left out.

    Parameters
    ----------
    cells : ndarray, shape (n, COLUMNS)
        Sums over each cell; a cell without samples is interpolated.
    cell_s : float
        Length of a cell, s.
    band_hz : (float, float)
        Band kept, Hz.
    roller_diameter_m : float
        D of Eq. (1), m.
    """
    held = cells[:, 0] > 0.0
    place = np.arange(cells.shape[0], dtype=np.float64)
    mean = cells[held] / cells[held, :1]
    columns = np.stack(
        [np.interp(place, place[held], mean[:, k]) for k in range(1, COLUMNS)], axis=1
    )
    y, speed, lines = columns[:, 0], float(columns[:, 1].mean()), columns[:, 2:]
    stuck = float(np.ptp(y)) <= STUCK * float(np.abs(y).max())
    trend = np.stack([np.ones_like(place), place / place.size], axis=1)
    known = bool(np.isfinite(lines).all())
    regressors = np.concatenate([trend, lines], axis=1) if known else trend
    y = y - regressors @ np.linalg.lstsq(regressors, y, rcond=None)[0]
    duration = y.size * cell_s
    frequency = np.arange(y.size // 2 + 1) / duration
    power = np.asarray(np.abs(np.fft.rfft(y)) ** 2 * cell_s / y.size, dtype=np.float64)
    weight = np.ones_like(frequency)
    for harmonic in range(1, HARMONICS + 1):
        line = harmonic * speed / (math.pi * roller_diameter_m)
        # A fitted line takes its own bins with it; one that is only known from the
        # speed is as wide as the speed is uncertain.
        width = 1.5 / duration if known else max(3.0 / duration, 0.02 * line)
        weight[np.abs(frequency - line) <= width] = 0.0
    above = (frequency > 1.5 * band_hz[1]) & (frequency < 2.7 * band_hz[1])
    inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    return SpeedLevel(
        speed=speed,
        duration_s=duration,
        omega=2.0 * np.pi * frequency[inside],
        periodogram=power[inside],
        weight=weight[inside],
        gain=np.sinc(frequency[inside] * cell_s) ** 2,
        # The median of exponentially distributed bins is ln 2 times their mean.
        floor=0.0 if stuck else float(np.median(power[above & (weight > 0.0)])) / math.log(2.0),
        rms=math.sqrt(2.0 / duration * float((power * weight)[inside].sum())),
    )
