"""Criteria that count consecutive peaks of the lateral acceleration above a limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled
from hunt_ros.criteria.base import Criterion, CriterionSettings
from hunt_ros.settings import setting


@compiled
def _lowest_of_peaks(
    values: NDArray[np.float64],
    peaks: NDArray[np.float64],
    state: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """
    Lowest of the last n peaks: n peaks in a row exceed a limit where this one does.

    A peak is the largest |a| between two changes of sign. peaks holds the last n
    complete ones, the newest first; state = [running peak, last sign]. The running peak
    counts from the moment it rises, the complete ones hold until the next is complete.
    """
    for k in range(values.size):
        sign = 1.0 if values[k] >= 0.0 else -1.0
        if state[1] != 0.0 and sign != state[1]:
            for i in range(peaks.size - 1, 0, -1):
                peaks[i] = peaks[i - 1]
            peaks[0] = state[0]
            state[0] = 0.0
        state[1] = sign
        state[0] = max(state[0], abs(values[k]))
        lowest = state[0]
        for i in range(peaks.size - 1):
            lowest = min(lowest, peaks[i])
        out[k] = max(lowest, peaks.min())


@dataclass(frozen=True)
class SixPeaksSettings(CriterionSettings):
    """Thresholds of the six-peak criterion."""

    peaks: int = setting(6, 'consecutive peaks', low=1, high=100)


class SixPeaks(Criterion):
    """
    Chinese practice: six consecutive peaks above 8 m/s^2 in 0.5 to 10 Hz.

    Peaks of either sign count, one each half cycle; who counts one a cycle sets `peaks`
    to twice as many.

    References
    ----------
    GB/T 5599-2019 (in force 1 July 2020; before it GB/T 5599-1985), Specification for
    dynamic performance assessment and testing verification of rolling stock, lateral
    stability of the bogie frame.
    """

    name = 'six_peaks'
    source = 'GB/T 5599-2019, lateral acceleration of the bogie frame'
    settings_type: ClassVar[type[CriterionSettings]] = SixPeaksSettings
    settings: SixPeaksSettings

    def _clear(self) -> None:
        self._peaks = np.zeros(self.settings.peaks)
        self._state = np.zeros(2)

    def _indices(
        self, acceleration: NDArray[np.float64], speed: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        out = np.empty(acceleration.size)
        _lowest_of_peaks(acceleration, self._peaks, self._state, out)
        return out


@dataclass(frozen=True)
class TenPeaksSettings(SixPeaksSettings):
    """Thresholds of the ten-peak criterion."""

    low_hz: float = setting(3.0, 'lower edge of the pass band', unit='Hz', low=0.01, high=100.0)
    high_hz: float = setting(9.0, 'upper edge of the pass band', unit='Hz', low=0.1, high=500.0)
    peaks: int = setting(10, 'consecutive peaks', low=1, high=100)


class TenPeaks(SixPeaks):
    """
    High-speed interoperability: ten consecutive peaks above 8 m/s^2 in 3 to 9 Hz.

    Counted as in `SixPeaks`: half cycles. Ten whole cycles are ``peaks=20``.

    References
    ----------
    Commission Decision 2008/232/EC of 21 February 2008 (technical specification for
    interoperability, rolling stock of the trans-European high-speed rail system, OJ L 84,
    26.3.2008, p. 132), instability of the running gear.
    """

    name = 'ten_peaks'
    source = 'Decision 2008/232/EC (TSI HS RST), 3 to 9 Hz'
    settings_type: ClassVar[type[CriterionSettings]] = TenPeaksSettings
    settings: TenPeaksSettings
