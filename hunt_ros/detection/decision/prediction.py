"""
What the normal form says about a row: branches, margin, chance of escape, time to the cycle.

Called by the kernel of the decisions, row by row; the tables behind it are those of `outlook`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.decision.outlook import FormNumbers
from hunt_ros.samples import NORMAL_95

#: Standard deviations beyond which a normal distribution is 0 or 1.
_SETTLED = 4.0
#: Horizon of the outlook: the next minute, as its name says; on the clock, not in periods.
_OUTLOOK_S = 60.0
#: The time to the limit cycle is that to this part of the stable amplitude,
_ARRIVED = 0.9
#: from at least this part of the unstable amplitude, near which the growth rate is zero.
_LEFT = 1.02
_PIECES = 64
#: A limit cycle may be smaller than at the fold by this factor: two deviations of a poor form.
_SMALLEST = 0.5
#: Frequency of worn wheels over that of new ones, or the other way round; and how many standard
#: deviations make a frequency another one.
_WORN, _SURE = 1.5, 3.0


@compiled_part
def _law(form: FormNumbers, v: float) -> tuple[float, float]:
    """Return the growth rate of r^2 -> 0 and its slope with r^2, by Eq. (24), without scale."""
    eps = v / form.critical_speed - 1.0
    return form.D1 * eps + form.D7 * eps**2, form.D4 + form.D10 * eps


@compiled_part
def growth_at(form: FormNumbers, v: float, a: float) -> float:
    """Growth rate of the form, Eq. (24) divided by r, 1/s, at one speed and amplitude."""
    c, b = _law(form, v)
    r2 = (a / (2.0 * form.length_scale)) ** 2
    return (c + b * r2 + form.D15 * r2**2) / form.time_scale


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
    return bool(not a < _SMALLEST * form.fold_amplitude or out['escape_probability'] > 0.5)


@compiled_part
def predict(form: FormNumbers, outlook: Any, v: float, a: float, s: float, out: Any) -> None:
    """
    Fill in branches, margin, probability of escape and outlook of a row that has none of them.

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
    damping = _branches(form, v, out['lateral_roughness'], out)
    if math.isnan(a):
        return
    edge, spread = out['unstable_amplitude'], out['unstable_amplitude_std']
    folded = math.isnan(edge) and damping < 0.0
    if folded:  # below the fold of the form, but not of all its draws
        k, _ = _place(form, v)
        edge, spread = form.unstable_mean[k], form.unstable_std[k]
    if not math.isnan(edge):
        out['margin'] = edge / a if a > 0.0 else math.inf
        most, least = a + NORMAL_95 * s, a - NORMAL_95 * s
        out['margin_low'] = max(edge - NORMAL_95 * spread, 0.0) / most if most > 0.0 else math.inf
        high = (edge + NORMAL_95 * spread) / least if least > 0.0 else math.inf
        out['margin_high'] = math.inf if folded else high
    probability = _beyond(outlook['decides'], a, s)
    out['escape_probability'] = probability
    # A mean may lie beyond such an end where the chance is settled but for a thin tail.
    low = _beyond(outlook['latest'], a - NORMAL_95 * s, 0.0)
    high = _beyond(outlook['earliest'], a + NORMAL_95 * s, 0.0)
    out['escape_probability_low'] = min(low, probability)
    out['escape_probability_high'] = max(high, probability)
    out['outlook'] = 1.0 - (1.0 - probability) * math.exp(-_OUTLOOK_S * outlook['rate'])


@compiled_part
def _branches(form: FormNumbers, v: float, roughness: float, out: Any) -> float:
    """
    Fill in the branches at a speed, Eq. (28), under a roughness line of amplitude B, m.

    Returns
    -------
    float
        Growth rate at zero amplitude, 1/s.
    """
    a = form.D15
    c, b = _law(form, v)
    first, second = math.nan, math.nan
    if a == 0.0:
        if b != 0.0:
            first = -c / b
    else:
        discriminant = b * b - 4.0 * a * c
        if discriminant >= 0.0:
            root = math.sqrt(discriminant)
            q = -0.5 * (b + root) if b >= 0.0 else -0.5 * (b - root)
            first = q / a
            if q != 0.0:
                second = c / q
    for r2 in (first, second):
        if r2 > 0.0:
            value = 2.0 * form.length_scale * math.sqrt(r2)
            if b + 2.0 * a * r2 > 0.0:
                out['unstable_amplitude'] = value
            else:
                out['stable_amplitude'] = value
    plain = out['unstable_amplitude']
    if not math.isnan(plain):
        k, part = _place(form, v)
        low, high = form.unstable_std[k], form.unstable_std[k + 1]
        spread = low + part * (high - low)
        if roughness > 0.0:
            # Roughness of amplitude B acts on the mean of the cubic term: A^2 -> A^2 + 2 B^2.
            lowered = math.sqrt(max(plain**2 - 2.0 * roughness**2, 0.01 * plain**2))
            spread *= lowered / plain
            out['unstable_amplitude'] = lowered
        out['unstable_amplitude_std'] = spread
    return c / form.time_scale


@compiled_part
def _place(form: FormNumbers, v: float) -> tuple[int, float]:
    """Cell of the tables in which a speed lies, and how far along it."""
    place = (v - form.speed_low) / form.speed_step
    k = min(max(int(place), 0), form.unstable_std.size - 2)
    return k, min(max(place - k, 0.0), 1.0)


@compiled_part
def _beyond(decides: NDArray[np.float64], a: float, s: float) -> float:
    """Chance that an amplitude known to within `s` is beyond the one that decides."""
    if math.isnan(decides[0]):
        return math.nan
    total = 0.0
    for edge in decides:
        if a - edge > _SETTLED * s:
            total += 1.0
        elif edge - a >= _SETTLED * s:
            break  # they are in order
        else:
            total += 0.5 * math.erfc((edge - a) / (s * math.sqrt(2.0)))
    return total / decides.size


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
