"""Phase portrait of a record: displacement against velocity (Fig. 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from hunt_ros.analysis.uniform import checked

#: Highest frequency of interest, Hz: hunting and the roughness line.
HIGHEST_HZ = 12.0


@dataclass(frozen=True, eq=False)
class PhasePortrait:
    """
    The orbit of a record.

    Parameters
    ----------
    displacement, velocity : ndarray, shape (n,)
        m and m/s (or rad and rad/s), smoothed alike, the mean removed.
    first : int
        Index in the record of the first point: half a window is lost at each end.
    """

    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    first: int


def phase_portrait(values: ArrayLike, rate_hz: float) -> PhasePortrait:
    """
    Displacement and velocity by local cubic polynomials (Savitzky-Golay).

    Displacement and velocity come from one polynomial, so the orbit closes where the
    motion does; the window keeps 90 % of a line at `HIGHEST_HZ`.

    Parameters
    ----------
    values : array_like, shape (n,)
        Uniform samples.
    rate_hz : float
        Sample rate, Hz.

    Raises
    ------
    IdentificationError
        For fewer than 32 values, or one that is not finite.

    References
    ----------
    Savitzky and Golay 1964, Anal. Chem. 36, 1627-1639.
    """
    array = checked(values, 32, 'phase portrait')
    half = min(max(round(0.3 * rate_hz / HIGHEST_HZ), 2), (array.size - 1) // 2)
    options = {'window_length': 2 * half + 1, 'polyorder': 3}
    smooth = signal.savgol_filter(array - array.mean(), **options)
    rate = signal.savgol_filter(array - array.mean(), deriv=1, delta=1.0 / rate_hz, **options)
    smooth, rate = smooth[half : array.size - half], rate[half : array.size - half]
    return PhasePortrait(smooth, rate, half)
