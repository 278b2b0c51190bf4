"""How large the motion is to be judged: do the sensors agree, is it a line of the roller?"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, F1, R1, compiled
from hunt_ros.detection import doubts
from hunt_ros.detection.configuration import DetectorConfig

#: Sensors contradict each other beyond this many standard deviations, or where one shows less than
#: this part of what the other tells, or nothing of what it would show if it were so many times as
#: poor; for so long, s, a blow moves more than one mode.
_CONTRARY, _PART, _POOR, _AGREE_S = 3.0, 0.5, 10.0, 0.5
#: A motion within this part of the frequency of a line, that is what a filter of two periods
#: resolves, is told from it only where the line has less than this part of its amplitude: a line
#: that passes the hunting frequency resonates, and the filter may share out one motion, or make
#: two of it that cancel. While the speed changes its size tells nothing either, and the line may
#: seem small at the peak: what was shared is until the line has less than the last part.
_NEAR, _SHARED, _STILL = 0.1, 0.25, 0.1
#: The speed changes where it is off by this part from what it was over the memory of the slowest
#: line (the least bandwidth in `tracker.tuning`), s of the reference rig.
_CHANGED, _MEMORY_S = 0.02, 20.0
#: The turning of the roller is averaged over this time, s: an encoder counts whole steps. What
#: the mean of the mean lags behind is added, so that none lags behind a steady change.
_TURNING_S = 1.0


class Turning:
    """
    How fast the roller turns, row by row.

    Parameters
    ----------
    config : DetectorConfig
        With a hunting frequency.
    """

    def __init__(self, config: DetectorConfig) -> None:
        self._memory_s = _MEMORY_S / config.faster
        self._memory = np.full(4, math.nan)
        self._last_ns = 0

    def update(
        self, rows_ns: NDArray[np.int64], angle: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """
        Take rows, m > 0, and the angle of the roller in rad or NaN at them.

        Returns
        -------
        turning : ndarray, shape (m,)
            Turns per second, NaN where unknown.
        changed : ndarray of bool, shape (m,)
            True where it is another than it was over the memory.
        """
        turning = np.full(rows_ns.size, math.nan)
        changed = np.zeros(rows_ns.size, dtype=np.bool_)
        seconds = np.diff(rows_ns, prepend=self._last_ns) * 1e-9
        self._last_ns = int(rows_ns[-1])
        _count_turns(seconds, angle, self._memory_s, self._memory, turning, changed)
        return turning, changed


@compiled
def _count_turns(
    seconds: R1, angle: R1, memory_s: float, memory: F1, turning: F1, changed: B1
) -> None:
    """Run `Turning.update`; memory = [last angle, mean, mean over the memory, mean of means]."""
    for i in range(angle.size):
        last, mean = memory[0], memory[1]
        memory[0] = angle[i]
        if not (math.isfinite(angle[i] - last) and seconds[i] > 0.0):
            memory[1] = math.nan
            continue
        turns = abs(angle[i] - last) / (2.0 * math.pi * seconds[i])
        if math.isnan(mean):
            mean = memory[3] = turns
        part = min(seconds[i] / _TURNING_S, 1.0)
        mean += part * (turns - mean)
        memory[3] += part * (mean - memory[3])
        if math.isnan(memory[2]):
            memory[2] = mean
        memory[2] += min(seconds[i] / memory_s, 1.0) * (mean - memory[2])
        memory[1] = mean
        turning[i] = max(2.0 * mean - memory[3], 0.0)
        changed[i] = abs(mean - memory[2]) > _CHANGED * memory[2]


class Agreement:
    """
    Whether lateral and yaw tell of one motion, and whether that is the hunting or a line.

    Parameters
    ----------
    config : DetectorConfig
    orders : sequence of float
        Of the lines, in turns of the roller.
    """

    def __init__(self, config: DetectorConfig, orders: Sequence[float]) -> None:
        self._hold = round(_AGREE_S * 1e9 / config.period_ns)
        self._orders = orders
        self._lost, self._lasted = False, 0
        self._shared = False

    def update(
        self,
        rows: NDArray[np.void],
        track: NDArray[np.void],
        turning: NDArray[np.float64],
        changed: NDArray[np.bool_],
    ) -> None:
        """
        Fill in doubts, how large the motion is to be judged, and where its size is not known.

        Parameters
        ----------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
            Filled in.
        track : ndarray of TRACK_DTYPE, shape (m,)
            They were made of.
        turning, changed : ndarray, shape (m,)
            What `Turning` gave.
        """
        contrary = track['yaw_contrary'] > _CONTRARY
        larger = np.where(contrary, np.fmax(track['yaw_factor'], 1.0), 1.0)
        rows['judged'] = larger * track['lateral_amplitude']
        rows['judged_std'] = larger * track['lateral_amplitude_std']
        lost, back = self._seen(track)
        if self._lost or lost.any():
            for k in range(rows.size):
                self._lost = bool(lost[k] or (self._lost and not back[k]))
                self._lasted = self._lasted + 1 if self._lost else 0
                lost[k] = self._lost
                contrary[k] |= self._lasted > self._hold
        rows['judged'][lost], rows['judged_std'][lost] = by_yaw(track[lost])
        rows['doubts'][contrary] |= np.uint32(doubts.CONTRARY)
        shared = self._on_line(track, turning, changed)
        rows['judged'][changed & shared] = math.nan
        rows['doubts'][shared] |= np.uint32(doubts.ON_LINE)

    def _seen(self, track: NDArray[np.void]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return in which rows lateral misses a motion that yaw shows, and where it has it."""
        a, s = track['lateral_amplitude'], track['lateral_amplitude_std']
        b, t = track['yaw_amplitude'], track['yaw_amplitude_std']
        told, std = by_yaw(track)
        measured = (track['lateral_tied'] == 0.0) & np.isfinite(a + b)
        hidden = np.isnan(told) & (a < _CONTRARY * s) & (b > _CONTRARY * _POOR * t)
        smaller = a + _CONTRARY * s < _PART * (told - _CONTRARY * std)
        shown = np.where(np.isnan(told), a > _CONTRARY * s, a > _PART * told)
        return measured & (smaller | hidden), ~measured | shown

    def _on_line(
        self,
        track: NDArray[np.void],
        turning: NDArray[np.float64],
        changed: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Return the rows in which the motion may be that of a line at its frequency."""
        away = np.abs(track['frequency_hz'] - np.multiply.outer(self._orders, turning))
        near = away < _NEAR * track['frequency_hz']
        shared, still = np.zeros((2, track.size), dtype=np.bool_)
        for name in ('lateral', 'yaw'):
            motion = track[f'{name}_amplitude']
            for line, which in zip(near, ('roughness', 'roughness_second'), strict=False):
                shared |= line & (track[f'{name}_{which}'] > _SHARED * motion)
                still |= line & (track[f'{name}_{which}'] > _STILL * motion)
        for k in np.flatnonzero(still & changed & ~shared):
            shared[k] = shared[k - 1] if k else self._shared
        self._shared = bool(shared[-1])
        return shared


def by_yaw(track: NDArray[np.void]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lateral amplitude that yaw tells by itself, and its deviation, m; NaN: none."""
    known = track['yaw_ratio_std'] < 0.5 * track['yaw_ratio']
    ratio = np.where(known, track['yaw_ratio'], math.nan)
    doubt = track['yaw_ratio_std'] / ratio
    ratio /= np.fmax(track['yaw_factor'], 1.0)
    told = track['yaw_amplitude'] / ratio
    return told, np.hypot(track['yaw_amplitude_std'] / ratio, told * doubt)
