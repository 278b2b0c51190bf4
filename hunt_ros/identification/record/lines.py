"""
The lines of the roller along a record, told apart from the hunting beside them.

The displacement is bias + hunting phasor + a phasor a line, which turns with the roller's own
angle. The phasors of the lines change slowly, those of hunting and bias as a random walk from one
knot to the next: a line near the hunting, or across it, is what turns on evenly with the roller
for many cycles. All knots of a record are solved for at once (generalised least squares). A step
of the hunting that is far from usual, as after a kick, has the weight of a rare one (Holland,
P. W., Welsch, R. E. (1977), Commun. Stat. A 6, 813-827: iteratively reweighted, Cauchy).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.ndimage import median_filter

from hunt_ros.compiled import F1, F2, R1, compiled
from hunt_ros.identification.record.channels import Channels

_F = NDArray[np.float64]

#: Distance of the knots of hunting and bias, in cycles, and how many lie between two of a line.
_KNOT_CYCLES, _EVERY = 1.5, 16
#: Solved so often, with the weights that follow from the solution before.
_ROUNDS = 4


def free_of_lines(channels: Channels, frequency: _F, orders: _F) -> tuple[Channels, _F]:
    """
    Take the lines of the roller out of the lateral displacement.

    Parameters
    ----------
    channels : Channels
        One record.
    frequency : ndarray, shape (n,)
        Of the hunting at each lateral sample, Hz, to a tenth or so.
    orders : ndarray, shape (k,)
        Of the lines, in turns of the roller.

    Returns
    -------
    channels : Channels
        Without the lines, or as they were without a roller channel.
    power : ndarray, shape (n,)
        Sum of the squared amplitudes of the lines, m^2; NaN without a roller channel.
    """
    time = channels.time
    if not channels.roller.size or not orders.size:
        return channels, np.full(time.size, np.nan)
    step = _KNOT_CYCLES / float(np.median(frequency))
    cells = max(int(np.ceil((time[-1] - time[0]) / (_EVERY * step))), 1)
    phase = 2.0 * np.pi * np.cumsum(np.diff(time, prepend=time[0]) * frequency)
    arrays = map(np.ascontiguousarray, (time, channels.lateral, phase, channels.roller, orders))
    lines, hunting, width = _places(cells, orders.size)
    size = int(hunting[-1, -1]) + 1
    band, right = np.zeros((width, size)), np.zeros(size)
    power = _normal_equations(*arrays, step, band, right)
    samples = max(int(np.isfinite(channels.lateral).sum()), 1)
    start = np.full(len(hunting) - 1, 1e-3 * samples / len(hunting))
    loose = start
    found = np.zeros(size)
    for _ in range(_ROUNDS):
        tied = band.copy()
        for part in hunting.T:
            _tie(tied, part, loose)
        for part in lines.T:
            _tie(tied, part, np.full(cells, float(np.median(loose))))
        found = solveh_banded(tied, right, lower=True)
        left = max(power - float(found @ right), 1e-12 * power) / samples
        steps = (np.diff(found[hunting[:, :2]], axis=0) ** 2).sum(axis=1)
        usual = steps + median_filter(steps, size=_EVERY + 1)
        # Within what rounding leaves to be told.
        loose = np.clip(left / np.maximum(usual, 1e-300), 1e-5 * start, 1e5 * start)
    place = (time - time[0]) / (_EVERY * step)
    sizes = [np.interp(place, np.arange(cells + 1), part) for part in found[lines].T]
    phasors = np.array(sizes[0::2]) - 1j * np.array(sizes[1::2])
    shown = (phasors * np.exp(1j * orders[:, None] * channels.roller)).real.sum(axis=0)
    total: _F = (np.abs(phasors) ** 2).sum(axis=0)
    return replace(channels, lateral=channels.lateral - shown), total


def _places(cells: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Return where the knots of the lines and of the hunting stand, and how far apart they act."""
    k = np.arange(cells * _EVERY + 1)
    hunting = 3 * k + 2 * count * (k // _EVERY + 1)
    lines = (3 * _EVERY + 2 * count) * np.arange(cells + 1)
    width = 3 * _EVERY + 4 * count + 3
    return lines[:, None] + np.arange(2 * count), hunting[:, None] + np.arange(3), width


def _tie(band: _F, places: NDArray[np.int64], weights: _F) -> None:
    """Add the squared differences of neighbouring unknowns, weighted, to the equations."""
    here, after = places[:-1], places[1:]
    np.add.at(band[0], here, weights)
    np.add.at(band[0], after, weights)
    band[after - here, here] -= weights


@compiled
def _normal_equations(
    time: R1, values: R1, phase: R1, roller: R1, orders: R1, step: float, band: F2, right: F1
) -> float:
    """Fill in the lower band of the normal equations; return the sum of the squared values."""
    lines = 2 * orders.size
    block = 3 * _EVERY + lines
    cells = (right.size - 3 - lines) // block
    total = 0.0
    places = np.zeros(6 + 2 * lines, dtype=np.int64)
    basis = np.zeros(6 + 2 * lines)
    for i in range(time.size):
        y = values[i]
        if not np.isfinite(y):
            continue
        x = (time[i] - time[0]) / step
        knot = min(int(x), cells * _EVERY - 1)
        cell = knot // _EVERY
        near, far = x - knot, x / _EVERY - cell
        waves = (np.cos(phase[i]), -np.sin(phase[i]), 1.0)
        for side in range(2):
            share = near if side else 1.0 - near
            at = 3 * (knot + side) + lines * ((knot + side) // _EVERY + 1)
            for c in range(3):
                places[3 * side + c] = at + c
                basis[3 * side + c] = share * waves[c]
            share = far if side else 1.0 - far
            for h in range(orders.size):
                k = 6 + lines * side + 2 * h
                places[k] = block * (cell + side) + 2 * h
                places[k + 1] = places[k] + 1
                basis[k] = share * np.cos(orders[h] * roller[i])
                basis[k + 1] = share * np.sin(orders[h] * roller[i])
        for a in range(places.size):
            right[places[a]] += basis[a] * y
            for b in range(places.size):
                if places[a] >= places[b]:
                    band[places[a] - places[b], places[b]] += basis[a] * basis[b]
        total += y * y
    return total
