"""
Judging samples at their source: is there one for each period, and is it a measurement?

What is wrong is counted from one report to the next. The detector judges what it hears once more;
here it is known what the device itself said, in its own unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.samples import GAP_STEPS, NANOSECONDS

#: Deviation of the spacing, in periods: 0.5 ms at 500 Hz is 1.5 % of an amplitude at 5 Hz.
_JITTER = 0.25
#: The rate is away by more than this fraction of what is expected.
_RATE = 0.05


@dataclass(frozen=True)
class SourceReport:
    """
    What the samples since the last report were like.

    Parameters
    ----------
    count : int
        Samples.
    rate_hz : float
        By their stamps; NaN for less than two.
    jitter_s : float
        Standard deviation of the spacing, gaps left out; NaN for less than three.
    longest_gap_s : float
        Longest spacing.
    not_a_number, saturated, gaps : int
        Samples that the device marked as bad; at the ends of the range or outside; spacings with a
        sample missing.
    stuck_s : float
        How long the reading has been the same, at the last sample.
    problems : tuple of str
        What is wrong, in words.
    """

    count: int
    rate_hz: float
    jitter_s: float
    longest_gap_s: float
    not_a_number: int
    saturated: int
    gaps: int
    stuck_s: float
    problems: tuple[str, ...]


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
        self._last_ns: int | None = None
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
        before = stamps_ns[0] if self._last_ns is None else self._last_ns
        spacings = np.diff(stamps_ns, prepend=before).astype(np.float64)
        self._spacings.append(spacings[1:] if self._last_ns is None else spacings)
        self._last_ns = int(stamps_ns[-1])
        self._count += stamps_ns.size
        self._not_a_number += int(np.isnan(readings).sum())
        self._saturated += int(np.asarray(saturated).sum())
        changed = np.flatnonzero(np.diff(readings, prepend=self._held) != 0.0)  # NaN is a change
        if changed.size:
            self._held_ns = int(stamps_ns[changed[-1]])
        self._held = float(readings[-1])

    def report(self) -> SourceReport:
        """Return what the samples since the last report were like."""
        spacings = np.concatenate(self._spacings) if self._spacings else np.zeros(0)
        gaps = spacings > GAP_STEPS * self._period_ns
        whole = spacings[~gaps]
        total_s = float(spacings.sum()) / NANOSECONDS
        rate_hz = spacings.size / total_s if total_s > 0.0 else math.nan
        jitter_s = float(whole.std()) / NANOSECONDS if whole.size > 1 else math.nan
        stuck_s = (
            (self._last_ns - self._held_ns) / NANOSECONDS
            if self._last_ns is not None and self._held_ns
            else 0.0
        )
        report = SourceReport(
            self._count,
            rate_hz,
            jitter_s,
            float(spacings.max(initial=0.0)) / NANOSECONDS,
            self._not_a_number,
            self._saturated,
            int(gaps.sum()),
            stuck_s,
            (),
        )
        self._clear()
        return SourceReport(**{**vars(report), 'problems': tuple(self._problems(report))})

    def _problems(self, report: SourceReport) -> list[str]:
        """Say what is wrong, the worst first."""
        said = []
        if report.saturated:
            said.append(f'{report.saturated} samples saturated')
        if report.not_a_number:
            said.append(f'{report.not_a_number} samples are no number')
        if self._stuck_s and report.stuck_s > self._stuck_s:
            said.append(f'stuck at {self._held:g} for {report.stuck_s:.1f} s')
        if report.gaps:
            said.append(f'{report.gaps} gaps, the longest {report.longest_gap_s:.3f} s')
        if abs(report.rate_hz / self._rate_hz - 1.0) > _RATE:
            said.append(f'{report.rate_hz:.0f} samples/s, expected {self._rate_hz:.0f}')
        if report.jitter_s * NANOSECONDS > _JITTER * self._period_ns:
            said.append(f'stamps jitter by {1e3 * report.jitter_s:.2f} ms')
        return said
