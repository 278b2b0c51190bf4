"""
Forecast of the linear critical speed before it is reached (flutter-test practice).

Below v_c the quiet response to broadband excitation is a damped oscillation whose
damping falls with speed. Its spectrum at each speed level tells the damping; a
damping law carries it to the speed where it vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.estimation.tracker_config import REFERENCE_HZ, Shaft
from hunt_ros.forecast.damping_laws import SmoothLaw, WheelsetLaw
from hunt_ros.forecast.levels import QuietLevels, SpeedLevel
from hunt_ros.forecast.response import Fit, ResponseLaw, Spectra, best_fit
from hunt_ros.samples import NANOSECONDS, Uncertain

#: What is looked at on a rig of the reference frequency, Hz.
BAND = (0.8, 8.0)
#: Why there is no number.
COLLECTING = 'collecting speed levels'
NO_EXCITATION = 'not enough excitation'
NOT_FALLING = 'the damping seen so far does not tell where it vanishes'
NO_FIT = 'the response does not follow the damping law'
RESTED = 'the rig has rested at speeds at which the damping seen should have vanished'


#: A new forecast after this time at the latest.
REFRESH_NS = 20 * NANOSECONDS
#: Levels needed before a forecast, and how far apart their speeds must be, over the highest.
FEWEST_LEVELS, SPAN = 3, 0.1
#: No number where half the 95 % interval is wider than this, or where it is further than this
#: beyond the highest speed, relative.
WIDEST, FARTHEST = 0.25, 0.6
#: No number whose interval ends so far below a speed at which the rig has rested, relative: what
#: its own amplitude holds down (supercritical) may be quiet a little beyond v_c, no further.
HELD = 0.1
#: How far the peak must stand above the noise floor (power), and the law above white noise (ln of
#: the likelihood ratio, whatever the parameters of the law).
CLEARANCE, LIKELIER = 2.0, 30.0
#: No number where the law fits worse (1 is perfect).
WORST_MISFIT = 3.0


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
    misfit : float
        1 where the law fits; the interval is widened by its root above 1.
    """

    stamp_ns: int = 0
    critical_speed: Uncertain | None = None
    reason: str = COLLECTING
    law: str = ''
    levels: int = 0
    misfit: float = math.nan


class CriticalSpeedForecast:
    """
    Forecast of v_c, updated live as speed levels accumulate.

    With a rig, the wheelset's own damping law (linear Eqs. (2), (3)); without one, or
    where the rig's law does not fit, the smooth law. Feeding a record in any blocks
    gives the same forecasts. What becomes of bad samples: see `QuietLevels`.

    Parameters
    ----------
    rig : RigParameters, optional
        Geometry and stiffness; its creep coefficients are not trusted.
    frequency_hz : float
        Nominal hunting frequency, Hz: times and band are those of a number of its periods.
    band_hz : (float, float)
        Where the rig may hunt; it is looked at as well, Hz.
    roller_diameter_m : float
        Of Eq. (1), where there is no rig, m.
    channel : 'lateral' or 'yaw'
        Which of the two is given to it.
    shafts : sequence of Shaft
        What turns, with its known lines in turns of the roller.
    live : bool
        Forecast as the run goes; False: only when asked to `finish`.
    """

    def __init__(
        self,
        rig: RigParameters | None = None,
        frequency_hz: float = REFERENCE_HZ,
        band_hz: tuple[float, float] = (math.inf, 0.0),
        roller_diameter_m: float = 0.3,
        channel: str = 'lateral',
        shafts: Sequence[Shaft] = (Shaft((1.0, 2.0)),),
        live: bool = True,
    ) -> None:
        self._live = live
        self._laws: list[ResponseLaw] = [SmoothLaw()]
        faster = frequency_hz / REFERENCE_HZ
        bands = [(BAND[0] * faster, BAND[1] * faster), band_hz]
        if rig is not None:
            own = WheelsetLaw(rig, channel=channel)
            self._laws.insert(0, own)
            roller_diameter_m = rig.roller_diameter_m
            bands.append(own.band(()))
        low, high = min(band[0] for band in bands), max(band[1] for band in bands)
        self._levels = QuietLevels(
            (max(low, 0.05), min(high, 100.0)), frequency_hz, roller_diameter_m, shafts
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
            y, m, or psi, rad: the channel that was named.
        speed : array_like, shape (n,) or scalar
            m/s.
        roller_angle : array_like, shape (n,) or scalar
            Continuous angle of the roller, rad; NaN where it is not known.
        quiet : array_like of bool, shape (n,) or scalar
            False while the wheelset hunts or decays: such samples say nothing of the
            quiet response, and the level that they end holds how the hunting grew: it is dropped.

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
                if self._live:
                    self._refresh(block_ns)
        return self._forecast

    def finish(self) -> Forecast:
        """Make the forecast from all that was fed so far, the open level included."""
        self._refit(self._levels.last_stamp_ns)
        return self._forecast

    def _refresh(self, stamp_ns: int) -> None:
        """Refit when a level was closed, or when the last forecast is old and more is known."""
        closed, gathered = self._levels.closed_s, self._levels.gathered_s
        # Not inside one refresh of the last: later, or the clock was set back.
        old = not 0 <= stamp_ns - self._fitted_ns < REFRESH_NS
        if closed == self._closed_s and not (old and gathered > 1.03 * self._gathered_s):
            return
        self._fitted_ns, self._closed_s, self._gathered_s = stamp_ns, closed, gathered
        self._refit(stamp_ns)

    def _refit(self, stamp_ns: int) -> None:
        """Fit the laws to the levels, in their order, until one fits."""
        levels = list(self.levels)
        speeds = [level.speed for level in levels]
        too_near = not speeds or max(speeds) - min(speeds) < SPAN * max(speeds)
        if len(levels) < FEWEST_LEVELS or too_near:
            self._forecast = Forecast(stamp_ns, levels=len(levels))
            return
        for law in self._laws:
            self._forecast = self._by_law(law, levels, stamp_ns)
            if self._forecast.reason not in (NO_FIT, RESTED):
                break

    def _by_law(self, law: ResponseLaw, levels: list[SpeedLevel], stamp_ns: int) -> Forecast:
        """Return the forecast by one law."""
        spectra = Spectra(levels, *law.band(levels))
        fit = best_fit(law, spectra, self._before.get(law.name))
        if fit is None:
            return Forecast(stamp_ns, None, NO_FIT, law.name, len(levels))
        self._before[law.name] = fit.theta
        reason, critical = self._judge(fit)
        return Forecast(stamp_ns, critical, reason, law.name, len(levels), fit.misfit)

    def _judge(self, fit: Fit) -> tuple[str, Uncertain | None]:
        """Say whether the fit supports a number, and which."""
        spectra = fit.spectra
        floor = math.exp(fit.theta[-1])
        flat = np.average(spectra.power, weights=spectra.weight)
        clear = np.max(fit.expected) > (1.0 + CLEARANCE) * floor
        if not clear or spectra.cost_of(flat) - fit.cost < LIKELIER:
            return NO_EXCITATION, None
        if fit.misfit > WORST_MISFIT:
            return NO_FIT, None
        fastest = float(np.max(spectra.speed))
        critical = fit.critical_speed(fastest)
        if fastest > (1.0 + HELD) * critical.high:
            return RESTED, None
        half = 0.5 * (critical.high - critical.low)
        beyond = critical.value / fastest - 1.0
        if not (half <= WIDEST * critical.value and beyond <= FARTHEST):
            return NOT_FALLING, None
        return '', critical
