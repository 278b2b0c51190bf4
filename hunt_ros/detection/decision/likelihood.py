"""
Likelihood ratios of the amplitude: does it grow, hold or fall, and is it more than noise?

The amplitude is looked at on marks 3/8 of a period apart, over horizons of 2, 4 and 8 marks, and
for the variance of the noise over longer ones as well: what beats moves no further over a longer
time, and is no noise.
An increment over a horizon T is

    y = a(t) - sqrt(a(t - T)^2 + 2 S),

where S is the variance of the noise that drives it: noise alone moves a small amplitude up,
its mean square by 2 S (distribution of Rice, Bell Syst. Tech. J. 24, 1945). Under a growth rate
mu it lies about (exp(mu T) - 1) a(t - T), with a Student distribution, because S is an estimate.

- *growth*: mu > 0 against mu = 0; *fall*: mu < 0 against half the least damping, -s/2;
  *hold*: mu = 0 against -s, or against half the growth rate of the normal form where there is
  one, counted while the motion is more than noise. The ratio of two likelihoods decides as soon
  as any test can (Wald, Ann. Math. Statist. 16, 1945). When the change comes is not known, so
  each is a statistic of Shiryaev and Roberts, R <- (R + 1) exp(l) (Shiryaev, Theory Probab.
  Appl. 8, 1963; Roberts, Technometrics 8, 1966), averaged over growth rates, horizons and their
  interleaved chains: under its null hypothesis its mean is the number of marks, so that it
  reaches the exponential of `rules.evidence` = ln(marks in the time of one false alarm) no more
  often than was asked for. No increment counts for more than a third of that: a kick alone
  decides nothing. What jumps has not held.
- *excess*: minus the logarithm of the chance that noise of damping s has this amplitude:
  (f/2) ln(1 + 2 x / f), which is x for a large f (distribution of Fisher and Snedecor), where
  x = a^2 / (S / (s T)), or less where the tracker itself is not sure of a, and S comes from f
  independent values. S is taken from what forgets a kick (the median below, over the longer
  horizons), and from what knows soon: the mean square, in which nearly all values count and in a
  median four of ten, over each horizon; a cycle from the first sample is said when f is large
  enough. The one that tells most decides. That several are tried is made up for by neighbouring
  marks being one trial: noise that is above x stays there for about 1 / (2 s x),
  several marks.

S is read off by how much the amplitude at the middle of two horizons misses the geometric mean
of those at their ends: steady growth does not enter it, and a median forgets a kick. In the mean
square a miss counts for no more than is usual. What the tracker itself says of its error counts:
from one mark to the next the error of an estimate that is being found out, s(t - T)^2 - s(t)^2,
adds to S (the variance of the step of a Kalman filter); a miss of variance S + e tells
(S / (S + e))^2 times as much of S as one of variance S, and has that weight. The first mark is a
step after the first estimate, which is a guess. What moves further over the shortest horizon than
noise does is a kick, or hunting that grows fast: the misses across it are left out.
What drives the motion at one speed does not at another, least of all at standstill. Nothing is
forgotten for it: an increment has a weight, of which the distance of its speed from that of now
takes away. After a change of the speed there are few degrees of freedom, and what was seen
before counts again where the speed comes back.
Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.decision.rules import Rules
from hunt_ros.detection.health import STANDSTILL_MPS

#: Horizons, marks; the first ones tell growth, the last of these that the noise is known.
#: Growth rates that are tried, 1/s at 2.84 Hz: from doubling in seven seconds to within a period.
HORIZONS = (2, 4, 8, 16, 32, 64)
_TELLING = 3
RATES = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
#: Increments in the variance at hand: this many lengths of their horizon.
_RECENT = 15
#: Marks from which the variance of the quiet motion is learnt, and the weight it has beside
#: what is at hand, in increments.
_MEMORY, _PRIOR = 240.0, 8.0
#: The variance is known from so many horizons before anything is said of what is usual.
_FIRST = 8
#: An amplitude wanders by this part of itself for other reasons than noise: the speed, the flange.
_WANDER = 0.005
#: No miss counts for more than this many times its variance: one in a hundred is larger.
_RARE = 6.6
#: An increment at a speed that differs by this part, and by what a roller at rest is read to
#: have, tells a quarter: S goes with some power of the speed, which is not known to two.
_ANOTHER_SPEED = 0.1
#: Median of chi^2 of one degree of freedom.
_MEDIAN = 0.455
#: S of independent amplitudes of a Rayleigh distribution, in parts of 2 D / damping.
_FORGOTTEN = 1.5 * (2.0 - 0.5 * math.pi)
#: The mean square of the amplitude moves up by this many S.
_RICE = 2.0
#: Noise alone has an amplitude of this excess once in twenty times: from there on it is doubtful.
DOUBT = math.log(20.0)
#: This part of what decides is something: it decides beside other evidence only, and no single
#: increment counts for more.
SOME = 1.0 / 3.0
#: Evidence is not counted beyond this multiple of what decides, so that the next change need
#: not first use it up.
_MOST = 4.0 / 3.0
#: The form is exact to this part: its growth rate may be as near to zero as that.
_EXACT = 0.5

#: A jump less than so many marks after another one is no kick: the noise has risen.
SELDOM = 4 * HORIZONS[_TELLING - 1]
_KEPT = 2 * HORIZONS[-1] + 1
_INCREMENTS = round(2.0 * _MEMORY)

#: What is remembered. Since the last gap: rows since the last mark, marks; the mean speed of those
#: rows, m/s (-1 before one is known); marks since a jump; amplitudes and their standard deviations
#: (m) at the last marks. Of the noise, by horizon: squared misses of the middle, the part of the
#: tracker's error in them (m^2) and their speeds (m/s, inf: none), the last one first; how many
#: marks they are worth, for how many of those it was noise alone; variance of the quiet motion and
#: variance S now (m^2; 0 before it is known), degrees of freedom; S by mean square (m^2), and the
#: sum of the weights in it. The statistics by horizon and chain, and their logarithms.
LIKELIHOOD: np.dtype[np.void] = np.dtype(
    [
        ('rows', np.int64),
        ('marks', np.int64),
        ('speed', np.float64),
        ('smooth', np.int64),
        ('a', np.float64, (_KEPT,)),
        ('s', np.float64, (_KEPT,)),
        ('square', np.float64, (len(HORIZONS), _INCREMENTS)),
        ('error', np.float64, (len(HORIZONS), _INCREMENTS)),
        ('at', np.float64, (len(HORIZONS), _INCREMENTS)),
        ('count', np.float64, (len(HORIZONS),)),
        ('alone', np.int64, (len(HORIZONS),)),
        ('quiet', np.float64, (len(HORIZONS),)),
        ('noise', np.float64, (len(HORIZONS),)),
        ('freedom', np.float64, (len(HORIZONS),)),
        ('moved', np.float64, (len(HORIZONS),)),
        ('known', np.float64, (len(HORIZONS),)),
        ('grows', np.float64, (_TELLING, HORIZONS[_TELLING - 1], len(RATES))),
        ('falls', np.float64, (_TELLING, HORIZONS[_TELLING - 1], len(RATES))),
        ('holds', np.float64, (_TELLING, HORIZONS[_TELLING - 1])),
        ('growth', np.float64),
        ('fall', np.float64),
        ('hold', np.float64),
    ],
    align=True,
)


@compiled_part
def interrupt(memory: Any) -> None:
    """Begin the chain of marks anew: the amplitude is not known. The evidence stands."""
    memory['rows'] = memory['marks'] = 0


@compiled_part
def settled(memory: Any) -> bool:
    """Return True once the noise is known over the longest horizon that tells growth, about."""
    return bool(memory['count'][_TELLING - 1] >= HORIZONS[_TELLING - 1])


@compiled_part
def rows_near(rules: Rules, memory: Any) -> float:
    """Return of how many rows at about this speed the noise is known."""
    return float(memory['count'][_TELLING - 1] * rules.step)


@compiled_part
def intensity(rules: Rules, memory: Any, damping: float) -> tuple[float, float]:
    """
    Return the noise intensity D, m^2/s, and the deviation of its logarithm.

    S = 2 D T where the quiet motion moves freely over T. Damped by `damping` (1/s; NaN: not known)
    it has forgotten after much longer where it was: S is then 1.5 times the variance of a
    Rayleigh distribution of mean square 2 D / damping. The interpolation is right to 3 %.
    Simulated, with filters of no lag and of 0.15 s, D is right to 35 %, and its deviation 0.3 to
    0.45 where all increments are there.
    """
    j = _TELLING - 1
    span = HORIZONS[j] * rules.step * rules.period_s
    free = 0.5 * memory['noise'][j] / span
    if damping > 0.0:
        free *= math.hypot(1.0, damping * span / _FORGOTTEN)
    return free, math.sqrt(4.0 / max(memory['freedom'][j], 1.0))


@compiled_part
def excess(rules: Rules, memory: Any) -> float:
    """Return minus the logarithm of the chance that noise alone has the amplitude at the mark."""
    most = 0.0
    longest = 0
    for j in range(len(HORIZONS)):
        worth = _independent(memory['known'][j], HORIZONS[j])
        most = max(most, _unlikely(rules, memory, j, memory['moved'][j], worth))
        if j < _TELLING and memory['noise'][j] > 0.0:
            longest = j
    for j in range(longest, len(HORIZONS)):
        # Neighbouring increments overlap: half a horizon of them makes up for an independent one.
        freedom = 2.0 / HORIZONS[j] * min(memory['count'][j], 2.0 * _MEMORY)
        if memory['noise'][j] > 0.0:
            most = max(most, _unlikely(rules, memory, j, memory['noise'][j], freedom))
    return most


@compiled_part
def _unlikely(rules: Rules, memory: Any, j: int, noise: float, freedom: float) -> float:
    """Return the same for a variance over a horizon that is known from so many increments."""
    # What noise alone drives, and what the tracker does not know of it: two components.
    horizon = HORIZONS[j] * rules.step * rules.period_s
    size = noise / (rules.least_damping * horizon) + 2.0 * memory['s'][0] ** 2
    if not (size > 0.0 and freedom > 0.0):
        return 0.0
    return float(0.5 * freedom * math.log1p(2.0 * memory['a'][0] ** 2 / (size * freedom)))


@compiled_part
def _independent(count: float, h: int) -> float:
    """
    Return how many independent misses so many over a horizon of h marks are worth.

    Of a random walk, misses k marks apart correlate by r = 1 - 1.5 k/h up to h, k/(2 h) - 1 up
    to 2 h, their squares by r^2; the sum of r^2 over all k is (4 h^2 + 5) / (6 h).
    """
    return float(count * 6.0 * h / (4.0 * h * h + 5.0))


@compiled_part
def watch(
    rules: Rules, memory: Any, v: float, a: float, s: float, drift: float, line: bool
) -> None:
    """
    Take in a row.

    Parameters
    ----------
    rules, memory
        Thresholds, and a record of LIKELIHOOD.
    v : float
        Speed, m/s; NaN: not known, the last one stands.
    a, s : float
        Amplitude and its standard deviation, m.
    drift : float
        Growth rate of the normal form at this speed and amplitude, 1/s; NaN: not known.
    line : bool
        It may be the motion of a line: that it holds is no evidence.
    """
    memory['rows'] += 1
    if v >= 0.0 and memory['speed'] < 0.0:  # the first that is known is that of before, too
        memory['speed'] = v
        for j in range(len(HORIZONS)):
            for k in range(_INCREMENTS):
                memory['at'][j, k] = v if memory['at'][j, k] < 0.0 else memory['at'][j, k]
    elif v >= 0.0:  # the mean since the last mark: a single reading may be noisy
        memory['speed'] += (v - memory['speed']) / memory['rows']
    if memory['rows'] < rules.step:
        return
    memory['rows'] = 0
    for k in range(_KEPT - 1, 0, -1):
        memory['a'][k] = memory['a'][k - 1]
        memory['s'][k] = memory['s'][k - 1]
    memory['a'][0] = a
    memory['s'][0] = s
    memory['marks'] += 1
    memory['smooth'] += 1
    jumps = _jumps(rules, memory)
    if jumps and memory['smooth'] >= SELDOM:
        memory['smooth'] = 0
    noise_alone = excess(rules, memory) < SOME * rules.evidence
    for j in range(len(HORIZONS)):
        reach = min(memory['marks'], memory['smooth'])
        if reach > 2 * HORIZONS[j] and memory['marks'] % _each(HORIZONS[j]) == 0:
            _learn_noise(memory, j, noise_alone)
    # The filter smooths: over a longer horizon more of the noise shows, once there is a value.
    for j in range(_TELLING):
        for i in range(j + 1, _TELLING):
            if _independent(memory['known'][i], HORIZONS[i]) >= 1.0:
                part = HORIZONS[j] / HORIZONS[i]
                memory['noise'][j] = max(memory['noise'][j], part * memory['noise'][i])
                memory['moved'][j] = max(memory['moved'][j], part * memory['moved'][i])
    count = excess(rules, memory) >= SOME * rules.evidence and not line
    count &= not jumps  # that does not hold
    if jumps and memory['a'][0] > memory['a'][HORIZONS[0]]:
        memory['falls'][:] = 0.0  # nor does it fall on as it did before
    for j in range(_TELLING):
        if memory['marks'] > 2 * HORIZONS[j] and memory['noise'][j] > 0.0:
            _compare(rules, memory, j, drift, count)
    if not count:
        memory['holds'][:] = 0.0
    _sum_up(rules, memory)


@compiled_part
def _jumps(rules: Rules, memory: Any) -> bool:
    """Return True where the amplitude has moved further, over the shortest horizon, than noise."""
    if memory['marks'] <= 2 * HORIZONS[0] or not memory['noise'][0] > 0.0:
        return False
    # At first what is known of the noise is how many misses there are, and their mean square.
    variance = max(memory['noise'][0], memory['moved'][0])
    variance += _found_out(memory['s'][HORIZONS[0]], memory['s'][0])
    y = memory['a'][0] - math.sqrt(memory['a'][HORIZONS[0]] ** 2 + _RICE * variance)
    freedom = min(memory['freedom'][0], _independent(memory['count'][0], HORIZONS[0]))
    return bool(_student(y, variance, freedom) < -rules.evidence)


@compiled_part
def _learn_noise(memory: Any, j: int, noise_alone: bool) -> None:
    """Estimate S over a horizon anew; what is noise alone is learnt as the quiet motion."""
    h = HORIZONS[j]
    each = _each(h)
    a, s = memory['a'], memory['s']
    square, error, at = memory['square'][j], memory['error'][j], memory['at'][j]
    for k in range(square.size - 1, 0, -1):
        square[k] = square[k - 1]
        error[k] = error[k - 1]
        at[k] = at[k - 1]
    square[0] = 2.0 * (math.sqrt(a[0] * a[2 * h]) - a[h]) ** 2
    found_out = _found_out(s[h], s[0]) + _found_out(s[2 * h], s[h])
    error[0] = 0.5 * found_out
    at[0] = memory['speed']
    near = _near(at, memory['speed'])
    memory['count'][j] = count = each * near.sum()
    now = near[: _RECENT * h // each]
    last, off = square[: now.size], error[: now.size]
    first = count <= _FIRST * h
    if first:
        quiet = _median(last, now) / _MEDIAN
        for _ in range(4):  # the error of the tracker is part of it: solved for the rest
            if quiet > 0.0:
                quiet *= _median(last / (quiet + off), now) / _MEDIAN
        # What was noise alone over a horizon is not raised by what is not, a kick above all. What
        # dies out smoothly from the start shows too little of the noise: it is no such value.
        memory['alone'][j] += each * (noise_alone and memory['quiet'][j] > 0.0)
        if noise_alone or memory['alone'][j] < h or quiet < memory['quiet'][j]:
            memory['quiet'][j] = quiet
    base = memory['quiet'][j] + (_WANDER * a[0]) ** 2
    if not base > 0.0:
        memory['noise'][j] = 0.0
        return
    ratio = _median(last / (base + off), now) / _MEDIAN
    if noise_alone and not first:
        memory['quiet'][j] *= 1.0 + (min(ratio, 4.0) - 1.0) * each / _MEMORY
    weight = each * now.sum() / h
    memory['noise'][j] = base * (_PRIOR + weight * ratio) / (_PRIOR + weight)
    memory['freedom'][j] = _PRIOR + weight
    share = near * (memory['noise'][j] / (memory['noise'][j] + error)) ** 2
    usual = np.minimum(square, _RARE * (memory['noise'][j] + error))
    memory['known'][j] = each * np.sum(share)
    memory['moved'][j] = np.sum(share * usual) / max(np.sum(share), 1e-300)


@compiled_part
def _each(h: int) -> int:
    """Return of how many increments over h marks one is taken: the others differ little."""
    return max(h // HORIZONS[_TELLING - 1], 1)


@compiled_part
def _near(at: Any, v: float) -> Any:
    """Return how much increments at speeds, m/s, tell of the noise at another one, v."""
    return 1.0 / (1.0 + ((at - v) / (_ANOTHER_SPEED * v + STANDSTILL_MPS)) ** 2) ** 2


@compiled_part
def _median(values: Any, weights: Any) -> float:
    """Return the weighted median."""
    order = np.argsort(values)
    left = 0.5 * weights.sum()
    for k in order:
        left -= weights[k]
        if left <= 0.0:
            return float(values[k])
    return 0.0


@compiled_part
def _found_out(before: float, after: float) -> float:
    """Return the variance of a step of the estimate that comes from its own error, m^2."""
    return max(before * before - after * after, 0.0)


@compiled_part
def _student(x: float, variance: float, freedom: float) -> float:
    """Return the logarithm of the density of Student's distribution, but for a constant."""
    return -0.5 * (freedom + 1.0) * math.log1p(x * x / (variance * freedom))


