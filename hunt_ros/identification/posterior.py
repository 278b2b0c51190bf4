"""
All that the data leave open: draws of the growth law and of the noise that drives it.

Every number with an interval is made from these draws, so that what hangs together (D4 to D15,
v_n and the amplitude there) hangs together here, at any speed, long after the fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from hunt_ros.dynamics.growth_law import GrowthLaw, normal_form_of
from hunt_ros.dynamics.normal_form import COEFFICIENTS, NormalForm
from hunt_ros.identification.uncertainty import summary
from hunt_ros.samples import Uncertain

Array = NDArray[np.float64]
BranchName = Literal['stable', 'unstable']

#: What is drawn together, in the order of `Posterior.table`.
QUANTITIES: tuple[str, ...] = ('v_c', 'v_n', 'fold_amplitude', *COEFFICIENTS)


@dataclass(frozen=True, eq=False)
class Posterior:
    """
    The law chosen, and draws of what it could be as well.

    Parameters
    ----------
    law : GrowthLaw
        The one chosen.
    p : ndarray, shape (n, 11)
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
            normal_form_of(one, *self.speeds) if there else None
            for one, there in zip(self.drawn, near.tolist(), strict=True)
        ]

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
        v_c, (v_n, amplitude) = self.laws.critical_speeds, self.laws.folds(self.reach[0])
        near = self._within(v_n)
        amplitude = np.where(np.isfinite(near), amplitude, math.nan)
        return np.column_stack([self._within(v_c), near, amplitude, coefficients])

    @cached_property
    def chosen(self) -> Array:
        """`QUANTITIES` of the law chosen, shape (8,)."""
        row: Array = replace(self, p=self.law.p[None]).table[0]
        return row

    def number(self, name: str, extra_std: float = 0.0) -> Uncertain | None:
        """Return one of `QUANTITIES` with its interval; None where too few draws have it."""
        k = QUANTITIES.index(name)
        return summary(self.chosen[k], self.table[:, k], extra_std)

    def correlations(self) -> Array:
        """
        Rank correlations of `QUANTITIES`, shape (8, 8); NaN for what too few draws have.

        Normal scores of the ranks: far draws of a direction that the data leave open neither
        stretch nor turn it (Liu, Lafferty and Wasserman 2009).
        """
        known = np.isfinite(self.table)
        matrix = np.full((len(QUANTITIES), len(QUANTITIES)), np.nan)
        for i in range(len(QUANTITIES)):
            for j in range(i + 1):
                both = known[:, i] & known[:, j]
                if both.sum() >= max(0.5 * len(both), 10):
                    pair = normal_scores(self.table[both][:, [i, j]])
                    matrix[i, j] = matrix[j, i] = float(np.mean(pair[:, 0] * pair[:, 1]))
        return matrix

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
        values = self.law.steady_amplitudes(speeds)
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
        unstable = np.where(below & np.isnan(unstable), end, unstable)
        stable = np.where(below & np.isnan(stable), end, stable)
        return np.stack([unstable, stable], axis=1)


def normal_scores(rows: Array) -> Array:
    """Ranks of each column as quantiles of a normal distribution of variance one, shape (n, k)."""
    ranks = np.argsort(np.argsort(rows, axis=0), axis=0)
    scores = stats.norm.ppf((ranks + 0.5) / len(rows))
    found: Array = scores / np.sqrt(np.mean(scores[:, :1] ** 2))
    return found
