"""
From samples to the complex envelope of the hunting mode: local least squares.

In a window of three cycles around each output instant the lateral signal, free of the roller's
lines (`lines`), is fitted with bias + hunting phasor, so that a missing, late or unevenly sampled
value costs only its weight. What comes out is the amplitude and phase against time that the
amplitude equation (24) speaks of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hunt_ros.identification.record.channels import Channels

#: Length of the window and distance of the outputs, in cycles of the hunting mode.
#: With a Blackman window twice as long as the step the noise of neighbours is nearly
#: independent, and nothing of the signal is left unused.
WINDOW_CYCLES = 3.0
STEP_CYCLES = 1.5
#: Variance of a Blackman window of half-length one.
WINDOW_VARIANCE = 0.1017
#: Mean distance of two instants drawn from it.
WINDOW_REACH = 0.3629
#: Correlation of white noise between two windows one step apart.
WINDOW_OVERLAP = 0.0896

#: Half the span of the local fit, in steps of the envelope.
_REACH = 12
#: Share of the largest amplitude above which the beat matters.
_LARGE = 0.4
#: Share of the beat's power that must be left beside a parabola to tell the two apart.
_TELL = 0.35
#: Change of ln A over a few instants below which a limit cycle counts as steady.
_STEADY = 0.04
#: Samples that a window must hold for bias, hunting phasor and its slope.
FEWEST_SAMPLES = 10
#: Least part of each that the others do not explain, of the window's weight.
_TOLD_APART = np.array([2e-2, 2e-2, 2e-2, 2e-3, 2e-3])
#: Windows that are fitted at once.
_BLOCK = 1024
#: A window with less of its weight on samples than this gives no value.
LEAST_WEIGHT = 0.6


@dataclass(frozen=True, eq=False)
class Envelope:
    """
    The hunting component of one record on an even grid of instants.

    Parameters
    ----------
    source : str
        Of the record.
    start_ns : int
        Stamp of time zero.
    time : ndarray, shape (n,)
        s since `start_ns`.
    phasor : ndarray of complex, shape (n,)
        Amplitude (m) and phase against the frame that turns at `frequency`; NaN where the
        window was not filled.
    speed : ndarray, shape (n,)
        Running speed averaged over the window, m/s.
    line_power : ndarray, shape (n,)
        Sum of the squared amplitudes of the roller's lines, m^2; NaN without a roller channel.
    noise : ndarray, shape (n,)
        Standard deviation of the phasor's parts by what the window leaves over, m.
    frequency : ndarray, shape (n,)
        Of the frame, Hz.
    residual : ndarray, shape (n,)
        RMS of what the window leaves over, m: noise, and the trace of a kick.
    phase, roller : ndarray, shape (n,)
        Angle of the frame and of the roller, rad; NaN without a roller channel.
    yaw : ndarray of complex, shape (n,)
        The phasor of yaw, rad; NaN without a yaw channel.
    """

    source: str
    start_ns: int
    time: NDArray[np.float64]
    phasor: NDArray[np.complex128]
    speed: NDArray[np.float64]
    line_power: NDArray[np.float64]
    noise: NDArray[np.float64]
    frequency: NDArray[np.float64]
    residual: NDArray[np.float64]
    phase: NDArray[np.float64]
    roller: NDArray[np.float64]
    yaw: NDArray[np.complex128]

    @property
    def amplitude(self) -> NDArray[np.float64]:
        """Amplitude of the hunting component, m, shape (n,)."""
        amplitude: NDArray[np.float64] = np.abs(self.phasor)
        return amplitude

    @property
    def step(self) -> float:
        """Distance of the instants, s."""
        return float(self.time[1] - self.time[0]) if self.time.size > 1 else math.nan

    def stamp(self, k: int) -> int:
        """Return the stamp of an instant, ns."""
        return self.start_ns + int(1e9 * self.time[k])


def window_weight(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Blackman window over -1 to 1."""
    weight = 0.42 + 0.5 * np.cos(np.pi * x) + 0.08 * np.cos(2.0 * np.pi * x)
    return np.maximum(weight, 0.0)  # by rounding below 0 at its ends


def _triangles(columns: Sequence[NDArray[Any]], root: NDArray[Any]) -> NDArray[np.float64]:
    """Triangular factors of weighted columns, shape (n, k, k), of roots of weights (n, m)."""
    rows = np.stack([root * column for column in columns], axis=-1)
    return np.asarray(np.linalg.qr(rows, mode='r'))


