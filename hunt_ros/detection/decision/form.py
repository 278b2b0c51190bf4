"""
What the normal form says: branches, margin, the outlook, the time to the limit cycle.

The outlook is how the motion will end, under noise, by a form that is known with an
uncertainty. Averaged over a cycle the amplitude obeys

    dA = (A s(A) + D / A) dt + sqrt(2 D) dW

with s the growth rate of Eq. (24) and D the noise intensity.
The chance that it reaches the limit cycle before it is quiet again, the committor, is the ratio
of two scale functions, with the density exp(-int s A dA / D) / A. It is averaged over draws of
the form, and of D, and grows with the amplitude from 0 to the share of the draws that have a
limit cycle: it is the distribution of the amplitude at which the outcome is decided. A table
keeps quantiles of that, so that a row with a Gaussian amplitude takes the mean of a few normal
distributions; and of the committors that 2.5 % of the draws exceed and fall short of, which are
its interval. Nothing here asks whether there is a fold or a quiet state: draws differ in it.

The tables are made in Python; what follows from them for a row is part of the kernel of the
decisions (`predict`).
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F1, compiled, compiled_part
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm, steady_radii
from hunt_ros.samples import NORMAL_95

_F = NDArray[np.float64]

#: Draws of the form for the branches, and for the outlook.
_DRAWS = 200
_PATHS = 64
_SPEEDS = 300
#: Quantiles of the deciding amplitude that are kept.
QUANTILES = 64
#: Amplitudes at which the committor is computed, from this part of the limit cycle on.
_AMPLITUDES, _LEAST = 384, 1e-3
#: Spacing of the speeds of the table, and a change that asks for another outlook, relative to v_c.
_SPEED_CELL, _SPEED_STEP = 0.005, 0.0025
#: Width of the cells of the spread of the noise intensity, and of the logarithms of this, of the
#: quiet amplitude and of the roughness, in which an outlook is taken as constant.
_CELL = 0.1
#: Where no noise is known it is this much, m^2/s: the edge is sharp.
_NO_NOISE = 1e-18
#: A limit cycle stands this many standard deviations of its amplitude clear of what is quiet.
_WANDERS = 2.0
#: Where growth has no end the motion has grown at this many times the amplitude from which on
#: it grows.
_GROWN = 2.0
#: Exponents beyond this are taken as infinite.
_LARGEST_EXPONENT = 600.0
#: The longest time, s, and the largest exponent of one step: their product does not overflow.
_LONGEST, _STEEPEST = 1e270, 50.0
#: Draws on either side of the interval of 95 %, of all of them.
_OUTSIDE = round(0.025 * _PATHS)
#: Outlooks that are kept for when they are asked for again.
_KEPT = 1000

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
SMALLEST = 0.5
#: Frequency of worn wheels over that of new ones, or the other way round; and how many standard
#: deviations make a frequency another one.
_WORN, _SURE = 1.5, 3.0

#: What the kernel of the decisions reads: quantiles of the amplitude at which the outcome is
#: decided (m; inf: nowhere), and of those of the draws that escape latest and earliest; escapes
#: from the quiet state per second; the share of the draws that have a quiet state.
OUTLOOK: np.dtype[np.void] = np.dtype(
    [
        ('decides', np.float64, (QUANTILES,)),
        ('latest', np.float64, (QUANTILES,)),
        ('earliest', np.float64, (QUANTILES,)),
        ('rate', np.float64),
        ('quiet', np.float64),
    ],
    align=True,
)

_QUANTILES = ('decides', 'latest', 'earliest')
_UNKNOWN = (math.nan,) * QUANTILES
#: Nothing is known.
NO_OUTLOOK: NDArray[np.void] = np.array(
    [(_UNKNOWN, _UNKNOWN, _UNKNOWN, math.nan, math.nan)], dtype=OUTLOOK
)


class FormNumbers(NamedTuple):
    """
    A normal form as a kernel reads it, as in `NormalForm`; NaN throughout where there is none.

    `fold_amplitude` is that of the limit cycle at v_n, m, NaN where there is no fold;
    `unstable_std` and `unstable_mean` are standard deviation and mean over the draws of the
    unstable amplitude, m, at speeds from `speed_low` on that are `speed_step` apart, m/s.
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
    speed_low: float
    speed_step: float
    unstable_std: F1
    unstable_mean: F1


