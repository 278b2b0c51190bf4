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

from hunt_ros.identification.record.envelope import Envelope

#: Half the span of the local fit, in steps of the envelope.
_REACH = 12
#: Share of the largest amplitude above which the beat matters.
_LARGE = 0.4
#: Share of the beat's power that must be left beside a parabola to tell the two apart.
_TELL = 0.35
#: Change of ln A over a few instants below which a limit cycle counts as steady.
_STEADY = 0.04


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
    large = known & (amplitude > _LARGE * float(np.nanmax(amplitude)))
    steady = large & _steady(amplitude)
    turn = np.exp(1j * (envelope.roller - 3.0 * envelope.phase))
    with np.errstate(all='ignore'):
        # The line grows with the square of the limit cycle.
        wave = turn * np.conj(envelope.phasor) ** 3 / amplitude
    phasor = envelope.phasor.copy()
    for k in np.flatnonzero(large):
        near = np.flatnonzero(steady[max(k - _REACH, 0) : k + _REACH + 1]) + max(k - _REACH, 0)
        if near.size < 10:
            continue
        size = _beat(amplitude[near], wave[near], (near - k) / _REACH)
        if size is None:
            # What cannot be told apart is left out, not left in; a transient passes it by.
            phasor[k] = np.nan if steady[k] else phasor[k]
        else:
            phasor[k] *= 1.0 - float((np.conj(size) * wave[k]).real) / amplitude[k]
    return replace(envelope, phasor=phasor)


def _steady(amplitude: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Instants around which the amplitude, averaged over the beat, stays where it is."""
    logs = np.log(np.where(amplitude > 0.0, amplitude, np.nan))
    steady = np.zeros(amplitude.size, dtype=bool)
    for k in range(3, amplitude.size - 3):
        before, after = np.mean(logs[k - 3 : k + 1]), np.mean(logs[k : k + 4])
        steady[k] = abs(after - before) < _STEADY
    return steady


def _beat(
    amplitude: NDArray[np.float64], wave: NDArray[np.complex128], x: NDArray[np.float64]
) -> complex | None:
    """Complex size of the beat over the square of the amplitude; None where it cannot be told."""
    smooth = np.stack([np.ones_like(x), x, x**2], axis=1)
    scale = float(np.mean(np.abs(wave)))
    parts = np.stack([wave.real, wave.imag], axis=1) / scale
    across = parts - smooth @ np.linalg.lstsq(smooth, parts, rcond=None)[0]
    power = np.linalg.svd(across, compute_uv=False)[-1] ** 2 / (0.5 * x.size)
    if power < _TELL:
        return None
    basis = np.concatenate([smooth, parts], axis=1)
    solution = np.linalg.lstsq(basis, amplitude, rcond=None)[0] / scale
    return complex(solution[3], solution[4])
