"""
Hunting frequency against amplitude: the imaginary part of the normal form, Eq. (25).

The paper reads amplitudes only; the same recordings hold how the frequency changes with
the amplitude, which is D4I.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.frequency_amplitude import (
    FrequencyLaw,
    amplitude_and_frequency,
    frequency_law,
)
from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.analysis.uniform import uniform
from hunt_ros.errors import IdentificationError
from hunt_ros.report.figures import style
from hunt_ros.samples import NANOSECONDS, Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Pass band around the hunting frequency, as shares of it; the roughness line lies above.
_BAND = (0.6, 1.5)
#: An amplitude whose windows scatter by more than this share of it is not steady.
_SETTLED = 0.05


@dataclass(frozen=True, eq=False)
class Frequencies:
    """
    Amplitude and frequency of steady states that hunt, and the law through them.

    Parameters
    ----------
    speed, amplitude, frequency_hz, frequency_std : ndarray, shape (n,)
        m/s, m, Hz, Hz.
    law : FrequencyLaw
        Eq. (25), with the terms that the data support.
    """

    speed: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    frequency_std: NDArray[np.float64]
    law: FrequencyLaw


def hunting_frequencies(
    records: Sequence[Record],
    states: Sequence[SteadyState],
    nominal_hz: float,
    critical_speed: float,
    scales: tuple[float, float],
) -> Frequencies:
    """
    Measure the frequency of every steady state that hunts, and fit Eq. (25).

    Parameters
    ----------
    records : sequence of Record
        In which the states were found.
    states : sequence of SteadyState
        All; those well above their noise count.
    nominal_hz : float
        Hunting frequency, Hz.
    critical_speed : float
        v_c, m/s.
    scales : (float, float)
        d0, m, and 1/omega_psi, s.

    Raises
    ------
    IdentificationError
        If too few states hunt, or all at one amplitude.
    """
    rows = [
        row
        for state in states
        for record in records
        if record.source == state.source
        for row in _measured(record, state, nominal_hz)
    ]
    if len(rows) < 4:
        raise IdentificationError(f'{len(rows)} steady states hunt, expected at least 4')
    speed, amplitude, frequency, std = np.array(rows).T
    length, time = scales
    law = frequency_law(amplitude, frequency, speed, critical_speed, std, length, time)
    return Frequencies(speed, amplitude, frequency, std, law)


def _measured(
    record: Record, state: SteadyState, nominal_hz: float
) -> list[tuple[float, float, float, float]]:
    """One row (speed, amplitude, frequency, its deviation), or none if it does not hunt."""
    part = record.between(state.start_ns, state.end_ns)
    try:
        stamps, lateral = uniform(part['lateral'])
        rate = NANOSECONDS / float(np.median(np.diff(stamps)))
        band = (_BAND[0] * nominal_hz, _BAND[1] * nominal_hz)
        _, amplitude, frequency = amplitude_and_frequency(lateral, rate, band)
    except IdentificationError:
        return []
    size = float(amplitude.mean())
    if float(amplitude.std()) > _SETTLED * size:
        return []
    std = float(frequency.std(ddof=1)) / np.sqrt(frequency.size)
    return [(state.speed, size, float(frequency.mean()), max(float(std), 1e-4))]


def frequency_diagram(found: Frequencies) -> Figure:
    """
    Draw frequency against amplitude, with the law along the measured states.

    Parameters
    ----------
    found : Frequencies
        What was measured.

    Returns
    -------
    Figure
        One column wide.
    """
    with style.journal_style():
        figure = style.new_figure()
        axes = figure.subplots()
        style.frame(axes, style.AMPLITUDE_LABEL, r'Hunting frequency $f_h$ (Hz)')
        order = np.argsort(found.amplitude)
        axes.errorbar(
            style.MILLIMETRES * found.amplitude,
            found.frequency_hz,
            yerr=found.frequency_std,
            fmt='o',
            color=style.STABLE,
            markerfacecolor='none',
            elinewidth=0.6,
            label='steady states',
        )
        fitted = found.law.frequency_hz(found.amplitude[order], found.speed[order])
        axes.plot(
            style.MILLIMETRES * found.amplitude[order],
            fitted,
            '+',
            color=style.INK,
            label='Eq. (25) at the same speeds',
        )
        style.legend_above(axes)
        return figure
