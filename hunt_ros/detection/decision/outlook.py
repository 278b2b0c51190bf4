"""
How the motion will end, under noise, by a form that is known with an uncertainty.

Averaged over a cycle the amplitude obeys

    dA = (A s(A) + D / A) dt + sqrt(2 D) dW

with s the growth rate of Eq. (24) and D the noise intensity.
The chance that it reaches the limit cycle before it is quiet again, the committor, is the ratio
of two scale functions, with the density exp(-int s A dA / D) / A. It is averaged over draws of
the form, and of D, and grows with the amplitude from 0 to the share of the draws that have a
limit cycle: it is the distribution of the amplitude at which the outcome is decided. A table
keeps quantiles of that, so that a row with a Gaussian amplitude takes the mean of a few normal
distributions; and of the committors that 2.5 % of the draws exceed and fall short of, which are
its interval. Nothing here asks whether there is a fold or a quiet state: draws differ in it.

The tables are made in Python; what follows from them for a row is `chance_beyond`, part of the
kernel of the decisions.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F1, compiled, compiled_part
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm, steady_radii

_F = NDArray[np.float64]

#: Draws of the form; those of its branches alone, which cost little.
_PATHS, _DRAWS = 64, 200
#: Quantiles of the deciding amplitude that are kept.
QUANTILES = 64
#: Amplitudes at which the committor is computed, from this part of the limit cycle on at least.
_AMPLITUDES, _LEAST = 384, 1e-3
#: A change of the speed that asks for another outlook, relative to v_c, or one of the roughness
#: that does as much; and the width of the cells in which one is taken as constant: of the speed,
#: relative as well; of the spread of the noise intensity, and of the logarithms of this and of
#: the quiet amplitude.
_SPEED_STEP, _SPEED_CELL, _CELL = 0.0025, 0.0005, 0.2
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
#: Horizon of the outlook, s: the next minute, as its name says; on the clock, not in periods.
_OUTLOOK_S = 60.0
#: Standard deviations beyond which a normal distribution is 0 or 1.
_SETTLED = 4.0

#: What the kernel of the decisions reads: quantiles of the amplitude at which the outcome is
#: decided (m; inf: nowhere), and of those of the draws that escape latest and earliest; the
#: chance to escape from the quiet state within a minute; the share of the draws that have such a
#: state; mean and standard deviation over the draws of the unstable amplitude, m.
OUTLOOK: np.dtype[np.void] = np.dtype(
    [
        ('decides', np.float64, (QUANTILES,)),
        ('latest', np.float64, (QUANTILES,)),
        ('earliest', np.float64, (QUANTILES,)),
        ('next_minute', np.float64),
        ('quiet', np.float64),
        ('unstable_mean', np.float64),
        ('unstable_std', np.float64),
    ],
    align=True,
)

#: Nothing is known.
NO_OUTLOOK: NDArray[np.void] = np.full(OUTLOOK.itemsize // 8, math.nan).view(OUTLOOK)


class OutlookTable:
    """
    Outlooks by speed, noise, quiet amplitude and roughness, computed when first asked for.

    All are rounded to cells first: the answer depends on what is asked alone, not on what was
    asked before.

    Parameters
    ----------
    identified : IdentifiedNormalForm or None
        None: there is no outlook, NaN throughout.
    """

    def __init__(self, identified: IdentifiedNormalForm | None) -> None:
        self._known: dict[tuple[float, ...], NDArray[np.void]] = {}
        self._speed_cell = math.inf
        if identified is None:
            return
        self._speed_cell = _SPEED_CELL * identified.form.critical_speed
        own, *others = map(_numbers, (identified.form, *_drawn(identified, _PATHS)))
        self._draws = np.array([_numbers(form) for form in _drawn(identified, _DRAWS)]).T
        forms = np.array(others)
        if not len(identified.sample):
            # With its mirror image to each, the draws have the mean of the form.
            half = forms[: _PATHS // 2]
            forms = np.concatenate([half, 2.0 * own - half])
        # Each draw has its own noise; an exact form is drawn as often as the noise is.
        self._forms = np.resize(forms[forms[:, 0] > 0.0], (_PATHS, own.size)).T
        self._size = 2.0 * identified.form.length_scale
        self._time_scale = identified.form.time_scale
        self._line_cell = _SPEED_STEP * identified.form.D1 / max(abs(identified.form.D4), 1e-300)
        normal = NormalDist()
        levels = [normal.inv_cdf((k + 0.5) / _PATHS) for k in range(_PATHS)]
        self._noise = np.random.default_rng(0).permutation(levels)
        # Before the form is in force: no row of a live run waits for machine code.
        self.at(1.02 * identified.form.critical_speed, math.nan, 0.0, math.nan, 0.0)

    def differ(self, speeds: _F, speed: float) -> NDArray[np.bool_]:
        """Return True for each speed, m/s, whose outlook is another one than that of `speed`."""
        step = self._speed_cell * (_SPEED_STEP / _SPEED_CELL)
        return np.asarray((speeds != speed) & ~(np.abs(speeds - speed) <= step))

    def at(
        self, speed: float, intensity: float, spread: float, quiet: float, roughness: float
    ) -> NDArray[np.void]:
        """
        Look up, or compute.

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
        spread = round(spread / _CELL) if intensity > 0.0 else 0
        share = min(roughness / self._size, _LARGEST_EXPONENT)
        line = round(2.0 * share**2 / self._line_cell)
        cell = round(speed / self._speed_cell), line, spread, _cell(intensity), _cell(quiet)
        if cell not in self._known:
            if len(self._known) >= _KEPT:
                self._known.clear()
            self._known[cell] = self._compute(
                cell[0] * self._speed_cell,
                cell[1] * self._line_cell,
                cell[2] * _CELL,
                *map(_middle, cell[3:]),
            )
        return self._known[cell]

    def _compute(
        self, speed: float, line: float, spread: float, intensity: float, quiet: float
    ) -> NDArray[np.void]:
        intensity = intensity or _NO_NOISE
        first, second, third = self._law(self._forms, speed, line)
        noise = intensity * np.exp(spread * self._noise)
        low, high = _ends(first, second, third, intensity, quiet)
        found = np.zeros(1, dtype=OUTLOOK)
        with np.errstate(all='ignore'):
            unstable, _ = steady_radii(*self._law(self._draws, speed, line))
        exists = unstable[np.isfinite(unstable)]
        found['unstable_mean'] = exists.mean() if exists.size else math.nan
        found['unstable_std'] = exists.std() if exists.size else 0.0
        found['quiet'] = np.mean(first < 0.0)
        if np.isnan(high).all():
            for name in ('decides', 'latest', 'earliest'):
                found[name] = math.inf
            return found
        # Where growth has no end in some draws, quiet may lie far below the cycle of others.
        top, least = float(np.nanmax(high)), float(low[np.isfinite(high)].min())
        grid = np.geomspace(min(_LEAST * top, 0.5 * least), top, _AMPLITUDES)
        risen, rate = _committors(first, second, third, noise, low, high, grid)
        # Of draws that differ: the mean of their rates would be that of the worst one.
        found['next_minute'] = -np.expm1(-_OUTLOOK_S * rate).mean()
        found['decides'] = _deciding(risen.mean(axis=0), grid)
        risen.partition((_OUTSIDE, _PATHS - 1 - _OUTSIDE), axis=0)
        found['latest'] = _deciding(risen[_OUTSIDE], grid)
        found['earliest'] = _deciding(risen[_PATHS - 1 - _OUTSIDE], grid)
        return found

    def _law(self, forms: _F, speed: float, line: float) -> list[_F]:
        """
        Return the growth rate of forms at a speed as a polynomial of A^2, its three coefficients.

        Roughness of amplitude B acts on the mean of the cubic term: A^2 -> A^2 + 2 B^2; `line`
        is that part, in the unit of the form.
        """
        v_c, d1, d7, d4, d10, d15 = forms
        eps = speed / v_c - 1.0
        first, second = d1 * eps + d7 * eps**2, d4 + d10 * eps
        first, second = first + line * (second + line * d15), second + 2.0 * line * d15
        scales = [self._time_scale * self._size**power for power in (0, 2, 4)]
        return [part / scale for part, scale in zip((first, second, d15), scales, strict=True)]


def _drawn(identified: IdentifiedNormalForm, count: int) -> list[NormalForm]:
    """Draws of the form; the form itself where it is taken as exact."""
    return identified.draws(count) if identified.covariance.any() else [identified.form]


def _numbers(form: NormalForm) -> _F:
    """Return what `OutlookTable._law` needs of a form."""
    names = ('critical_speed', 'D1', 'D7', 'D4', 'D10', 'D15')
    return np.array([getattr(form, name) for name in names])


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
def chance_beyond(decides: _F, a: float, s: float) -> float:
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
