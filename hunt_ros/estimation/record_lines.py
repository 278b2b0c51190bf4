"""
The lines in the displacement of whole records: which one hunts, and which are forced.

Hunting is a mode: it is excited, grows and decays, and its amplitude changes. A forced line
follows the speed, as all does that turns, or it is the same at every speed, as hum and motors
are. So the hunting is where the power of the displacement changes most, and the line is not
forced. Records that are steady throughout do not tell it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.record_motion import GRID, LONG, WINDOW, Motion

_F = NDArray[np.float64]

#: Where wheelsets hunt, Hz.
HUNTING_HZ = (0.5, 10.0)
#: A line stands so many times (power) above the middle of its surroundings, which reach from
#: `1 / _AROUND` to `_AROUND` of its frequency: noise, once smoothed by the window, does not.
_CLEAR, _AROUND = 10.0, 2.0
#: Share of the power of a forced line that changes, at most: an amplitude within 10 %.
_STEADY = 0.01
#: A line follows the speed where its power against the way is so many times that against time:
#: at one speed both are the same.
_FOLLOWS = 1.2
#: ... and where the speeds at which its power is found are so far apart (standard deviation,
#: relative): half the width of the window, so that what stays at one frequency leaves it.
_APART = 0.04
#: So near to a line that was taken out, relative, what stands out is the rest of it.
_LEFT = 0.12
#: A line is a known one if their orders differ by less than this, relative.
_SAME = 0.05
#: Share of the time at which a forced line may be weaker than its `lasting` power says: it is
#: there always, so that it is seen beside hunting that is stronger for most of the time.
_WEAKER = 0.2
#: Where the middles of the lower and the upper third of the speeds differ by this, relative, a
#: line whose amplitudes there differ by less than the other is no limit cycle, which grows
#: with about the root of the speed.
_FASTER, _SAME_SIZE = 0.1, 0.02
#: What is at 80 % of the time more than so many times what it is at 20 % is hunting whose
#: frequency follows the speed, as that of wheelsets does: no wheel that turns has a line that
#: grows so.
_GROWS = 10.0
#: What turns goes on at its pace: over so many periods, at which the window has forgotten noise to
#: e^-1, the phase of a line advances alike. The mean resultant length of these steps is 1, for
#: motion that noise drives 0.3.
_PACE, _EVEN = 2.0 * WINDOW, 0.7
#: Kinds of the power of a line.
_MEAN, _CHANGING, _LASTING = range(3)


@dataclass(frozen=True)
class ForcedLine:
    """
    A line that is not hunting.

    Parameters
    ----------
    turns_per_metre : float
        Cycles in a metre of way, 1/m; NaN for a line that stays at one frequency.
    frequency_hz : float
        Of a line that stays at it, Hz; NaN for one that follows the speed.
    """

    turns_per_metre: float = math.nan
    frequency_hz: float = math.nan

    def words(self, roller: float = math.nan) -> str:
        """
        Return the line in words.

        Parameters
        ----------
        roller : float
            Turns of the roller in a metre of way, 1/m; NaN where they are not known.
        """
        if math.isfinite(self.frequency_hz):
            return (
                f'line at {self.frequency_hz:.3g} Hz: forced, not hunting'
                ' (neither speed nor time changes it)'
            )
        if math.isfinite(roller):
            times = self.turns_per_metre / roller
            return f"line at {times:.3g} times the roller's turn: forced, not hunting"
        return (
            f'line at {self.turns_per_metre:.3g} v Hz: forced, not hunting (it follows the speed)'
        )


class _Side:
    """
    Records beside each other, all even in time or all in way: the power of each line of the grid.

    Parameters
    ----------
    motions : sequence of Motion
    unit : float
        What a cycle of the motions is in those of the grid, which are Hz.

    Attributes
    ----------
    powers : ndarray, shape (lines, 3)
        By line of the grid, see `power`.
    """

    def __init__(self, motions: Sequence[Motion], unit: float = 1.0) -> None:
        self.motions, self._unit = motions, unit
        self.powers = np.array([self.power(one / unit) for one in GRID.tolist()])

    def power(self, line: float, width: float = WINDOW) -> _F:
        """
        Return the power of a line in all records, m^2, shape (3,).

        That of its mean amplitude, what is more than that, and what lasts.
        """
        amplitude, _ = self.amplitudes(line, width)
        known = amplitude[np.isfinite(amplitude)]
        if known.size < 2:
            return np.zeros(3)
        lasting = np.quantile(known, _WEAKER) ** 2
        return 0.5 * np.array([known.mean() ** 2, known.var(), lasting])

    def amplitudes(self, line: float, width: float = WINDOW) -> tuple[_F, _F]:
        """Return amplitude, m, NaN in gaps, and speed of a line in all records, in a row."""
        lines = [motion.line(line, width) for motion in self.motions]
        phasor, speed = (np.concatenate([np.zeros(0), *(one[k] for one in lines)]) for k in (2, 3))
        return np.abs(phasor), speed

    def evenness(self, line: float) -> float:
        """Return the mean resultant length of the steps of a line's phase, 0 to 1."""
        even, count = 0.0, 0
        for motion in self.motions:
            _, step, phasor, _ = motion.line(line)
            lag = max(round(_PACE / (line * step)), 1)
            angle = np.angle(phasor[lag:] * np.conj(phasor[:-lag]))
            angle = angle[np.isfinite(angle)]
            even, count = even + abs(complex(np.exp(1j * angle).sum())), count + angle.size
        return even / max(count, 1)

    def take_out(self, known: list[float], width_of: Callable[[float, float], float]) -> bool:
        """
        Find forced lines among the peaks of the lasting power, and take them out.

        `width_of` a line and its power is that of its window, 0 where it is not forced; what is
        left of the known ones is none. Returns False if there is none.
        """
        found, lasting = [], self.powers[:, _LASTING]
        for place in _lines(lasting):
            line = _between(lasting, place) / self._unit
            if not any(abs(math.log(line / one)) < _LEFT for one in known) and (
                width := width_of(line, float(lasting[place]))
            ):
                found.append(self._exact(line, width))
        for line in found:
            for motion in self.motions:
                motion.remove(line)
        known += found
        return bool(found)

    def _exact(self, line: float, width: float) -> float:
        """Return the frequency of a line by how its phasors turn, in cycles of the motions."""
        found, weight = 0.0, 0.0
        for motion in self.motions:
            centre, step, phasor, _ = motion.line(line, width)
            # Each period counts alike: where hunting passes through the line it is the larger one.
            angle = np.angle(phasor[1:] * np.conj(phasor[:-1]))
            turn = complex(np.exp(1j * angle[np.isfinite(angle)]).sum())
            turns = math.atan2(turn.imag, turn.real) / (2.0 * math.pi)
            found += abs(turn) * (centre + turns / step)
            weight += abs(turn)
        return found / weight if weight > 0.0 else line


