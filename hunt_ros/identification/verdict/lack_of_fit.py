"""Does the law follow the measured limit cycle over the whole range? A test, and how much."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.dynamics.growth_law import GrowthLaw
from hunt_ros.identification.fit import FittedLaw
from hunt_ros.identification.likelihood.stationary import stationary_amplitude
from hunt_ros.identification.record.segments import Run

#: A discrepancy is a lack of fit if chance makes it in one case of a hundred, and it is
#: more than this share of the amplitude.
_LEVEL = 0.01
_SHARE = 0.01
#: Amplitudes are not known to better than this share.
_FLOOR = 1e-4
#: Logarithm of the amplitude that a state counts as off where the law has no limit cycle.
_ABSENT = 0.3
#: Relative deviation from which an amplitude wanders too far to be compared: which part of
#: its wandering a plateau shows, and whether it counts as hunting, is chance.
_WANDERS = 0.2
#: Distance from the fold, relative, within which a state lingers.
_LINGERING = 0.025
#: Time over which random forcing adds up before damping forgets it, s.
_MEMORY_S = 5.0


@dataclass(frozen=True)
class LackOfFit:
    """
    Result of the test.

    Parameters
    ----------
    p : float
        Probability of a discrepancy this large if the law held; NaN where there are too
        few steady states to tell.
    share : float
        RMS of the systematic discrepancy, relative to the amplitude.
    """

    p: float = math.nan
    share: float = 0.0

    @property
    def flagged(self) -> bool:
        """Whether the law does not fit."""
        return self.p < _LEVEL and self.share > _SHARE


def lack_of_fit(
    law: GrowthLaw,
    states: Sequence[SteadyState],
    noise: NDArray[np.float64] | None = None,
) -> LackOfFit:
    """
    Test the stable branch of a law against steady amplitudes.

    The logarithmic residuals are regressed on a cubic in the speed. A law that fits
    leaves nothing for it; the scatter of the states around the cubic is the
    pure error.

    Parameters
    ----------
    law : GrowthLaw
        The law that was fitted.
    states : sequence of SteadyState
        Hunting states only.
    noise : ndarray, shape (5,), optional
        Forcing found beside the law: the states are then compared with the mean amplitude
        of the forced motion, which near a critical speed is not that of the branch.

    Returns
    -------
    LackOfFit

    References
    ----------
    Seber, G. A. F., Lee, A. J., Linear Regression Analysis (2003), Sect. 4.4: the F test.
    """
    speed = np.array([state.speed for state in states])
    amplitude = np.array([state.amplitude for state in states])
    if len(states) < 8 or np.ptp(speed) < 0.02 * float(np.mean(speed)):
        return LackOfFit()
    expected = _expected(law, states, noise)
    told = ~np.isinf(expected)
    residual = np.log(amplitude / np.where(told, expected, np.nan))
    residual = np.clip(np.where(np.isfinite(residual), residual, _ABSENT), -_ABSENT, _ABSENT)
    # Also just below the data: a line forced by the roller moves the fold a little.
    lowest = float(speed[told].min(initial=math.inf))
    fold = law.saddle_node((1.0 - 2.0 * _LINGERING) * lowest) if told.sum() >= 8 else None
    if fold is not None:
        # Near the fold relaxation is slow, so that the state lags behind the speed.
        told &= np.abs(speed / fold - 1.0) > _LINGERING
    if told.sum() < 8:
        return LackOfFit()
    speed, residual = speed[told], residual[told]
    basis = np.vander((speed - speed.mean()) / max(float(np.ptp(speed)), 1e-9), 4)
    fitted = basis @ np.linalg.lstsq(basis, residual, rcond=None)[0]
    freedom = residual.size - 4
    # A floor: amplitudes are not known to better than this.
    pure = max(float(np.sum((residual - fitted) ** 2)) / freedom, _FLOOR**2)
    # A law that was fitted to these states has bent towards them: p is rather too large.
    ratio = float(np.sum(fitted**2)) / 4.0 / pure
    return LackOfFit(float(stats.f.sf(ratio, 4, freedom)), float(np.sqrt(np.mean(fitted**2))))


def _expected(
    law: GrowthLaw, states: Sequence[SteadyState], noise: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Amplitudes that the law expects, m; inf for one that wanders too far to be compared."""
    speed = np.array([state.speed for state in states])
    line = np.array([state.line_power for state in states])
    if noise is None:
        return law.steady_amplitudes(speed, line)[1]
    mean, std = stationary_amplitude(law, noise, speed, line)
    return np.where(std > _WANDERS * mean, np.inf, mean)


def missed_transients(fitted: FittedLaw, runs: Sequence[Run]) -> tuple[int, int]:
    """
    Count the free transients that go another way than the law says.

    Parameters
    ----------
    fitted : FittedLaw
        The law, with the random forcing that was found beside it.
    runs : sequence of Run
        Of all records.

    Returns
    -------
    missed, all : int
        A transient is missed where the change of ln A and the integral of the growth rate
        along it are apart by more than a third of the larger, and by more than noise.
    """
    law, theta = fitted.law, fitted.fit.theta
    # Below this the random forcing takes the motion where it likes, whatever the law.
    forcing = math.sqrt(math.exp(theta[-3]) * _MEMORY_S + math.exp(theta[-2]))
    floor = 4.0 * law.scales.amplitude * forcing
    missed = count = 0
    for run in runs:
        envelope = run.envelope
        for segment in run.segments:
            if segment.kind != 'transient':
                continue
            stamp = envelope.start_ns + 1e9 * envelope.time
            inside = (stamp >= segment.start_ns - 1e6) & (stamp <= segment.end_ns + 1e6)
            amplitude, speed = envelope.amplitude[inside], envelope.speed[inside]
            time = envelope.time[inside]
            line = np.nan_to_num(envelope.line_power[inside])
            large = np.isfinite(amplitude) & (amplitude > floor)
            if large.sum() < 4:
                continue
            amplitude, speed, time = amplitude[large], speed[large], time[large]
            rate = law.growth_rate(speed, amplitude, line[large])
            said = float(np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)))
            seen = math.log(float(amplitude[-1] / amplitude[0]))
            count += 1
            missed += abs(said - seen) > 0.35 * max(abs(said), abs(seen)) + 0.4
    return missed, count


def contradictions(states: Sequence[SteadyState]) -> str:
    """
    Name runs whose limit cycles at one speed differ beyond error and by more than a tenth.

    Parameters
    ----------
    states : sequence of SteadyState
        Hunting states of all runs.

    Returns
    -------
    str
        Of the worst pair; '' where the runs agree.
    """
    worst, said = 0.1, ''
    for one, other in combinations(states, 2):
        if one.source == other.source or abs(one.speed - other.speed) > 0.01 * one.speed:
            continue
        apart = abs(one.amplitude - other.amplitude)
        share = apart / max(one.amplitude, other.amplitude)
        if share > worst and apart > 5.0 * math.hypot(one.amplitude_std, other.amplitude_std):
            worst = share
            said = (
                f'runs contradict each other: at {one.speed:.3g} m/s the limit cycle is'
                f' {1e3 * one.amplitude:.3g} mm in {one.source} and'
                f' {1e3 * other.amplitude:.3g} mm in {other.source}'
            )
    return said