@compiled_part
def _compare(rules: Rules, memory: Any, j: int, drift: float, count: bool) -> None:
    """Advance the statistics of one horizon."""
    h = HORIZONS[j]
    a0, freedom = memory['a'][h], memory['freedom'][j]
    span = h * rules.step * rules.period_s
    # Whatever was smoothed away before: over the longest, none is known better than its end.
    unsure = memory['s'][0] ** 2 * h / HORIZONS[_TELLING - 1]
    variance = max(memory['noise'][j], unsure) + _found_out(memory['s'][h], memory['s'][0])
    y = memory['a'][0] - math.sqrt(a0 * a0 + _RICE * variance)
    chain = memory['marks'] % h
    still = _student(y, variance, freedom)
    slow = _student(_off(y, a0, -0.5 * rules.least_damping * span), variance, freedom)
    for i in range(len(RATES)):
        rate = RATES[i] * rules.faster
        up = _student(_off(y, a0, rate * span), variance, freedom) - still
        memory['grows'][j, chain, i] = _next(rules, memory['grows'][j, chain, i], up)
        down = _student(_off(y, a0, -rate * span), variance, freedom) - slow
        memory['falls'][j, chain, i] = _next(rules, memory['falls'][j, chain, i], down)
    if count:
        null = -rules.least_damping if math.isnan(drift) else _EXACT * drift
        gain = still - _student(_off(y, a0, null * span), variance, freedom)
        memory['holds'][j, chain] = _next(rules, memory['holds'][j, chain], gain)


@compiled_part
def _off(y: float, a0: float, growth: float) -> float:
    """Return how far an increment lies from that of a growth by exp(growth), m."""
    return y - a0 * (math.exp(min(growth, 50.0)) - 1.0)


@compiled_part
def _next(rules: Rules, statistic: float, gain: float) -> float:
    """Advance a Shiryaev-Roberts statistic by one log likelihood ratio."""
    most = math.exp(_MOST * rules.evidence)
    return min((statistic + 1.0) * math.exp(min(gain, SOME * rules.evidence)), most)


@compiled_part
def _sum_up(rules: Rules, memory: Any) -> None:
    """Fill in the logarithms of the mean statistics."""
    grows = falls = holds = 0.0
    chains = 0
    for j in range(_TELLING):
        for chain in range(HORIZONS[j]):
            chains += 1
            holds += memory['holds'][j, chain]
            for i in range(len(RATES)):
                grows += memory['grows'][j, chain, i]
                falls += memory['falls'][j, chain, i]
    memory['growth'] = math.log(max(grows / (chains * len(RATES)), 1e-300))
    memory['fall'] = math.log(max(falls / (chains * len(RATES)), 1e-300))
    memory['hold'] = math.log(max(holds / chains, 1e-300))
