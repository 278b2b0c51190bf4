"""One speed level reduced to its periodogram, without the known lines, Eq. (1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.tracker_config import Shaft
from hunt_ros.estimation.turning import SPEED_STD

#: Columns of a cell: count, sums of y, v and the roller's angle, then sums of cos and sin of each
#: line that turns with that angle.
COLUMNS = 4

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
        Windows averaged in each bin; 0 where a known line lies.
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


def fitted_orders(shafts: Sequence[Shaft]) -> NDArray[np.float64]:
    """Return the lines that turn with the roller's angle, in its turns: their phase is known."""
    orders = [order for shaft in shafts if shaft.slip_std == 0.0 for order in shaft.orders]
    return np.array(orders, dtype=np.float64)


def level_spectrum(
    cells: NDArray[np.float64],
    cell_s: float,
    band_hz: tuple[float, float],
    roller_diameter_m: float,
    shafts: Sequence[Shaft],
) -> SpeedLevel:
    """
    Periodogram of a stretch of cells, without trend and known lines.

    The lines that turn with the roller are fitted by their phase, which the encoder gives.
    The others, and without a roller angle all, are fitted where they are strongest within their
    slip, and the bins where they may be are left out.

    Parameters
    ----------
    cells : ndarray, shape (n, COLUMNS + 2 * orders)
        Sums over each cell; a cell without samples is interpolated.
    cell_s : float
        Length of a cell, s.
    band_hz : (float, float)
        Band kept, Hz.
    roller_diameter_m : float
        D of Eq. (1), m: how fast the roller turns where its angle is not known.
    shafts : sequence of Shaft
        What turns, with its lines in turns of the roller.
    """
    held = cells[:, 0] > 0.0
    place = np.arange(cells.shape[0], dtype=np.float64)
    mean = cells[held] / cells[held, :1]
    columns = np.stack(
        [np.interp(place, place[held], mean[:, k]) for k in range(1, cells.shape[1])], axis=1
    )
    y, speed = columns[:, 0], float(columns[:, 1].mean())
    angle, lines = columns[:, 2], columns[:, 3:]
    stuck = float(np.ptp(y)) <= STUCK * float(np.abs(y).max())
    known = bool(np.isfinite(angle).all())
    if not known:
        turning = columns[:, 1] * 2.0 / roller_diameter_m
        angle, lines = np.cumsum(turning) * cell_s, lines[:, :0]
    trend = np.stack([np.ones_like(place), place / place.size], axis=1)
    regressors = np.concatenate([trend, lines], axis=1)
    y = y - regressors @ np.linalg.lstsq(regressors, y, rcond=None)[0]
    duration = y.size * cell_s
    frequency = np.arange(y.size // 2 + 1) / duration
    weight = np.ones_like(frequency)
    roller = abs(float(np.polyfit(place * cell_s, angle, 1)[0])) / (2.0 * math.pi)
    for shaft in shafts:
        slip = shaft.slip_std if known else max(shaft.slip_std, SPEED_STD)
        for order in shaft.orders:
            # A fitted line takes its own bins with it; another is as wide as it may slip.
            line = order * roller
            width = max(3.0 / duration, 2.0 * slip * line) if slip > 0.0 else 1.5 / duration
            weight[np.abs(frequency - line) <= width] = 0.0
            if slip > 0.0:
                y = y - _strongest(y, order * angle, 2.0 * slip)
    power = np.asarray(np.abs(np.fft.rfft(y)) ** 2 * cell_s / y.size, dtype=np.float64)
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


def _strongest(
    y: NDArray[np.float64], phase: NDArray[np.float64], slip: float
) -> NDArray[np.float64]:
    """Return the line of this phase, rad, at the slip at which most of it is in y."""
    step = 0.25 * 2.0 * math.pi / max(float(np.ptp(phase)), 1.0)
    scales = 1.0 + np.arange(-slip, slip + step, step)
    place = int(np.argmax([abs(np.exp(-1j * scale * phase) @ y) for scale in scales]))
    basis = np.stack([np.cos(scales[place] * phase), np.sin(scales[place] * phase)], axis=1)
    line: NDArray[np.float64] = basis @ np.linalg.lstsq(basis, y, rcond=None)[0]
    return line
