"""
The beat between hunting and the roughness line, taken out of the envelope.

The cubic restoring force mixes a roughness line at f_r with a limit cycle at f_h into a
line at f_r - 2 f_h. It lies beside f_h, and on f_h itself where f_r = 3 f_h (8 m/s on the
paper's rig): there roughness of 30 um moves the amplitude of the limit cycle by 2 %. Its
phase is known, theta - 3 phi, so that it can be fitted and removed wherever it turns.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.identification.envelope import Envelope

#: Half the span of the local fit, in steps of the envelope.
_REACH = 12
#: Share of a limit cycle's amplitude above which the beat matters.
_LARGE = 0.4
#: Share of the beat's power that must be left beside a parabola to tell the two apart.
_TELL = 0.35


def without_beat(envelope: Envelope) -> Envelope:
    """
    Remove the beat from the amplitude, and drop limit cycles locked to it.

    Parameters
    ----------
    envelope : Envelope
        With the roller angle; without one it is handed back as it is.

    Returns
    -------
    Envelope
        With a corrected `phasor`; NaN where a limit cycle and the beat turn together.
    """
    if not np.isfinite(envelope.roller).any():
        return envelope
    amplitude = envelope.amplitude
    known = np.isfinite(amplitude)
    if known.sum() < 2 * _REACH:
        return envelope
    large = known & (amplitude > _LARGE * float(np.nanpercentile(amplitude, 95.0)))
    turn = np.exp(1j * (envelope.roller - 3.0 * envelope.phase))
    with np.errstate(all='ignore'):
        turn = turn * (np.conj(envelope.phasor) / amplitude) ** 3
    # The window weighs a line beside f_h down by itself; only its phase matters here.
    phasor = envelope.phasor.copy()
    for k in np.flatnonzero(large):
        low, high = _neighbours(large, int(k))
        if high - low < 10:
            continue
        share = _local_beat(amplitude[low:high], turn[low:high], int(k) - low)
        # A share that cannot be told apart is left out, not left in.
        phasor[k] = np.nan if share is None else phasor[k] * (1.0 - share)
    return replace(envelope, phasor=phasor)


def _neighbours(large: NDArray[np.bool_], k: int) -> tuple[int, int]:
    """Stretch of large amplitude around k, at most `_REACH` to either side."""
    low = k
    while low > 0 and k - low < _REACH and large[low - 1]:
        low -= 1
    high = k + 1
    while high < large.size and high - k <= _REACH and large[high]:
        high += 1
    return low, high


def _local_beat(
    amplitude: NDArray[np.float64], turn: NDArray[np.complex128], k: int
) -> float | None:
    """Share of the amplitude at k that is beat; None where it cannot be told."""
    x = (np.arange(amplitude.size) - k) / _REACH
    smooth = np.stack([np.ones_like(x), x, x**2], axis=1)
    wave = np.stack([turn.real, turn.imag], axis=1)
    across = wave - smooth @ np.linalg.lstsq(smooth, wave, rcond=None)[0]
    power = np.linalg.svd(across, compute_uv=False)[-1] ** 2 / (0.5 * x.size)
    if power < _TELL:
        return None
    basis = np.concatenate([smooth, wave], axis=1)
    solution = np.linalg.lstsq(basis, amplitude, rcond=None)[0]
    return float(wave[k] @ solution[3:]) / float(amplitude[k])
