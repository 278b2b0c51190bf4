"""
What the amplitude does: damped, growing, or in a cycle; one Bayesian model that switches.

From one mark to the next, 3/4 of a period later, the phasor of the motion obeys one of a grid of
laws, under noise of an intensity q, another grid:

- *damped* or *growing* at a rate g: a step of a complex Ornstein-Uhlenbeck process, by which
  |z| has the distribution of Rice (Bell Syst. Tech. J. 24, 1945), about exp(g T) |z|; each rate
  stands for those as far as half way to the next;
- a *cycle*: |z| returns at a rate k to an amplitude of its own, which is not known: normal, given
  each k and q, with a mean and a variance (Kalman). What is not clear of the noise that drives it
  is none: noise alone returns to its mean.

The weight of each hypothesis is its posterior probability, mixed at each mark as the laws change
(Hamilton, Econometrica 57, 1989; the amplitudes of cycles by their moments: Blom and Bar-Shalom,
IEEE Trans. Autom. Control 33, 1988). What is damped begins to hunt as often as one false alarm is
allowed to come (Shiryaev, Theory Probab. Appl. 8, 1963), and more often while the speed changes,
by which cycles end and the noise walks as well. A kick is an amplitude that is as likely anywhere
else: what lands clear of the noise hunts in one of five cases, and hunts on where it did and went
further.

An amplitude that is not clear of its own error may refute that it hunts, but does not support it:
the filter that has no motion to follow moves smoothly. Called by the kernel of the decisions, row
by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.decision.rules import Rules
from hunt_ros.detection.health import STANDSTILL_MPS

#: Rates, 1/s at 2.84 Hz: of damping (none less than the least; the first may be that of the form),
#: growth, return.
RATES = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 0.3, 1.0, 3.0, 8.0)
_GROWING, _CYCLES, _LAWS = 7, 13, len(RATES)
#: Intensities, m^2/s or rad^2/s: the least, and how many, each twice the last.
_LEAST, _NOISES = 1e-20, 66
#: Chance at a mark: of another rate of the same kind; that growth ends in a cycle; that the noise
#: doubles, or halves; of a kick; that what it moved hunts; and that it hunts at the start. That
#: hunting ends: at a mark, and for each relative change of the speed; that it begins, for that.
_WALK, _SETTLES, _MOVES, _KICK, _LANDS, BEGINS = 0.03, 0.1, 0.003, 0.01, 0.2, 0.003
_ENDS, _ENDS_AT, _BEGINS_AT = 1e-6, 0.3, 0.03
#: Largest chance of any of them.
_MOST = 0.3
#: The noise doubles within a change of the speed of a third; a cycle follows it fourfold.
_AT_SPEED, _FOLLOWS = 3.0, 4.0
#: Parts of itself by which an amplitude wanders from other causes than noise, in which that of a
#: cycle is known at first, and by which it walks.
_WANDER, _UNKNOWN, _DRIFT = 0.005, 0.3, 1e-3
#: What hunts is clear of what noise alone makes, and of the error of the filter, by this factor.
_CLEAR = 3.0
#: What the filter knows, it has found out over eight marks of 3/8 of a period.
_FOUND = 0.125
#: Deviation of the rate of a law, relative: it stands for all as far as half way to the next.
_BAND = 0.2
#: Marks after which the noise is known, about; and over which the speed is followed.
_FIRST = 12
#: They tell nothing of the noise at a speed that differs by this part.
_ANOTHER_SPEED = 0.1
#: A kick lands within e^2.
_ANYWHERE = 2.0
#: What is remembered: rows since the last mark, marks, and whether the next begins anew; how
#: likely it hunts at the start; amplitude and its deviation at the mark, m; mean speed since then
#: and at the mark, that of a while, m/s, and how far it is off that, relative; weights; means (m)
#: and variances of the amplitudes of cycles; posterior probabilities of growth and of a cycle. Of
#: the noise by what is damped: mean square of the amplitude that it alone makes, m^2, and q.
SWITCHING: np.dtype[np.void] = np.dtype(
    [
        ('rows', np.int64),
        ('marks', np.int64),
        ('begins', np.bool_),
        ('prior', np.float64),
        ('a', np.float64),
        ('s', np.float64),
        ('mean', np.float64),
        ('speed', np.float64),
        ('at', np.float64),
        ('off', np.float64),
        ('weight', np.float64, (_LAWS, _NOISES)),
        ('centre', np.float64, (_LAWS, _NOISES)),
        ('variance', np.float64, (_LAWS, _NOISES)),
        ('grows', np.float64),
        ('cycles', np.float64),
        ('alone', np.float64),
        ('driven', np.float64),
    ],
    align=True,
)


@compiled_part
def hunts(memory: Any) -> float:
    """Return the posterior probability of hunting."""
    return float(memory['grows'] + memory['cycles'])


@compiled_part
def told(memory: Any) -> bool:
    """Return True once there are marks enough to tell noise from hunting."""
    return bool(memory['marks'] >= _FIRST)


@compiled_part
def settled(memory: Any) -> bool:
    """Return True once the noise at this speed is known, about."""
    return bool(told(memory) and memory['off'] < _ANOTHER_SPEED)


@compiled_part
def watch(
    rules: Rules, memory: Any, v: float, a: float, s: float, drift: float, basin: bool, line: bool
) -> None:
    """
    Take in a row.

    Parameters
    ----------
    rules, memory
        Thresholds, and a record of SWITCHING.
    v : float
        Speed, m/s; NaN: not known.
    a, s : float
        Amplitude and its standard deviation, m.
    drift : float
        Growth rate of the normal form at this speed and amplitude, 1/s; NaN: not known.
    basin : bool
        There may be a quiet state: the normal form has no growth from zero at this speed.
    line : bool
        It may be the motion of a line, which tells nothing.
    """
    memory['rows'] += 1
    if v >= 0.0:  # the mean since the last mark: a single reading may be noisy
        mean = v if math.isnan(memory['mean']) else memory['mean']
        memory['mean'] = mean + (v - mean) / memory['rows']
    if line or not math.isfinite(a + s):
        memory['rows'], memory['begins'] = 0, True
    if memory['rows'] < rules.step:
        return
    memory['rows'] = 0
    a, clear = max(a, 1e-15), a > _CLEAR * math.sqrt(2.0) * s
    turned, risen = _follow(memory)
    if memory['marks'] == 0:
        _begin(rules, memory, a, s, memory['prior'] if basin else 1.0)
    elif not memory['begins']:
        if s > _CLEAR * memory['s'] and not clear:
            # How far it was kicked is not known yet; it is if the error stays as large.
            memory['s'] *= 2.0
            return
        hazard = max(rules.hazard, BEGINS if drift > 0.0 else 0.0) + _BEGINS_AT * risen
        _mix(memory, turned, min(hazard, _MOST))
        _weigh(rules, memory, a, s, clear, drift if drift < 0.0 else -rules.least_damping)
    memory['marks'] += 1
    memory['a'], memory['s'], memory['begins'] = a, s, False
    _sum_up(rules, memory, s)


@compiled_part
def _follow(memory: Any) -> tuple[float, float]:
    """Take in the speed of a mark; return its relative change, and that of its mean of a while."""
    v, last, before = memory['mean'], memory['speed'], memory['at']
    memory['mean'] = math.nan
    if math.isnan(v):
        return 0.0, 0.0
    memory['speed'] = v
    if math.isnan(last):
        memory['at'] = v
        return 0.0, 0.0
    # What a roller at rest is read to have is no change.
    size = 0.5 * (v + last) + STANDSTILL_MPS
    turned = abs(v - last) / size
    if v < STANDSTILL_MPS:  # what is seen there is of no other speed
        memory['at'], memory['off'] = v, 0.0
        return turned, 0.0
    memory['at'] = before + (v - before) / _FIRST
    memory['off'] = abs(v - before) / size
    return turned, abs(memory['at'] - before) / size


@compiled_part
def _noise(j: int) -> float:
    return float(_LEAST * 2.0**j)


@compiled_part
def _rate(rules: Rules, h: int) -> float:
    rate = RATES[h] * rules.faster
    return float(max(rate, rules.least_damping) if h < _GROWING else rate)


@compiled_part
def _begin(rules: Rules, memory: Any, a: float, s: float, prior: float) -> None:
    """Weigh the first amplitude: damped, it has the distribution of noise alone."""
    weight = memory['weight']
    for h in range(_LAWS):
        for j in range(_NOISES):
            memory['centre'][h, j] = a
            memory['variance'][h, j] = (_UNKNOWN * a) ** 2
            if h < _GROWING:
                size = 0.5 * _noise(j) / _rate(rules, h) + s * s
                weight[h, j] = a * a / size * math.exp(-0.5 * a * a / size) / _GROWING
            else:
                clear = a * a / (a * a + 2.0 * s * s)
                weight[h, j] = clear * prior / (_GROWING * (_LAWS - _GROWING))
    weight /= weight.sum()


@compiled_part
def _mix(memory: Any, turned: float, hazard: float) -> None:
    """Let the laws and the noise change from one mark to the next."""
    w, centre, variance = memory['weight'], memory['centre'], memory['variance']
    a, ends = memory['a'], min(_ENDS + _ENDS_AT * turned, _MOST)
    for j in range(_NOISES):
        damped = w[:_GROWING, j].sum()
        growing = w[_GROWING:_CYCLES, j].sum()
        cycles = max(w[_CYCLES:, j].sum(), 1e-300)
        mean = (w[_CYCLES:, j] * centre[_CYCLES:, j]).sum() / cycles
        off = variance[_CYCLES:, j] + (centre[_CYCLES:, j] - mean) ** 2
        spread = (w[_CYCLES:, j] * off).sum() / cycles
        for h in range(_LAWS):
            if h < _GROWING:
                w[h, j] *= 1.0 - _WALK - hazard
                w[h, j] += (_WALK * damped + ends * (growing + cycles)) / _GROWING
            elif h < _CYCLES:
                w[h, j] *= 1.0 - _WALK - ends - _SETTLES
                w[h, j] += (_WALK * growing + 0.5 * hazard * damped + ends * cycles) / (
                    _CYCLES - _GROWING
                )
            else:
                old = w[h, j] * (1.0 - _WALK - 2.0 * ends)
                new = (_SETTLES * growing + 0.5 * hazard * damped) / (_LAWS - _CYCLES)
                other = _WALK * cycles / (_LAWS - _CYCLES)
                total = old + new + other
                m = (old * centre[h, j] + new * a + other * mean) / total
                var = old * (variance[h, j] + (centre[h, j] - m) ** 2)
                var += new * ((_UNKNOWN * a) ** 2 + (a - m) ** 2)
                var += other * (spread + (mean - m) ** 2)
                w[h, j], centre[h, j] = total, m
                variance[h, j] = var / total + ((_DRIFT + _FOLLOWS * turned) * a) ** 2
    share = min(_MOVES + _AT_SPEED * turned, _MOST)
    jump = min(turned * turned, 1.0 - 2.0 * share)
    for h in range(_LAWS):
        before, mean = w[h, 0], jump * w[h].mean()
        for j in range(_NOISES):
            now, after = w[h, j], w[h, min(j + 1, _NOISES - 1)]
            w[h, j] = (1.0 - 2.0 * share - jump) * now + share * (before + after) + mean
            before = now


@compiled_part
def _weigh(rules: Rules, memory: Any, a: float, s: float, clear: bool, least: float) -> None:
    """Weigh each hypothesis by the amplitude at the mark, which may have been kicked there."""
    w, centre, variance = memory['weight'], memory['centre'], memory['variance']
    a0, s0 = memory['a'], memory['s']
    span = rules.step * rules.period_s
    # What is not clear of the error of the filter is known no better than to that.
    found = _FOUND * s * s if a > _CLEAR * s else s * s
    extra = max(s0 * s0 - s * s, found) + (_WANDER * a) ** 2
    kick = _KICK * math.exp(-_ANYWHERE) / a
    known = clear and told(memory)
    lands = _LANDS if known and a > _CLEAR * math.sqrt(memory['alone']) else 0.0
    # What hunts and is kicked further goes on.
    stays = 1.0 if clear and a > a0 else 0.0
    for j in range(_NOISES):
        q, damped, usual = _noise(j), 1e-300, 0.0
        kicked = kick * (w[:_GROWING, j].sum() + (1.0 - stays) * w[_GROWING:, j].sum())
        for h in range(_LAWS):
            rate = least if h == 0 else _rate(rules, h) * (-1.0 if h < _GROWING else 1.0)
            keep = math.exp(-rate * span) if h >= _CYCLES else math.exp(rate * span)
            life = span if abs(rate) * span < 1e-6 else (keep * keep - 1.0) / (2.0 * rate)
            if h < _CYCLES:
                v = q * life + extra + (_BAND * rate * span * a0 * keep) ** 2
                x = a * a0 * keep / v
                chance = a / v * math.exp(-0.5 * (a - a0 * keep) ** 2 / v + _log_i0(x))
            else:
                p = variance[h, j]
                v = q * span + extra + (1.0 - keep) ** 2 * p
                miss = a - centre[h, j] - (a0 - centre[h, j]) * keep
                chance = math.exp(-0.5 * miss * miss / v) / math.sqrt(2.0 * math.pi * v)
                gain = p * (1.0 - keep) / v
                centre[h, j] += gain * miss
                variance[h, j] = p * (1.0 - gain * (1.0 - keep))
                if centre[h, j] < _CLEAR * math.sqrt(q * span / (1.0 - keep * keep)):
                    chance = 0.0
            if h < _GROWING:
                damped += w[h, j]
                usual += w[h, j] * chance
                hits = kicked * (1.0 - lands) / _GROWING
            else:
                if not clear:
                    chance = min(chance, usual / damped)
                kinds = _CYCLES - _GROWING if h < _CYCLES else _LAWS - _CYCLES
                chance += kick * stays
                hits = 0.5 * kicked * lands / kinds
            w[h, j] = w[h, j] * chance + hits
            if h >= _CYCLES and hits > 0.0:
                new, off = hits / w[h, j], a - centre[h, j]
                centre[h, j] += new * off
                variance[h, j] += new * ((_UNKNOWN * a) ** 2 - variance[h, j])
                variance[h, j] += new * (1.0 - new) * off * off
    total = w.sum()
    for h in range(_LAWS):
        for j in range(_NOISES):
            w[h, j] = max(w[h, j] / total, 1e-30)


@compiled_part
def _log_i0(x: float) -> float:
    """Return ln I0(x) - x, x >= 0, of the Bessel function (Abramowitz and Stegun 9.8.1, 9.8.2)."""
    if x < 3.75:
        q = (x / 3.75) ** 2
        sum_ = q * (1.2067492 + q * (0.2659732 + q * (0.0360768 + q * 0.0045813)))
        return math.log(1.0 + q * (3.5156229 + q * (3.0899424 + sum_))) - x
    q = 3.75 / x
    sum_ = q * (-0.02057706 + q * (0.02635537 + q * (-0.01647633 + q * 0.00392377)))
    sum_ = q * (0.00225319 + q * (-0.00157565 + q * (0.00916281 + sum_)))
    return math.log((0.39894228 + q * 0.01328592 + q * sum_) / math.sqrt(x))


@compiled_part
def _sum_up(rules: Rules, memory: Any, s: float) -> None:
    """Fill in what the decisions ask for."""
    w = memory['weight']
    memory['grows'] = w[_GROWING:_CYCLES].sum()
    memory['cycles'] = w[_CYCLES:].sum()
    damped = size = driven = 0.0
    for h in range(_GROWING):
        for j in range(_NOISES):
            damped += w[h, j]
            size += w[h, j] * math.log(_noise(j) / _rate(rules, h) + 2.0 * s * s)
            driven += w[h, j] * math.log(_noise(j))
    memory['alone'], memory['driven'] = math.exp(size / damped), math.exp(driven / damped)
