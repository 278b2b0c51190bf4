"""
All that the data leave open: draws of the growth law and of the noise that drives it.

Every number with an interval is made from these draws, so that what hangs together (D4 to D15,
v_n and the amplitude there) hangs together here, at any speed, long after the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from hunt_ros.dynamics.normal_form import COEFFICIENTS, NormalForm
from hunt_ros.identification.growth_law import TERMS, GrowthLaw
from hunt_ros.identification.normal_form_map import normal_form_of
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
    """

    law: GrowthLaw
    p: Array
    intensity: Array
    speeds: tuple[float, float]

    @classmethod
    def of(
        cls,
        law: GrowthLaw,
        drawn: Sequence[GrowthLaw],
        speeds: tuple[float, float],
        intensity: Array | None = None,
    ) -> Posterior:
        """
        Collect draws.

        Parameters
        ----------
        law : GrowthLaw
            The one chosen.
        drawn : sequence of GrowthLaw
            In the same scales.
        speeds : (float, float)
            Lowest and highest speed of the data, m/s.
        intensity : ndarray, shape (n,), optional
            Noise intensity of each draw, m^2/s.
        """
        p = np.array([one.p for one in drawn]).reshape(-1, TERMS)
        if intensity is None:
            intensity = np.full(len(drawn), np.nan)
        return cls(law, p, intensity, speeds)

    @cached_property
    def drawn(self) -> list[GrowthLaw]:
        """The laws drawn."""
        return [GrowthLaw(row, self.law.scales) for row in self.p]

    @property
    def lowest(self) -> float:
        """Speed below which no fold is looked for, m/s."""
        low, high = self.speeds
        return low - 0.3 * (high - low)

    @cached_property
    def forms(self) -> list[NormalForm | None]:
        """Normal form of each draw; None where it has no critical speed."""
        return [normal_form_of(one, *self.speeds) for one in self.drawn]

    @cached_property
    def folds(self) -> list[float | None]:
        """Nonlinear critical speed of each draw, m/s; None where it has no fold."""
        return [one.saddle_node(self.lowest) for one in self.drawn]

    @cached_property
    def table(self) -> Array:
        """The draws of `QUANTITIES`, SI units, shape (n, 8); NaN for what a draw has not."""
        rows = np.full((len(self.p), len(QUANTITIES)), np.nan)
        for row, law, fold, form in zip(rows, self.drawn, self.folds, self.forms, strict=True):
            if law.critical_speed is not None:
                row[0] = law.critical_speed
            if fold is not None:
                row[1:3] = fold, amplitude_at(law, fold)
            if form is not None:
                row[3:] = [getattr(form, name) for name in COEFFICIENTS]
        return rows

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

    def branch(self, which: BranchName, speeds: ArrayLike) -> list[Uncertain | None]:
        """
        Amplitude of a limit cycle with its interval, speed by speed.

        A draw is continued beyond its ends: at zero beyond v_c, at the fold's amplitude below
        v_n. A draw without the branch at a speed is part of the interval there, no gap in it.

        Parameters
        ----------
        which : {'stable', 'unstable'}
            Limit cycle.
        speeds : array_like, shape (n,)
            m/s.

        Returns
        -------
        list of Uncertain or None
            m; None where the law chosen, or too many draws, have none.
        """
        return self.branches(speeds)[which]

    def branches(self, speeds: ArrayLike) -> dict[str, list[Uncertain | None]]:
        """Both branches, as `branch` gives them."""
        speeds = np.atleast_1d(np.asarray(speeds, dtype=np.float64))
        values = self.law.steady_amplitudes(speeds)
        drawn = self.continued(speeds)
        return {
            name: [
                summary(float(values[k][i]), drawn[:, k, i], least=0.3) for i in range(speeds.size)
            ]
            for k, name in enumerate(('unstable', 'stable'))
        }

    def continued(self, speeds: Array) -> Array:
        """Both branches of each draw, continued beyond their ends, m, shape (n, 2, speeds)."""
        pairs = zip(self.drawn, self.folds, strict=True)
        return np.array([_continued(one, below, speeds) for one, below in pairs])


def amplitude_at(law: GrowthLaw, fold: float) -> float:
    """Amplitude at which the two limit cycles of a law meet, m."""
    unstable, stable = law.steady_amplitudes(np.array([fold]))
    return 0.5 * float(unstable[0] + stable[0])


def normal_scores(rows: Array) -> Array:
    """Ranks of each column as quantiles of a normal distribution of variance one, shape (n, k)."""
    ranks = np.argsort(np.argsort(rows, axis=0), axis=0)
    scores = stats.norm.ppf((ranks + 0.5) / len(rows))
    found: Array = scores / np.sqrt(np.mean(scores[:, :1] ** 2))
    return found


def _continued(law: GrowthLaw, fold: float | None, speeds: Array) -> tuple[Array, Array]:
    """Branches of a draw, continued beyond their ends."""
    unstable, stable = law.steady_amplitudes(speeds)
    v_c = law.critical_speed
    if v_c is not None:
        unstable = np.where(np.isnan(unstable) & (speeds >= v_c), 0.0, unstable)
        if law.criticality == 'supercritical':
            stable = np.where(np.isnan(stable) & (speeds <= v_c), 0.0, stable)
    if fold is not None:
        end = amplitude_at(law, fold)
        below = speeds <= fold
        unstable = np.where(below & np.isnan(unstable), end, unstable)
        stable = np.where(below & np.isnan(stable), end, stable)
    return unstable, stable
