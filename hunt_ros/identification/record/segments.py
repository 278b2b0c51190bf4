"""
What a record is made of, found by itself: holds of the speed, kicks, steady tails.

Each function looks at one trace and knows nothing of the others; `plateaus` puts what
they find together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from hunt_ros.analysis.steady_state import standard_error
from hunt_ros.identification.record.channels import Channels
from hunt_ros.identification.record.envelope import WINDOW_CYCLES, Envelope
from hunt_ros.samples import key

Kind = Literal['plateau', 'ramp', 'kick', 'transient', 'gap']

#: A kick leaves a jump in its window: a residual this many times the usual one, and this
#: share of the amplitude. It only spares the other windows the likelihoods, which decide: that of
#: some hundred samples is off by a tenth, and a step that is told at all stands out more.
_JUMP_NOISE = 1.5
_JUMP_SHARE = 0.04
#: Powers of time that smooth growth of the phasor has in a window, at most: a limit cycle reached
#: from a third of it within one window has four. And places where a step is looked for.
_SMOOTH_ORDER, _STEP_PLACES = 4, 15


@dataclass(frozen=True)
class Segment:
    """
    One stretch of a record.

    Parameters
    ----------
    kind : 'plateau', 'ramp', 'kick', 'transient' or 'gap'
    source : str
    start_ns, end_ns : int
    speed_start, speed_end : float
        m/s.
    used : bool
    reason : str
        What it was used for, or why it was dropped.
    growth_rate, growth_rate_std : float
        Mean d ln A / dt of a transient below half its largest amplitude, 1/s; NaN else.
    """

    kind: Kind
    source: str
    start_ns: int
    end_ns: int
    speed_start: float = field(metadata=key('speed_start_mps'))
    speed_end: float = field(metadata=key('speed_end_mps'))
    used: bool
    reason: str
    growth_rate: float = field(default=math.nan, metadata=key('growth_rate_per_s'))
    growth_rate_std: float = field(default=math.nan, metadata=key('growth_rate_std_per_s'))


def speed_holds(
    time: NDArray[np.float64], speed: NDArray[np.float64], shortest_s: float
) -> list[tuple[int, int]]:
    """
    Stretches at one speed.

    Parameters
    ----------
    time, speed : ndarray, shape (n,)
        s, m/s.
    shortest_s : float
        Shortest stretch that counts.

    Returns
    -------
    list of (int, int)
        First index and one past the last, in order, not overlapping.
    """
    if time.size < 2:
        return []
    jitter = 1.4826 * float(np.median(np.abs(np.diff(speed)))) / math.sqrt(2.0)
    tolerance = max(0.004 * float(np.median(np.abs(speed))), 4.0 * min(jitter, 0.05))
    holds: list[tuple[int, int]] = []
    start = 0
    while start < time.size - 1:
        low = high = speed[start]
        end = start + 1
        while end < time.size:
            low, high = min(low, speed[end]), max(high, speed[end])
            if high - low > 2.0 * tolerance:
                break
            end += 1
        if time[end - 1] - time[start] >= shortest_s and not _drifts(
            time[start:end], speed[start:end], tolerance
        ):
            holds.append((start, end))
            start = end
        else:
            start += 1
    return holds


def _drifts(time: NDArray[np.float64], speed: NDArray[np.float64], tolerance: float) -> bool:
    """Whether the speed runs through its whole tolerance: a slow ramp, not a hold."""
    slope = float(np.polyfit(time - time[0], speed, 1)[0])
    return abs(slope) * float(time[-1] - time[0]) > 1.5 * tolerance


def find_kicks(
    channels: Channels, envelope: Envelope, orders: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """
    Instants at which the amplitude changed as no growth law changes it.

    A window that leaves much over holds a kick where a step of the phasor is likelier than
    smooth growth, however fast.

    Parameters
    ----------
    channels : Channels
        One record.
    envelope : Envelope
        Its hunting component.
    orders : ndarray, shape (k,)
        Known lines, in turns of the roller.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where the window holds a kick.
    """
    amplitude, residual = envelope.amplitude, envelope.residual
    kicked = np.zeros(amplitude.size, dtype=bool)
    known = np.isfinite(residual)
    if known.sum() < 4:
        return kicked
    usual = float(np.median(residual[known]))
    jump = known & (np.nan_to_num(residual) > _JUMP_NOISE * usual)
    jump &= np.nan_to_num(residual) > _JUMP_SHARE * np.nan_to_num(amplitude)
    # Not where noise has grown for good (a worn sensor), but where it stands out.
    around = median_filter(np.where(known, residual, usual), size=15, mode='nearest')
    jump &= np.nan_to_num(residual) > 2.0 * around
    limit = math.log(amplitude.size)
    for first, last in runs(jump):
        ratios = (step_ratio(channels, envelope, orders, k) for k in range(first, last))
        if max(ratios) > limit:
            kicked[max(first - 1, 0) : last + 1] = True
    return kicked


def step_ratio(
    channels: Channels, envelope: Envelope, orders: NDArray[np.float64], k: int
) -> float:
    """
    Log likelihood of a step of the phasor in a window, less that of smooth growth.

    Parameters
    ----------
    channels : Channels
        One record.
    envelope : Envelope
        Its hunting component.
    orders : ndarray, shape (m,)
        Known lines, in turns of the roller.
    k : int
        Number of the window.

    Returns
    -------
    float
        -inf where the window has too few samples.

    References
    ----------
    Willsky, A. S., Jones, H. L. (1976), IEEE Trans. Autom. Control 21, 108-115: generalised
    likelihood ratio of a jump; Schwarz, G. (1978), Ann. Statist. 6, 461-464: its cost in
    parameters.
    """
    half = 0.5 * WINDOW_CYCLES / float(np.median(envelope.frequency))
    low, high = np.searchsorted(channels.time, envelope.time[k] + half * np.array([-1.0, 1.0]))
    time, y = channels.time[low:high], channels.lateral[low:high]
    good = np.isfinite(y)
    time, y = time[good], y[good]
    lines = orders if channels.roller.size else np.zeros(0)
    count = 1 + 2 * (_SMOOTH_ORDER + 1) + 2 * lines.size
    if y.size < count + 4:
        return -math.inf
    x = (time - envelope.time[k]) / half
    root = np.sqrt(0.42 + 0.5 * np.cos(np.pi * x) + 0.08 * np.cos(2.0 * np.pi * x))
    phase = 2.0 * np.pi * envelope.frequency[k] * (time - envelope.time[k])
    turning = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    common = [np.ones((y.size, 1))]
    if lines.size:
        angle = channels.roller[low:high][good][:, None] * lines
        common += [np.cos(angle), np.sin(angle)]
    powers = [x[:, None] ** n * turning for n in range(_SMOOTH_ORDER + 1)]
    stepped = min(
        _left(root, y, [*common, *powers[:2], (x[:, None] > at) * turning])
        for at in np.linspace(-0.7, 0.7, _STEP_PLACES)
    )

    def ratio(order: int) -> float:
        # The step has its two parts and its place; growth its powers beyond the first.
        spent = 0.5 * (3 - 2 * (order - 1)) * math.log(y.size)
        smooth = _left(root, y, [*common, *powers[: order + 1]])
        return 0.5 * y.size * math.log(smooth / stepped) - spent

    return min(ratio(order) for order in range(1, _SMOOTH_ORDER + 1))


def _left(
    root: NDArray[np.float64], y: NDArray[np.float64], columns: list[NDArray[np.float64]]
) -> float:
    """Weighted sum of squares that columns leave over of samples."""
    basis = np.concatenate(columns, axis=1) * root[:, None]
    wanted = root * y
    left = wanted - basis @ np.linalg.lstsq(basis, wanted, rcond=None)[0]
    return max(float(left @ left), 1e-300)


def steady_part(amplitude: NDArray[np.float64], least: int) -> slice | None:
    """
    Longest tail over which the amplitude does not drift.

    Parameters
    ----------
    amplitude : ndarray, shape (n,)
        m, free of NaN.
    least : int
        Fewest instants that count.

    Returns
    -------
    slice or None
        None where it drifts to the very end.
    """
    n = amplitude.size
    start = 0
    while n - start >= least:
        tail = amplitude[start:]
        third = max(tail.size // 3, 2)
        drift = abs(float(tail[-third:].mean() - tail[:third].mean()))
        # The error is that of the second half, or an approach would excuse itself.
        half = tail[tail.size // 2 :]
        x = np.linspace(-0.5, 0.5, half.size)
        level = half - half.mean() - x * float(x @ half / (x @ x))
        error = standard_error(level)
        error = 2.0 * error if math.isfinite(error) else 0.0
        if drift <= max(2.5 * error, 0.01 * float(tail.mean())):
            return slice(start, n)
        start += max(1, (n - start) // 10)
    return None


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and one past the last index of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
