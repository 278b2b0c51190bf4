"""
Does the motion follow the law everywhere? One test, which names the speed and the amplitude.

The path is parted into cells of speed and amplitude, and each is asked whether a growth rate of
its own would follow the motion better. The derivative of the log likelihood by it is, where the
law holds, a normal number of known variance: what the fit took up is charged, and what every
recording has of its own. All cells together are a chi-square.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hunt_ros.dynamics.covariance_root import inverse_of
from hunt_ros.dynamics.growth_law import GrowthLaw
from hunt_ros.identification.fit import FittedLaw
from hunt_ros.identification.likelihood.path import Path

#: Cells that the ranges of the speed and of the amplitude are parted into.
_SPEEDS, _AMPLITUDES = 6, 4
#: A discrepancy is a lack of fit if chance makes it in one case of a hundred, and the growth is
#: that of a speed or amplitude further away than this share.
_LEVEL, _SHARE = 0.01, 0.01
#: Share of its information that a cell, or a combination of cells, keeps at least of what the fit
#: did not take up, to say something.
_LEAST_LEFT = 0.01


@dataclass(frozen=True)
class LackOfFit:
    """
    Result of the test.

    Parameters
    ----------
    p : float
        Probability of a discrepancy this large if the law held; NaN where no cell tells.
    ratio : float
        Its mean square over that of chance.
    share : float
        How far the cell that is farthest off by chance is from the law, as a share of its
        amplitude or speed.
    held : bool
        Whether the motion there is on the limit cycle.
    words : str
        That cell and what its motion does.
    """

    p: float = math.nan
    ratio: float = 1.0
    share: float = 0.0
    held: bool = False
    words: str = ''

    @property
    def flagged(self) -> bool:
        """Whether the law does not fit."""
        return self.p < _LEVEL and self.share > _SHARE

    @property
    def stretch(self) -> float:
        """
        Factor on all deviations.

        References
        ----------
        Birge, R. T. (1932), Phys. Rev. 40, 207-227.
        """
        return math.sqrt(max(self.ratio, 1.0))


def lack_of_fit(fitted: FittedLaw, names: Sequence[str] = ()) -> LackOfFit:
    """
    Test a law against the path it was fitted to.

    Parameters
    ----------
    fitted : FittedLaw
        The law.
    names : sequence of str
        Of the recordings.

    Returns
    -------
    LackOfFit

    References
    ----------
    Rao, C. R. (1948), Proc. Camb. Phil. Soc. 44, 50-57: the score test; of a model that was
    fitted: Neyman, J. (1959), Optimal asymptotic tests, in: Probability and Statistics, 213-234.
    """
    fit = fitted.fit
    if not fit.converged:
        return LackOfFit()  # what is left to gain is no misfit of the law
    n, path = fit.theta.size, fit.problem.path
    cells = _cells(path)
    with np.errstate(all='ignore'):  # of a law that runs away
        at = fit.problem.expand(fit.theta, fit.own, cells)
        gradient, information = at.reduced()
    if not (cells.max() >= 0 and np.isfinite(gradient).all() and np.isfinite(information).all()):
        return LackOfFit()
    taken = information[n:, :n] @ inverse_of(information[:n, :n])
    score = gradient[n:] - taken @ gradient[:n]
    variance = information[n:, n:] - taken @ information[:n, n:]
    left = np.diag(variance) / np.maximum(np.diag(information)[n:], 1e-300)
    told = np.flatnonzero(left > _LEAST_LEFT)
    std = np.sqrt(np.diag(variance)[told])
    values, vectors = np.linalg.eigh(variance[np.ix_(told, told)] / np.outer(std, std))
    apart = score[told] / std
    square = ((vectors.T @ apart) ** 2 / values)[values > _LEAST_LEFT]
    if not square.size:
        return LackOfFit()
    worst = int(np.argmax(np.abs(apart)))
    more = float(apart[worst] / std[worst])
    share, held, words = _of_cell(fitted.law, path, cells == told[worst], more)
    if len(names) > 1:
        most = int(np.argmax(np.sign(more) * at.scores[:, n + told[worst]]))
        words += f', most of all in {names[most]}'
    p = float(stats.chi2.sf(square.sum(), square.size))
    return LackOfFit(p, float(square.mean()), share, held, words)


def _cells(path: Path) -> NDArray[np.int64]:
    """
    Return the number of the cell that the way to each instant leads through, -1 for none.

    The amplitude is that from which it leads: that to which it leads is what is tested.
    """
    size = np.abs(path.phasor)
    before = np.concatenate([[math.nan], size[:-1]])
    known = np.isfinite(before) & np.isfinite(size) & ~path.starts
    cells = np.full(size.size, -1)
    if not known.any():
        return cells
    u = path.u[known] - path.u[known].min()
    speed = np.minimum(_SPEEDS * u // max(float(u.max()), 1e-9), _SPEEDS - 1)
    amplitude = np.minimum(_AMPLITUDES * before[known] // np.nanmax(size), _AMPLITUDES - 1)
    cells[known] = np.unique(_AMPLITUDES * speed + amplitude, return_inverse=True)[1]
    return cells


def _of_cell(
    law: GrowthLaw, path: Path, inside: NDArray[np.bool_], more: float
) -> tuple[float, bool, str]:
    """How far a cell that grows by `more` is off, whether it is of the limit cycle, and words."""
    unit = law.scales.amplitude
    speed = law.scales.speed * (1.0 + float(path.u[inside].mean()))
    amplitude = unit * float(np.abs(path.phasor[inside]).mean())
    cycle = float(law.steady_amplitudes(speed)[1][0])
    held = abs(cycle - amplitude) < 0.5 * unit * np.nanmax(np.abs(path.phasor)) / _AMPLITUDES
    point = cycle if held else amplitude
    beside = 1.0 + np.array([0.0, 1e-3])
    rate, faster = law.growth_rate(speed * beside, point).tolist()
    larger = float(law.growth_rate(speed, point * beside)[1]) - rate
    # Next to the fold the amplitude of a limit cycle is a matter of the last digits of the speed.
    share = abs(1e-3 * more) / math.hypot(faster - rate, larger)
    where = f'at {speed:.3g} m/s, {1e3 * amplitude:.2g} mm'
    if held:
        off, kind = abs(1e-3 * more / larger), 'larger' if more > 0.0 else 'smaller'
        return share, True, f'{where} the limit cycle is {kind} than the law by {100 * off:.2g} %'
    seen, said = (
        f'{"grows" if one > 0.0 else "dies"} by {abs(one):.2g} 1/s' for one in (rate + more, rate)
    )
    return share, False, f'{where} motion {seen}, by the law it {said}'