def _is_steady(power: _F) -> bool:
    """Return True if the amplitude of a line does not change."""
    return bool(power[_CHANGING] < _STEADY * power[:_LASTING].sum())


class RecordLines:
    """
    The lines of the displacement in records of one rig: which one hunts, which are forced.

    Parameters
    ----------
    motions : sequence of Motion or None
        Of the records; None says nothing.
    hunting_hz : tuple of float
        Where the hunting is looked for, Hz.
    known : sequence of float
        Lines that are known, in turns in a metre of way: that these follow the speed need not
        be seen.

    Notes
    -----
    A line that is found forced is taken out, and the rest looked at again: it does not hide
    the others.
    """

    def __init__(
        self,
        motions: Sequence[Motion | None],
        hunting_hz: tuple[float, float] = HUNTING_HZ,
        known: Sequence[float] = (),
    ) -> None:
        self._range = hunting_hz
        self._known = known
        self._time = _Side([motion for motion in motions if motion is not None])
        self._fixed: list[float] = []
        self._orders: list[float] = []
        while self._find_fixed() or self._find_orders():
            self._time = _Side(self._time.motions)

    @property
    def hunting_hz(self) -> float | None:
        """Frequency of the mode whose power changes most, Hz; None where all is steady."""
        powers = self._time.powers
        changing = powers[:, _CHANGING]
        for place, frequency in self._in_range(changing, _CLEAR):
            return None if _is_steady(powers[place]) else frequency
        return None

    @property
    def strongest_hz(self) -> float | None:
        """
        Frequency of the hunting, Hz, also where all is steady; None where nothing is seen.

        Where all is steady the strongest line that is none of the known ones is the limit cycle.
        """
        lines = self._in_range(self._time.powers[:, _MEAN], 0.0)
        unknown = (hz for _, hz in lines if not self._is_known(hz / self._speed))
        return self.hunting_hz or next(unknown, None)

    def _in_range(self, power: _F, clear: float) -> Iterator[tuple[int, float]]:
        """Give place and frequency, Hz, of the lines where hunting is looked for."""
        for place in _lines(power, clear):
            frequency = _between(power, place)
            if self._range[0] <= frequency <= self._range[1]:
                yield place, frequency

    @property
    def _speed(self) -> float:
        """Median of the speeds, m/s; NaN where none is known."""
        speeds = [float(np.median(motion.speed)) for motion in self._time.motions]
        return float(np.median(speeds)) if speeds else math.nan

    def forced(self) -> list[ForcedLine]:
        """Return the forced lines: those that follow the speed, then those of one frequency."""
        found = [ForcedLine(turns_per_metre=order) for order in self._orders]
        return found + [ForcedLine(frequency_hz=frequency) for frequency in self._fixed]

    def unknown(self) -> list[ForcedLine]:
        """Return those of the forced lines that are none of the known ones."""
        # At one speed a known line is at one frequency.
        return [
            line
            for line in self.forced()
            if not self._is_known(line.turns_per_metre)
            and not self._is_known(line.frequency_hz / self._speed)
        ]

    def _is_known(self, order: float) -> bool:
        return any(abs(order / one - 1.0) < _SAME for one in self._known)

    def _find_fixed(self) -> bool:
        """Find the lines of one frequency, and take them out; return False if there is none."""

        def width(line: float, _: float) -> float:
            """Return the width of the window by which a line stays as it is; 0: by none."""
            return next((one for one in (WINDOW, LONG) if self._stays(line, one)), 0.0)

        return self._time.take_out(self._fixed, width)

    def _find_orders(self) -> bool:
        """Find those that follow the speed, and take them out; return False if there is none."""
        motions = self._time.motions
        ways = [motion.by_way() for motion in motions]
        known = [way for way in ways if way is not None]
        if not known:
            return False
        # What a frequency of the grid is in way, with one mean speed of all records.
        side = _Side(known, GRID[0] / float(np.mean([way.lowest for way in known])))
        speed = np.concatenate([way.speed for way in known])
        slow, fast = np.percentile(speed, [1.0, 99.0]) * (0.95, 1.05)

        def width(line: float, power: float) -> float:
            """Return the width of the window if a line is that of something that turns, else 0."""
            # Over time it would be somewhere between these, or beside them.
            first, last = np.searchsorted(GRID, [slow * line, fast * line])
            others = self._time.powers[max(int(first) - 1, 0) : int(last) + 1, _LASTING]
            clear = power > _FOLLOWS * others.max()
            return WINDOW if clear and self._turns(side, line) else 0.0

        found = side.take_out(self._orders, width)
        if found:
            self._time.motions = [
                motion if way is None else motion.by_time(way)
                for motion, way in zip(motions, ways, strict=True)
            ]
        return found

    def _turns(self, side: _Side, order: float) -> bool:
        """
        Return True if a line, cycles a metre, is of something that turns.

        It is seen at speeds between which it must move, and is no hunting of the kinematic
        wavelength (Klingel, 1883): at rest noise drives that at no pace, and it grows out of the
        quiet motion and dies out again.
        """
        if self._is_known(order):
            return True
        amplitude, speed = side.amplitudes(order)
        known = np.isfinite(amplitude) & np.isfinite(speed)
        weight = amplitude[known] ** 2
        if not weight.sum() > 0.0 or side.evenness(order) < _EVEN:
            return False
        low, high = np.quantile(amplitude[known], [_WEAKER, 1.0 - _WEAKER])
        if high > _GROWS * low:
            return False
        mean = float(np.average(speed[known], weights=weight))
        apart = math.sqrt(float(np.average((speed[known] - mean) ** 2, weights=weight)))
        return apart > _APART * mean

    def _stays(self, frequency: float, width: float) -> bool:
        """Return True if a line is the same always, also where a limit cycle would not be."""
        if not _is_steady(self._time.power(frequency, width)):
            return False
        if not self._range[0] <= frequency <= self._range[1]:
            return True
        amplitude, speed = self._time.amplitudes(frequency, width)
        known = np.isfinite(amplitude) & np.isfinite(speed)
        if known.sum() < 3:
            return False
        low, high = np.quantile(speed[known], [1.0 / 3.0, 2.0 / 3.0])
        slow, fast = known & (speed <= low), known & (speed >= high)
        if not np.median(speed[fast]) > (1.0 + _FASTER) * np.median(speed[slow]):
            return False
        change = float(np.mean(amplitude[fast]) / np.mean(amplitude[slow])) - 1.0
        return abs(change) < _SAME_SIZE


def _between(power: _F, place: int) -> float:
    """Return the frequency of a peak by the parabola through its three points, Hz."""
    left, top, right = np.log(np.maximum(power[place - 1 : place + 2], 1e-300)).tolist()
    bend = left - 2.0 * top + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    ratio = float(GRID[1] / GRID[0])
    return float(GRID[place] * ratio ** min(max(shift, -0.5), 0.5))


def _lines(power: _F, clear: float = _CLEAR) -> Iterator[int]:
    """Give the places of the lines, peaks that are clear of their surroundings, largest first."""
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    for place in peaks[np.argsort(-power[peaks])].tolist():
        around = (GRID[place] / _AROUND < GRID) & (GRID[place] * _AROUND > GRID) & (power > 0)
        if power[place] > clear * float(np.median(power[around])):
            yield place
