"""
The bias of a damping that was read from random motion, to first order, and its removal.

Where the quiet state's own random motion shows how fast it is damped, the likelihood finds
too much damping: by 1 / T from a stretch of T seconds, a third of the deviation itself on a
hold of half a minute. Many holds do not average it out, and v_c, which lies where the
damping ends, comes out late.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, F1, compiled
from hunt_ros.dynamics.covariance_root import inverse_of
from hunt_ros.dynamics.growth_law import LINEAR, SATURATION, TERMS
from hunt_ros.identification.likelihood.path import Path

#: Share of A_ref up to which motion is quiet: the cubic term changes its growth by little.
_QUIET = 0.2


@compiled
def _memory(
    growth: F1,
    forcing: F1,
    step: F1,
    restart: B1,
    power: F1,
    out: F1,
) -> None:
    """Fill out = d ln E|z|^2 / d(growth rate), s, times the share of the motion that is forced."""
    expected = 0.0
    forced = 0.0
    memory = 0.0
    for k in range(growth.size):
        if restart[k] or not math.isfinite(power[k]) or expected <= 0.0:
            memory = 0.0
            forced = 0.0
            expected = power[k] if math.isfinite(power[k]) else 0.0
        else:
            # dE/dt = 2 g E + 2 Q, and its derivative by g; growth and forcing held over a step.
            turned = 2.0 * growth[k] * step[k]
            grown = math.exp(min(turned, 5.0))
            mean = 1.0 + 0.5 * turned if abs(turned) < 1e-4 else (grown - 1.0) / turned
            pushed = 2.0 * forcing[k] * step[k] * mean
            fresh = grown * expected + pushed
            forced = grown * forced + pushed
            slope = grown * expected * (memory + 2.0 * step[k]) + 2.0 * forcing[k] * step[k] ** 2
            memory = slope / fresh
            expected = fresh
        out[k] = memory * forced / expected if expected > 0.0 else 0.0


def damping_correction(
    theta: NDArray[np.float64],
    path: Path,
    derivative: NDArray[np.float64],
    information: NDArray[np.float64],
) -> NDArray[np.float64]:
    """
    What is to be added to a law for the bias of the damping of its quiet motion.

    To first order the bias of a maximum of the likelihood is
    - I^-1 sum_l (dI / dp_l) I^-1 e_l, if the derivative of the log likelihood is linear in p;
    the information on the growth rate of forced motion is its expected power, and what that
    changes with the growth rate is the time for which the motion remembers. The noise is taken
    as known. What grows is left as it is: the result is one of stationary motion.

    Parameters
    ----------
    theta : ndarray, shape (15,)
        Law and noise at the maximum.
    path : Path
        The measured envelope.
    derivative : ndarray, shape (15, n, 2)
        Of the whitened innovations by theta.
    information : ndarray, shape (15, 15)
        Fisher information, with the priors.

    Returns
    -------
    ndarray, shape (10,)

    References
    ----------
    Cox, D. R., Snell, E. J. (1968), J. R. Statist. Soc. B 30, 248-275, Eq. (20); for the
    autoregression: Marriott, F. H. C., Pope, J. A. (1954), Biometrika 41, 390-402.
    """
    pull = np.zeros(TERMS)
    if not (np.isfinite(information).all() and np.isfinite(derivative).all()):
        return pull
    # With the noise held: it is known from all of the record.
    inverse = inverse_of(information[:TERMS, :TERMS])
    power = np.abs(path.phasor) ** 2
    columns = np.stack([path.u**power_of_u for power_of_u in LINEAR])
    growth = theta[list(LINEAR)] @ columns
    quiet = (np.nan_to_num(power, nan=np.inf) < _QUIET**2) & (growth < 0.0)
    forcing = np.exp(np.clip(theta[-3] + theta[-5] * path.u, -40.0, 10.0))
    step = np.diff(path.time, prepend=path.time[0])
    memory = np.empty(path.time.size)
    begins = path.restart.copy()
    begins[1:] |= ~quiet[:-1]
    _memory(growth, forcing, step, begins, power, memory)
    rows = derivative[:TERMS]
    leverage = np.einsum('jnc,jk,knc->n', rows, inverse, rows, optimize=True)
    weight = np.where(quiet, leverage * memory, 0.0)
    if not np.isfinite(weight).all():
        return pull
    pull[list(LINEAR)] = columns @ weight
    correction: NDArray[np.float64] = inverse @ pull
    # First order is only that: never more than one deviation.
    correction /= max(1.0, math.sqrt(max(float(pull @ correction), 0.0)))
    # No saturation is negative: where it is held at 0 the others follow it, as in the fit.
    short = -(theta[SATURATION] + correction[SATURATION])
    if short > 0.0 < inverse[SATURATION, SATURATION]:
        correction += short * inverse[SATURATION] / inverse[SATURATION, SATURATION]
    return correction
