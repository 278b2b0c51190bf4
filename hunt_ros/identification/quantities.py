"""The quantities a law implies, each with the spread that the draws give it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS, NormalForm
from hunt_ros.identification.growth_law import GrowthLaw
from hunt_ros.identification.guards import Support
from hunt_ros.identification.normal_form_map import normal_form_of
from hunt_ros.identification.result import BranchPoint
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.uncertainty import summary
from hunt_ros.samples import Uncertain

#: Step that spreads points evenly over an interval, however many there are.
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
#: Speeds at which the branches are given.
_BRANCH_POINTS = 41


class Quantities:
    """
    Quantities of a law, each with the spread that the draws give it; None where too few
    draws have it.

    Parameters
    ----------
    law : GrowthLaw
        The one chosen.
    drawn : sequence of GrowthLaw
        As the data leave it open.
    speeds : (float, float)
        Lowest and highest speed of the data, m/s.
    settings : IdentificationSettings
        For the errors of the speed reading.
    """

    def __init__(
        self,
        law: GrowthLaw,
        drawn: Sequence[GrowthLaw],
        speeds: tuple[float, float],
        settings: IdentificationSettings,
    ) -> None:
        self._law, self._drawn, self._settings = law, drawn, settings
        self._low, self._high = speeds
        self.form = normal_form_of(law, self._low, self._high)
        self.forms: list[NormalForm | None] = [
            normal_form_of(one, self._low, self._high) for one in drawn
        ]
        self._folds = [one.saddle_node(self._lowest) for one in drawn]

    @property
    def _lowest(self) -> float:
        return self._low - 0.3 * (self._high - self._low)

    def _speed_std(self, speed: float) -> float:
        """Deviation of a speed by resolution and scale of the reading, m/s."""
        return math.hypot(
            self._settings.speed_resolution / math.sqrt(12.0),
            self._settings.speed_scale_std * speed,
        )

    def critical_speed(self) -> Uncertain | None:
        """Linear critical speed v_c, m/s."""
        v_c = self._law.critical_speed
        if v_c is None:
            return None
        return summary(
            v_c, _values([one.critical_speed for one in self._drawn]), self._speed_std(v_c)
        )

    def fold(self) -> Uncertain | None:
        """Nonlinear critical speed v_n, m/s."""
        v_n = self._law.saddle_node(self._lowest)
        return None if v_n is None else summary(v_n, _values(self._folds), self._speed_std(v_n))

    def width(self) -> Uncertain | None:
        """Hysteresis width v_c - v_n, m/s."""
        v_c, v_n = self._law.critical_speed, self._law.saddle_node(self._lowest)
        if v_c is None or v_n is None:
            return None
        ends = zip(self._drawn, self._folds, strict=True)
        sample = _values(
            [
                None if fold is None or one.critical_speed is None else one.critical_speed - fold
                for one, fold in ends
            ]
        )
        # A scale error of the speed stretches the width, a resolution blurs both its ends.
        extra = math.hypot(
            self._settings.speed_resolution / math.sqrt(6.0),
            self._settings.speed_scale_std * (v_c - v_n),
        )
        return summary(v_c - v_n, sample, extra)

    def coefficients(self, support: Support) -> dict[str, Uncertain | None]:
        """Coefficients that the data support."""
        known: dict[str, Uncertain | None] = dict.fromkeys(COEFFICIENTS)
        if self.form is None:
            return known
        for name in COEFFICIENTS:
            if support.knows(name):
                sample = _values([None if f is None else getattr(f, name) for f in self.forms])
                known[name] = summary(getattr(self.form, name), sample)
        return known

    def identified(self, name: str) -> IdentifiedNormalForm | None:
        """Normal form with its covariance."""
        if self.form is None:
            return None
        rows = np.array([IdentifiedNormalForm(f).vector for f in self.forms if f is not None])
        matrix = _rank_covariance(rows)
        matrix[0, 0] += self._speed_std(self.form.critical_speed) ** 2
        provenance = {'method': 'trajectory likelihood', 'law': name}
        return IdentifiedNormalForm(self.form, matrix, provenance)

    def branches(self) -> tuple[BranchPoint, ...]:
        """Both limit cycles over the speeds of the data."""
        speeds = np.linspace(self._low, self._high, _BRANCH_POINTS)
        fold = self._law.saddle_node(self._lowest)
        if fold is not None and self._low < fold < self._high:
            speeds = np.unique(np.concatenate([speeds, fold + np.array([1e-4, 0.01, 0.03, 0.1])]))
        drawn = [
            _continued(one, below, speeds)
            for one, below in zip(self._drawn, self._folds, strict=True)
        ]
        unstable, stable = self._law.steady_amplitudes(speeds)

        def at(k: int, value: float, index: int) -> Uncertain | None:
            sample = np.array([pair[index][k] for pair in drawn])
            return summary(value, sample, least=0.3)

        return tuple(
            BranchPoint(float(speed), at(k, float(stable[k]), 1), at(k, float(unstable[k]), 0))
            for k, speed in enumerate(speeds)
        )

    def disturbance(self, observed: ObservedCriticalSpeeds) -> Uncertain | None:
        """Disturbance that explains the observed jump up: A_u there, Appendix A."""
        low, high = observed.v_c_between
        if observed.v_c is None or low is None or high is None:
            return None
        value = float(self._law.steady_amplitudes(observed.v_c)[0][0])
        # The jump lies anywhere between the two states: each draw has it elsewhere.
        share = (np.arange(len(self._drawn)) * _GOLDEN) % 1.0
        sample = np.array(
            [
                float(one.steady_amplitudes(low + x * (high - low))[0][0])
                for one, x in zip(self._drawn, share, strict=True)
            ]
        )
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
    ranks = np.argsort(np.argsort(rows, axis=0), axis=0)
    scores = stats.norm.ppf((ranks + 0.5) / len(rows))
    correlation = scores.T @ scores / np.sum(scores[:, 0] ** 2)
    std = 0.5 * (above - below)
    covariance: NDArray[np.float64] = correlation * np.outer(std, std)
    return covariance


def _continued(
    law: GrowthLaw, fold: float | None, speeds: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Branches of a draw, continued beyond their ends: at zero beyond v_c, at the fold's amplitude
    below v_n. A draw without the branch at a speed is part of the interval there, not a gap in it.
    """
    unstable, stable = law.steady_amplitudes(speeds)
    v_c = law.critical_speed
    if v_c is not None:
        unstable = np.where(np.isnan(unstable) & (speeds >= v_c), 0.0, unstable)
        if law.criticality == 'supercritical':
            stable = np.where(np.isnan(stable) & (speeds <= v_c), 0.0, stable)
    if fold is not None:
        low, high = law.steady_amplitudes(np.array([fold]))
        end = 0.5 * float(low[0] + high[0])
        below = speeds <= fold
        unstable = np.where(below & np.isnan(unstable), end, unstable)
        stable = np.where(below & np.isnan(stable), end, stable)
    return unstable, stable


def _values(values: Sequence[float | None]) -> NDArray[np.float64]:
    return np.array([math.nan if value is None else value for value in values])
