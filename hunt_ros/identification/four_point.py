"""
The paper's four-point recipe, Sect. 3.3: four steady amplitudes, one linear solve.

It is the paper's result and stands beside the fit for comparison. With D1 taken as
known the four unknowns D4, D7, D10, D15 follow from four points of the stable branch;
the system is so badly conditioned that errors of 0.5 % in the amplitudes can change the
sign of the unstable branch. Its condition number is part of the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.samples import key

#: Detunings at which the paper takes its four amplitudes.
PAPER_DETUNINGS: tuple[float, ...] = (-0.2, -0.1, 0.0, 0.1)
#: How far from them a limit cycle may be.
_NEAR = 0.05


@dataclass(frozen=True)
class FourPoint:
    """
    Coefficients from four steady amplitudes.

    Parameters
    ----------
    D4, D7, D10, D15 : float
        As in Eq. (33).
    condition_number : float
        Of the system with its columns brought to one length: relative errors of the
        amplitudes grow by up to about this.
    missed : int
        Points at which the coefficients themselves have no such stable limit cycle.
    """

    D4: float
    D7: float
    D10: float
    D15: float
    condition_number: float
    missed: int = field(default=0, metadata=key(''))


def at_detunings(
    states: Sequence[SteadyState], moved: Sequence[tuple[str, int, int]], critical_speed: float
) -> list[SteadyState] | str:
    """
    Choose the limit cycles at the paper's four detunings.

    Parameters
    ----------
    states : sequence of SteadyState
        Limit cycles only.
    moved : sequence of (str, int, int)
        Source, and first and last stamp, ns, of its ways to and from hunting: a state in which,
        or as long before it as it lasts, the rig was on one is left out: it may not have settled.
    critical_speed : float
        m/s.

    Returns
    -------
    list of SteadyState, or str
        Four, in the order of the detunings; or why there are not four.
    """
    if len(states) < 4:
        return f'the four-point recipe needs four limit cycles, {len(states)} were measured'

    def settled(state: SteadyState) -> bool:
        """Return True where nothing moved for as long before."""
        start, end = 2 * state.start_ns - state.end_ns, state.end_ns
        ways = (way for source, *way in moved if source == state.source)
        return not any(first < end and last > start for first, last in ways)

    still = [state for state in states if state.kind == 'plateau' and settled(state)]
    chosen = []
    for target in PAPER_DETUNINGS:
        off = [abs(state.speed / critical_speed - 1.0 - target) for state in still]
        if not off or min(off) > _NEAR:
            return (
                f'no settled limit cycle near eps = {target:g}; the recipe needs'
                f' {", ".join(f"{x:g}" for x in PAPER_DETUNINGS)}'
            )
        chosen.append(still[int(np.argmin(off))])
    if len({state.speed for state in chosen}) < 4:
        return 'no four limit cycles near eps = -0.2, -0.1, 0, 0.1, as the recipe needs'
    return chosen


def four_point(detunings: NDArray[np.float64], radii: NDArray[np.float64], D1: float) -> FourPoint:
    """
    Solve Eq. (28) for D4, D7, D10, D15 at four points.

    Parameters
    ----------
    detunings : ndarray, shape (4,)
        All different, as `at_detunings` chooses them:
        eps = v / v_c - 1, Eq. (5).
    radii : ndarray, shape (4,)
        r = y_amp / (2 d0), Eq. (32).
    D1 : float
        Real part of the linear coefficient, taken as known.

    Returns
    -------
    FourPoint

    References
    ----------
    The paper, Sect. 3.3, Eqs. (26)-(33).
    """
    eps, r = detunings, radii
    matrix = np.stack([r**2, eps**2, eps * r**2, r**4], axis=1)
    lengths = np.linalg.norm(matrix, axis=0)
    condition = float(np.linalg.cond(matrix / lengths))
    D4, D7, D10, D15 = (float(x) for x in np.linalg.solve(matrix, -D1 * eps))
    form = NormalForm(critical_speed=1.0, D1=D1, D4=D4, D7=D7, D10=D10, D15=D15)
    stable = form.stable_amplitude(1.0 + eps) / (2.0 * form.length_scale)
    missed = int(np.sum(~np.isclose(stable, r, rtol=1e-3)))
    return FourPoint(D4, D7, D10, D15, condition, missed)


def recipe(
    identified: IdentifiedNormalForm | None,
    states: Sequence[SteadyState],
    moved: Sequence[tuple[str, int, int]],
    warnings: list[str],
) -> FourPoint | str:
    """Run the recipe with v_c and D1 of a normal form, on limit cycles; or say why not."""
    if identified is None:
        return 'the four-point recipe needs v_c and D1 of a normal form, and none is given'
    form = identified.form
    chosen = at_detunings(states, moved, form.critical_speed)
    if isinstance(chosen, str):
        return chosen
    eps = np.array([state.speed / form.critical_speed - 1.0 for state in chosen])
    radii = np.array([state.amplitude for state in chosen]) / (2.0 * form.length_scale)
    found = four_point(eps, radii, form.D1)
    if found.missed:
        warnings.append(
            f'four-point recipe: {found.missed} of its 4 amplitudes are no stable limit cycle of'
            f' its own coefficients (condition number {found.condition_number:.3g})'
        )
    return found
