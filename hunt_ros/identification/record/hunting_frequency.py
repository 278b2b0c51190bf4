"""Where the hunting line is: the frequency of the frame in which the envelope is slow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import IdentificationError
from hunt_ros.estimation.record_lines import ForcedLine, Motion, RecordLines, motion_of
from hunt_ros.estimation.spectrum import without_lines
from hunt_ros.identification.record.channels import Channels
from hunt_ros.identification.record.envelope import Envelope, envelope_of
from hunt_ros.identification.record.lines import free_of_lines
from hunt_ros.identification.record.screening import Stretch
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import NANOSECONDS, Record, Series

#: Length of a piece of the search, s: fine enough to tell lines 0.1 Hz apart.
_PIECE_S = 10.24
#: Lines are looked for in so much at least of what there is, s.
_MOST_S = 7200.0
#: The frequency of the power that changes is known to this, relative: the width of its window.
_NEAR = 0.15
#: Samples in a cycle of the first pass, at least.
_COARSE = 40.0


Array = NDArray[np.float64]
#: Power of each frequency of a grid, added up over the pieces of a stretch, and how many.
Power: TypeAlias = tuple[Array, int]


def motion_of_channels(channels: Channels) -> Motion | None:
    """Return the lateral displacement, in which lines are looked for."""
    stamps = channels.start_ns + np.round(channels.time * NANOSECONDS).astype(np.int64)
    values = {'lateral': channels.lateral, 'speed': channels.speed}
    return motion_of(Record({name: Series(stamps, one) for name, one in values.items()}))


def looked_at(stretches: Sequence[Stretch]) -> list[int]:
    """
    Choose the stretches in which lines are looked for.

    Up to two hours all of them. Of more, whose samples together no machine might hold, as many
    evenly by their swing, the largest among them: some at rest, some in between, some that move.

    Returns
    -------
    list of int
        Places, in order.
    """
    every = math.ceil(sum(one.duration_s for one in stretches) / _MOST_S)
    by_swing = sorted(range(len(stretches)), key=lambda k: (-stretches[k].swing, k))
    return sorted(by_swing[:: max(every, 1)])


def frequency_grid(lines: RecordLines, settings: IdentificationSettings) -> Array:
    """Return the frequencies at which the hunting is looked for, Hz."""
    grid = np.arange(*settings.frequency_range_hz, 0.02)
    if lines.hunting_hz is None:
        return grid
    near: Array = grid[np.abs(np.log(grid / lines.hunting_hz)) < _NEAR]
    return near


def strongest(grid: Array, powers: Sequence[Power]) -> float:
    """
    Frequency of the hunting, Hz: of the motion that changes most, or of the strongest line.

    Where all records are steady the strongest line is the limit cycle.

    Parameters
    ----------
    grid : ndarray, shape (n,)
        As `frequency_grid` gives it, Hz.
    powers : sequence of Power
        On it, of each stretch.

    Raises
    ------
    IdentificationError
        If no stretch has a piece that is long enough.
    """
    if not sum(pieces for _, pieces in powers):
        raise IdentificationError('no stretch of the lateral channel is free of drop-outs')
    power = np.zeros(grid.size)
    for one, _ in powers:
        power += one
    return float(grid[int(np.argmax(power))])


def power_on(
    record: Channels,
    grid: Array,
    forced: Sequence[ForcedLine],
    settings: IdentificationSettings,
) -> Power:
    """
    Power of the lateral displacement at the frequencies of a grid.

    Each piece is freed from its trend, from the lines at the roller's own angle where that is
    known, and from lines that are forced; the power of the pieces is added up.

    Parameters
    ----------
    record : Channels
        One stretch.
    grid : ndarray, shape (n,)
        Hz.
    forced : sequence of ForcedLine
        What is not hunting.
    settings : IdentificationSettings
        For the known lines and the range.

    Raises
    ------
    IdentificationError
        If the sampling is too slow for the range.
    """
    low, high = settings.frequency_range_hz
    rate = min(record.rate_hz, 8.0 * high)
    if rate < 4.0 * low:
        raise IdentificationError(
            f'{record.source}: {record.rate_hz:.3g} samples a second are too few for a mode'
            f' of {low:g} Hz'
        )
    power, pieces = np.zeros(grid.size), 0
    length = min(_PIECE_S, 0.9 * float(record.time[-1] - record.time[0]))
    even = np.arange(length * rate) / rate
    window = np.hanning(even.size)
    known = np.isfinite(record.lateral)
    way = np.concatenate([[0.0], np.cumsum(record.speed[1:] * np.diff(record.time))])
    orders = settings.orders if record.roller.size else np.zeros(0)
    for start in np.arange(record.time[0], record.time[-1] - length + 1e-6, 0.5 * length):
        part = slice(*np.searchsorted(record.time, [start, start + length]))
        here, time = known[part], record.time[part]
        if here.sum() < max(0.6 * here.size, 30):
            continue
        piece = np.interp(start + even, time[here], record.lateral[part][here])
        covered = np.interp(start + even, time, way[part])
        angles = [2.0 * np.pi * line.turns(even, covered) for line in forced]
        if orders.size:
            angle = np.interp(start + even, time, record.roller[part])
            angles += [order * angle for order in orders]
        left = window * without_lines(piece, even, np.exp(1j * np.array(angles)), window)
        size = 1 << (math.ceil(math.log2(left.size)) + 2)
        spectrum = np.abs(np.fft.rfft(left, size)) ** 2
        at_grid = np.interp(grid, np.fft.rfftfreq(size, 1.0 / rate), spectrum, right=0.0)
        power += at_grid / left.size**2
        pieces += 1
    return power, pieces


def tracked_envelope(
    record: Channels,
    frequency_hz: float,
    settings: IdentificationSettings,
    forced: Sequence[ForcedLine] = (),
) -> tuple[Envelope, Channels]:
    """
    Envelope in a frame that follows the mode's own frequency.

    The frequency moves with speed and amplitude, Eq. (25). A first pass in a frame of
    constant frequency shows by how much; a second one turns with it, so that the
    window does not weigh the amplitude down.

    Parameters
    ----------
    record : Channels
        The record.
    frequency_hz : float
        First guess.
    settings : IdentificationSettings
        Says which lines of the roller are taken out.
    forced : sequence of ForcedLine
        Others that are.

    Returns
    -------
    envelope : Envelope
    clean : Channels
        The record without the lines.
    """
    # The first pass needs the turning alone: a few dozen samples a cycle show it.
    stride = max(int(record.rate_hz / (_COARSE * frequency_hz)), 1)
    coarse = record.part(slice(None, None, stride))
    constant = np.full(coarse.time.size, frequency_hz)
    first = envelope_of(free_of_lines(coarse, constant, settings.orders, forced)[0], constant)
    offset, along = _frequency_offset(first), np.full(record.time.size, frequency_hz)
    if offset is not None:
        # Never beyond what the first pass could have seen without folding.
        limit = 0.3 / first.step
        along += np.clip(np.interp(record.time, first.time, offset), -limit, limit)
    clean, line_power = free_of_lines(record, along, settings.orders, forced)
    return envelope_of(clean, along, line_power), clean


def _frequency_offset(envelope: Envelope) -> Array | None:
    """Frequency against the frame, Hz, by regression on speed and amplitude squared; (n,)."""
    z, step, speed = envelope.phasor, envelope.step, envelope.speed
    turned = z[1:] * np.conj(z[:-1])
    good = np.isfinite(turned)
    if good.sum() < 6:
        return None
    # One global turn first, so that the rest does not wrap.
    common = float(np.angle(np.sum(turned[good])))
    angle = np.angle(turned[good] * np.exp(-1j * common))
    u = (speed - np.mean(speed)) / max(float(np.ptp(speed)), 1e-9)
    power = np.nan_to_num(np.abs(z) ** 2)
    w = power / max(float(power.max()), 1e-300)
    moves = np.ptp(speed) > 1e-3 * np.mean(np.abs(speed))
    basis = np.stack([np.ones_like(u), *([u, u**2] if moves else []), w, w**2], axis=1)
    root = np.sqrt(np.abs(turned[good]))
    # The ridge keeps columns the record does not move from inventing a frequency.
    ridge = 1e-3 * root.sum() / np.sqrt(root.size) * np.eye(basis.shape[1])
    rows = np.concatenate([0.5 * (basis[1:] + basis[:-1])[good] * root[:, None], ridge])
    wanted = np.concatenate([angle * root, np.zeros(basis.shape[1])])
    offset: Array = common + basis @ np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return offset / (2.0 * np.pi * step)
