"""
What the normal form says of a row: branches, margin, the outlook, the time to the limit cycle.

The parts of the kernel of the decisions that need it (`predict`), and its numbers as they read
them. How the motion will end under noise is looked up: `outlook`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.decision.outlook import chance_beyond
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import steady_radii
from hunt_ros.samples import NORMAL_95

#: The time to the limit cycle is that to this part of the stable amplitude,
_ARRIVED = 0.9
#: from at least this part of the unstable amplitude, near which the growth rate is zero.
_LEFT = 1.02
_PIECES = 64
#: A limit cycle may be smaller than at the fold by this factor: two deviations of a poor form.
SMALLEST = 0.5
#: Frequency of worn wheels over that of new ones, or the other way round; and how many standard
#: deviations make a frequency another one.
_WORN, _SURE = 1.5, 3.0


class FormNumbers(NamedTuple):
    """
    A normal form as a kernel reads it, as in `NormalForm`; NaN throughout where there is none.

    `fold_amplitude` is that of the limit cycle at v_n, m, NaN where there is no fold.
    """

    known: bool
    critical_speed: float
    D1: float
    D4: float
    D7: float
    D10: float
    D15: float
    length_scale: float
    time_scale: float
    frequency_hz: float
    fold_amplitude: float


def form_numbers(identified: IdentifiedNormalForm | None) -> FormNumbers:
    """Prepare a normal form."""
    if identified is None:
        return FormNumbers._make([False, *[math.nan] * 10])
    form = identified.form
    fold = form.saddle_node()
    known = (getattr(form, name) for name in FormNumbers._fields[1:10])
    return FormNumbers._make([True, *known, math.nan if fold is None else fold[1]])


def fill_branches(form: FormNumbers, rows: NDArray[np.void]) -> None:
    """
    Fill in the branches at the speeds of rows (ESTIMATE_DTYPE), under their roughness line.

    Roughness of amplitude B acts on the mean of the cubic term: A^2 -> A^2 + 2 B^2.
    """
    if not form.known:
        return
    eps = rows['speed'] / form.critical_speed - 1.0
    rest, cubic = form.D1 * eps + form.D7 * eps**2, form.D4 + form.D10 * eps
    radii = steady_radii(rest, cubic, np.full_like(eps, form.D15))
    unstable, stable = (2.0 * form.length_scale * radius for radius in radii)
    lowered = unstable**2 - 2.0 * np.fmax(rows['lateral_roughness'], 0.0) ** 2
    rows['unstable_amplitude'] = np.sqrt(np.fmax(lowered, 0.01 * unstable**2))
    rows['stable_amplitude'] = stable


@compiled_part
def growth_at(form: FormNumbers, v: float, a: float) -> float:
    """Growth rate of the form, Eq. (24) divided by r, 1/s, at one speed and amplitude."""
    eps = v / form.critical_speed - 1.0
    r2 = (a / (2.0 * form.length_scale)) ** 2
    rest, cubic = form.D1 * eps + form.D7 * eps**2, form.D4 + form.D10 * eps
    return (rest + cubic * r2 + form.D15 * r2**2) / form.time_scale


@compiled_part
def is_hunting_of(form: FormNumbers, nominal_hz: float, v: float, a: float, out: Any) -> bool:
    """
    Return False where a steady motion of amplitude a is for sure not the hunting of the form.

    The frequency may go with the speed (Klingel, 1883), or not at all, and with the root of the
    conicity, which wear may double. Where the rig says another frequency than the form, either
    may be. A form may be wrong about the speed; no cycle of a rig with a fold is much smaller
    than that at the fold.
    """
    hz, std_hz = out['frequency_hz'], out['frequency_hz_std']
    faster = v / form.critical_speed
    lowest = min(form.frequency_hz, nominal_hz) * min(faster, 1.0) / _WORN
    highest = max(form.frequency_hz, nominal_hz) * max(faster, 1.0) * _WORN
    if hz + _SURE * std_hz < lowest or hz - _SURE * std_hz > highest:
        return False
    return bool(not a < SMALLEST * form.fold_amplitude or out['escape_probability'] > 0.5)


@compiled_part
def predict(form: FormNumbers, outlook: Any, v: float, a: float, s: float, out: Any) -> None:
    """
    Fill in margin, probability of escape and outlook of a row that has its branches.

    Parameters
    ----------
    form
        The form.
    outlook
        A record of OUTLOOK.
    v, a, s : float
        Speed, m/s; amplitude and its standard deviation, m; NaN where unknown.
    out
        The row.
    """
    if not form.known or math.isnan(v):
        return
    edge, spread = out['unstable_amplitude'], outlook['unstable_std']
    if not math.isnan(edge):
        out['unstable_amplitude_std'] = spread
    if math.isnan(a):
        return
    folded = math.isnan(edge) and growth_at(form, v, 0.0) < 0.0
    if folded:  # below the fold of the form, but not of all its draws
        edge = outlook['unstable_mean']
    if not math.isnan(edge):
        out['margin'] = edge / a if a > 0.0 else math.inf
        most, least = a + NORMAL_95 * s, a - NORMAL_95 * s
        out['margin_low'] = max(edge - NORMAL_95 * spread, 0.0) / most if most > 0.0 else math.inf
        high = (edge + NORMAL_95 * spread) / least if least > 0.0 else math.inf
        out['margin_high'] = math.inf if folded else high
    probability = chance_beyond(outlook['decides'], a, s)
    out['escape_probability'] = probability
    # A mean may lie beyond such an end where the chance is settled but for a thin tail.
    low = chance_beyond(outlook['latest'], a - NORMAL_95 * s, 0.0)
    high = chance_beyond(outlook['earliest'], a + NORMAL_95 * s, 0.0)
    out['escape_probability_low'] = min(low, probability)
    out['escape_probability_high'] = max(high, probability)
    out['outlook'] = 1.0 - (1.0 - probability) * (1.0 - outlook['next_minute'])


@compiled_part
def time_to_cycle(form: FormNumbers, v: float, a: float, out: Any) -> float:
    """Time to 90 % of the stable branch along the form, s; Simpson's rule in ln A."""
    stable = out['stable_amplitude']
    if math.isnan(stable):
        return math.nan
    end = math.log(_ARRIVED * stable)
    begin = math.log(max(a, 1e-12))
    if not math.isnan(out['unstable_amplitude']):
        begin = max(begin, math.log(_LEFT * out['unstable_amplitude']))
    if begin >= end:
        return 0.0
    step = (end - begin) / _PIECES
    total = 0.0
    for k in range(_PIECES + 1):
        rate = growth_at(form, v, math.exp(begin + k * step))
        if rate <= 0.0:
            return math.inf
        weight = 1.0 if k == 0 or k == _PIECES else 4.0 if k % 2 else 2.0
        total += weight / rate
    return total * step / 3.0
