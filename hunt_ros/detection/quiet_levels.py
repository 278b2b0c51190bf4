"""
From a running record to spectra of the quiet response, one for each speed level.

A *level* is a stretch of nearly constant speed. Samples are averaged into cells
of equal length, cells are gathered into blocks of a second, and blocks into a
level while the speed stays. A closed level is reduced to its periodogram with the
roughness lines of Eq. (1) taken out, so that hours of running stay small.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled
from hunt_ros.samples import NANOSECONDS

#: Harmonics of the roller's frequency that are fitted and removed.
HARMONICS = 3

#: A block whose rms exceeds this many times the level's median was disturbed.
DISTURBED = 4.0

#: Columns of a cell: count, sum of y, sum of v, then sums of cos and sin of each harmonic.
COLUMNS = 3 + 2 * HARMONICS

#: Cells in a block, and what part of them must hold data.
BLOCK = 50
FILLED = 0.8


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
        White level above the band, m^2 s.
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


@compiled
def _fill_cells(
    stamps: NDArray[np.int64],
    values: NDArray[np.float64],
    speeds: NDArray[np.float64],
    angles: NDArray[np.float64],
    cell_ns: int,
    clock: NDArray[np.int64],
    cell: NDArray[np.float64],
    numbers: NDArray[np.int64],
    cells: NDArray[np.float64],
) -> int:
    """
    Sum samples into cells; return how many cells were completed.

    clock = [number of the open cell, last stamp, running, dropped]. Changed in place.
    """
    done = 0
    for k in range(stamps.size):
        if clock[2] and 0 <= clock[1] - stamps[k] <= NANOSECONDS:
            clock[3] += 1
            continue
        clock[1] = stamps[k]
        number = stamps[k] // cell_ns
        if clock[2] == 0 or number != clock[0]:
            if clock[2] and cell[0] > 0.0:
                numbers[done] = clock[0]
                cells[done] = cell
                done += 1
            clock[0] = number
            clock[2] = 1
            cell[:] = 0.0
        if not (np.isfinite(values[k]) and np.isfinite(speeds[k])):
            continue
        cell[0] += 1.0
        cell[1] += values[k]
        cell[2] += speeds[k]
        for h in range(HARMONICS):
            cell[3 + 2 * h] += np.cos((h + 1) * angles[k])
            cell[4 + 2 * h] += np.sin((h + 1) * angles[k])
    return done


class QuietLevels:
    """
    Collect the levels of a run as it goes.

    Feeding it in any blocks gives the same levels. A sample without a finite value or
    speed is left out; a stamp that does not advance is dropped and counted; a clock set
    back by more than a second, or a gap of a block, closes the level.

    Parameters
    ----------
    lowest_hz, highest_hz : float
        Band in which hunting is looked for, Hz.
    speed_tolerance : float
        How far the speed may stray within a level, relative.
    shortest_s, longest_s : float
        A level shorter than the first is not used; one that reaches the second closes.
    settle_s : float
        Left out at the start of a level: the response still remembers the speed before.
    roller_diameter_m : float
        D of Eq. (1), m: where the roughness lines are.
    """

    def __init__(
        self,
        lowest_hz: float,
        highest_hz: float,
        speed_tolerance: float = 0.01,
        shortest_s: float = 8.0,
        longest_s: float = 60.0,
        settle_s: float = 2.0,
        roller_diameter_m: float = 0.3,
    ) -> None:
        self._band = (lowest_hz, highest_hz)
        self._cell_ns = round(NANOSECONDS / (6.0 * highest_hz))
        self._cell_s = self._cell_ns / NANOSECONDS
        self._tolerance = speed_tolerance
        self._block_s = BLOCK * self._cell_s
        self._fewest = max(math.ceil(shortest_s / self._block_s), 4)
        self._most = max(math.ceil(longest_s / self._block_s), self._fewest)
        self._settle = math.ceil(settle_s / self._block_s)
        self._diameter = roller_diameter_m
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.levels: list[SpeedLevel] = []
        self.closed_s = 0.0
        self._clock = np.zeros(4, dtype=np.int64)
        self._cell = np.zeros(COLUMNS)
        self._block = np.zeros((BLOCK, COLUMNS))
        self._block_number: int | None = None
        self._blocks: list[NDArray[np.float64]] = []
        self._speed = 0.0
        self._skip = 0

    @property
    def dropped(self) -> int:
        """Samples dropped because their stamp did not advance."""
        return int(self._clock[3])

    @property
    def last_stamp_ns(self) -> int:
        """Stamp of the last sample taken."""
        return int(self._clock[1])

    @property
    def gathered_s(self) -> float:
        """Time gathered in all levels, the open one included, s."""
        return self.closed_s + len(self._blocks) * self._block_s

    def update(
        self,
        stamps_ns: NDArray[np.int64],
        values: NDArray[np.float64],
        speeds: NDArray[np.float64],
        angles: NDArray[np.float64],
    ) -> Iterator[int]:
        """
        Take samples; give the stamp (ns) of each block they complete, as it completes.

        The levels stand as they were at that stamp until the next one is asked for: all
        must be asked for.

        Parameters
        ----------
        stamps_ns, values, speeds, angles : ndarray, shape (n,)
            ns; m; m/s; continuous roller angle in rad, NaN where it is not known.
        """
        numbers = np.empty(stamps_ns.size, dtype=np.int64)
        cells = np.empty((stamps_ns.size, COLUMNS))
        count = _fill_cells(
            stamps_ns,
            values,
            speeds,
            angles,
            self._cell_ns,
            self._clock,
            self._cell,
            numbers,
            cells,
        )
        for number, cell in zip(numbers[:count].tolist(), cells[:count], strict=True):
            block, place = divmod(number, BLOCK)
            if block != self._block_number:
                if self._block_number is not None:
                    self._take_block()
                    if block != self._block_number + 1:
                        self._close()
                    yield (self._block_number + 1) * BLOCK * self._cell_ns
                self._block_number = block
                self._block[:] = 0.0
            self._block[place] = cell

    def mark_disturbed(self) -> None:
        """Close the level: what comes now is not the quiet response (a kick, hunting)."""
        self._close()
        self._block[:] = 0.0

    def open_level(self) -> SpeedLevel | None:
        """Return the level that is still open as it stands; None while it is too short."""
        return self._reduce()

    def _take_block(self) -> None:
        """Put the finished block into the open level, or close that and start another."""
        held = self._block[:, 0] > 0.0
        if held.mean() < FILLED:
            self._close()
            return
        speed = float(self._block[:, 2].sum() / self._block[:, 0].sum())
        first = self._block[: BLOCK // 2]
        before = float(first[:, 2].sum() / max(first[:, 0].sum(), 1.0))
        limit = self._tolerance * abs(self._speed if self._blocks else speed)
        steady = abs(before - speed) <= limit  # half the change over the block
        if not steady or (self._blocks and abs(speed - self._speed) > limit):
            self._close()
        if not steady or speed <= 0.0:
            return
        if self._skip < self._settle and not self._blocks:
            self._skip += 1
            return
        self._blocks.append(self._block.copy())
        self._speed += (speed - self._speed) / len(self._blocks)
        if len(self._blocks) >= self._most:
            self._close()
            self._skip = self._settle  # the speed has not changed: nothing to settle

    def _close(self) -> None:
        """End the open level and keep it, if it is long enough and was quiet."""
        level = self._reduce()
        self._blocks = []
        self._speed = 0.0
        self._skip = 0
        if level is None:
            return
        self.closed_s += level.duration_s
        for k, other in enumerate(self.levels):
            near = abs(other.speed - level.speed) <= 0.5 * self._tolerance * level.speed
            if near and other.omega.size == level.omega.size:
                self.levels[k] = other.merged(level)
                return
        self.levels.append(level)

    def _quiet_blocks(self) -> list[NDArray[np.float64]]:
        """Return the longest run of blocks without a disturbance."""
        if len(self._blocks) < self._fewest:
            return []
        sizes = []
        for block in self._blocks:
            held = block[block[:, 0] > 0.0]
            sizes.append(float(np.std(held[:, 1] / held[:, 0])))
        calm = np.array(sizes) <= DISTURBED * float(np.median(sizes))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], calm.astype(int), [0]])))
        begin, end = max(
            zip(edges[::2], edges[1::2], strict=True), key=lambda run: run[1] - run[0]
        )
        return self._blocks[begin:end] if end - begin >= self._fewest else []

    def _reduce(self) -> SpeedLevel | None:
        """Periodogram of the open level without trend and roughness lines."""
        blocks = self._quiet_blocks()
        if not blocks:
            return None
        cells = np.concatenate(blocks)
        held = cells[:, 0] > 0.0
        place = np.arange(cells.shape[0], dtype=np.float64)
        mean = cells[held] / cells[held, :1]
        columns = np.stack(
            [np.interp(place, place[held], mean[:, k]) for k in range(1, COLUMNS)], axis=1
        )
        y, speed, lines = columns[:, 0], float(columns[:, 1].mean()), columns[:, 2:]
        trend = np.stack([np.ones_like(place), place / place.size], axis=1)
        known = bool(np.isfinite(lines).all())
        regressors = np.concatenate([trend, lines], axis=1) if known else trend
        y = y - regressors @ np.linalg.lstsq(regressors, y, rcond=None)[0]
        return self._periodogram(y, speed, known)

    def _periodogram(
        self, y: NDArray[np.float64], speed: float, lines_removed: bool
    ) -> SpeedLevel:
        duration = y.size * self._cell_s
        frequency: NDArray[np.float64] = np.fft.rfftfreq(y.size, self._cell_s)
        power: NDArray[np.float64] = np.abs(np.fft.rfft(y)) ** 2 * self._cell_s / y.size
        weight = np.ones_like(frequency)
        for harmonic in range(1, HARMONICS + 1):
            line = harmonic * speed / (math.pi * self._diameter)
            # A fitted line takes its own bins with it; one that is only known from the
            # speed is as wide as the speed is uncertain.
            width = 1.5 / duration if lines_removed else max(3.0 / duration, 0.02 * line)
            weight[np.abs(frequency - line) <= width] = 0.0
        above = (frequency > 1.5 * self._band[1]) & (frequency < 2.7 * self._band[1])
        floor = float(np.median(power[above & (weight > 0.0)])) / math.log(2.0)
        inside = (frequency >= self._band[0]) & (frequency <= self._band[1])
        gain = np.sinc(frequency[inside] * self._cell_s) ** 2
        rms = math.sqrt(2.0 / duration * float((power * weight)[inside].sum()))
        return SpeedLevel(
            speed,
            duration,
            2.0 * np.pi * frequency[inside],
            power[inside],
            weight[inside],
            gain,
            floor,
            rms,
        )
