"""
The lines along a record, of the roller and others, told apart from the hunting beside them.

The displacement is bias + hunting phasor + a phasor a line, which turns with an angle that is
known: the roller's own, or what follows from time or way. The phasors of the lines change slowly,
those of hunting and bias as a random walk from one knot to the next: a line near the hunting, or
across it, is what turns on evenly for many cycles. All knots of a record are solved for at once,
by generalised least squares. What is far from usual, as at a kick, has the weight of a rare one:
Cauchy's, in iterations (Holland, P. W., Welsch, R. E. (1977), Communications in Statistics A 6,
813-827).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.ndimage import median_filter

from hunt_ros.identification.record.channels import Channels

_F = NDArray[np.float64]

#: Distance of the knots of hunting and bias, in cycles, and how many lie between two of a line.
_KNOT_CYCLES, _EVERY = 1.5, 16
#: Change of the speed, relative, over which the phasor of a line of the roller is one, and knots
#: of which the median shows it.
_MOVED, _STEADY = 0.02, 5
#: Samples in which lines are looked for, at least.
_FEWEST = 40
#: Solved so often, with the weights that follow from the solution before.
_ROUNDS = 4


def free_of_lines(
    channels: Channels,
    frequency: _F,
    orders: _F,
    fixed_hz: Sequence[float] = (),
    turning: Sequence[float] = (),
) -> tuple[Channels, _F]:
    """
    Take lines out of the lateral displacement, and of yaw where there is such a channel.

    Parameters
    ----------
    channels : Channels
        One record.
    frequency : ndarray, shape (n,)
        Of the hunting at each lateral sample, Hz, to a tenth or so.
    orders : ndarray, shape (k,)
        Of those of the roller, in its turns; they count where there is a roller channel.
    fixed_hz : sequence of float
        Of others, at the same frequency at every speed.
    turning : sequence of float
        Of others, in turns of the roller: what they are of is not known.

    Returns
    -------
    channels : Channels
        Without the lines.
    power : ndarray, shape (n,)
        Sum of the squared amplitudes of `orders`, m^2; NaN without a roller channel.
    """
    time, hz = channels.time, float(np.median(frequency))
    known = np.isfinite(channels.lateral)
    steps = np.diff(time, prepend=time[0])
    own = orders.tolist() if channels.roller.size else []
    also = list(turning) if channels.roller.size else []
    turned = [order * channels.roller for order in (*own, *also)]
    turned += [2.0 * np.pi * hz * (time - time[0]) for hz in fixed_hz]
    if not turned or known.sum() < _FEWEST:
        return channels, np.full(time.size, np.nan)
    angles = np.array(turned)
    phase = 2.0 * np.pi * np.cumsum(steps * frequency)
    when, values, turn = (x[known] for x in (time - time[0], channels.lateral, phase))
    step = _KNOT_CYCLES / hz
    knot = ((time - time[0]) / step).astype(np.int64)
    edges = _edges(np.bincount(knot, channels.speed) / np.maximum(np.bincount(knot), 1))
    knots = _phasors(when, values, turn, angles[:, known], step, edges)
    place = edges * step
    phasors = np.array([np.interp(time - time[0], place, size) for size in knots.T])
    shown = (phasors * np.exp(1j * angles)).real.sum(axis=0)
    power = (np.abs(phasors[: len(own)]) ** 2).sum(axis=0) if own else np.full(time.size, np.nan)
    yaw = channels.yaw
    if yaw is not None:
        yaw, _ = free_of_lines(
            yaw, np.interp(yaw.time, time, frequency), orders, fixed_hz, turning
        )
    return replace(channels, lateral=channels.lateral - shown, yaw=yaw), power


def _edges(speed: _F) -> NDArray[np.int64]:
    """
    Knots at which the phasors of the lines are free: closer where the speed changes.

    Parameters
    ----------
    speed : ndarray, shape (n,)
        Its mean from each knot to the next, m/s; 0 where no sample is.
    """
    usual, edges = median_filter(speed, size=_STEADY, mode='nearest'), [0]
    for k in range(1, speed.size + 1):
        moved = abs(usual[min(k, speed.size - 1)] / max(usual[edges[-1]], 1e-9) - 1.0) > _MOVED
        if moved or k - edges[-1] == _EVERY or k == speed.size:
            edges.append(k)
    return np.array(edges)


def _phasors(
    time: _F, values: _F, phase: _F, angles: _F, step: float, edges: NDArray[np.int64]
) -> NDArray[np.complex128]:
    """Solve for the phasors of the lines at their knots `edges`: shape (cells + 1, k)."""
    cells, count = edges.size - 1, int(edges[-1])
    knot = np.minimum((time / step).astype(np.int64), count - 1)
    seen = np.maximum(np.bincount(knot, minlength=count), 1)
    # A value reads hunting and bias at the two knots about it, the lines at the ends of its cell.
    cell = np.repeat(np.arange(cells), np.diff(edges))
    near = time / step - knot
    far = (time / step - edges[cell][knot]) / np.diff(edges)[cell][knot]
    mode = [np.cos(phase), -np.sin(phase), np.ones(time.size)]
    turning = [part(angle) for angle in angles for part in (np.cos, np.sin)]
    sides = (1.0 - near, mode), (near, mode), (1.0 - far, turning), (far, turning)
    basis = [share * wave for share, waves in sides for wave in waves]
    # Lines stand before the hunting of their cell, so that the equations are a narrow band.
    k, lines = np.arange(count + 1), np.arange(len(turning))
    lines = (3 * edges + lines.size * np.arange(cells + 1))[:, None] + lines
    hunting = (3 * k + len(turning) * np.append(cell + 1, cells + 1))[:, None] + np.arange(3)
    places = np.hstack([hunting[:-1], hunting[1:], lines[cell], lines[cell + 1]]).T
    size, width = int(hunting[-1, -1]) + 1, 3 * (_EVERY + 1) + 2 * len(turning)
    one, other = np.triu_indices(len(basis))
    entries = np.abs(places[one] - places[other]) * size + np.minimum(places[one], places[other])
    # What the values of each interval add to the equations, whatever their weight.
    squares = np.array(
        [np.bincount(knot, basis[a] * basis[b], count) for a, b in zip(one, other, strict=True)]
    )
    moments = np.array([np.bincount(knot, column * values, count) for column in basis])
    start = np.full(count, 1e-3 * time.size / count)
    weights, loose = np.ones(count), start
    for _ in range(_ROUNDS):
        summed = np.bincount(entries.ravel(), (weights * squares).ravel(), width * size)
        band = np.asarray(summed, dtype=np.float64).reshape(width, size)
        right = np.bincount(places.ravel(), (weights * moments).ravel(), size)
        for part in hunting.T:
            _tie(band, part, loose)
        for part in lines.T:
            _tie(band, part, np.full(cells, float(np.median(loose))))
        # What cannot be told from bias or hunting at all, as of a roller that stands, is no line.
        band[0, lines] += 1e-3 * start[0]
        found = solveh_banded(band, right, lower=True)
        left = values - sum(wave * found[at][knot] for wave, at in zip(basis, places, strict=True))
        # Within what rounding leaves to be told.
        noise = np.bincount(knot, left**2, count) / seen
        usual = max(float(np.median(noise)), 1e-12 * float(np.mean(values**2)), 1e-300)
        weights = usual / (usual + noise)
        steps = np.square(np.diff(found[hunting[:, :2]], axis=0)).sum(axis=1)
        steps += median_filter(steps, size=_EVERY + 1)
        loose = np.clip(usual / np.maximum(steps, 1e-300), 1e-5 * start, 1e5 * start)
    sizes: NDArray[np.complex128] = found[lines[:, 0::2]] - 1j * found[lines[:, 1::2]]
    return sizes


def _tie(band: _F, places: NDArray[np.int64], weights: _F) -> None:
    """Add the squared differences of neighbouring unknowns, weighted, to the equations."""
    here, after = places[:-1], places[1:]
    np.add.at(band[0], here, weights)
    np.add.at(band[0], after, weights)
    band[after - here, here] -= weights
