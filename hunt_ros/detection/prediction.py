"""
What the normal form says about a row: branches, margin, chance of escape, time to the cycle.

Each part fills in its numbers in a row of the estimates (`VERDICT` names them). Called
by the kernel of the decisions, row by row; the tables behind it are those of `basin`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.basin import FormNumbers

#: The noise at the edge of the basin, `EdgeNoise` as the kernel reads it.
EDGE: np.dtype[np.void] = np.dtype(
    [('centre', np.float64), ('width', np.float64), ('rate', np.float64)], align=True
)

_NORMAL_95 = 1.959964
#: Gauss-Hermite quadrature of three points: the outer ones, and the weight of the middle.
_NODE, _MIDDLE = math.sqrt(3.0), 2.0 / 3.0
#: The time to the limit cycle is that to this part of the stable amplitude,
_ARRIVED = 0.9
#: from at least this part of the unstable amplitude, about which time stands still.
_LEFT = 1.02
_PIECES = 64
#: Far below the edge the chance is settled; this keeps its parts finite.
_LARGEST_EXPONENT = 600.0


@compiled_part
def clear(out: Any) -> None:
    """Set all numbers of a row that come from the form to unknown."""
    out['unstable_amplitude'] = math.nan
    out['unstable_amplitude_std'] = math.nan
    out['stable_amplitude'] = math.nan
    out['margin'] = math.nan
    out['margin_low'] = math.nan
    out['margin_high'] = math.nan
    out['escape_probability'] = math.nan
    out['escape_probability_low'] = math.nan
    out['escape_probability_high'] = math.nan
    out['outlook'] = math.nan
    out['time_to_limit_cycle'] = math.nan


@compiled_part
def growth_at(form: FormNumbers, v: float, a: float) -> float:
    """Growth rate of the form, Eq. (24) divided by r, 1/s, at one speed and amplitude."""
    eps = v / form.critical_speed - 1.0
    r2 = (a / (2.0 * form.length_scale)) ** 2
    return (
        form.D1 * eps + form.D7 * eps**2 + (form.D4 + form.D10 * eps) * r2 + form.D15 * r2**2
    ) / form.time_scale


@compiled_part
def branches(form: FormNumbers, v: float, roughness: float, out: Any) -> float:
    """
    Fill in the branches at a speed, Eq. (28), under a roughness line of amplitude B, m.

    Returns
    -------
    float
        Growth rate at zero amplitude, 1/s.
    """
    eps = v / form.critical_speed - 1.0
    a = form.D15
    b = form.D4 + form.D10 * eps
    c = form.D1 * eps + form.D7 * eps**2
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
    k = min(max(int(place), 0), form.quiet_share.size - 2)
    return k, min(max(place - k, 0.0), 1.0)


@compiled_part
def judge(
    form: FormNumbers,
    edge_noise: Any,
    noise_spread: float,
    v: float,
    a: float,
    s: float,
    damping: float,
    outlook_s: float,
    out: Any,
) -> None:
    """
    Fill in margin, probability of escape and outlook, after `branches`.

    Parameters
    ----------
    form, edge_noise
        The form, and what the noise does at the edge of the basin.
    noise_spread : float
        Standard deviation of the logarithm of the noise intensity.
    v, a, s : float
        Speed, m/s; amplitude and its standard deviation, m.
    damping : float
        Growth rate at zero amplitude, 1/s.
    outlook_s : float
        Horizon of the outlook, s.
    out
        The row.
    """
    k, part = _place(form, v)
    exact = form.unstable_std.max() == 0.0  # no uncertainty: the shares are a matter of sign
    quiet = 1.0 if damping < 0.0 else 0.0
    cycle = 0.0 if math.isnan(out['stable_amplitude']) else 1.0
    edge = out['unstable_amplitude']
    if not exact:
        quiet = form.quiet_share[k] + part * (form.quiet_share[k + 1] - form.quiet_share[k])
        cycle = form.cycle_share[k] + part * (form.cycle_share[k + 1] - form.cycle_share[k])
        if math.isnan(edge) and damping < 0.0:
            edge = form.unstable_mean[k]
    inside, least_inside, most_inside = 0.0, 0.0, 0.0
    if not math.isnan(edge):
        spread = out['unstable_amplitude_std']
        spread = 0.0 if math.isnan(spread) else spread
        variance = s * s + spread * spread
        inside = _beyond(edge_noise, noise_spread, edge, a, variance)
        # Its interval: what it would be were the distance to the edge at the ends of its own.
        off = _NORMAL_95 * math.sqrt(variance)
        least_inside = _beyond(edge_noise, noise_spread, edge, a - off, 0.0)
        most_inside = _beyond(edge_noise, noise_spread, edge, a + off, 0.0)
        out['margin'] = edge / a if a > 0.0 else math.inf
        most, least = a + _NORMAL_95 * s, a - _NORMAL_95 * s
        out['margin_low'] = max(edge - _NORMAL_95 * spread, 0.0) / most if most > 0.0 else math.inf
        out['margin_high'] = (edge + _NORMAL_95 * spread) / least if least > 0.0 else math.inf
    elif damping >= 0.0:
        quiet = min(quiet, 0.5) if not exact else 0.0
    probability = 1.0 - quiet + quiet * cycle * inside
    out['escape_probability'] = probability
    # A mean may lie beyond such an end where the chance is settled but for a thin tail.
    low, high = (
        1.0 - quiet + quiet * cycle * least_inside,
        1.0 - quiet + quiet * cycle * most_inside,
    )
    out['escape_probability_low'] = min(low, probability)
    out['escape_probability_high'] = max(high, probability)
    stays = (1.0 - probability) * math.exp(-outlook_s * edge_noise['rate'])
    out['outlook'] = 1.0 - stays


@compiled_part
def _beyond(edge_noise: Any, noise_spread: float, edge: float, a: float, variance: float) -> float:
    """
    Committor averaged over the uncertainty of amplitude, edge (`variance`, m^2) and noise.

    The noise is uncertain by a factor: Gauss-Hermite quadrature over its logarithm. The
    width of the edge goes with the root of the intensity, its shift with the intensity.
    """
    total = 0.0
    for k in range(3):
        factor = math.exp((k - 1) * _NODE * noise_spread)
        centre = max(1.0 - (1.0 - edge_noise['centre']) * factor, 0.5)
        width = math.sqrt((edge_noise['width'] * edge) ** 2 * factor + variance)
        distance = a - centre * edge
        if width > 0.0:
            beyond = 0.5 * math.erfc(-distance / (width * math.sqrt(2.0)))
        else:
            beyond = 1.0 if distance > 0.0 else 0.0
        total += (_MIDDLE if k == 1 else 0.5 * (1.0 - _MIDDLE)) * beyond
    return total


@compiled_part
def stays_up(
    form: FormNumbers, v: float, a: float, low: float, high: float, diffusion: float
) -> float:
    """
    Chance that a motion reaches the amplitude `high` before it falls to `low`.

    From dA = (s A + D / A) dt + sqrt(2 D) dW, with s the growth rate of the form: the scale
    function has the density exp(-int s A dA / D) / A (Gardiner, Handbook of Stochastic
    Methods, 2004, Eq. (5.2.189)). Simpson's rule in ln A.

    Parameters
    ----------
    form : FormNumbers
        A form that is known.
    v, a, low, high : float
        Speed, m/s, and amplitudes, m; `low` above zero.
    diffusion : float
        Noise intensity D, m^2/s, above zero.
    """
    if a <= low or high <= low:
        return 0.0
    if a >= high:
        return 1.0
    fallen = _scale(form, v, a, low, a, diffusion)
    return fallen / (fallen + _scale(form, v, a, a, high, diffusion))


@compiled_part
def _scale(
    form: FormNumbers, v: float, a: float, low: float, high: float, diffusion: float
) -> float:
    """Scale function from `low` to `high`, but for a factor that depends on `a`."""
    eps = v / form.critical_speed - 1.0
    first = form.D1 * eps + form.D7 * eps**2
    second, third = 0.5 * (form.D4 + form.D10 * eps), form.D15 / 3.0
    size = 4.0 * form.length_scale**2
    factor = 0.5 * size / (form.time_scale * diffusion)
    r2 = a * a / size
    here = r2 * (first + r2 * (second + r2 * third))
    step = math.log(high / low) / _PIECES
    total = 0.0
    for k in range(_PIECES + 1):
        r2 = (low * math.exp(k * step)) ** 2 / size
        fall = here - r2 * (first + r2 * (second + r2 * third))
        weight = 1.0 if k == 0 or k == _PIECES else 4.0 if k % 2 else 2.0
        total += weight * math.exp(min(factor * fall, _LARGEST_EXPONENT))
    return total * step / 3.0


@compiled_part
def wander(form: FormNumbers, v: float, a: float, diffusion: float) -> float:
    """
    Standard deviation, m, of the amplitude about a stable branch `a`, m, under noise.

    Linearised: sqrt(D / -(A ds/dA)); infinite where nothing holds it.
    """
    pull = (growth_at(form, v, 0.99 * a) - growth_at(form, v, 1.01 * a)) / 0.02
    return math.sqrt(diffusion / pull) if pull > 0.0 else math.inf


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
