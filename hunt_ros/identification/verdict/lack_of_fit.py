"""Does the law follow the measured limit cycle over the whole range? A test, and how much."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.dynamics.growth_law import GrowthLaw
from hunt_ros.identification.fit import FittedLaw
from hunt_ros.identification.likelihood.stationary import forcing, stationary_amplitude
from hunt_ros.identification.record.channels import runs as spans
from hunt_ros.identification.record.segments import Run
from hunt_ros.identification.uncertainty import law_covariance

#: A discrepancy is a lack of fit if chance makes it in one case of a hundred, and it is
#: more than this share of the amplitude.
_LEVEL = 0.01
_SHARE = 0.01
#: Largest ratio of it and chance that deviations are stretched for: beyond it laws without an end
#: of the growth are drawn.
_MOST = 10.0
#: Share of its variance that a direction of the residuals keeps at least: the covariance of a
#: fit is not known to better.
_LEAST_LEFT = 0.05
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
    ratio : float
        Its mean square over that of chance.
    """

    p: float = math.nan
    share: float = 0.0
    ratio: float = 1.0

    @property
    def flagged(self) -> bool:
        """Whether the law does not fit."""
        return self.p < _LEVEL and self.share > _SHARE

    @property
    def stretch(self) -> float:
        """
        Factor on the deviations of what the limit cycle tells, where the law misses it by more
        than chance.

        References
        ----------
        Birge, R. T. (1932), Phys. Rev. 40, 207-227.
        """
        return math.sqrt(min(max(self.ratio, 1.0), _MOST)) if self.p < _LEVEL else 1.0


def lack_of_fit(
    law: GrowthLaw,
    states: Sequence[SteadyState],
    noise: NDArray[np.float64] | None = None,
    covariance: NDArray[np.float64] | None = None,
) -> LackOfFit:
    """
    Test the stable branch of a law against steady amplitudes.

    A state that follows a ramp of the speed lags behind the branch, most where relaxation is
    slow: near v_c of a soft onset, and near a fold. It stands where the growth rate of the law
    is not zero but its own. The logarithmic residuals from there are regressed on a cubic in the
    speed. A law that fits leaves nothing for it; the scatter of the states around the cubic is
    the pure error.

    Parameters
    ----------
    law : GrowthLaw
        The law that was fitted.
    states : sequence of SteadyState
        Hunting states only.
    noise : ndarray, shape (5,), optional
        Forcing found beside the law: the states are then compared with the mean amplitude
        of the forced motion, which near a critical speed is not that of the branch.
    covariance : ndarray, shape (10, 10), optional
        Of the law's coefficients, where it was fitted to these states: by the likelihood.

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
    expected, error = _expected(law, states, noise)
    residual = np.log(amplitude / expected)
    residual = np.clip(np.where(np.isfinite(residual), residual, _ABSENT), -_ABSENT, _ABSENT)
    # Also just below the data: a line forced by the roller moves the fold a little.
    fold = law.folds((1.0 - 2.0 * _LINGERING) * float(speed.min()))[0, 0]
    # Near the fold relaxation is slow: a state that stands there may be on its way.
    told = np.isfinite(error) & ~(np.abs(speed / fold - 1.0) <= _LINGERING)
    if told.sum() < 8:
        return LackOfFit()
    bent = _bent(law, states, covariance)
    return _against_curve(speed[told], residual[told], error[told], bent[told])


def _against_curve(
    speed: NDArray[np.float64],
    residual: NDArray[np.float64],
    error: NDArray[np.float64],
    bent: NDArray[np.float64],
) -> LackOfFit:
    """
    Regress the residuals on a cubic in the speed; what scatters about it is pure error.

    A law that was fitted to these states has bent towards them. Of each direction of the cubic
    the residuals then hold only what the fit could not take up, and count for as much.

    Parameters
    ----------
    speed : ndarray, shape (n,)
        m/s.
    residual : ndarray, shape (n,)
        ln of the measured over the expected amplitude.
    error : ndarray, shape (n,)
        Standard deviation of each that is expected of random motion.
    bent : ndarray, shape (n, k)
        Change of ln of each expected amplitude with k independent directions of the law's
        coefficients, by one deviation each.

    Returns
    -------
    LackOfFit

    References
    ----------
    Satterthwaite, F. E. (1946), Biometrics Bulletin 2, 110-114: degrees of freedom of a sum of
    squares of unequal variances.
    """
    x = (speed - speed.mean()) / max(float(np.ptp(speed)), 1e-9)
    basis = np.vander(x, 4)
    freedom = residual.size - 4
    pure = np.inf
    # Once for the scatter of all alike, once more with the wandering of each beside it.
    for _ in range(2):
        weight = np.ones(residual.size) if pure == np.inf else _weights(pure, error)
        rows = basis * weight[:, None]
        fitted = basis @ np.linalg.lstsq(rows, residual * weight, rcond=None)[0]
        # A floor: amplitudes are not known to better than this.
        pure = max(float(np.sum((weight * (residual - fitted)) ** 2)) / freedom, _FLOOR**2)
    directions = np.linalg.qr(basis * weight[:, None])[0]
    taken = directions.T @ (weight[:, None] * bent)
    left = np.clip(1.0 - np.linalg.svd(taken, compute_uv=False) ** 2 / pure, _LEAST_LEFT, 1.0)
    left = np.concatenate([left, np.ones(4 - left.size)])
    ratio = float(np.sum((weight * fitted) ** 2)) / float(left.sum()) / pure
    terms = float(left.sum() ** 2 / np.sum(left**2))
    share = float(np.sqrt(np.mean(fitted**2)))
    return LackOfFit(float(stats.f.sf(ratio, terms, freedom)), share, ratio)


def _weights(pure: float, error: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Weights of states that wander, of which all together scatter by `pure`.

    A law that does not fit finds a forcing that is too strong, and would be excused by it:
    what the states wander by is a part of what they are seen to scatter by, not more.
    """
    wandering = error**2
    mean = max(float(np.mean(wandering)), _FLOOR**2)
    variance = max(pure - mean, 0.0) + wandering * min(1.0, pure / mean)
    return np.asarray(np.sqrt(pure / np.maximum(variance, 1e-2 * pure)))


