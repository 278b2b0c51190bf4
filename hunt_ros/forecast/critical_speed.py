"""
Forecast of the linear critical speed before it is reached (flutter-test practice).

Below v_c the quiet response to broadband excitation is a damped oscillation whose
damping falls with speed. Its spectrum at each speed level tells the damping; a
damping law carries it to the speed where it vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.estimation.tracker_config import Shaft
from hunt_ros.forecast.damping_laws import SmoothLaw, WheelsetLaw
from hunt_ros.forecast.level_spectrum import SpeedLevel
from hunt_ros.forecast.quiet_levels import QuietLevels
from hunt_ros.forecast.response_spectrum import ResponseLaw, Spectra
from hunt_ros.forecast.whittle import WhittleFit, best_fit, critical_interval
from hunt_ros.samples import NANOSECONDS, Uncertain
from hunt_ros.settings import Settings, setting

#: Why there is no number.
COLLECTING = 'collecting speed levels'
NO_EXCITATION = 'not enough excitation'
NOT_FALLING = 'the damping seen so far does not tell where it vanishes'
NO_FIT = 'the response does not follow the damping law'


@dataclass(frozen=True)
class ForecastSettings(Settings):
    """
    How the forecast of v_c is made.

    Raises
    ------
    ConfigError
        Naming the field that is out of its range.
    """

    lowest_hz: float = setting(0.8, 'lowest frequency looked at', unit='Hz', low=0.05, high=50.0)
    highest_hz: float = setting(8.0, 'highest frequency looked at', unit='Hz', low=0.2, high=100.0)
    channel: str = setting(
        'lateral', 'which of the two is given to it', choices=('lateral', 'yaw')
    )
    speed_tolerance: float = setting(
        0.015, 'relative change of speed within one level', low=1e-4, high=0.1
    )
    shortest_level_s: float = setting(6.0, 'shortest level used', unit='s', low=0.1, high=6e3)
    longest_level_s: float = setting(
        60.0, 'a longer hold is cut into levels', unit='s', low=0.2, high=6e3
    )
    settle_s: float = setting(2.0, 'left out after a change of speed', unit='s', low=0.0, high=6e2)
    refresh_s: float = setting(
        20.0, 'a new forecast after this time at the latest', unit='s', low=1.0, high=3600.0
    )
    live: bool = setting(True, 'forecast as the run goes; false: only when asked to finish')
    fewest_levels: int = setting(3, 'speeds needed before a forecast', low=2, high=100)
    span: float = setting(
        0.1, 'how far apart the speeds must be, relative to the highest', low=0.0, high=0.9
    )
    widest: float = setting(
        0.25, 'no number where half the 95 % interval is wider, relative', low=0.01, high=1.0
    )
    farthest: float = setting(
        0.6, 'no number further than this beyond the highest speed, relative', low=0.05, high=3.0
    )
    clearance: float = setting(
        2.0, 'how far the peak must stand above the noise floor (power)', low=0.1, high=1e3
    )
    worst_misfit: float = setting(
        3.0, 'no number where the law fits worse (1 is perfect)', low=1.1, high=100.0
    )
    roller_diameter_m: float = setting(0.3, 'roller diameter', unit='m', low=0.01, high=10.0)

    def paced(self, faster: float) -> ForecastSettings:
        """
        Return the settings for a rig that hunts faster: the same numbers of periods.

        Parameters
        ----------
        faster : float
            Its hunting frequency over the one that these settings are made for.
        """
        return replace(
            self,
            lowest_hz=min(max(self.lowest_hz * faster, 0.05), 50.0),
            highest_hz=min(max(self.highest_hz * faster, 0.2), 100.0),
            shortest_level_s=self.shortest_level_s / faster,
            longest_level_s=self.longest_level_s / faster,
            settle_s=self.settle_s / faster,
        )


@dataclass(frozen=True)
class Forecast:
    """
    What is known of v_c from the quiet response so far.

    Parameters
    ----------
    stamp_ns : int
        End of the data used.
    critical_speed : Uncertain or None
        v_c, m/s, with its 95 % interval; None where it cannot be known yet.
    reason : str
        Why there is no number; empty where there is one.
    law : str
        'wheelset' or 'smooth': the damping law behind it.
    levels : int
        Speed levels used.
    speeds, growth_rates, frequencies : tuple of float
        The law at the speeds of the levels: m/s, 1/s (negative: damped), Hz.
    misfit : float
        1 where the law fits; the interval is widened by its root above 1.
    """

    stamp_ns: int = 0
    critical_speed: Uncertain | None = None
    reason: str = COLLECTING
    law: str = ''
    levels: int = 0
    speeds: tuple[float, ...] = ()
    growth_rates: tuple[float, ...] = ()
    frequencies: tuple[float, ...] = ()
    misfit: float = math.nan


class CriticalSpeedForecast:
    """
    Forecast of v_c, updated live as speed levels accumulate.

    With a rig, the wheelset's own damping law (linear Eqs. (2), (3)); without one, or
    where the rig's law does not fit, the smooth law. Feeding a record in any blocks
    gives the same forecasts. What becomes of bad samples: see `QuietLevels`.

    Parameters
    ----------
    settings : ForecastSettings
    rig : RigParameters, optional
        Geometry and stiffness; its creep coefficients are not trusted.
    shafts : sequence of Shaft
        What turns, with its known lines in turns of the roller.
    """

    def __init__(
        self,
        settings: ForecastSettings | None = None,
        rig: RigParameters | None = None,
        shafts: Sequence[Shaft] = (Shaft((1.0, 2.0)),),
    ) -> None:
        self.settings = ForecastSettings() if settings is None else settings
        self._laws: list[ResponseLaw] = (
            [SmoothLaw()]
            if rig is None
            else [
                WheelsetLaw(rig, channel=self.settings.channel),
                SmoothLaw(),
            ]
        )
        s = self.settings
        diameter, low, high = s.roller_diameter_m, s.lowest_hz, s.highest_hz
        if rig is not None:
            diameter = rig.roller_diameter_m
            own = WheelsetLaw(rig).band(())
            low, high = min(low, own[0]), max(high, own[1])
        self._levels = QuietLevels(
            low,
            high,
            s.speed_tolerance,
            s.shortest_level_s,
            s.longest_level_s,
            s.settle_s,
            diameter,
            shafts,
        )
        self.reset()

    def reset(self) -> None:
        """Forget everything: as new."""
        self._levels.reset()
        self._forecast = Forecast()
        self._fitted_ns = 0
        self._closed_s = self._gathered_s = 0.0
        self._before: dict[str, NDArray[np.float64]] = {}

    @property
    def forecast(self) -> Forecast:
        """The latest forecast."""
        return self._forecast

    @property
    def levels(self) -> tuple[SpeedLevel, ...]:
        """The levels so far, with the open one if it is long enough."""
        opened = self._levels.open_level()
        return (*self._levels.levels, *(() if opened is None else (opened,)))

    def update(
        self,
        stamps_ns: ArrayLike,
        lateral: ArrayLike,
        speed: ArrayLike,
        roller_angle: ArrayLike = math.nan,
        quiet: ArrayLike = True,
    ) -> Forecast:
        """
        Take a block of samples.

        Parameters
        ----------
        stamps_ns : array_like of int64, shape (n,)
            Header stamps.
        lateral : array_like, shape (n,)
            y, m, or psi, rad: the channel of the settings.
        speed : array_like, shape (n,) or scalar
            m/s.
        roller_angle : array_like, shape (n,) or scalar
            Continuous angle of the roller, rad; NaN where it is not known.
        quiet : array_like of bool, shape (n,) or scalar
            False while the wheelset hunts or decays: such samples say nothing of the
            quiet response, and end the level they fall into.

        Returns
        -------
        Forecast
            The latest.
        """
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        shape = stamps.shape
        columns = [
            np.ascontiguousarray(np.broadcast_to(np.asarray(x, dtype=np.float64), shape))
            for x in (lateral, speed, roller_angle)
        ]
        calm = np.broadcast_to(np.asarray(quiet, dtype=np.bool_), shape)
        changes = (np.flatnonzero(np.diff(calm)) + 1).tolist()
        for begin, end in pairwise([0, *changes, stamps.size] if stamps.size else []):
            if not calm[begin]:
                self._levels.mark_disturbed()
                continue
            parts = (column[begin:end] for column in columns)
            for block_ns in self._levels.update(stamps[begin:end], *parts):
                if self.settings.live:
                    self._refresh(block_ns)
        return self._forecast

    def finish(self) -> Forecast:
        """Make the forecast from all that was fed so far, the open level included."""
        self._refit(self._levels.last_stamp_ns)
        return self._forecast

    def _refresh(self, stamp_ns: int) -> None:
        """Refit when a level was closed, or when the last forecast is old and more is known."""
        closed, gathered = self._levels.closed_s, self._levels.gathered_s
        refresh_ns = round(self.settings.refresh_s * NANOSECONDS)
        # Not inside one refresh of the last: later, or the clock was set back.
        old = not 0 <= stamp_ns - self._fitted_ns < refresh_ns
        if closed == self._closed_s and not (old and gathered > 1.03 * self._gathered_s):
            return
        self._fitted_ns, self._closed_s, self._gathered_s = stamp_ns, closed, gathered
        self._refit(stamp_ns)

    def _refit(self, stamp_ns: int) -> None:
        """Fit the laws to the levels, in their order, until one fits."""
        levels = list(self.levels)
        speeds = [level.speed for level in levels]
        too_near = not speeds or max(speeds) - min(speeds) < self.settings.span * max(speeds)
        if len(levels) < self.settings.fewest_levels or too_near:
            self._forecast = Forecast(stamp_ns, levels=len(levels))
            return
        for law in self._laws:
            self._forecast = self._by_law(law, levels, stamp_ns)
            if self._forecast.reason != NO_FIT:
                break

    def _by_law(self, law: ResponseLaw, levels: list[SpeedLevel], stamp_ns: int) -> Forecast:
        """Return the forecast by one law."""
        spectra = Spectra(levels, *law.band(levels))
        fit = best_fit(law, spectra, self._before.get(law.name))
        if fit is None:
            return Forecast(stamp_ns, None, NO_FIT, law.name, len(levels))
        self._before[law.name] = fit.theta
        modes = [law.eigenvalue(fit.theta, level.speed) for level in levels]
        reason, critical = self._judge(law, fit)
        return Forecast(
            stamp_ns,
            critical,
            reason,
            law.name,
            len(levels),
            tuple(level.speed for level in levels),
            tuple(mode.real for mode in modes),
            tuple(mode.imag / (2.0 * math.pi) for mode in modes),
            fit.misfit,
        )

    def _judge(self, law: ResponseLaw, fit: WhittleFit) -> tuple[str, Uncertain | None]:
        """Say whether the fit supports a number, and which."""
        spectra = fit.spectra
        floor = math.exp(fit.theta[-1])
        flat = np.average(spectra.power, weights=spectra.weight)
        flat_cost = float(np.sum(spectra.weight * (math.log(flat) + spectra.power / flat)))
        clear = np.max(fit.expected) > (1.0 + self.settings.clearance) * floor
        # 30: the law must be e^30 times likelier than white noise, whatever its parameters.
        if not clear or flat_cost - fit.cost < 30.0:
            return NO_EXCITATION, None
        if fit.misfit > self.settings.worst_misfit:
            return NO_FIT, None
        critical = critical_interval(law, fit, float(np.max(spectra.speed)))
        half = 0.5 * (critical.high - critical.low)
        beyond = critical.value / float(np.max(spectra.speed)) - 1.0
        if not (
            half <= self.settings.widest * critical.value and beyond <= self.settings.farthest
        ):
            return NOT_FALLING, None
        return '', critical
