"""
From displacement samples to band-passed lateral acceleration, on a uniform grid.

The railway criteria are written for an accelerometer sampled at a fixed rate. A
rig measures displacement, with stamps that jitter and samples that are missing;
this module bridges the two, and every criterion starts from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.compiled import compiled
from hunt_ros.errors import ConfigError
from hunt_ros.samples import CLOCK_RESET_NS, NANOSECONDS


@compiled
def _resample(
    stamps: NDArray[np.int64],
    values: NDArray[np.float64],
    speeds: NDArray[np.float64],
    reset_ns: int,
    clock: NDArray[np.int64],
    last: NDArray[np.float64],
    grid: NDArray[np.int64],
    resampled: NDArray[np.float64],
    restarts: NDArray[np.bool_],
) -> tuple[int, int]:
    """
    Interpolate samples linearly onto the grid, as far as the output has room.

    clock = [last stamp, next grid stamp, step, longest gap, dropped, missing, running],
    ns and counts; last = [last value, last speed]. resampled has a row for y and one for
    v. All are changed in place. Returns the samples used and the grid points filled.
    """
    filled = 0
    most = clock[3] // clock[2] + 2  # grid points one sample can complete
    for k in range(stamps.size):
        if filled + most > grid.size:
            return k, filled
        stamp = stamps[k]
        if np.isfinite(speeds[k]):
            last[1] = speeds[k]
        back = clock[0] - stamp
        if clock[6] and 0 <= back <= reset_ns:
            clock[4] += 1
            continue
        if not np.isfinite(values[k]):
            clock[5] += 1
            continue
        fresh = clock[6] == 0 or back > 0 or -back > clock[3]
        clock[6] = 1
        if fresh:
            clock[1] = stamp
            clock[0] = stamp - 1
            last[0] = values[k]
        while clock[1] <= stamp:
            part = (clock[1] - clock[0]) / (stamp - clock[0])
            grid[filled] = clock[1]
            resampled[0, filled] = last[0] + part * (values[k] - last[0])
            resampled[1, filled] = last[1]
            restarts[filled] = fresh
            fresh = False
            filled += 1
            clock[1] += clock[2]
        clock[0] = stamp
        last[0] = values[k]
    return stamps.size, filled


class LateralAcceleration:
    """
    Lateral acceleration in a pass band, derived from displacement, as a stream.

    Samples are interpolated linearly onto a grid of step 1/rate, differenced twice,
    and passed through a Butterworth band-pass of order four a side (24 dB an octave,
    as the standards ask for at least). A gap longer than `longest_gap_s` restarts the
    filter. A non-finite sample counts as missing (`missing`), a stamp that does not
    advance is dropped and counted (`dropped`), and a stamp more than a second back is
    taken for a clock that was set: the filter restarts there.

    Parameters
    ----------
    rate_hz : float
        Grid rate, Hz; best the sensor's own.
    low_hz, high_hz : float
        Pass band (-3 dB), Hz.
    longest_gap_s : float
        Longest silence that is bridged by interpolation, s.

    Raises
    ------
    ConfigError
        For a band that does not lie between zero and half the rate.
    """

    def __init__(
        self, rate_hz: float, low_hz: float, high_hz: float, longest_gap_s: float = 0.05
    ) -> None:
        if not 0.0 < low_hz < high_hz < 0.5 * rate_hz:
            raise ConfigError(
                f'pass band {low_hz:g} to {high_hz:g} Hz: expected 0 < low < high < half the'
                f' rate of {rate_hz:g} Hz'
            )
        from scipy import signal  # here: it takes long, and few runs have a criterion

        self.rate_hz = rate_hz
        self._sections = signal.butter(
            4, [low_hz, high_hz], btype='bandpass', fs=rate_hz, output='sos'
        )
        self._sosfilt = signal.sosfilt
        self._step = round(NANOSECONDS / rate_hz)
        self._gap = max(round(longest_gap_s * NANOSECONDS), 2 * self._step)
        self.reset()

    def reset(self) -> None:
        """Forget every sample."""
        self._clock = np.array([0, 0, self._step, self._gap, 0, 0, 0], dtype=np.int64)
        self._last = np.array([0.0, np.nan])
        self._restart_filter()

    def _restart_filter(self) -> None:
        self._memory = np.zeros((self._sections.shape[0], 2))
        self._before = np.zeros(0)  # the last two grid values of y

    @property
    def dropped(self) -> int:
        """Samples dropped because their stamp did not advance."""
        return int(self._clock[4])

    @property
    def missing(self) -> int:
        """Samples that were not finite."""
        return int(self._clock[5])

    def update(
        self, stamps_ns: ArrayLike, lateral: ArrayLike, speed: ArrayLike = np.nan
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """
        Take samples; give the acceleration at the grid points they complete.

        Parameters
        ----------
        stamps_ns : array_like of int64, shape (n,)
            Header stamps.
        lateral : array_like, shape (n,)
            Displacement y, m.
        speed : array_like, shape (n,) or scalar
            Running speed, m/s; NaN keeps the last one known.

        Returns
        -------
        stamps_ns : ndarray of int64, shape (m,)
        acceleration : ndarray, shape (m,)
            m/s^2.
        speed : ndarray, shape (m,)
            m/s; NaN while none is known.
        restarted : ndarray of bool, shape (m,)
            True at the first grid point after a gap (and at the very first).
        """
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        values = np.atleast_1d(np.asarray(lateral, dtype=np.float64))
        speeds = np.ascontiguousarray(
            np.broadcast_to(np.asarray(speed, dtype=np.float64), stamps.shape)
        )
        parts = []
        used = 0
        while used < stamps.size:
            room = stamps.size - used + self._gap // self._step + 2
            grid = np.empty(room, dtype=np.int64)
            resampled = np.empty((2, room))
            restarts = np.zeros(room, dtype=np.bool_)
            taken, filled = _resample(
                stamps[used:],
                values[used:],
                speeds[used:],
                CLOCK_RESET_NS,
                self._clock,
                self._last,
                grid,
                resampled,
                restarts,
            )
            used += taken
            parts.append((grid[:filled], resampled[:, :filled], restarts[:filled]))
        if not parts:
            empty = np.zeros(0)
            return empty.astype(np.int64), empty, empty, empty.astype(np.bool_)
        grid = np.concatenate([part[0] for part in parts])
        resampled = np.concatenate([part[1] for part in parts], axis=1)
        restarts = np.concatenate([part[2] for part in parts])
        acceleration = np.empty(grid.size)
        for begin, end in runs(restarts):
            acceleration[begin:end] = self._filter(resampled[0, begin:end], restarts[begin])
        return grid, acceleration, resampled[1], restarts

    def _filter(self, lateral: NDArray[np.float64], fresh: bool) -> NDArray[np.float64]:
        """Difference twice and band-pass a run without gap."""
        if fresh:
            self._restart_filter()
            self._before = np.full(2, lateral[0])
        joined = np.concatenate([self._before, lateral])
        self._before = joined[-2:].copy()
        second = (joined[2:] - 2.0 * joined[1:-1] + joined[:-2]) * self.rate_hz**2
        filtered, self._memory = self._sosfilt(self._sections, second, zi=self._memory)
        return np.asarray(filtered, dtype=np.float64)


def runs(restarts: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Give begin and end of each stretch of grid points without a restart inside."""
    edges = [0, *np.flatnonzero(restarts).tolist(), restarts.size]
    return ((begin, end) for begin, end in pairwise(edges) if end > begin)
