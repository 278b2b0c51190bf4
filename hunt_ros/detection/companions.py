"""
What runs beside the detector on the same samples: the railway criteria and the forecast of v_c.

    companions = Companions(CompanionConfig(criteria=('cfr_213_333',)))
    verdicts = companions.update(detect(HuntingDetector(), record).motion)

They are fed with what the detector gives out, after its door: what is late, silent or
stuck is so for them as well, and a replay of a live run tells them what the run told.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.criteria import CRITERIA, CriteriaPanel, Verdict
from hunt_ros.detection.configuration import DetectorConfig, with_frequency
from hunt_ros.detection.estimates import roller_diameter, shafts
from hunt_ros.detection.output import Event
from hunt_ros.detection.regions import Level
from hunt_ros.dynamics.parameters import RigParameters, paper_rig
from hunt_ros.errors import ConfigError
from hunt_ros.forecast import CriticalSpeedForecast, Forecast
from hunt_ros.settings import Settings, setting

#: Rate at which the criteria work, Hz.
_CRITERIA_HZ = 200.0


@dataclass(frozen=True)
class CompanionConfig(Settings):
    """
    Settings of what runs beside the detector.

    Raises
    ------
    ConfigError
        For an unknown criterion, or a value out of its range.
    """

    criteria: tuple[str, ...] = setting(
        (), f'railway criteria to run as well: {", ".join(CRITERIA)}', fixed=True
    )
    criteria_scale: float = setting(1.0, 'their limits times this', low=1e-4, high=1e4, fixed=True)
    forecast: str = setting(
        'smooth',
        'damping law of the forecast of v_c from the quiet response',
        choices=('off', 'smooth', 'wheelset'),
        fixed=True,
    )
    forecast_rig: str = setting(
        '', "YAML file of the rig for the law 'wheelset'; empty: the built-in rig", fixed=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.criteria:
            if name and name not in CRITERIA:
                raise ConfigError(f'criteria: unknown {name!r}, expected some of {list(CRITERIA)}')


class Companions:
    """
    Criteria and forecast, fed with the outputs of a detector.

    Feeding the outputs of a run one by one, or joined, gives the same verdicts and the
    same forecasts. What becomes of bad samples: the detector has left them out.

    Parameters
    ----------
    config : CompanionConfig
        What to run.
    detector : DetectorConfig, optional
        What the detector is told of the rig: its channels (without a lateral sensor the
        forecast is made from yaw), where it hunts, its roller and the known lines.
    rig : RigParameters, optional
        For the law 'wheelset'; without it the built-in rig.
    live : bool
        Forecast as the run goes; False: only when asked to `finish`.

    Attributes
    ----------
    idle : bool
        There is nothing to do.

    Raises
    ------
    ConfigError
        For criteria without a lateral sensor.
    """

    def __init__(
        self,
        config: CompanionConfig,
        detector: DetectorConfig | None = None,
        rig: RigParameters | None = None,
        live: bool = True,
    ) -> None:
        detector = detector or DetectorConfig()
        channels = detector.channels
        names = [name for name in config.criteria if name]
        channel = 'lateral' if 'lateral' in channels else 'yaw'
        if names and channel != 'lateral':
            raise ConfigError(f'criteria: {names} need the lateral channel, got {channels}')
        self._criteria = CriteriaPanel(names, _CRITERIA_HZ, config.criteria_scale)
        self._forecast: CriticalSpeedForecast | None = None
        if config.forecast != 'off':
            tuned = with_frequency(detector)
            self._forecast = CriticalSpeedForecast(
                (rig or paper_rig()) if config.forecast == 'wheelset' else None,
                tuned.hunting_frequency_hz,
                tuned.followed_hz,
                roller_diameter(detector),
                channel,
                shafts(detector),
                live,
            )
        self.idle = not names and self._forecast is None

    @property
    def forecast(self) -> Forecast | None:
        """The latest forecast; None where none is made."""
        return None if self._forecast is None else self._forecast.forecast

    def reset(self) -> None:
        """Forget everything: as new."""
        self._criteria.reset()
        if self._forecast is not None:
            self._forecast.reset()

    def update(self, motion: NDArray[np.void]) -> tuple[Verdict, ...]:
        """
        Take samples (MOTION_DTYPE) that the detector has given out.

        Returns
        -------
        tuple of Verdict
            Criteria that began or ceased to exceed their limit.
        """
        samples = motion['stamps_ns'], motion['values'], motion['speed']
        if self._forecast is not None:
            self._forecast.update(*samples, motion['roller_angle'], motion['quiet'])
        return self._criteria.update(*samples)

    def finish(self) -> Forecast | None:
        """Forecast from all that was fed; None where none is made."""
        return None if self._forecast is None else self._forecast.finish()


def criterion_event(
    verdict: Verdict, stamp_ns: int, level: Level, numbers: Mapping[str, float]
) -> Event:
    """
    Return the event that a criterion began or ceased to exceed its limit.

    Parameters
    ----------
    verdict : Verdict
        Which it is.
    stamp_ns : int
        Row at which it is known.
    level : Level
        Of that row: a criterion does not change it.
    numbers : mapping of str to float
        Of that row, see `Event`.
    """
    index = f'{verdict.index:.3g} m/s^2' if math.isfinite(verdict.index) else 'not defined'
    word = 'criterion_exceeded' if verdict.exceeded else 'criterion_cleared'
    cause = f'{verdict.criterion}: {index}, limit {verdict.limit:.3g} m/s^2'
    since_ns = min(verdict.stamp_ns, stamp_ns)
    return Event(stamp_ns, word, level, since_ns, verdict.criterion, cause, numbers=numbers)
