"""
The analysis of one steady state, as Figs. 5 and 7 show it.

The analysis itself is in `hunt_ros.analysis`; here it is called with what the record
has. What it refuses is left out, with its reason, and never replaced.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.phase_portrait import PhasePortrait, phase_portrait
from hunt_ros.analysis.poincare import PoincareSection, own_section, poincare_section
from hunt_ros.analysis.spectrum import Spectrum, power_spectrum, roughness_frequency
from hunt_ros.analysis.uniform import on_stamps, uniform
from hunt_ros.errors import IdentificationError
from hunt_ros.samples import NANOSECONDS, Record

_Result = TypeVar('_Result')

#: Spread of a section of one point from which the noise about it is told.
_NOISY = 0.1


@dataclass(frozen=True, eq=False)
class Response:
    """
    What Fig. 5 shows of one speed; None where it cannot be known.

    Parameters
    ----------
    speed : float
        m/s.
    time, lateral : ndarray, shape (n,)
        s and m, without the mean; empty where the channel is not usable.
    spectrum : Spectrum or None
        With its lines named.
    portrait : PhasePortrait or None
        Displacement and velocity.
    section : PoincareSection or None
        Once a revolution of the roller, or once a cycle where there is none.
    unknown : mapping of str to str
        Panel -> why it is not known.
    """

    speed: float
    time: NDArray[np.float64]
    lateral: NDArray[np.float64]
    spectrum: Spectrum | None
    portrait: PhasePortrait | None
    section: PoincareSection | None
    unknown: Mapping[str, str]

    @property
    def kind(self) -> str:
        """What the section says, in words."""
        if self.section is None:
            return 'not known'
        if self.section.kind == 'periodic' and self.section.period > 1:
            turns = 'revolutions' if self.section.cut == 'revolution' else 'cycles'
            return f'periodic, {self.section.period} {turns}'
        if self.section.kind == 'noise-driven':
            return 'noise-driven, not periodic'
        if self.section.kind == 'periodic' and self.section.spread > _NOISY:
            return 'periodic, with noise about it'
        return self.section.kind

    @property
    def cut(self) -> str:
        """Where the section was cut, in words."""
        if self.section is not None and self.section.cut == 'hunting':
            return 'one point a hunting cycle, as there is no roller'
        return 'one point a revolution of the roller'


def response_of(
    record: Record, speed: float, hunting_hz: float, diameter: float | None = None
) -> Response:
    """
    Analyse a steady stretch of a record.

    Parameters
    ----------
    record : Record
        Cut to the stretch; `lateral`, and `roller` where there is one.
    speed : float
        Mean running speed there, m/s.
    hunting_hz : float
        Hunting frequency of the rig, Hz.
    diameter : float, optional
        Of the roller, m, where its angle was not recorded: its revolutions are then
        counted from the speed, Eq. (1). With neither, the motion is cut at a phase of its
        own.

    Returns
    -------
    Response
    """
    unknown: dict[str, str] = {}

    def tried(panel: str, work: Callable[[], _Result]) -> _Result | None:
        """Do the work of a panel; where it cannot be done, keep the reason."""
        try:
            return work()
        except IdentificationError as error:
            unknown[panel] = str(error)
            return None

    even = tried('time history', lambda: uniform(record['lateral']))
    if even is None:
        nothing = np.zeros(0)
        return Response(speed, nothing, nothing, None, None, None, unknown)
    stamps, lateral = even
    rate = NANOSECONDS / float(np.median(np.diff(stamps)))
    seconds: NDArray[np.float64] = (stamps - stamps[0]) / NANOSECONDS
    angle = on_stamps(record['roller'], stamps) if 'roller' in record else None
    if angle is not None and not np.isfinite(angle).all():
        angle = None
    if angle is None and diameter is not None:
        angle = 2.0 * math.pi * roughness_frequency(speed, diameter) * seconds
    # Without a roller no line is its roughness, and there is no revolution to cut at.
    turns = 0.0 if angle is None else abs(float(angle[-1] - angle[0])) / (2.0 * math.pi)

    def spectrum() -> Spectrum:
        """Name the lines of hunting and of the roller."""
        return power_spectrum(lateral, rate, hunting_hz, turns / float(seconds[-1]))

    def section() -> PoincareSection:
        """Cut at the revolutions of the roller, without these at those of the motion itself."""
        if angle is not None:
            return poincare_section(lateral, rate, angle)
        yaw = on_stamps(record['yaw'], stamps) if 'yaw' in record else None
        known = yaw is not None and bool(np.isfinite(yaw).all()) and float(np.ptp(yaw)) > 0.0
        return own_section(lateral, rate, yaw if known else None)

    return Response(
        speed,
        seconds,
        lateral - lateral.mean(),
        tried('power spectrum', spectrum),
        tried('phase portrait', lambda: phase_portrait(lateral, rate)),
        tried('section', section),
        unknown,
    )
