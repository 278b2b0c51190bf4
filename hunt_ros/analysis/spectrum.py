"""
Power spectrum with the hunting and the roughness lines named (Fig. 5, Eq. (1)).

The paper's upper line is the roughness of the roller, at f_r = v / (pi D) (a
frequency in Hz); the lower one is hunting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from hunt_ros.analysis.uniform import checked

#: Roughness lines looked for; and the length of the segments averaged, s (or a shorter record's).
ORDERS, SEGMENT_S = 3, 20.0
#: A line must stand above the spectrum around it by this factor (in power) to be named.
PROMINENCE = 8.0

#: A signal that varies by less than this part of itself is taken for a constant.
STUCK = 1e-12

#: Half the width of the main lobe of the Hann window, in bins.
LOBE = 2


@dataclass(frozen=True)
class Line:
    """
    A named line of a spectrum.

    Parameters
    ----------
    name : str
        'hunting', 'roughness', 'roughness 2', ... (order of the roller); 'hunting 3' for an
        overtone that lies where roughness was looked for.
    frequency_hz, frequency_std : float
        Hz. The deviation of a line the window resolves; for a broad peak, its own width.
    amplitude : float
        Of the sinusoid of the same power, in the unit of the signal.
    """

    name: str
    frequency_hz: float
    frequency_std: float
    amplitude: float


@dataclass(frozen=True, eq=False)
class Spectrum:
    """
    One-sided power spectral density and its named lines.

    Parameters
    ----------
    frequency_hz, density : ndarray, shape (k,)
        Hz; unit of the signal squared per Hz.
    lines : tuple of Line
        By frequency.
    """

    frequency_hz: NDArray[np.float64]
    density: NDArray[np.float64]
    lines: tuple[Line, ...]

    def line(self, name: str) -> Line | None:
        """Return the line of that name; None where the spectrum has none."""
        return next((line for line in self.lines if line.name == name), None)


def roughness_frequency(speed: float, roller_diameter_m: float) -> float:
    """Return v / (pi D), Hz, Eq. (1): the paper's omega_r is a frequency in Hz."""
    return speed / (math.pi * roller_diameter_m)


def power_spectrum(
    values: ArrayLike, rate_hz: float, hunting_hz: float, roller_hz: float = 0.0
) -> Spectrum:
    """
    Power spectrum by Welch's method, with hunting and roughness named.

    Parameters
    ----------
    values : array_like, shape (n,)
        Uniform samples of y (m) or psi (rad).
    rate_hz : float
        Sample rate, Hz.
    hunting_hz : float
        Hunting frequency of the rig, Hz: the line is looked for within half an octave of it.
    roller_hz : float
        Revolutions of the roller a second, `roughness_frequency`; 0: no line is called roughness.

    Returns
    -------
    Spectrum

    Raises
    ------
    IdentificationError
        For fewer than 64 values, or one that is not finite.

    References
    ----------
    Welch 1967, IEEE Trans. Audio Electroacoust. 15, 70-73. The paper, Eq. (1), Fig. 5.
    """
    array = checked(values, 64, 'spectrum')
    size = min(array.size, max(round(SEGMENT_S * rate_hz), 64))
    if float(np.ptp(array)) <= STUCK * float(np.abs(array).max()):
        array = np.zeros_like(array)  # varies by rounding only
    frequency, density = signal.welch(
        array - array.mean(), rate_hz, 'hann', size, detrend='linear', scaling='density'
    )
    segments = max(array.size / size, 1.0)
    found = []
    for order in range(1, ORDERS + 1) if roller_hz > 0.0 else ():
        expected = order * roller_hz
        name = 'roughness' if order == 1 else f'roughness {order}'
        near = np.abs(frequency - expected) <= max(0.02 * expected, 2.0 * rate_hz / size)
        line = _line(name, frequency, density, near, segments)
        if line is not None:
            found.append(line)
    near = (frequency > math.sqrt(0.5) * hunting_hz) & (frequency < math.sqrt(2.0) * hunting_hz)
    for line in found:
        # Past its main lobe a line leaks 1/(pi k (k^2 - 1)) of its amplitude, k bins away.
        bins = np.abs(frequency - line.frequency_hz) * size / rate_hz
        near &= bins > LOBE + 1
        top = float(density[np.argmin(bins)])
        leak = top / (math.pi * np.maximum(bins, 2.0) * (np.maximum(bins, 2.0) ** 2 - 1.0)) ** 2
        near &= density > 4.0 * leak
    hunting = _line('hunting', frequency, density, near, segments, broad=True)
    if hunting is not None:
        found = [_renamed(line, hunting, roller_hz) for line in found]
        found.append(hunting)
    found.sort(key=lambda line: line.frequency_hz)
    return Spectrum(frequency, density, tuple(found))


def _renamed(line: Line, hunting: Line, roller_hz: float) -> Line:
    """Call a line a harmonic of hunting where that is nearer than the roughness expected."""
    order = round(line.frequency_hz / hunting.frequency_hz)
    overtone = abs(line.frequency_hz - order * hunting.frequency_hz)
    away = abs(line.frequency_hz - round(line.frequency_hz / roller_hz) * roller_hz)
    # Only an odd nonlinearity of a strong limit cycle makes overtones, and they are weaker.
    if order >= 2 and overtone < 0.5 * away and line.amplitude < 0.2 * hunting.amplitude:
        return replace(line, name=f'hunting {order}')
    return line


def _line(
    name: str,
    frequency: NDArray[np.float64],
    density: NDArray[np.float64],
    near: NDArray[np.bool_],
    segments: float,
    broad: bool = False,
) -> Line | None:
    """Measure the strongest line where `near` holds; None where none stands out."""
    places = np.flatnonzero(near)
    if not places.size:
        return None
    step = float(frequency[1])
    top = int(places[np.argmax(density[places])])
    # The spectrum around: past the lobe, within half an octave.
    around = np.abs(frequency - frequency[top]) > (LOBE + 1) * step
    around &= (frequency > 0.7 * frequency[top]) & (frequency < 1.4 * frequency[top])
    if broad:
        # The hunting peak of a quiet wheelset is wide: its surroundings lie further out.
        around = (frequency > 1.6 * frequency[top]) & (frequency < 3.0 * frequency[top])
    floor = float(np.median(density[around])) if around.any() else 0.0
    if not density[top] > 0.0 or density[top] <= PROMINENCE * floor:
        return None
    lobe = slice(max(top - LOBE, 0), top + LOBE + 1)
    if broad:
        low = high = top
        while low > 1 and density[low - 1] > max(0.1 * density[top], 2.0 * floor):
            low -= 1
        while high + 2 < density.size and density[high + 1] > max(0.1 * density[top], 2.0 * floor):
            high += 1
        lobe = slice(min(low, top - LOBE), max(high, top + LOBE) + 1)
    excess = np.maximum(density[lobe] - floor, 0.0)
    power = float(excess.sum()) * step
    centre = float(excess @ frequency[lobe]) / float(excess.sum())
    width = math.sqrt(float(excess @ (frequency[lobe] - centre) ** 2) / float(excess.sum()))
    return Line(
        name,
        centre,
        width / math.sqrt(segments * max(density[top] / max(floor, 1e-300), 1.0) ** 0.5),
        math.sqrt(2.0 * power),
    )