def form_numbers(identified: IdentifiedNormalForm | None) -> FormNumbers:
    """Prepare a normal form: branches of draws from its covariance, tabulated by speed."""
    if identified is None:
        none = np.full(2, math.nan)
        return FormNumbers._make([False, *[math.nan] * 10, 0.0, 1.0, none, none])
    form = identified.form
    speeds = np.linspace(0.3, 1.7, _SPEEDS) * form.critical_speed
    with np.errstate(all='ignore'):
        unstable = np.array(
            [draw.unstable_amplitude(speeds) for draw in _drawn(identified, _DRAWS)]
        )
    exists = np.isfinite(unstable)
    count = np.maximum(exists.sum(axis=0), 1)
    mean = np.where(exists, unstable, 0.0).sum(axis=0) / count
    spread = np.where(exists, unstable - mean, 0.0)
    mean[~exists.any(axis=0)] = math.nan
    fold = form.saddle_node()
    return FormNumbers._make(
        [
            True,
            *(getattr(form, name) for name in FormNumbers._fields[1:10]),
            math.nan if fold is None else fold[1],
            float(speeds[0]),
            float(speeds[1] - speeds[0]),
            np.sqrt((spread**2).sum(axis=0) / count),
            mean,
        ]
    )


def _drawn(identified: IdentifiedNormalForm, count: int) -> list[NormalForm]:
    """Draws of the form; the form itself where it is taken as exact."""
    return identified.draws(count) if identified.covariance.any() else [identified.form]


