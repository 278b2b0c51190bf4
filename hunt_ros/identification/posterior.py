"""
All that the data leave open: draws of the growth law and of the noise that drives it.

Every number with an interval is made from these draws, so that what hangs together (D4 to D15,
v_n and the amplitude there) hangs together here, at any speed, long after the fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.dynamics.growth_law import GrowthLaw
from hunt_ros.dynamics.identified import EXISTS, IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS, NormalForm
from hunt_ros.dynamics.paper_form import normal_form_of
from hunt_ros.identification.uncertainty import ENOUGH_DRAWS, summary
from hunt_ros.samples import NORMAL_95, Uncertain, as_json

Array = NDArray[np.float64]
BranchName = Literal['stable', 'unstable']

#: What is drawn together, in the order of `Posterior.table`.
QUANTITIES: tuple[str, ...] = ('v_c', 'v_n', 'fold_amplitude', *COEFFICIENTS)
#: Share of the draws that must have a v_c: 95 % leave 2.5 % beyond each end of the interval, and
#: those without one all lie above it, for rest is stable in them at every speed.
_BOUNDED = 0.975
#: Step that spreads points evenly over an interval, however many there are.
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
#: Speeds at which the branches are given.
_BRANCH_POINTS = 41
#: Draws that stand in the parameter file.
_SAMPLE = 64


@dataclass(frozen=True)
class BranchPoint:
    """
    The two limit cycles at one speed, with their intervals; None where there is none.

    Parameters
    ----------
    speed : float
        m/s.
    stable, unstable : Uncertain or None
        m.
    """

    speed: float
    stable: Uncertain | None
    unstable: Uncertain | None

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `branches`."""
        entry: dict[str, Any] = {'speed_mps': self.speed}
        for name, number in (('stable', self.stable), ('unstable', self.unstable)):
            told = as_json(number) or dict.fromkeys(('value', 'std', 'ci95'))
            entry[f'{name}_amplitude_m'] = told['value']
            entry |= {f'{name}_{what}_m': told[what] for what in ('std', 'ci95')}
        return entry


