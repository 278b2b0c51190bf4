"""Kicks: where the envelope moved as no growth law moves it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from hunt_ros.estimation.spectrum import without_lines
from hunt_ros.identification.record.channels import Channels, runs
from hunt_ros.identification.record.envelope import WINDOW_CYCLES, Envelope, window_weight

#: A kick leaves a jump in its window: a residual this many times the usual one, and this
#: share of the amplitude. It only spares the other windows the likelihoods, which decide: that of
#: some hundred samples is off by a tenth, and a step that is told at all stands out more.
_JUMP_NOISE = 1.5
_JUMP_SHARE = 0.04
#: Powers of time that smooth growth of the phasor has in a window, at most: a limit cycle reached
#: from a third of it within one window has four. And places where a step is looked for.
_SMOOTH_ORDER, _STEP_PLACES = 4, 15


def find_kicks(channels: Channels, envelope: Envelope) -> NDArray[np.bool_]:
    """
    Instants at which the amplitude changed as no growth law changes it.

    A window that leaves much over holds a kick where a step of the phasor is likelier than
    smooth growth, however fast.

    Parameters
    ----------
    channels : Channels
        One record, free of lines.
    envelope : Envelope
        Its hunting component.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where the window holds a kick.
    """
    amplitude, residual = envelope.amplitude, envelope.residual
    kicked = np.zeros(amplitude.size, dtype=bool)
    known = np.isfinite(residual)
    usual = float(np.median(residual[known]))
    jump = known & (np.nan_to_num(residual) > _JUMP_NOISE * usual)
    jump &= np.nan_to_num(residual) > _JUMP_SHARE * np.nan_to_num(amplitude)
    # Not where noise has grown for good (a worn sensor), but where it stands out.
    around = median_filter(np.where(known, residual, usual), size=15, mode='nearest')
    jump &= np.nan_to_num(residual) > 2.0 * around
    limit = math.log(amplitude.size)
    for first, last in runs(jump):
        ratios = (step_ratio(channels, envelope, k) for k in range(first, last))
        if max(ratios) > limit:
            kicked[max(first - 1, 0) : last + 1] = True
    return kicked


def step_ratio(channels: Channels, envelope: Envelope, k: int) -> float:
    """
    Log likelihood of a step of the phasor in a window, less that of smooth growth.

    Parameters
    ----------
    channels : Channels
        One record, free of lines.
    envelope : Envelope
        Its hunting component.
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
    if y.size < 2 * (_SMOOTH_ORDER + 1) + 6:
        return -math.inf
    x = (time - envelope.time[k]) / half
    root = np.sqrt(window_weight(x))
    turning = np.exp(2j * np.pi * envelope.frequency[k] * (time - envelope.time[k]))
    growth = [x**n * turning for n in range(_SMOOTH_ORDER + 1)]

    def left(*waves: NDArray[np.complex128]) -> float:
        """Return the power that these waves leave."""
        rest = root * without_lines(y, x, waves, root)
        return max(float(rest @ rest), 1e-300)

    places = np.linspace(-0.7, 0.7, _STEP_PLACES)
    stepped = min(left(*growth[:2], (x > at) * turning) for at in places)
    # The step has its two parts and its place; growth its powers beyond the first.
    return min(
        0.5 * y.size * math.log(left(*growth[: order + 1]) / stepped)
        - 0.5 * (3 - 2 * (order - 1)) * math.log(y.size)
        for order in range(1, _SMOOTH_ORDER + 1)
    )
