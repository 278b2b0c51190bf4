"""How far recordings of one rig differ: spreads learnt from them, and a fit with these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.identification.likelihood.reading import OWN
from hunt_ros.identification.likelihood.trajectory_fit import (
    SPREADS,
    USUAL,
    TrajectoryFit,
    fit_path,
    log_widths,
    solved,
)

Array = NDArray[np.float64]
#: Rounds in which the spreads are learnt.
_ROUNDS = 4


def learnt(fit: TrajectoryFit) -> TrajectoryFit:
    """
    Learn how far recordings differ, and fit anew with that.

    The spreads are those that make the recordings likeliest, averaged over the law and over what
    each of them has of its own, by the expansion of the likelihood about the fit (restricted
    maximum likelihood); each is drawn towards none by its prior. They are learnt from few: a
    spread from R recordings is taken (R + 1) / (R - 1) times as wide, in variance, as it seems.

    References
    ----------
    Pinheiro, J. C., Bates, D. M., Mixed-Effects Models in S and S-PLUS (2000), Sect. 7.2.
    """
    path = fit.problem.path
    count = len(path.recordings)
    if count < 2 or path.hold_std:
        return fit
    for turn in range(_ROUNDS):
        spread = _likeliest(fit)
        settled = (np.abs(np.log(spread / fit.problem.spread)) < 0.5).all()
        last = settled or turn == _ROUNDS - 1
        if last:
            spread = spread * np.sqrt((count + 1.0) / (count - 1.0))
        fit = fit_path(replace(fit.problem, spread=spread), fit.theta, own=fit.own)
        if last:
            break
    return fit


def _likeliest(fit: TrajectoryFit) -> Array:
    """Spreads of what recordings have of their own that explain them best, shape (5,)."""
    before = fit.problem.spread
    at, precision = fit.problem.expand(fit.theta, fit.own), np.diag(before**-2.0)
    if not all(np.isfinite(one).all() for one in (at.information, at.own_block, at.cross)):
        return before  # of a law that ran away
    bare = at.own_block - precision
    # With what the recordings have held, at zero.
    law, pull = at.information, at.gradient + np.einsum('rjk,rk->j', at.cross, fit.own)
    wanted = at.own_slope + fit.own / before**2 + np.einsum('rjk,rk->rj', bare, fit.own)
    free = np.flatnonzero(np.diag(law) > 0.0)

    def evidence(spread: Array) -> float:
        """Return the log evidence of the spreads, with their prior."""
        block = bare + np.diag(spread**-2.0)
        weighed = solved(block, at.cross.transpose(0, 2, 1))
        seen = solved(block, wanted[..., None])[..., 0]
        reduced = (law - np.einsum('rjk,rki->ji', at.cross, weighed))[np.ix_(free, free)]
        left = (pull - np.einsum('rki,rk->i', weighed, wanted))[free]
        gain = np.sum(wanted * seen) + left @ solved(reduced, left[:, None])[:, 0]
        width = log_widths(block, spread)
        width += np.linalg.slogdet(reduced)[1]
        return float(0.5 * (gain - width) - np.sum(spread / USUAL))

    spread: Array = before.copy()
    for _ in range(3):
        for k in range(OWN):
            tried = np.tile(spread, (SPREADS.shape[1], 1))
            tried[:, k] = SPREADS[k]
            spread = tried[int(np.argmax([evidence(one) for one in tried]))]
    return spread
