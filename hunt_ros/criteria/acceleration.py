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

from hunt_ros.errors import ConfigError
from hunt_ros.samples import NANOSECONDS

#: The longest silence that is bridged by interpolation.
LONGEST_GAP_NS = 50_000_000

#: Of a run without a gap: True where it begins after one, stamps, acceleration, speed.
Run = tuple[bool, NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]


class LateralAcceleration:
    """
    Lateral acceleration in a pass band, derived from displacement, as a stream.

    Samples are interpolated linearly onto a grid of step 1/rate, differenced twice,
    and passed through a Butterworth band-pass of order four a side (24 dB an octave,
    as the standards ask for at least). A gap, or a stamp that does not advance (the clock
    was set), restarts the filter. A value that is not finite is a missing sample.

    Parameters
    ----------
    rate_hz : float
        Grid rate, Hz; best the sensor's own.
    low_hz, high_hz : float
        Pass band (-3 dB), Hz.

    Raises
    ------
    ConfigError
        For a band that does not lie between zero and half the rate.
    """

    def __init__(self, rate_hz: float, low_hz: float, high_hz: float) -> None:
        if not 0.0 < low_hz < high_hz < 0.5 * rate_hz:
            raise ConfigError(
                f'pass band {low_hz:g} to {high_hz:g} Hz: expected 0 < low < high < half the'
                f' rate of {rate_hz:g} Hz'
            )
        from scipy import signal  # here: it takes long, and few runs have a criterion

        self._rate = rate_hz
        self._sections = signal.butter(
            4, [low_hz, high_hz], btype='bandpass', fs=rate_hz, output='sos'
        )
        self._sosfilt = signal.sosfilt
        self._step = round(NANOSECONDS / rate_hz)
        self._gap = max(LONGEST_GAP_NS, 2 * self._step)
        self.reset()

    def reset(self) -> None:
        """Forget every sample."""
        self._last: tuple[int, float] | None = None
        self._speed = np.nan
        self._next_ns = 0

    def update(self, stamps_ns: ArrayLike, lateral: ArrayLike, speed: ArrayLike) -> Iterator[Run]:
        """
        Take samples; give the acceleration at the grid points they complete, run by run.

        Parameters
        ----------
        stamps_ns : array_like of int64, shape (n,)
            Header stamps.
        lateral : array_like, shape (n,)
            Displacement y, m.
        speed : array_like, shape (n,) or scalar
            Running speed, m/s; NaN keeps the last one known.

        Yields
        ------
        fresh : bool
            True where the run begins after a gap, or is the first.
        stamps_ns : ndarray of int64, shape (m,)
        acceleration, speed : ndarray, shape (m,)
            m/s^2 and m/s; the speed is NaN while none is known.
        """
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        values = np.atleast_1d(np.asarray(lateral, dtype=np.float64))
        speeds = np.concatenate(([self._speed], np.broadcast_to(speed, stamps.shape)))
        given = np.where(np.isfinite(speeds), np.arange(speeds.size), 0)
        speeds = speeds[np.maximum.accumulate(given)][1:]
        there = np.isfinite(values)
        if not there.any():
            return
        stamps, values, speeds = stamps[there], values[there], speeds[there]
        self._speed = speeds[-1]
        steps = np.diff(stamps, prepend=self._last[0] if self._last else stamps[0])
        fresh = (steps <= 0) | (steps > self._gap)
        for begin, end in pairwise(sorted({0, *np.flatnonzero(fresh).tolist(), stamps.size})):
            if fresh[begin]:
                self._begin(int(stamps[begin]), values[begin])
            assert self._last is not None
            t = np.concatenate(([self._last[0]], stamps[begin:end]))
            y = np.concatenate(([self._last[1]], values[begin:end]))
            self._last = int(t[-1]), float(y[-1])
            grid = np.arange(self._next_ns, t[-1] + 1, self._step)
            if not grid.size:
                continue
            self._next_ns += grid.size * self._step
            place = np.searchsorted(t, grid)
            part = (grid - t[place - 1]) / (t[place] - t[place - 1])
            even = y[place - 1] + part * (y[place] - y[place - 1])
            yield bool(fresh[begin]), grid, self._filter(even), speeds[begin:end][place - 1]

    def _begin(self, stamp_ns: int, value: float) -> None:
        """Begin anew with a sample."""
        self._last, self._next_ns = (stamp_ns - 1, value), stamp_ns
        self._memory = np.zeros((self._sections.shape[0], 2))
        self._before = np.full(2, value)  # the last two grid values of y

    def _filter(self, lateral: NDArray[np.float64]) -> NDArray[np.float64]:
        """Difference twice and band-pass a run without gap."""
        joined = np.concatenate([self._before, lateral])
        self._before = joined[-2:].copy()
        second = (joined[2:] - 2.0 * joined[1:-1] + joined[:-2]) * self._rate**2
        filtered, self._memory = self._sosfilt(self._sections, second, zi=self._memory)
        return np.asarray(filtered, dtype=np.float64)
