"""The quantities a law implies, each with the spread that the draws give it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.dynamics.growth_law import normal_form_of
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS
from hunt_ros.identification.posterior import Posterior, normal_scores
from hunt_ros.identification.result import BranchPoint
from hunt_ros.identification.uncertainty import summary
from hunt_ros.samples import Uncertain

#: Step that spreads points evenly over an interval, however many there are.
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
#: Speeds at which the branches are given.
_BRANCH_POINTS = 41
#: Draws that stand in the parameter file.
_SAMPLE = 64


def numbers_of(posterior: Posterior, speed_std: float) -> dict[str, Uncertain | None]:
    """
    Return the numbers of a law, each with the spread that the draws give it.

    Parameters
    ----------
    posterior : Posterior
        The law chosen, and its draws.
    speed_std : float
        Deviation of a speed by the resolution of its reading, m/s.

    Returns
    -------
    dict of str to Uncertain or None
        By the key of the JSON, SI units; None where too few draws have it.
    """
    v_c, v_n = posterior.chosen[:2]
    both = posterior.table[:, :2]
    return {
        'v_c': posterior.number('v_c', speed_std),
        'v_n': posterior.number('v_n', speed_std),
        'fold_amplitude_m': posterior.number('fold_amplitude'),
        'hysteresis_width': summary(
            v_c - v_n, both[:, 0] - both[:, 1], math.sqrt(2.0) * speed_std
        ),
        **{f'coefficients.{name}': posterior.number(name) for name in COEFFICIENTS},
    }


def identified(posterior: Posterior, speed_std: float) -> IdentifiedNormalForm | None:
    """Return the normal form of the law chosen, with its covariance; None where it has none."""
    form = normal_form_of(posterior.law, *posterior.speeds)
    if form is None:
        return None
    known = [form for form in posterior.forms if form is not None]
    rows = np.array([IdentifiedNormalForm(form).vector for form in known])
    matrix = _rank_covariance(rows)
    matrix[0, 0] += speed_std**2
    provenance = {'method': 'trajectory likelihood', 'law': posterior.law.name}
    sample = rows[np.linspace(0, len(rows) - 1, _SAMPLE).round().astype(np.intp)]
    sample[:, 0] += speed_std * np.random.default_rng(0).standard_normal(_SAMPLE)
    sample = np.vectorize(lambda x: float(f'{x:.6g}'))(sample)  # as short as it is sure
    return IdentifiedNormalForm(form, matrix, provenance, sample=sample)


def branches(posterior: Posterior) -> tuple[BranchPoint, ...]:
    """Both limit cycles over the speeds of the data."""
    low, high = posterior.speeds
    speeds, fold = np.linspace(low, high, _BRANCH_POINTS), posterior.chosen[1]
    if low < fold < high:
        speeds = np.unique(np.concatenate([speeds, fold + np.array([1e-4, 0.01, 0.03, 0.1])]))
    found = posterior.branches(speeds)
    return tuple(map(BranchPoint, speeds.tolist(), found['stable'], found['unstable']))


def disturbance(posterior: Posterior, observed: ObservedCriticalSpeeds) -> Uncertain | None:
    """Disturbance that explains the observed jump up: A_u there, Appendix A."""
    low, high = observed.v_c_between
    if observed.v_c is None or low is None or high is None:
        return None
    law, laws = posterior.law, posterior.laws
    value = float(law.steady_amplitudes(observed.v_c)[0][0])
    # The jump lies anywhere between the two states: each draw has it elsewhere.
    share = (np.arange(len(laws.p)) * _GOLDEN) % 1.0
    sample = laws.steady_amplitudes(low + share[:, None] * (high - low))[0][:, 0]
    return summary(value, sample, least=0.5)


def _rank_covariance(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Covariance with the deviations that `summary` gives, and the correlations of normal scores.

    Far draws of a direction that the data leave open neither stretch nor turn it.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        Draws.

    References
    ----------
    Liu, H., Lafferty, J., Wasserman, L. (2009), J. Mach. Learn. Res. 10, 2295-2328: normal
    scores of the ranks.
    """
    below, above = np.percentile(rows, [15.87, 84.13], axis=0)
    scores = normal_scores(rows)
    correlation = scores.T @ scores / len(rows)
    std = 0.5 * (above - below)
    covariance: NDArray[np.float64] = correlation * np.outer(std, std)
    return covariance