class OutlookTable:
    """
    Outlooks by speed, noise, quiet amplitude and roughness, computed when first asked for.

    All but the speed are rounded to cells first. The answer depends on what is asked alone, not
    on what was asked before.

    Parameters
    ----------
    identified : IdentifiedNormalForm or None
        None: there is no outlook, NaN throughout.
    """

    def __init__(self, identified: IdentifiedNormalForm | None) -> None:
        self._known: dict[tuple[float, ...], NDArray[np.void]] = {}
        self._speed_cell = self._speed_step = math.inf
        if identified is None:
            return
        self._speed_cell = _SPEED_CELL * identified.form.critical_speed
        self._speed_step = _SPEED_STEP * identified.form.critical_speed
        names = ('critical_speed', 'D1', 'D7', 'D4', 'D10', 'D15')
        own, *drawn = (
            np.array([getattr(form, name) for name in names])
            for form in (identified.form, *_drawn(identified, _PATHS))
        )
        forms = np.array(drawn)
        if not len(identified.sample):
            # With its mirror image to each, the draws have the mean of the form.
            half = forms[: _PATHS // 2]
            forms = np.concatenate([half, 2.0 * own - half])
        # Each draw has its own noise; an exact form is drawn as often as the noise is.
        self._forms = np.resize(forms[forms[:, 0] > 0.0], (_PATHS, len(names))).T
        self._size = 2.0 * identified.form.length_scale
        self._time_scale = identified.form.time_scale
        normal = NormalDist()
        levels = [normal.inv_cdf((k + 0.5) / _PATHS) for k in range(_PATHS)]
        self._noise = np.random.default_rng(0).permutation(levels)
        # Before the form is in force: no row of a live run waits for machine code.
        self.at(1.02 * identified.form.critical_speed, math.nan, 0.0, math.nan, 0.0)

    def differ(self, speeds: _F, speed: float) -> NDArray[np.bool_]:
        """Return True for each speed, m/s, whose outlook is another one than that of `speed`."""
        return np.asarray((speeds != speed) & ~(np.abs(speeds - speed) <= self._speed_step))

    def at(
        self, speed: float, intensity: float, spread: float, quiet: float, roughness: float
    ) -> NDArray[np.void]:
        """
        Look up, or compute; from one speed of the table to the next linear in 1 / amplitude.

        Parameters
        ----------
        speed : float
            m/s.
        intensity, spread : float
            Noise intensity D, m^2/s, NaN or zero where it is not known, and the standard
            deviation of its logarithm.
        quiet : float
            Amplitude below which the motion counts as quiet, m; NaN where it is not known.
        roughness : float
            Amplitude of the roughness line, m.

        Returns
        -------
        ndarray of OUTLOOK, shape (1,)
        """
        if not math.isfinite(speed) or self._speed_cell == math.inf:
            return NO_OUTLOOK
        place = speed / self._speed_cell
        number = math.floor(place)
        part = place - number
        cells = (
            _cell(intensity),
            round(spread / _CELL) if intensity > 0.0 else 0,
            _cell(quiet),
            _cell(roughness),
        )
        below, above = self._entry(number, *cells), self._entry(number + 1, *cells)
        found = np.zeros(1, dtype=OUTLOOK)
        with np.errstate(divide='ignore'):
            for name in _QUANTILES:
                found[name] = 1.0 / ((1.0 - part) * below[name] + part * above[name])
        for name in ('rate', 'quiet'):
            found[name] = (1.0 - part) * below[name] + part * above[name]
        return found

    def _entry(self, *cell: float) -> NDArray[np.void]:
        """An entry of the table: OUTLOOK with the reciprocals of its amplitudes."""
        if cell not in self._known:
            if len(self._known) >= _KEPT:
                self._known.clear()
            number, intensity, spread, quiet, roughness = cell
            self._known[cell] = self._compute(
                number * self._speed_cell,
                _middle(intensity) or _NO_NOISE,
                spread * _CELL,
                _middle(quiet),
                _middle(roughness),
            )
            for name in _QUANTILES:
                self._known[cell][name] **= -1.0
        return self._known[cell]

    def _compute(
        self, speed: float, intensity: float, spread: float, quiet: float, roughness: float
    ) -> NDArray[np.void]:
        v_c, d1, d7, d4, d10, d15 = self._forms
        eps = speed / v_c - 1.0
        # Growth rate as a polynomial of A^2. Roughness of amplitude B acts on the mean of the
        # cubic term: A^2 -> A^2 + 2 B^2.
        line = 2.0 * (roughness / self._size) ** 2
        first, second = d1 * eps + d7 * eps**2, d4 + d10 * eps
        first, second = first + line * (second + line * d15), second + 2.0 * line * d15
        first, second, third = (
            part / (self._time_scale * self._size**power)
            for part, power in ((first, 0), (second, 2), (d15, 4))
        )
        noise = intensity * np.exp(spread * self._noise)
        low, high = _ends(first, second, third, intensity, quiet)
        found = np.zeros(1, dtype=OUTLOOK)
        found['quiet'] = np.mean(first < 0.0)
        if np.isnan(high).all():
            for name in _QUANTILES:
                found[name] = math.inf
            return found
        top = float(np.nanmax(high))
        grid = np.geomspace(_LEAST * top, top, _AMPLITUDES)
        risen, rate = _committors(first, second, third, noise, low, high, grid)
        found['rate'] = rate.mean()
        found['decides'] = _deciding(risen.mean(axis=0), grid)
        risen.partition((_OUTSIDE, _PATHS - 1 - _OUTSIDE), axis=0)
        found['latest'] = _deciding(risen[_OUTSIDE], grid)
        found['earliest'] = _deciding(risen[_PATHS - 1 - _OUTSIDE], grid)
        return found


def _cell(value: float) -> float:
    """Cell of the logarithm of a positive number; -inf where there is none."""
    return round(math.log(value) / _CELL) if value > 0.0 else -math.inf


def _middle(cell: float) -> float:
    """Middle of a cell; 0 where there is none."""
    return math.exp(cell * _CELL)


def _ends(first: _F, second: _F, third: _F, intensity: float, quiet: float) -> tuple[_F, _F]:
    """Amplitudes at which it is quiet again, and hunts, m; the latter NaN where it never does."""
    unstable, stable = steady_radii(first, second, third)
    # An unstable branch beyond the limit cycle is not on the way to it.
    edge = np.nan_to_num(np.where(unstable > stable, math.nan, unstable))
    leading = np.where(third != 0.0, third, np.where(second != 0.0, second, first))
    endless = np.isnan(stable) & (leading > 0.0)
    high = np.where(endless, _GROWN * np.fmax(edge, quiet), 0.5 * (edge + stable))
    # Where what is quiet is not known yet, and no branch tells, only the cycle itself counts.
    low = np.full_like(high, quiet) if quiet > 0.0 else np.where(edge > 0.0, 0.5 * edge, high)
    with np.errstate(all='ignore'):
        pull = -(2.0 * second * stable**2 + 4.0 * third * stable**4)
        clear = stable - _WANDERS * np.sqrt(intensity / pull) > low
    high = np.fmax(high, low)
    high[~((clear | endless) & (high > 0.0))] = math.nan
    return low, high


def _deciding(risen: _F, grid: _F) -> _F:
    """Quantiles of a distribution over a grid of amplitudes, m; inf beyond its end."""
    levels = (np.arange(QUANTILES) + 0.5) / QUANTILES
    place = np.exp(np.interp(levels, risen, np.log(grid)))
    return np.where(levels <= risen[-1], place, math.inf)


@compiled
def _committors(
    first: F1, second: F1, third: F1, noise: F1, low: F1, high: F1, grid: F1
) -> tuple[_F, _F]:
    """
    Committor, and escapes per second, of each draw.

    Parameters
    ----------
    first, second, third : ndarray, shape (n,)
        Growth rate by powers of A^2: 1/s, 1/(s m^2), 1/(s m^4).
    noise : ndarray, shape (n,)
        Noise intensity, m^2/s.
    low, high : ndarray, shape (n,)
        Amplitudes at which it is quiet, and on the limit cycle, m; `high` NaN where there is
        none.
    grid : ndarray, shape (m,)
        Amplitudes, m, evenly spaced in their logarithm.

    Returns
    -------
    risen : ndarray, shape (n, m)
    rate : ndarray, shape (n,)
        1/s; the mean time to the cycle is that from amplitude zero.

    References
    ----------
    C. W. Gardiner, Handbook of Stochastic Methods (2004), Eqs. (5.2.159), (5.2.189).
    """
    risen = np.zeros((noise.size, grid.size))
    rate = np.zeros(noise.size)
    exponent = np.empty(grid.size)
    step = math.log(grid[-1] / grid[0]) / (grid.size - 1)
    for k in range(noise.size):
        if math.isnan(high[k]):
            continue
        largest = -math.inf
        for i in range(grid.size):
            a2 = grid[i] * grid[i]
            growth = a2 * (first[k] / 2.0 + a2 * (second[k] / 4.0 + a2 * third[k] / 6.0))
            exponent[i] = -growth / noise[k]
            if low[k] <= grid[i] <= high[k]:
                largest = max(largest, exponent[i])
        total, before = 0.0, 0.0
        time, lasted = 0.0, 0.5 * grid[0] * grid[0] / noise[k]
        for i in range(grid.size):
            density = 0.0
            if low[k] <= grid[i] <= high[k]:
                density = math.exp(max(exponent[i] - largest, -_LARGEST_EXPONENT))
                total += 0.5 * step * (before + density)
            before = density
            risen[k, i] = total
            if i > 0 and grid[i] <= high[k]:
                rise = min(max(exponent[i] - exponent[i - 1], -_STEEPEST), _STEEPEST)
                share = 0.5 * step / noise[k]
                lasted = (lasted + share * grid[i - 1] ** 2) * math.exp(rise)
                lasted = min(lasted + share * grid[i] ** 2, _LONGEST)
                time += step * lasted
        for i in range(grid.size):
            if total > 0.0:
                risen[k, i] /= total
            else:
                risen[k, i] = 1.0 if grid[i] > low[k] else 0.0
        rate[k] = 1.0 / time
    return risen, rate


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
    return bool(not a < SMALLEST * form.fold_amplitude or out['escape_probability'] > 0.5)


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
def _beyond(decides: _F, a: float, s: float) -> float:
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
