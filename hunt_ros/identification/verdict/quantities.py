"""The quantities a law implies, each with the spread that the draws give it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS
from hunt_ros.identification.normal_form_map import normal_form_of
from hunt_ros.identification.posterior import QUANTITIES, Posterior, amplitude_at, normal_scores
from hunt_ros.identification.result import BranchPoint
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.uncertainty import summary
from hunt_ros.samples import Uncertain

#: Step that spreads points evenly over an interval, however many there are.
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
#: Speeds at which the branches are given.
_BRANCH_POINTS = 41
#: Draws that stand in the parameter file.
_SAMPLE = 64


class Quantities:
    """
    Quantities of a law, each with the spread that the draws give it; None where too few
    draws have it.

    Parameters
    ----------
    posterior : Posterior
        The law chosen, and its draws.
    settings : IdentificationSettings
        For the errors of the speed reading.
    """

    def __init__(self, posterior: Posterior, settings: IdentificationSettings) -> None:
        self._posterior, self._settings = posterior, settings
        self._law, self._drawn = posterior.law, posterior.drawn
        self._low, self._high = posterior.speeds
        self._folds, self.forms = posterior.folds, posterior.forms
        self._fold = self._law.saddle_node(posterior.lowest)
        self.form = normal_form_of(self._law, self._low, self._high)

    def _speed_std(self, speed: float) -> float:
        """Deviation of a speed by resolution and scale of the reading, m/s."""
        return math.hypot(
            self._settings.speed_resolution / math.sqrt(12.0),
            self._settings.speed_scale_std * speed,
        )

    def critical_speed(self) -> Uncertain | None:
        """Linear critical speed v_c, m/s."""
        v_c, sample = self._law.critical_speed, [one.critical_speed for one in self._drawn]
        return None if v_c is None else summary(v_c, _values(sample), self._speed_std(v_c))

    def fold(self) -> Uncertain | None:
        """Nonlinear critical speed v_n, m/s."""
        v_n = self._fold
        return None if v_n is None else summary(v_n, _values(self._folds), self._speed_std(v_n))

    def fold_amplitude(self) -> Uncertain | None:
        """Amplitude at which the two limit cycles meet, at v_n, m."""
        if self._fold is None:
            return None
        sample = self._posterior.table[:, QUANTITIES.index('fold_amplitude')]
        return summary(amplitude_at(self._law, self._fold), sample)

    def width(self) -> Uncertain | None:
        """Hysteresis width v_c - v_n, m/s."""
        v_c, v_n = self._law.critical_speed, self._fold
        if v_c is None or v_n is None:
            return None
        sample = _values([one.critical_speed for one in self._drawn]) - _values(self._folds)
        # A scale error of the speed stretches the width, a resolution blurs both its ends.
        extra = math.hypot(
            self._settings.speed_resolution / math.sqrt(6.0),
            self._settings.speed_scale_std * (v_c - v_n),
        )
        return summary(v_c - v_n, sample, extra)

    def coefficients(self) -> dict[str, Uncertain | None]:
        """Return all coefficients."""
        known: dict[str, Uncertain | None] = dict.fromkeys(COEFFICIENTS)
        if self.form is not None:
            for name in COEFFICIENTS:
                sample = _values([None if f is None else getattr(f, name) for f in self.forms])
                known[name] = summary(getattr(self.form, name), sample)
        return known

    def identified(self, name: str) -> IdentifiedNormalForm | None:
        """Normal form with its covariance."""
        if self.form is None:
            return None
        rows = np.array([IdentifiedNormalForm(f).vector for f in self.forms if f is not None])
        matrix = _rank_covariance(rows)
        speed_std = self._speed_std(self.form.critical_speed)
        matrix[0, 0] += speed_std**2
        provenance = {'method': 'trajectory likelihood', 'law': name}
        sample = rows[np.linspace(0, len(rows) - 1, _SAMPLE).round().astype(np.intp)]
        sample[:, 0] += speed_std * np.random.default_rng(0).standard_normal(_SAMPLE)
        sample = np.vectorize(lambda x: float(f'{x:.6g}'))(sample)  # as short as it is sure
        return IdentifiedNormalForm(self.form, matrix, provenance, sample=sample)

    def branches(self) -> tuple[BranchPoint, ...]:
        """Both limit cycles over the speeds of the data."""
        speeds = np.linspace(self._low, self._high, _BRANCH_POINTS)
        fold = self._fold
        if fold is not None and self._low < fold < self._high:
            speeds = np.unique(np.concatenate([speeds, fold + np.array([1e-4, 0.01, 0.03, 0.1])]))
        found = self._posterior.branches(speeds)
        pairs = zip(found['stable'], found['unstable'], strict=True)
        return tuple(BranchPoint(v, *pair) for v, pair in zip(speeds.tolist(), pairs, strict=True))

    def disturbance(self, observed: ObservedCriticalSpeeds) -> Uncertain | None:
        """Disturbance that explains the observed jump up: A_u there, Appendix A."""
        low, high = observed.v_c_between
        if observed.v_c is None or low is None or high is None:
            return None
        value = float(self._law.steady_amplitudes(observed.v_c)[0][0])
        # The jump lies anywhere between the two states: each draw has it elsewhere.
        share = (np.arange(len(self._drawn)) * _GOLDEN) % 1.0
        at = zip(self._drawn, (low + share * (high - low)).tolist(), strict=True)
        return summary(
            value, _values([one.steady_amplitudes(v)[0][0] for one, v in at]), least=0.5
        )


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


def _values(values: Sequence[float | None]) -> NDArray[np.float64]:
    return np.array([math.nan if value is None else value for value in values])