@dataclass(frozen=True, eq=False)
class Posterior:
    """
    The law chosen, and draws of what it could be as well.

    Parameters
    ----------
    law : GrowthLaw
        The one chosen.
    p : ndarray, shape (n, 10)
        Coefficients of each draw.
    intensity : ndarray, shape (n,)
        Noise intensity D of each, m^2/s: dA = (A g + D / A) dt + sqrt(2 D) dW; NaN where the
        motion shows none.
    speeds : (float, float)
        Lowest and highest speed of the data, m/s.
    prior_v_c : float, optional
        What is known of v_c from elsewhere, m/s.
    """

    law: GrowthLaw
    p: Array
    intensity: Array
    speeds: tuple[float, float]
    prior_v_c: float | None = None

    @cached_property
    def laws(self) -> GrowthLaw:
        """All laws drawn, at once."""
        return GrowthLaw(self.p, self.law.scales)

    @cached_property
    def drawn(self) -> list[GrowthLaw]:
        """The laws drawn, one by one."""
        return [GrowthLaw(row, self.law.scales) for row in self.p]

    @property
    def reach(self) -> tuple[float, float]:
        """Speeds between which a law says something of v_n and v_c, m/s: half the range beyond."""
        low, high = self.speeds
        beyond, known = 0.5 * (high - low), [] if self.prior_v_c is None else [self.prior_v_c]
        return min(low - beyond, *known, low), max(high + beyond, *known, high)

    @cached_property
    def forms(self) -> list[NormalForm | None]:
        """Normal form of each draw; None where it has no critical speed within reach."""
        near = np.isfinite(self._within(self.laws.critical_speeds))
        return [
            normal_form_of(one, *self.speeds, fold) if there else None
            for one, there, fold in zip(self.drawn, near.tolist(), self.folds[0], strict=True)
        ]

    @cached_property
    def folds(self) -> Array:
        """Where the branches of each draw end, m/s, and their amplitude there, m, shape (2, n)."""
        return self.laws.folds(*self.reach)

    def _within(self, speeds: Array) -> Array:
        """Speeds, NaN for those beyond reach."""
        low, high = self.reach
        with np.errstate(invalid='ignore'):
            return np.where((speeds >= low) & (speeds <= high), speeds, math.nan)

    @cached_property
    def table(self) -> Array:
        """The draws of `QUANTITIES`, SI units, shape (n, 8); NaN for what a draw has not."""
        nothing = [math.nan] * len(COEFFICIENTS)
        rows = [
            nothing if form is None else [getattr(form, name) for name in COEFFICIENTS]
            for form in self.forms
        ]
        coefficients = np.array(rows).reshape(-1, len(COEFFICIENTS))
        v_c = self.laws.critical_speeds
        v_n, amplitude = self.folds
        near = self._within(v_n)
        amplitude = np.where(np.isfinite(near), amplitude, math.nan)
        return np.column_stack([self._within(v_c), near, amplitude, coefficients])

    @cached_property
    def chosen(self) -> Array:
        """`QUANTITIES` of the law chosen, shape (8,)."""
        row: Array = self._own.table[0]
        return row

    @cached_property
    def _own(self) -> Posterior:
        """The law chosen as the only draw."""
        return replace(self, p=self.law.p[None])

    def number(self, name: str, extra_std: float = 0.0) -> Uncertain | None:
        """Return one of `QUANTITIES` with its interval; None where too few draws have it."""
        k = QUANTITIES.index(name)
        least = _BOUNDED if name == 'v_c' else EXISTS
        return summary(self.chosen[k], self.table[:, k], extra_std, least)

    @cached_property
    def supercritical(self) -> float | None:
        """Share of the draws with a v_c that are supercritical there; None of too few."""
        there = np.isfinite(self.laws.critical_speeds)
        return float(np.mean(self.laws.soft[there])) if there.sum() >= ENOUGH_DRAWS else None

    def coexist(self, speed: float) -> bool:
        """
        Whether rest is stable at a speed, m/s, in `EXISTS` of the draws, and a cycle in half.

        What rests for a short time may be growth, and what stays decay, that has not come far.
        """
        rest = self.laws.growth_rate(speed, 0.0) < 0.0
        cycle = np.isfinite(self.laws.steady_amplitudes(speed)[1])
        return len(self.p) > 0 and rest.mean() >= EXISTS and cycle.mean() >= 0.5

    def hysteresis_below(self, speed_std: float) -> float | None:
        """
        Return the width that hysteresis does not exceed, m/s; None where nothing bounds it.

        It is that of 95 % of the draws, zero for a supercritical one. But an onset whose speed
        is not known any better is not told from a hysteresis as wide as its interval.

        Parameters
        ----------
        speed_std : float
            Deviation of a speed by the resolution of its reading, m/s.
        """
        v_c = self.number('v_c', speed_std)
        width = np.where(self.laws.soft, 0.0, self.table[:, 0] - self.table[:, 1])
        # A subcritical draw without a fold within reach has a hysteresis without an end.
        most = np.quantile(np.nan_to_num(width, nan=np.inf), EXISTS, method='higher')
        return max(float(most), NORMAL_95 * v_c.std) if v_c and most < np.inf else None

    def branches(self, speeds: ArrayLike) -> dict[BranchName, list[Uncertain | None]]:
        """
        Amplitude of both limit cycles with its interval, speed by speed.

        A draw is continued beyond its ends: at zero beyond v_c, at the fold's amplitude below
        v_n. A draw without the branch at a speed is part of the interval there, no gap in it.

        Parameters
        ----------
        speeds : array_like, shape (n,)
            m/s.

        Returns
        -------
        dict of str to list of Uncertain or None
            m; None where the law chosen, or too many draws, have none.
        """
        speeds = np.atleast_1d(np.asarray(speeds, dtype=np.float64))
        # What a law has below its fold hangs together with nothing that was seen.
        below = speeds < self.chosen[1]
        values = [np.where(below, math.nan, one) for one in self.law.steady_amplitudes(speeds)]
        drawn = self.continued(speeds)
        unstable, stable = (
            [summary(float(values[k][i]), drawn[:, k, i], least=0.3) for i in range(speeds.size)]
            for k in (0, 1)
        )
        return {'unstable': unstable, 'stable': stable}

    def continued(self, speeds: Array) -> Array:
        """Both branches of each draw, continued beyond their ends, m, shape (n, 2, speeds)."""
        unstable, stable = self.laws.steady_amplitudes(speeds)
        v_c, fold, end = self.table[:, :3].T[:, :, None]
        with np.errstate(invalid='ignore'):
            soft = np.isnan(stable) & (speeds <= v_c) & self.laws.soft[:, None]
            unstable = np.where(np.isnan(unstable) & (speeds >= v_c), 0.0, unstable)
            stable = np.where(soft, 0.0, stable)
            below = speeds <= fold
        return np.stack([np.where(below, end, branch) for branch in (unstable, stable)], axis=1)

    def numbers(self, speed_std: float) -> dict[str, Uncertain | None]:
        """
        Return the numbers of a law, each with the spread that the draws give it.

        Parameters
        ----------
        speed_std : float
            Deviation of a speed by the resolution of its reading, m/s.

        Returns
        -------
        dict of str to Uncertain or None
            By the key of the JSON, SI units; None where too few draws have it.
        """
        v_c, v_n = self.chosen[:2]
        both = self.table[:, :2]
        return {
            'v_c': self.number('v_c', speed_std),
            'v_n': self.number('v_n', speed_std),
            'fold_amplitude_m': self.number('fold_amplitude'),
            'hysteresis_width': summary(
                v_c - v_n, both[:, 0] - both[:, 1], math.sqrt(2.0) * speed_std
            ),
            **{f'coefficients.{name}': self.number(name) for name in COEFFICIENTS},
        }

    def identified(self, speed_std: float) -> IdentifiedNormalForm | None:
        """Return the normal form of the law chosen, with its covariance; None without one."""
        form = self._own.forms[0]
        if form is None:
            return None
        rows = np.array([IdentifiedNormalForm(one).vector for one in self.forms if one])
        below, above = np.percentile(rows, [15.87, 84.13], axis=0)
        std = 0.5 * (above - below)
        matrix = rank_correlations(rows) * np.outer(std, std)
        matrix[0, 0] += speed_std**2
        provenance = {'method': 'trajectory likelihood', 'law': self.law.name}
        sample = rows[np.linspace(0, len(rows) - 1, _SAMPLE).round().astype(np.intp)]
        sample[:, 0] += speed_std * np.random.default_rng(0).standard_normal(_SAMPLE)
        sample = np.vectorize(lambda x: float(f'{x:.6g}'))(sample)  # as short as it is sure
        return IdentifiedNormalForm(form, matrix, provenance, sample=sample)

    def branch_points(self) -> tuple[BranchPoint, ...]:
        """Both limit cycles over the speeds of the data."""
        low, high = self.speeds
        speeds, fold = np.linspace(low, high, _BRANCH_POINTS), self.chosen[1]
        if low < fold < high:
            speeds = np.unique(np.concatenate([speeds, fold + np.array([1e-4, 0.01, 0.03, 0.1])]))
        found = self.branches(speeds)
        return tuple(map(BranchPoint, speeds.tolist(), found['stable'], found['unstable']))

    def disturbance(self, observed: ObservedCriticalSpeeds) -> Uncertain | None:
        """Disturbance that explains the observed jump up: A_u there, Appendix A."""
        low, high = observed.v_c_between
        if observed.v_c is None or low is None or high is None:
            return None
        law, laws = self.law, self.laws
        value = float(law.steady_amplitudes(observed.v_c)[0][0])
        # The jump lies anywhere between the two states: each draw has it elsewhere.
        share = (np.arange(len(laws.p)) * _GOLDEN) % 1.0
        sample = laws.steady_amplitudes(low + share[:, None] * (high - low))[0][:, 0]
        return summary(value, sample, least=0.5)


def rank_correlations(rows: Array) -> Array:
    """
    Correlations of the normal scores of the ranks, shape (k, k).

    Far draws of a direction that the data leave open neither stretch nor turn them.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
        Draws.

    References
    ----------
    Liu, H., Lafferty, J., Wasserman, L. (2009), J. Mach. Learn. Res. 10, 2295-2328: normal
    scores of the ranks.
    """
    ranks = np.argsort(np.argsort(rows, axis=0), axis=0)
    scores = stats.norm.ppf((ranks + 0.5) / len(rows))
    return np.asarray(scores.T @ scores / np.sum(scores[:, 0] ** 2))
