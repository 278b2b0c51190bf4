"""
From a running record to spectra of the quiet response, one for each speed level.

A *level* is a stretch of nearly constant speed. Samples are averaged into cells
of equal length, cells are gathered into blocks of a second, and blocks into a
level while the speed stays. A closed level is reduced to its periodogram, so that
hours of running stay small.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.spectrum import without_lines
from hunt_ros.estimation.tracker_config import REFERENCE_HZ, Shaft
from hunt_ros.estimation.turning import SPEED_STD
from hunt_ros.samples import NANOSECONDS

#: A signal that varies by less than this part of itself varies by rounding only.
STUCK = 1e-9

#: A block whose rms exceeds this many times the level's median was disturbed.
DISTURBED = 4.0

#: Levels that are kept; beyond, the shorter of two at nearly the same speed goes.
MOST_LEVELS = 60

#: How far the speed may stray within a level, relative.
TOLERANCE = 0.015
#: Of a rig of the reference frequency, s: a shorter level is not used, a longer hold is cut into
#: levels, and after a change of speed the response still remembers the speed before.
SHORTEST_S, LONGEST_S, SETTLE_S = 6.0, 60.0, 2.0

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
        Windows averaged in each bin; 0 where a known line lies.
    gain : ndarray, shape (k,)
        Power response of the averaging into cells.
    floor : float
        White level above the band, m^2 s; 0 for a sensor that is stuck.
    """

    speed: float
    duration_s: float
    omega: NDArray[np.float64]
    periodogram: NDArray[np.float64]
    weight: NDArray[np.float64]
    gain: NDArray[np.float64]
    floor: float

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
        )


def _strongest(
    y: NDArray[np.float64], phase: NDArray[np.float64], slip: float
) -> NDArray[np.complex128]:
    """Return the wave of this phase, rad, at the slip at which most of it is in y."""
    step = 0.25 * 2.0 * math.pi / max(float(np.ptp(phase)), 1.0)
    scales = 1.0 + np.arange(-slip, slip + step, step)
    waves = [np.exp(1j * scale * phase) for scale in scales]
    return max(waves, key=lambda wave: float(abs(np.vdot(wave, y))))