def _bent(
    law: GrowthLaw, states: Sequence[SteadyState], covariance: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Change of ln A of the stable branch with each direction of the law that is open, (n, k)."""
    if covariance is None:
        return np.zeros((len(states), 1))
    open_to = np.diag(covariance) > 0.0
    size = np.where(open_to, np.sqrt(np.abs(np.diag(covariance))), 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    changes = []
    for value, vector in zip(values, vectors.T, strict=True):
        step = size * vector * math.sqrt(max(float(value), 0.0))
        # A tenth of a deviation: the branch bends little, and is still there.
        above, below = (
            _along(replace(law, p=law.p + side * 0.1 * step), states)[1] for side in (1.0, -1.0)
        )
        changes.append(np.nan_to_num(np.log(above / below) / 0.2))
    return np.stack(changes, axis=1)


def _expected(
    law: GrowthLaw, states: Sequence[SteadyState], noise: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Amplitudes that the law expects, m, and by how much a plateau's mean may be off, of it."""
    here, amplitude = _along(law, states)
    if noise is None:
        return amplitude, np.zeros(len(states))
    speed = np.array([state.speed for state in states])
    line = np.array([state.line_power for state in states])
    mean, std = stationary_amplitude(here, noise, speed, line)
    seconds = np.array([max(state.end_ns - state.start_ns, 1) / 1e9 for state in states])
    u, w = law.detuning(speed), (mean / law.scales.amplitude) ** 2
    push = law.scales.amplitude**2 * forcing(noise, u, np.nan_to_num(w))
    # An amplitude held weakly wanders slowly: std^2 = Q / 2 rate, and few of its turns fit in.
    share = 4.0 * std**2 / (push * seconds)
    # What stands still is off by no more; of what moves, the mean forcing meanwhile is left.
    still = [state.growth_rate == 0.0 for state in states]
    error = std / mean * np.sqrt(np.where(still, np.minimum(share, 1.0), share))
    blurred = np.maximum(std, error * mean) > _WANDERS * mean
    return mean, np.nan_to_num(np.where(blurred, np.inf, error), nan=0.0, posinf=np.inf)


def _along(law: GrowthLaw, states: Sequence[SteadyState]) -> tuple[GrowthLaw, NDArray[np.float64]]:
    """Law of each state in the frame that moves as it does, and its stable amplitude, m, (n,)."""
    speed, line, rate = np.array(
        [(state.speed, state.line_power, state.growth_rate) for state in states]
    ).T
    p = np.tile(law.p, (len(states), 1))
    p[:, 0] -= rate
    moving = replace(law, p=p)
    return moving, moving.steady_amplitudes(speed[:, None], line[:, None])[1][:, 0]


def misfit_of(fitted: FittedLaw, states: Sequence[SteadyState]) -> LackOfFit:
    """Test the stable branch of a fitted law against the steady amplitudes it was fitted to."""
    return lack_of_fit(fitted.law, states, fitted.noise, law_covariance(fitted.fit))


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
    moved = [(run.envelope, s) for run in runs for s in run.segments if s.kind == 'transient']
    for envelope, segment in moved:
        stamp = envelope.start_ns + 1e9 * envelope.time
        inside = (stamp >= segment.start_ns - 1e6) & (stamp <= segment.end_ns + 1e6)
        # A fall and a rise with rest between them are two.
        for a, b in spans(inside & (envelope.amplitude > floor)):
            if b - a < 4:
                continue
            amplitude, time = envelope.amplitude[a:b], envelope.time[a:b]
            line = np.nan_to_num(envelope.line_power[a:b])
            rate = law.growth_rate(envelope.speed[a:b], amplitude, line)
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