def envelope_of(
    channels: Channels,
    frequency: NDArray[np.float64],
    line_power: NDArray[np.float64] | None = None,
    step_cycles: float = STEP_CYCLES,
) -> Envelope:
    """
    Complex envelope of the hunting mode along one record.

    Parameters
    ----------
    channels : Channels
        The record, free of lines.
    frequency : ndarray, shape (n,)
        Of the turning frame at each lateral sample, Hz.
    line_power : ndarray, shape (n,), optional
        Sum of the squared amplitudes of the lines that there were, m^2.
    step_cycles : float
        Distance of the windows, cycles of the frame.

    Returns
    -------
    Envelope
    """
    time = channels.time
    centre_hz = float(np.median(frequency))
    half = 0.5 * WINDOW_CYCLES / centre_hz
    step = step_cycles / centre_hz
    centres = np.arange(time[0] + half, time[-1] - half + 1e-9, step)
    increments = np.diff(time, prepend=time[0]) * frequency
    phase = 2.0 * np.pi * np.cumsum(increments)
    phasor, noise, residual = _windows(channels, phase, centres, half)
    yaw = np.full(centres.size, complex(math.nan, math.nan))
    if channels.yaw is not None:
        seen = np.interp(channels.yaw.time, time, phase)
        yaw = _windows(channels.yaw, seen, centres, half)[0]
    edges = np.searchsorted(time, np.stack([centres - 0.5 * half, centres + 0.5 * half]))
    summed = np.concatenate([[0.0], np.cumsum(channels.speed)])
    spans = np.maximum(edges[1] - edges[0], 1)
    speed = (summed[np.minimum(edges[0] + spans, time.size)] - summed[edges[0]]) / spans
    power = np.full(time.size, np.nan) if line_power is None else line_power
    lines = np.isfinite(power).any()
    return Envelope(
        channels.source,
        channels.start_ns,
        centres,
        phasor,
        speed,
        np.interp(centres, time, power),
        noise.real,
        np.interp(centres, time, frequency),
        residual.real,
        np.interp(centres, time, phase),
        np.interp(centres, time, channels.roller) if lines else np.full(centres.size, np.nan),
        yaw,
    )


def _windows(
    channels: Channels, phase: NDArray[np.float64], centres: NDArray[np.float64], half: float
) -> NDArray[np.complex128]:
    """Fit all windows; return phasor, noise and residual of each: shape (3, n)."""
    known = np.isfinite(channels.lateral)
    instants, values = channels.time[known], channels.lateral[known]
    turning = np.exp(1j * phase[known])
    found = np.full((3, centres.size), complex(math.nan, math.nan))
    first, end = np.searchsorted(instants, [centres - half, centres + half])
    # Weight of a full window, by the nominal rate: what is missing is missing from this.
    full = 0.42 * 2.0 * half * channels.rate_hz
    filled = np.flatnonzero(end - first >= FEWEST_SAMPLES)
    for begin in range(0, filled.size, _BLOCK):
        k = filled[begin : begin + _BLOCK]
        place = first[k][:, None] + np.arange((end - first)[k].max())
        inside = place < end[k][:, None]
        place = np.where(inside, place, 0)
        x = np.where(inside, (instants[place] - centres[k][:, None]) / half, 1.0)
        weight, wave = window_weight(x), turning[place]
        seen = weight.sum(axis=1)
        # Growth and turning within the window are fitted too, so that only a jump is left over.
        waves = wave.real, -wave.imag, x * wave.real, -x * wave.imag
        triangle = _triangles([np.ones_like(x), *waves, values[place]], np.sqrt(weight))
        apart = np.diagonal(triangle, axis1=1, axis2=2)[:, :-1] ** 2 > _TOLD_APART * seen[:, None]
        told = apart.all(axis=1) & (seen >= LEAST_WEIGHT * full)
        k, triangle, seen, square = k[told], triangle[told], seen[told], (weight**2).sum(1)[told]
        parts = np.linalg.solve(triangle[:, :-1, :-1], triangle[:, :-1, -1:])[..., 0]
        residual = np.abs(triangle[:, -1, -1]) / np.sqrt(seen)
        noise = residual * np.sqrt(2.0 * square) / seen
        found[:, k] = parts[:, 1] + 1j * parts[:, 2], noise, residual
    return found


def without_beat(envelope: Envelope) -> Envelope:
    """
    Remove the beat of hunting and roughness from the amplitude; drop limit cycles locked to it.

    The cubic restoring force mixes a roughness line at f_r with a limit cycle at f_h into a
    line at f_r - 2 f_h. It lies beside f_h, and on f_h itself where f_r = 3 f_h (8 m/s on the
    paper's rig): there roughness of 30 um moves the amplitude of the limit cycle by 2 %. Its
    phase is known, theta - 3 phi, so that it can be fitted and removed wherever it turns.

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
    at, offset = np.flatnonzero(large), np.arange(-_REACH, _REACH + 1)
    place = at[:, None] + offset
    near = steady[np.clip(place, 0, steady.size - 1)] & (place >= 0) & (place < steady.size)
    enough = near.sum(axis=1) >= 10
    at, place, near = at[enough], place[enough], near[enough]
    place = np.where(near, place, at[:, None])
    count, x = near.sum(axis=1), np.broadcast_to(offset / _REACH, near.shape)
    scale = (near * np.abs(wave[place])).sum(axis=1) / count
    part = wave[place] / scale[:, None]
    smooth = np.ones_like(x), x, x**2
    triangle = _triangles([*smooth, part.real, part.imag, amplitude[place]], near)
    block = triangle[:, 3:5, 3:5]
    told = np.linalg.svd(block, compute_uv=False)[:, -1] ** 2 >= 0.5 * _TELL * count
    # What cannot be told apart is left out, not left in; a transient passes it by.
    phasor[at[~told & steady[at]]] = np.nan
    at, size = at[told], np.linalg.solve(block[told], triangle[told, 3:5, 5:])[..., 0]
    shown = np.sum(size * np.stack([wave[at].real, wave[at].imag], axis=1), axis=1) / scale[told]
    phasor[at] *= 1.0 - shown / amplitude[at]
    return replace(envelope, phasor=phasor)


def _steady(amplitude: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Instants around which the amplitude, averaged over the beat, stays where it is."""
    logs = np.log(np.where(amplitude > 0.0, amplitude, np.nan))
    mean = sliding_window_view(logs, 4).mean(axis=1)
    return np.pad(np.abs(mean[3:] - mean[:-3]) < _STEADY, 3)
