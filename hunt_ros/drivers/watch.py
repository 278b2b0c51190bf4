"""
Judging samples at their source: is there one for each period, and is it a measurement?

What is wrong is counted from one report to the next. The detector judges what it hears once more;
here it is known what the device itself said, in its own unit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.samples import GAP_STEPS, NANOSECONDS

#: Deviation of the spacing, in periods: 0.5 ms at 500 Hz is 1.5 % of an amplitude at 5 Hz.
_JITTER = 0.25
#: The rate is away by more than this fraction of what is expected.
_RATE = 0.05


class SourceWatch:
    """
    Counts what is wrong with the samples of one sensor.

    Parameters
    ----------
    rate_hz : float
        Samples a second that are expected.
    stuck_s : float
        A reading that stays the same for so long is no measurement; 0: never.
    """

    def __init__(self, rate_hz: float, stuck_s: float) -> None:
        self._period_ns = NANOSECONDS / rate_hz
        self._rate_hz = rate_hz
        self._stuck_s = stuck_s
        self._last_ns = 0  # 0: none yet
        self._held = math.nan  # reading that stays the same
        self._held_ns = 0  # since
        self._clear()

    def _clear(self) -> None:
        self._spacings: list[NDArray[np.float64]] = []
        self._count = self._not_a_number = self._saturated = 0

    def take(
        self,
        stamps_ns: NDArray[np.int64],
        readings: NDArray[np.float64],
        saturated: NDArray[np.bool_],
    ) -> None:
        """Count samples, in their order, shape (n,) each."""
        if not stamps_ns.size:
            return
        spacings = np.diff(stamps_ns, prepend=self._last_ns).astype(np.float64)
        self._spacings.append(spacings if self._last_ns else spacings[1:])
        self._last_ns = int(stamps_ns[-1])
        self._count += stamps_ns.size
        self._not_a_number += int(np.isnan(readings).sum())
        self._saturated += int(np.asarray(saturated).sum())
        changed = np.flatnonzero(np.diff(readings, prepend=self._held) != 0.0)  # NaN is a change
        if changed.size:
            self._held_ns = int(stamps_ns[changed[-1]])
        self._held = float(readings[-1])

    def report(self) -> tuple[int, dict[str, float], list[str]]:
        """
        Return what the samples since the last report were like.

        Returns
        -------
        count : int
            Samples.
        values : dict of str to float
            `rate_hz` by their stamps (NaN for less than two), `jitter_ms` (standard deviation of
            the spacing, gaps left out; NaN for less than three), `longest_gap_ms`, `saturated`
            samples, `stuck_s`: how long the reading has been the same, at the last sample.
        problems : list of str
            What is wrong, in words, the worst first.
        """
        spacings = np.concatenate([np.zeros(0), *self._spacings])
        gaps = spacings > GAP_STEPS * self._period_ns
        whole, total_s = spacings[~gaps], float(spacings.sum()) / NANOSECONDS
        rate_hz = spacings.size / total_s if total_s > 0.0 else math.nan
        jitter_ms = 1e-6 * float(whole.std()) if whole.size > 1 else math.nan
        longest_ms = 1e-6 * float(spacings.max(initial=0.0))
        stuck_s = (self._last_ns - self._held_ns) / NANOSECONDS if self._last_ns else 0.0
        said = []
        if self._saturated:
            said.append(f'{self._saturated} samples saturated')
        if self._not_a_number:
            said.append(f'{self._not_a_number} samples are no number')
        if 0.0 < self._stuck_s < stuck_s:
            said.append(f'stuck at {self._held:g} for {stuck_s:.1f} s')
        if gaps.any():
            said.append(f'{gaps.sum()} gaps, the longest {1e-3 * longest_ms:.3f} s')
        if abs(rate_hz / self._rate_hz - 1.0) > _RATE:
            said.append(f'{rate_hz:.0f} samples/s, expected {self._rate_hz:.0f}')
        if 1e6 * jitter_ms > _JITTER * self._period_ns:
            said.append(f'stamps jitter by {jitter_ms:.2f} ms')
        values = {
            'rate_hz': round(rate_hz, 1),
            'jitter_ms': round(jitter_ms, 4),
            'longest_gap_ms': round(longest_ms, 3),
            'saturated': self._saturated,
            'stuck_s': round(stuck_s, 3),
        }
        count = self._count
        self._clear()
        return count, values, said