class QuietLevels:
    """
    Collect the levels of a run as it goes.

    Feeding it in any blocks gives the same levels. A sample without a finite value or
    speed is left out; a clock that is set back, or a gap of a block, closes the level.

    Parameters
    ----------
    band_hz : (float, float)
        Band in which hunting is looked for, Hz.
    frequency_hz : float
        Nominal hunting frequency, Hz: all times are numbers of its periods.
    roller_diameter_m : float
        D of Eq. (1), m: how fast the roller turns where its angle is not known.
    shafts : sequence of Shaft
        What turns, with its lines in turns of the roller.
    """

    def __init__(
        self,
        band_hz: tuple[float, float],
        frequency_hz: float = REFERENCE_HZ,
        roller_diameter_m: float = 0.3,
        shafts: Sequence[Shaft] = (Shaft((1.0, 2.0)),),
    ) -> None:
        self._band = band_hz
        self._cell_ns = round(NANOSECONDS / (6.0 * band_hz[1]))
        self._cell_s = self._cell_ns / NANOSECONDS
        self._block_s = BLOCK * self._cell_s
        unit_s = self._block_s * frequency_hz / REFERENCE_HZ
        self._fewest = max(math.ceil(SHORTEST_S / unit_s), 4)
        self._most = max(math.ceil(LONGEST_S / unit_s), self._fewest)
        self._settle = math.ceil(SETTLE_S / unit_s)
        self._diameter, self._shafts = roller_diameter_m, tuple(shafts)
        # Those that turn with the roller's angle: their phase is known.
        orders = [order for shaft in shafts if shaft.slip_std == 0.0 for order in shaft.orders]
        self._orders = np.array(orders, dtype=np.float64)[:, None]
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.levels: list[SpeedLevel] = []
        self.closed_s = 0.0
        self.last_stamp_ns = 0
        #: Samples of the block that is open: stamps, values, speeds, angles, part by part.
        self._open: list[tuple[NDArray[Any], ...]] = []
        self._block_number: int | None = None
        self._blocks: list[NDArray[np.float64]] = []
        self._speed = 0.0
        self._skip = 0

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
        if stamps_ns.size:
            self.last_stamp_ns = int(stamps_ns[-1])
        good = np.isfinite(values) & np.isfinite(speeds)
        columns = [column[good] for column in (stamps_ns, values, speeds, angles)]
        blocks = columns[0] // (BLOCK * self._cell_ns)
        changes = (np.flatnonzero(np.diff(blocks)) + 1).tolist()
        for begin, end in pairwise([0, *changes, blocks.size] if blocks.size else []):
            block = int(blocks[begin])
            if block != self._block_number:
                if self._block_number is not None:
                    self._take_block(self._cells())
                    if block != self._block_number + 1:
                        self._close()
                    yield (self._block_number + 1) * BLOCK * self._cell_ns
                self._block_number, self._open = block, []
            self._open.append(tuple(column[begin:end] for column in columns))

    def _cells(self) -> NDArray[np.float64]:
        """
        Return the sums of the open block, cell by cell.

        Count, sums of y, v and the roller's angle, then of cos and sin of each line that turns
        with that angle, shape (BLOCK, 4 + 2 orders).
        """
        nothing = tuple(np.zeros(0, dtype=kind) for kind in (np.int64, *3 * (np.float64,)))
        stamps, *columns = map(np.concatenate, zip(nothing, *self._open, strict=True))
        turned = self._orders * columns[2]
        lines = [wave for one in turned for wave in (np.cos(one), np.sin(one))]
        cell = stamps // self._cell_ns % BLOCK
        samples = [np.ones(cell.size), *columns, *lines]
        return np.stack([np.bincount(cell, column, BLOCK) for column in samples], axis=1)

    def mark_disturbed(self) -> None:
        """Drop the level: the wheelset hunts, and its motion grew in the level that was open."""
        self._blocks, self._open = [], []
        self._close()

    def open_level(self) -> SpeedLevel | None:
        """Return the level that is still open; None while it is too short or not quiet."""
        blocks = self._quiet_blocks()
        if not blocks:
            return None
        level = self._spectrum(np.concatenate(blocks))
        return level if level.floor > 0.0 else None  # a stuck sensor has no noise at all

    def _spectrum(self, cells: NDArray[np.float64]) -> SpeedLevel:
        """
        Periodogram of a stretch of cells, without trend and known lines.

        The lines that turn with the roller are fitted by their phase, which the encoder gives.
        The others, and without a roller angle all, are fitted where they are strongest within
        their slip, and the bins where they may be are left out. A cell without samples is
        interpolated.
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
            turning = columns[:, 1] * 2.0 / self._diameter
            angle, lines = np.cumsum(turning) * self._cell_s, lines[:, :0]
        place /= place.size
        y = without_lines(y, place, (lines[:, ::2] + 1j * lines[:, 1::2]).T)
        duration = y.size * self._cell_s
        frequency = np.arange(y.size // 2 + 1) / duration
        weight = np.ones_like(frequency)
        roller = abs(float(np.polyfit(place * duration, angle, 1)[0])) / (2.0 * math.pi)
        for shaft in self._shafts:
            slip = shaft.slip_std if known else max(shaft.slip_std, SPEED_STD)
            for order in shaft.orders:
                # A fitted line takes its own bins with it; another is as wide as it may slip.
                line = order * roller
                width = max(3.0 / duration, 2.0 * slip * line) if slip > 0.0 else 1.5 / duration
                weight[np.abs(frequency - line) <= width] = 0.0
                if slip > 0.0:
                    y = without_lines(y, place, [_strongest(y, order * angle, 2.0 * slip)])
        power = np.asarray(np.abs(np.fft.rfft(y)) ** 2 * self._cell_s / y.size, dtype=np.float64)
        above = (frequency > 1.5 * self._band[1]) & (frequency < 2.7 * self._band[1])
        inside = (frequency >= self._band[0]) & (frequency <= self._band[1])
        return SpeedLevel(
            speed=speed,
            duration_s=duration,
            omega=2.0 * np.pi * frequency[inside],
            periodogram=power[inside],
            weight=weight[inside],
            gain=np.sinc(frequency[inside] * self._cell_s) ** 2,
            # The median of exponentially distributed bins is ln 2 times their mean.
            floor=0.0
            if stuck
            else float(np.median(power[above & (weight > 0.0)])) / math.log(2.0),
        )

    def _take_block(self, block: NDArray[np.float64]) -> None:
        """Put the finished block into the open level, or close that and start another."""
        held = block[:, 0] > 0.0
        if held.mean() < FILLED:
            self._close()
            return
        speed = float(block[:, 2].sum() / block[:, 0].sum())
        first = block[: BLOCK // 2]
        before = float(first[:, 2].sum() / max(first[:, 0].sum(), 1.0))
        limit = TOLERANCE * abs(self._speed if self._blocks else speed)
        steady = abs(before - speed) <= limit  # half the change over the block
        if not steady or (self._blocks and abs(speed - self._speed) > limit):
            self._close()
        if not steady or speed <= 0.0:
            return
        if self._skip < self._settle and not self._blocks:
            self._skip += 1
            return
        self._blocks.append(block)
        self._speed += (speed - self._speed) / len(self._blocks)
        if len(self._blocks) >= self._most:
            self._close()
            self._skip = self._settle  # the speed has not changed: nothing to settle

    def _close(self) -> None:
        """End the open level and keep it, if it is long enough and was quiet."""
        level = self.open_level()
        self._blocks = []
        self._speed = 0.0
        self._skip = 0
        if level is None:
            return
        self.closed_s += level.duration_s
        for k, other in enumerate(self.levels):
            near = abs(other.speed - level.speed) <= 0.5 * TOLERANCE * level.speed
            if near and other.omega.size == level.omega.size:
                self.levels[k] = other.merged(level)
                return
        self.levels.append(level)
        if len(self.levels) > MOST_LEVELS:
            self._thin_out()

    def _thin_out(self) -> None:
        """Drop the shorter of the two levels whose speeds are nearest to each other."""
        self.levels.sort(key=lambda level: level.speed)
        steps = np.diff([math.log(level.speed) for level in self.levels])
        k = int(np.argmin(steps))
        first, second = self.levels[k : k + 2]
        del self.levels[k if first.duration_s < second.duration_s else k + 1]

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
