"""What the user may say about a rig and about how to identify it; everything has a default."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.errors import ConfigError
from hunt_ros.rig import Rig

#: Names of settings, and their range.
_RANGES = (
    (('length_scale', 'time_scale', 'frequency_hz', 'minimum_hold_s'), 1e-300, math.inf),
    (('speed_resolution', 'speed_scale_std', 'seed'), 0.0, math.inf),
    (('lateral_range_m', 'flange_clearance_m'), 0.0, 1e300),
    (('roller_diameter_m', 'wheel_diameter_m'), 0.0, 10.0),
)


@dataclass(frozen=True)
class IdentificationSettings:
    """
    Settings of an identification.

    Parameters
    ----------
    length_scale : float, optional
        d0, m: the unit of amplitude of the coefficients, Eq. (32); None for the paper's.
    time_scale : float, optional
        1 / omega_psi, s: the unit of time of the coefficients; None for the paper's.
    frequency_hz : float, optional
        Hunting frequency, where it is known better than the recording shows it.
    frequency_range_hz : tuple of float
        Where the hunting frequency is looked for.
    lines : tuple of float
        Known lines that are removed, in turns of the roller; they need not be whole numbers.
    roller_diameter_m : float
        Where the channel `roller` is missing its angle is integrated from the speed; 0: as
        the built-in rig, which is said in a warning.
    wheel_diameter_m : float
        The wheel's own line is removed as well; 0: none. It needs `roller_diameter_m`.
    prior_v_c, prior_D1 : tuple of (float, float), optional
        Value and standard deviation known from elsewhere (linear theory, an earlier run).
    speed_resolution : float
        Smallest step of the speed reading, m/s (0.2 on the paper's rig, Sect. 2.4).
        A resolution r enters every speed as a standard error r / sqrt(12).
    speed_scale_std : float
        Relative standard deviation of the scale of the speed reading.
    ignore : tuple of (float, float, int)
        Intervals that are left out: s since the start of a recording, from and to, and its
        number, 1 for the first; 0: of every recording.
    lateral_range_m : float
        The lateral sensor reads from minus this to this; 0: not known, looked for.
    flange_clearance_m : float
        Amplitude at which a flange touches: motion there is said and not fitted; 0: not known.
    minimum_hold_s : float
        Shortest stretch at one speed that counts as a plateau.
    seed : int
        Of the draws.
    cluster : str
        Address of a Dask scheduler whose workers read and prepare the recordings
        ('' for none).

    Raises
    ------
    ConfigError
        For a value out of its range.
    """

    length_scale: float | None = None
    time_scale: float | None = None
    frequency_hz: float | None = None
    frequency_range_hz: tuple[float, float] = (0.5, 20.0)
    lines: tuple[float, ...] = (1.0, 2.0)
    roller_diameter_m: float = 0.0
    wheel_diameter_m: float = 0.0
    prior_v_c: tuple[float, float] | None = None
    prior_D1: tuple[float, float] | None = None
    speed_resolution: float = 0.0
    speed_scale_std: float = 0.0
    ignore: tuple[tuple[float, float, int], ...] = ()
    lateral_range_m: float = 0.0
    flange_clearance_m: float = 0.0
    minimum_hold_s: float = 8.0
    seed: int = 0
    cluster: str = ''

    def __post_init__(self) -> None:
        for names, low, high in _RANGES:
            for name in names:
                value = getattr(self, name)
                fine = value is None or low <= value <= high
                _require(name, value, fine, f'within {low:g}..{high:g}')
        low, high = self.frequency_range_hz
        _require('frequency_range_hz', self.frequency_range_hz, 0.0 < low < high, '0 < low < high')
        fine = all(0.0 < order <= 100.0 for order in self.lines)
        _require('lines', self.lines, fine, 'within 0..100')
        fine = all(0.0 <= a < b < math.inf and number >= 0 for a, b, number in self.ignore)
        _require('ignore', self.ignore, fine, '0 <= from < to, and a number')
        fine = self.wheel_diameter_m == 0.0 or self.roller_diameter_m > 0.0
        _require('roller_diameter_m', 0.0, fine, 'given with wheel_diameter_m')
        for name in ('prior_v_c', 'prior_D1'):
            prior = getattr(self, name) or (1.0, 1.0)
            fine = 0.0 < prior[0] < math.inf and prior[1] > 0.0
            _require(name, prior, fine, 'a positive value and a positive standard deviation')

    @classmethod
    def of_rig(cls, rig: Rig, **given: Any) -> IdentificationSettings:
        """
        Return the settings for a rig.

        Parameters
        ----------
        rig : Rig
            What it does not tell has the default.
        **given
            Settings by name that are told otherwise; None: not told.

        Raises
        ------
        ConfigError
            For a value out of its range.
        """
        low, high = cls.frequency_range_hz
        names = ('roller_diameter_m', 'wheel_diameter_m', 'lateral_range_m', 'flange_clearance_m')
        told = {
            **{name: getattr(rig, name) for name in (*names, 'speed_scale_std')},
            'length_scale': rig.length_scale_m or None,
            'time_scale': rig.time_scale_s or None,
            'frequency_hz': rig.hunting_frequency_hz or None,
            'frequency_range_hz': (
                rig.hunting_frequency_min_hz or low,
                rig.hunting_frequency_max_hz or high,
            ),
            'lines': tuple(order for order in rig.lines if order > 0.0),
            'prior_v_c': rig.prior_v_c or None,
            'prior_D1': rig.prior_D1 or None,
            'speed_resolution': rig.speed_resolution_mps,
        }
        return cls(**told | {name: value for name, value in given.items() if value is not None})

    def of_recording(self) -> IdentificationSettings:
        """Return them without what only the fit to all recordings takes."""
        fit = ('prior_v_c', 'prior_D1', 'seed', 'cluster')
        return replace(self, **{name: getattr(type(self), name) for name in fit})

    @property
    def length_unit(self) -> float:
        """d0, m: as given, or the paper's."""
        return PAPER_NORMAL_FORM.length_scale if self.length_scale is None else self.length_scale

    @property
    def time_unit(self) -> float:
        """1 / omega_psi, s: as given, or the paper's."""
        return PAPER_NORMAL_FORM.time_scale if self.time_scale is None else self.time_scale

    @property
    def orders(self) -> NDArray[np.float64]:
        """All known lines, in turns of the roller, shape (n,)."""
        wheel = self.wheel_diameter_m
        own = (self.roller_diameter_m / wheel,) if wheel > 0.0 else ()
        return np.array([*self.lines, *own], dtype=np.float64)


def _require(name: str, value: object, fine: bool, expected: str) -> None:
    if not fine:
        raise ConfigError(f'identification: {name} must be {expected}, got {value}')
