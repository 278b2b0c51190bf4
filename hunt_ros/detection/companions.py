"""
What runs beside the detector on the same samples: the railway criteria and the forecast of v_c.

Both want the displacement with the speed and the roller angle of the same moment;
lateral samples wait here until both are known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.criteria import CriteriaPanel, Verdict
from hunt_ros.detection.forecast import CriticalSpeedForecast, Forecast

#: Lateral samples that wait for speed and roller at the most; older ones are let go.
_MOST_WAITING = 20_000


class Companions:
    """
    Criteria and forecast, fed channel by channel like the detector.

    Parameters
    ----------
    criteria : CriteriaPanel or None
        The criteria the user has listed.
    forecast : CriticalSpeedForecast or None
        None: no forecast.
    roller : bool
        Whether the rig has a roller angle; without it the roughness line stays in.
    """

    def __init__(
        self,
        criteria: CriteriaPanel | None,
        forecast: CriticalSpeedForecast | None,
        roller: bool = True,
    ) -> None:
        self._criteria = criteria
        self._forecast = forecast
        self._slow = ('speed', 'roller') if roller else ('speed',)
        self.reset()

    def reset(self) -> None:
        """Forget everything: as new."""
        self._waiting: list[tuple[int, float]] = []
        self._known: dict[str, list[tuple[int, float]]] = {name: [] for name in self._slow}
        for part in (self._criteria, self._forecast):
            if part is not None:
                part.reset()

    @property
    def forecast(self) -> Forecast | None:
        """The latest forecast; None where none is made."""
        return None if self._forecast is None else self._forecast.forecast

    def update(
        self,
        channel: str,
        stamps_ns: NDArray[np.int64],
        values: NDArray[np.float64],
        quiet: bool = True,
    ) -> tuple[Verdict, ...]:
        """
        Take samples of one channel.

        Parameters
        ----------
        channel : str
            'lateral' (m), 'speed' (m/s) or 'roller' (rad); others are passed over.
        stamps_ns : ndarray of int64, shape (n,)
            Header stamps.
        values : ndarray of float64, shape (n,)
            The samples.
        quiet : bool
            False while the detector sees the wheelset hunt.

        Returns
        -------
        tuple of Verdict
            Criteria that began or ceased to exceed their limit.
        """
        samples = zip(stamps_ns.tolist(), values.tolist(), strict=True)
        if channel == 'lateral':
            self._waiting += samples
            del self._waiting[:-_MOST_WAITING]
        elif channel in self._known:
            self._known[channel] += samples
        else:
            return ()
        return self._release(quiet)

    def _release(self, quiet: bool) -> tuple[Verdict, ...]:
        """Hand over the lateral samples up to which speed and roller are known."""
        if not self._waiting or not all(self._known.values()):
            return ()
        until = min(known[-1][0] for known in self._known.values())
        count = sum(stamp <= until for stamp, _ in self._waiting)
        if not count:
            return ()
        ready, self._waiting = self._waiting[:count], self._waiting[count:]
        stamps = np.array([stamp for stamp, _ in ready], dtype=np.int64)
        lateral = np.array([value for _, value in ready])
        slow = {name: _interpolated(stamps, known) for name, known in self._known.items()}
        for known in self._known.values():
            behind = sum(stamp <= stamps[-1] for stamp, _ in known)
            del known[: max(0, behind - 1)]
        if self._forecast is not None:
            angle = slow.get('roller', np.full(stamps.size, np.nan))
            self._forecast.update(stamps, lateral, slow['speed'], angle, quiet=quiet)
        if self._criteria is None:
            return ()
        return self._criteria.update(stamps, lateral, slow['speed'])


def _interpolated(
    stamps_ns: NDArray[np.int64], known: Sequence[tuple[int, float]]
) -> NDArray[np.float64]:
    times = np.array([stamp for stamp, _ in known], dtype=np.int64)
    values = np.array([value for _, value in known])
    order = np.argsort(times, kind='stable')
    origin = int(stamps_ns[0])
    result: NDArray[np.float64] = np.interp(
        stamps_ns - origin, times[order] - origin, values[order]
    )
    return result
