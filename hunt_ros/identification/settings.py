"""What the user may say about a rig and about how to identify it; everything has a default."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.errors import ConfigError
from hunt_ros.rig import Rig
from hunt_ros.settings import setting

#: Where the hunting frequency is looked for, if the rig does not tell it, Hz.
FREQUENCIES_HZ = (0.5, 20.0)


@dataclass(frozen=True)
class IdentificationSettings(Rig):
    """
    Settings of an identification: the rig (see `Rig`; units and lines of it above all), and more.

    Parameters
    ----------
    ignore : tuple of (float, float, int)
        Intervals that are left out: s since the start of a recording, from and to, and its
        number, 1 for the first; 0: of every recording.
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

    ignore: tuple[tuple[float, float, int], ...] = ()
    minimum_hold_s: float = setting(
        8.0, 'shortest hold of the speed', unit='s', low=1e-300, high=1e6
    )
    seed: int = setting(0, 'of everything random', low=0)
    cluster: str = ''

    def __post_init__(self) -> None:
        super().__post_init__()
        fine = all(0.0 <= a < b < math.inf and number >= 0 for a, b, number in self.ignore)
        if not fine:
            raise ConfigError(
                f'identification: ignore must be 0 <= from < to, and a number, got {self.ignore}'
            )

    @property
    def length_unit(self) -> float:
        """d0, m: as given, or the paper's."""
        return self.length_scale_m or PAPER_NORMAL_FORM.length_scale

    @property
    def time_unit(self) -> float:
        """1 / omega_psi, s: as given, or the paper's."""
        return self.time_scale_s or PAPER_NORMAL_FORM.time_scale

    @property
    def orders(self) -> NDArray[np.float64]:
        """All known lines, in turns of the roller, shape (n,)."""
        wheel = self.wheel_diameter_m
        own = (self.roller_diameter_m / wheel,) if wheel > 0.0 else ()
        return np.array([*(x for x in self.lines if x > 0.0), *own], dtype=np.float64)
