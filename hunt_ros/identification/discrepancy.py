"""
What a law that is nearly right may be held to.

An hour on the limit cycle tells its amplitude to a thousandth. No law of six numbers is
that true, and a fit that believes it bends the linear growth rate, known far less well,
to serve the last micrometre. Where the test of fit shows such a discrepancy, the limit
cycle counts at each speed as one measurement with an error of the size of the
discrepancy; transients and the quiet state count in full.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.identification.envelope import Envelope
from hunt_ros.identification.law_choice import FittedLaw
from hunt_ros.identification.path import Path
from hunt_ros.identification.pure_error import LackOfFit

#: Width of a cell of speeds within which a discrepancy is the same, relative to the speed.
_CELL = 0.03
#: The fit has bent to make the discrepancy small: it is taken for this much larger.
_BENT = 2.0


def held_less(
    fitted: FittedLaw,
    misfit: LackOfFit,
    hunting: Sequence[SteadyState],
    envelopes: Sequence[Envelope],
) -> Path:
    """
    Weigh the limit cycle by what the law can be held to.

    Parameters
    ----------
    fitted : FittedLaw
        The law whose discrepancy was found.
    misfit : LackOfFit
        Its size.
    hunting : sequence of SteadyState
        Stretches of limit cycle.
    envelopes : sequence of Envelope
        In the order in which they make up the path.

    Returns
    -------
    Path
        With weights.

    References
    ----------
    Kennedy, M. C., O'Hagan, A. (2001), J. R. Statist. Soc. B 63, 425-464: a model has an
    error of its own, and its parameters are biased where that is left out.
    """
    path = fitted.path
    on = _on_limit_cycle(hunting, envelopes)
    sizes = np.exp(fitted.fit.innovations[:, 2])
    used = on & (fitted.fit.innovations[:, 2] != 0.0)
    weight = np.ones(path.time.size)
    if not used.any():
        return replace(path, conicity=False, weight=weight)
    cell = np.floor(path.u / _CELL).astype(np.int64)
    cell -= cell.min()
    count = np.bincount(cell[used], minlength=int(cell.max()) + 1)
    amplitude = np.abs(path.phasor[used])
    error = (_BENT * misfit.share * amplitude) ** 2
    weight[used] = np.minimum(1.0, sizes[used] / (count[cell[used]] * error))
    return replace(path, conicity=False, weight=weight)


def _on_limit_cycle(
    hunting: Sequence[SteadyState], envelopes: Sequence[Envelope]
) -> NDArray[np.bool_]:
    """Instants of the path that belong to a steady limit cycle."""
    parts = []
    for envelope in envelopes:
        stamp = envelope.start_ns + 1e9 * envelope.time
        on = np.zeros(stamp.size, dtype=bool)
        for state in hunting:
            if state.source == envelope.source:
                on |= (stamp >= state.start_ns - 1e6) & (stamp <= state.end_ns + 1e6)
        parts.append(on)
    return np.concatenate(parts)
