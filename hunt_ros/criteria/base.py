"""
What every railway criterion has in common: an index, a limit, a stream.

Each standard is written as one number a moment, the *index* in m/s^2, that must
not exceed one *limit*. One pass over a record therefore answers for any scaled
limit, which is how criteria are compared at equal false-alarm rates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.criteria.acceleration import LateralAcceleration, runs
from hunt_ros.settings import Settings, setting

#: A row a grid point: the index (m/s^2; NaN while it is not yet defined) and the verdict.
CRITERION_DTYPE = np.dtype([('stamp_ns', 'i8'), ('index', 'f8'), ('exceeded', '?')])


@dataclass(frozen=True)
class CriterionSettings(Settings):
    """
    Thresholds of a criterion: the limit of its standard and its pass band.

    Raises
    ------
    ConfigError
        Naming the field that is out of its range.
    """

    limit: float = setting(8.0, 'limit of the index', unit='m/s^2', low=0.0, high=1e3)
    scale: float = setting(
        1.0, 'factor on the limit, for rigs that are no full-size vehicle', low=1e-9, high=1e3
    )
    low_hz: float = setting(0.5, 'lower edge of the pass band', unit='Hz', low=0.01, high=100.0)
    high_hz: float = setting(10.0, 'upper edge of the pass band', unit='Hz', low=0.1, high=500.0)


class Criterion(ABC):
    """
    A railway stability criterion as a streaming detector on lateral displacement.

    Feeding a record sample by sample, in any blocks or whole gives the same rows. A
    non-finite sample counts as missing, a stamp that does not advance is dropped and
    counted (one more than a second back starts the criterion anew: the clock was set);
    after a gap of more than 50 ms the criterion starts anew (index NaN until
    its window has filled again), because it must not be computed across a hole.

    Parameters
    ----------
    rate_hz : float
        Rate at which the criterion works, Hz; best the sensor's own.
    settings : CriterionSettings
    """

    name: ClassVar[str]
    source: ClassVar[str]
    settings_type: ClassVar[type[CriterionSettings]] = CriterionSettings

    def __init__(self, rate_hz: float, settings: CriterionSettings | None = None) -> None:
        self.settings = self.settings_type() if settings is None else settings
        self.rate_hz = float(rate_hz)
        self._acceleration = LateralAcceleration(
            self.rate_hz, self.settings.low_hz, self.settings.high_hz
        )
        self.reset()

    def reset(self) -> None:
        """Forget everything: as new."""
        self._acceleration.reset()
        self._index = np.nan
        self._stamp = 0
        self._clear()

    @abstractmethod
    def _clear(self) -> None:
        """Forget the window."""

    @abstractmethod
    def _indices(
        self, acceleration: NDArray[np.float64], speed: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the index at each grid point of a run without gap."""

    @property
    def limit(self) -> float:
        """The limit in force, m/s^2: that of the settings times its scale."""
        return self.settings.limit * self.settings.scale

    @property
    def index(self) -> float:
        """The latest index, m/s^2; NaN while it is not defined."""
        return float(self._index)

    @property
    def exceeded(self) -> bool:
        """Whether the latest index is above the limit."""
        return bool(self._index > self.limit)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the latest row; 0 before the first."""
        return self._stamp

    @property
    def dropped(self) -> int:
        """Samples dropped because their stamp did not advance."""
        return self._acceleration.dropped

    @property
    def missing(self) -> int:
        """Samples that were not finite."""
        return self._acceleration.missing

    def update(
        self, stamps_ns: ArrayLike, lateral: ArrayLike, speed: ArrayLike = np.nan
    ) -> NDArray[np.void]:
        """
        Take displacement samples, and give the index at the grid points they complete.

        Parameters
        ----------
        stamps_ns : array_like of int64, shape (n,)
            Header stamps.
        lateral : array_like, shape (n,)
            y, m.
        speed : array_like, shape (n,) or scalar
            Running speed, m/s; only windows measured in metres use it.

        Returns
        -------
        ndarray of CRITERION_DTYPE, shape (m,)
        """
        stamps, acceleration, speeds, restarts = self._acceleration.update(
            stamps_ns, lateral, speed
        )
        rows = np.empty(stamps.size, dtype=CRITERION_DTYPE)
        rows['stamp_ns'] = stamps
        for begin, end in runs(restarts):
            if restarts[begin]:
                self._clear()
            rows['index'][begin:end] = self._indices(acceleration[begin:end], speeds[begin:end])
        rows['exceeded'] = rows['index'] > self.limit
        if stamps.size:
            self._index = float(rows['index'][-1])
            self._stamp = int(stamps[-1])
        return rows
