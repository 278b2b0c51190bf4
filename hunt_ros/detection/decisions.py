"""
The decisions, row by row: noise floor, margin, probability of escape, region, state, alarm.

One compiled kernel with its memory in an array, so that an hour of rows costs a
fraction of a second and the live detector runs the very same code on one row.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled
from hunt_ros.detection.basin import FormNumbers
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.regions import held, region_of, switched

_F = NDArray[np.float64]

# Memory.
(
    M_FLOOR2,  # mean square of the quiet amplitude, m^2
    M_FLOOR_ROWS,  # rows it was learnt from
    M_NOISE,  # noise intensity D, m^2/s
    M_NOISE_ROWS,
    M_RECENT,  # mean square of the amplitude over a few seconds, m^2
    M_FAST,  # running means of the well-known amplitude, m, over _FAST_S and _SLOW_S,
    M_SLOW,
    M_SQUARE,  # and of its square over _SLOW_S, m^2
    M_LONG,  # mean, m, and mean square over _LONG_S, m^2
    M_LONG_SQUARE,
    M_STD,  # and of its standard deviation, m
    M_SURE_ROWS,  # rows they were taken from
    M_ROWS,  # rows with an estimate since the start
    M_REFERENCE,  # amplitude in the limit cycle, m
    M_REGION,
    M_REGION_WAITED,
    M_STATE,
    M_STATE_WANTED,
    M_STATE_WAITED,
    M_DISTURBED,
    M_ESCAPING,
    M_GROWING,
    M_MARGIN_LOW,
    M_MARGIN_WAITED,
    M_DISAGREE,
    M_DISAGREE_WAITED,
    M_ALARM,
    M_ACKNOWLEDGED,
    M_EDGE_CENTRE,
    M_EDGE_WIDTH,
    M_EDGE_RATE,
    N_MEMORY,
) = range(32)

# Columns of the numbers given out.
(
    O_FLOOR,
    O_NOISE,
    O_UNSTABLE,
    O_UNSTABLE_STD,
    O_STABLE,
    O_MARGIN,
    O_MARGIN_LOW,
    O_MARGIN_HIGH,
    O_PROBABILITY,
    O_OUTLOOK,
    O_TIME,
    N_OUTPUT,
) = range(12)

# Doubts: each makes the level WARN at least.
D_MARGIN, D_DISAGREE, D_NO_FORM, D_NO_SPEED, D_SETTLING, D_NO_ESTIMATE = 1, 2, 4, 8, 16, 32
D_DECAYING, D_HYSTERESIS, D_UNSTABLE = 64, 128, 256

_QUIET, _DISTURBED, _ESCAPING, _LIMIT_CYCLE, _DECAYING = 0, 1, 2, 3, 4

#: Rows of the quiet motion, s, from which the first noise floor is taken.
_SETTLE_S = 2.0
#: A motion that is large from the start, and not steady, is given this long, s, before it is
#: taken for the quiet motion of a lively rig.
_PATIENCE_S = 5.0
#: The floor follows at once where the recent mean square lies below this part of it.
_FALLEN = 0.1
_RECENT_S = 3.0
#: Means of the amplitude whose difference tells its trend.
_FAST_S, _SLOW_S = 0.5, 1.5
#: Steady over this time constant is a limit cycle, however large the noise floor seems to be.
#: Narrow-band noise of a damping as low as 0.08 1/s does not keep its amplitude within
#: `_VERY_STEADY` for 3 s once in 24 hours (simulated).
_LONG_S = 4.0
_VERY_STEADY = 0.08
#: The floor rises this much more slowly on a motion that stands clear of the sensor noise: it
#: may be hunting on its way up.
_WARY = 0.25
#: An amplitude is well known when its standard deviation is below this part of it.
_SURE = 0.1
#: A floor learnt for no longer than this, s, may be half of what it will be, or less.
_YOUNG_S = 4.0
#: Share of the rows in which the amplitude must be well known for it to be large.
_MOSTLY = 0.5
#: Hunting that stands less clear of the floor than this (squared) shows the floor to be wrong.
_FLOOR_CLEAR = 9.0
#: Without a floor yet, the standard deviation of the amplitude estimate stands in, so often.
_STD_FLOORS = 1.5
#: Relative fluctuation of the amplitude that a limit cycle may have (noise-driven motion: 0.52).
_STEADY = 0.1
#: The damping must be at least this, 1/s, for the noise intensity to be read off it.
_LEAST_DAMPING = 0.1
#: About the unstable branch a motion lingers without being a limit cycle.
_LINGER_LOW, _LINGER_HIGH = 0.7, 1.35
#: With a stable branch in the form, a limit cycle is at least this share of it.
_CYCLE_AT_LEAST = 0.5


class Rules(NamedTuple):
    """Thresholds as the kernel reads them: amplitudes in m, times in rows."""

    period_s: float
    v_n: float
    v_c: float
    region_band: float
    region_hold: int
    floor: float
    floor_rows: float
    disturbed_in: float
    disturbed_out: float
    disturbed_hold: int
    quiet_hold: int
    probability_in: float
    probability_out: float
    escape_hold: int
    sigma: float
    growth_floor: float
    growth_hold: int
    cycle_fraction: float
    cycle_floor: float
    cycle_growth: float
    cycle_amplitude: float
    cycle_hold: int
    decay_fraction: float
    decay_rate: float
    decay_hold: int
    margin_in: float
    margin_out: float
    margin_hold: int
    disagree_hold: int
    outlook_s: float


def rules_of(config: DetectorConfig, v_n: float, v_c: float) -> Rules:
    """
    Translate the settings.

    Parameters
    ----------
    config : DetectorConfig
        In SI.
    v_n, v_c : float
        Boundaries of the regions, m/s; NaN: none, unknown.
    """
    period = config.period_ns * 1e-9

    def rows(seconds: float) -> int:
        return round(seconds / period)

    return Rules(
        period_s=period,
        v_n=v_n,
        v_c=v_c,
        region_band=config.region_band_mps,
        region_hold=rows(config.region_hold_s),
        floor=config.noise_floor_m,
        floor_rows=config.floor_time_s / period,
        disturbed_in=config.disturbed_in,
        disturbed_out=config.disturbed_out,
        disturbed_hold=rows(config.disturbed_hold_s),
        quiet_hold=rows(config.quiet_hold_s),
        probability_in=config.escape_probability_in,
        probability_out=config.escape_probability_out,
        escape_hold=rows(config.escape_hold_s),
        sigma=config.growth_sigma,
        growth_floor=config.growth_floor,
        growth_hold=rows(config.growth_hold_s),
        cycle_fraction=config.limit_cycle_fraction,
        cycle_floor=config.limit_cycle_floor,
        cycle_growth=config.limit_cycle_growth_per_s,
        cycle_amplitude=config.limit_cycle_amplitude_m,
        cycle_hold=rows(config.limit_cycle_hold_s),
        decay_fraction=config.decay_fraction,
        decay_rate=config.decay_rate_per_s,
        decay_hold=rows(config.decay_hold_s),
        margin_in=config.margin_in,
        margin_out=config.margin_out,
        margin_hold=rows(config.margin_hold_s),
        disagree_hold=rows(config.agreement_hold_s),
        outlook_s=config.outlook_s,
    )


def fresh_memory() -> _F:
    """Return the memory of a detector that has seen nothing, shape (N_MEMORY,)."""
    memory = np.zeros(N_MEMORY)
    memory[[M_FLOOR2, M_NOISE, M_REFERENCE]] = math.nan
    memory[M_EDGE_CENTRE] = 1.0
    return memory


@compiled
def decide(
    rules: Rules,
    form: FormNumbers,
    memory: _F,
    amplitude: _F,
    amplitude_std: _F,
    growth: _F,
    growth_std: _F,
    speed: _F,
    roughness: _F,
    disagree: NDArray[np.bool_],
    numbers: _F,
    regions: NDArray[np.int8],
    states: NDArray[np.int8],
    doubts: NDArray[np.uint32],
    alarms: NDArray[np.bool_],
) -> None:
    """
    Judge rows in order.

    Parameters
    ----------
    rules, form, memory
        Thresholds, normal form, and what is remembered from the rows before.
    amplitude, amplitude_std, growth, growth_std, speed, roughness : ndarray, shape (m,)
        m, m, 1/s, 1/s, m/s, m; NaN where unknown. The form is not used with `form.known`
        false.
    disagree : ndarray of bool, shape (m,)
        The two amplitude estimates differ at this row.
    numbers : ndarray, shape (m, N_OUTPUT)
        Filled in.
    regions, states, doubts, alarms : ndarray, shape (m,)
        Filled in.
    """
    for k in range(amplitude.size):
        a, s, v = amplitude[k], amplitude_std[k], speed[k]
        out = numbers[k]
        out[:] = np.nan
        known = not math.isnan(a)
        region = _region(rules, memory, v)
        damping = np.nan
        if form.known and not math.isnan(v):
            damping = _branches(form, v, roughness[k], out)
            if known:
                _edge(form, rules, memory, v, a, s, damping, out)
        if known:
            _learn(rules, form, memory, v, a, s)
        floor = _floor(rules, memory, s)
        out[O_FLOOR] = floor
        out[O_NOISE] = memory[M_NOISE]
        if known:
            wanted, hold = _wanted(
                rules, memory, a, s, growth[k], growth_std[k], floor, damping, out
            )
            _move(memory, wanted, hold, a)
        state = int(memory[M_STATE])
        if form.known and state == _ESCAPING and known:
            out[O_TIME] = _time_to_cycle(form, v, a, out)
        _hold_doubts(rules, memory, disagree[k], out)
        _latch(memory, state)
        regions[k] = region
        states[k] = state
        alarms[k] = memory[M_ALARM] > 0.0
        doubt = 0
        if memory[M_MARGIN_LOW] > 0.0:
            doubt |= D_MARGIN
        if memory[M_DISAGREE] > 0.0:
            doubt |= D_DISAGREE
        if math.isnan(v):
            doubt |= D_NO_SPEED
        elif region == 0:
            doubt |= D_NO_FORM
        if not known:
            doubt |= D_NO_ESTIMATE
        elif math.isnan(memory[M_FLOOR2]) and rules.floor == 0.0 and state == _QUIET:
            doubt |= D_SETTLING
        if state == _DECAYING:
            doubt |= D_DECAYING
        if region == 2:
            doubt |= D_HYSTERESIS
        if region == 3:
            doubt |= D_UNSTABLE
        doubts[k] = doubt


@compiled
def growth_at(form: FormNumbers, v: float, a: float) -> float:
    """Growth rate of the form, Eq. (24) divided by r, 1/s, at one speed and amplitude."""
    eps = v / form.critical_speed - 1.0
    r2 = (a / (2.0 * form.length_scale)) ** 2
    return (
        form.D1 * eps + form.D7 * eps**2 + (form.D4 + form.D10 * eps) * r2 + form.D15 * r2**2
    ) / form.time_scale


@compiled
def _region(rules: Rules, memory: _F, v: float) -> int:
    now = int(memory[M_REGION])
    wanted = region_of(now, v, rules.v_n, rules.v_c, rules.region_band)
    hold = 0 if now == 0 or wanted == 0 else rules.region_hold
    region, waited = held(now, wanted, int(memory[M_REGION_WAITED]), hold)
    memory[M_REGION] = region
    memory[M_REGION_WAITED] = waited
    return region


@compiled
def _branches(form: FormNumbers, v: float, roughness: float, out: _F) -> float:
    """Fill in the branches at a speed, Eq. (28); return the growth rate at zero amplitude."""
    eps = v / form.critical_speed - 1.0
    a = form.D15
    b = form.D4 + form.D10 * eps
    c = form.D1 * eps + form.D7 * eps**2
    first, second = np.nan, np.nan
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
                out[O_UNSTABLE] = value
            else:
                out[O_STABLE] = value
    place = (v - form.speed_low) / form.speed_step
    k = min(max(int(place), 0), form.unstable_std.size - 2)
    part = min(max(place - k, 0.0), 1.0)
    if not math.isnan(out[O_UNSTABLE]):
        low, high = form.unstable_std[k], form.unstable_std[k + 1]
        out[O_UNSTABLE_STD] = low + part * (high - low)
        if roughness > 0.0:
            # Roughness of amplitude B acts on the mean of the cubic term: A^2 -> A^2 + 2 B^2.
            plain = out[O_UNSTABLE]
            lowered = math.sqrt(max(plain**2 - 2.0 * roughness**2, 0.01 * plain**2))
            out[O_UNSTABLE_STD] *= lowered / plain
            out[O_UNSTABLE] = lowered
    return c / form.time_scale


@compiled
def _edge(
    form: FormNumbers,
    rules: Rules,
    memory: _F,
    v: float,
    a: float,
    s: float,
    damping: float,
    out: _F,
) -> None:
    """Fill in margin, probability of escape and outlook."""
    place = (v - form.speed_low) / form.speed_step
    k = min(max(int(place), 0), form.quiet_share.size - 2)
    part = min(max(place - k, 0.0), 1.0)
    exact = form.unstable_std.max() == 0.0  # no uncertainty: the shares are a matter of sign
    quiet = 1.0 if damping < 0.0 else 0.0
    cycle = 0.0 if math.isnan(out[O_STABLE]) else 1.0
    edge = out[O_UNSTABLE]
    if not exact:
        quiet = form.quiet_share[k] + part * (form.quiet_share[k + 1] - form.quiet_share[k])
        cycle = form.cycle_share[k] + part * (form.cycle_share[k + 1] - form.cycle_share[k])
        if math.isnan(edge) and damping < 0.0:
            edge = form.unstable_mean[k]
    inside = 0.0
    if not math.isnan(edge):
        spread = 0.0 if math.isnan(out[O_UNSTABLE_STD]) else out[O_UNSTABLE_STD]
        width = math.sqrt((memory[M_EDGE_WIDTH] * edge) ** 2 + s * s + spread * spread)
        distance = a - memory[M_EDGE_CENTRE] * edge
        if width > 0.0:
            inside = 0.5 * math.erfc(-distance / (width * math.sqrt(2.0)))
        else:
            inside = 1.0 if distance > 0.0 else 0.0
        out[O_MARGIN] = edge / a if a > 0.0 else np.inf
        out[O_MARGIN_LOW] = max(edge - 1.959964 * spread, 0.0) / (a + 1.959964 * s)
        least = a - 1.959964 * s
        out[O_MARGIN_HIGH] = (edge + 1.959964 * spread) / least if least > 0.0 else np.inf
    elif damping >= 0.0:
        quiet = min(quiet, 0.5) if not exact else 0.0
    probability = 1.0 - quiet + quiet * cycle * inside
    out[O_PROBABILITY] = probability
    stays = (1.0 - probability) * math.exp(-rules.outlook_s * memory[M_EDGE_RATE])
    out[O_OUTLOOK] = 1.0 - stays


@compiled
def _learn(rules: Rules, form: FormNumbers, memory: _F, v: float, a: float, s: float) -> None:
    """Learn what quiet is: mean square of the amplitude, and the noise that keeps it up."""
    memory[M_ROWS] += 1.0
    rows = memory[M_ROWS]
    square = a * a
    weight = max(1.0 / rows, rules.period_s / _RECENT_S)
    memory[M_RECENT] += weight * (square - memory[M_RECENT])
    if s < _SURE * a:
        memory[M_SURE_ROWS] += 1.0
        sure = memory[M_SURE_ROWS]
        memory[M_FAST] += max(1.0 / sure, rules.period_s / _FAST_S) * (a - memory[M_FAST])
        weight = max(1.0 / sure, rules.period_s / _SLOW_S)
        memory[M_SLOW] += weight * (a - memory[M_SLOW])
        memory[M_SQUARE] += weight * (square - memory[M_SQUARE])
        memory[M_STD] += weight * (s - memory[M_STD])
        weight = max(1.0 / sure, rules.period_s / _LONG_S)
        memory[M_LONG] += weight * (a - memory[M_LONG])
        memory[M_LONG_SQUARE] += weight * (square - memory[M_LONG_SQUARE])
    state = int(memory[M_STATE])
    if state > _DISTURBED:
        return
    if math.isnan(memory[M_FLOOR2]):
        elapsed = rows * rules.period_s
        large = memory[M_SURE_ROWS] > _MOSTLY * rows
        patience = _PATIENCE_S if large else _SETTLE_S
        if elapsed >= patience and not (large and _steady(rules, memory)):
            memory[M_FLOOR2] = max(memory[M_RECENT], 1e-300)
            memory[M_FLOOR_ROWS] = _SETTLE_S / rules.period_s
        return
    if memory[M_RECENT] < _FALLEN * memory[M_FLOOR2]:
        weight = rules.period_s / _RECENT_S
        memory[M_FLOOR2] += weight * (memory[M_RECENT] - memory[M_FLOOR2])
    limit = rules.disturbed_in**2 * memory[M_FLOOR2]
    pace = 1.0
    if square > limit:  # a disturbance, or a new level of the noise: give way slowly
        square = limit
        pace = 0.1
    elif square > memory[M_FLOOR2] and s < _SURE * a:
        pace = _WARY
    memory[M_FLOOR_ROWS] += pace
    weight = pace * max(1.0 / memory[M_FLOOR_ROWS], 1.0 / rules.floor_rows)
    memory[M_FLOOR2] += weight * (square - memory[M_FLOOR2])
    if form.known and not math.isnan(v) and pace > 0.1:
        rate = growth_at(form, v, a)
        if rate < -_LEAST_DAMPING:
            memory[M_NOISE_ROWS] += 1.0
            weight = max(1.0 / memory[M_NOISE_ROWS], 0.5 / rules.floor_rows)
            value = -0.5 * rate * a * a
            if math.isnan(memory[M_NOISE]):
                memory[M_NOISE] = value
            else:
                memory[M_NOISE] += weight * (value - memory[M_NOISE])


@compiled
def _trend(rules: Rules, memory: _F) -> float:
    """Relative rate of change of the well-known amplitude, 1/s; NaN before it is known."""
    if memory[M_SURE_ROWS] * rules.period_s < _SLOW_S:
        return np.nan
    return float((memory[M_FAST] - memory[M_SLOW]) / ((_SLOW_S - _FAST_S) * memory[M_SLOW]))


@compiled
def _steady(rules: Rules, memory: _F) -> bool:
    """Tell an amplitude that neither moves nor fluctuates, as that of a limit cycle."""
    variance = memory[M_SQUARE] - memory[M_SLOW] ** 2
    quiet = variance < (_STEADY * memory[M_SLOW]) ** 2
    return bool(quiet and abs(_trend(rules, memory)) < rules.cycle_growth)


@compiled
def _very_steady(rules: Rules, memory: _F) -> bool:
    """Tell an amplitude that noise cannot hold as steady for as long."""
    if memory[M_SURE_ROWS] * rules.period_s < 0.5 * _LONG_S or not _steady(rules, memory):
        return False
    variance = memory[M_LONG_SQUARE] - memory[M_LONG] ** 2
    return bool(variance < (_VERY_STEADY * memory[M_LONG]) ** 2)


@compiled
def _floor(rules: Rules, memory: _F, s: float) -> float:
    """Return the amplitude that counts as quiet, m; NaN before anything is known."""
    floor = rules.floor
    if not math.isnan(memory[M_FLOOR2]):
        floor = max(floor, math.sqrt(memory[M_FLOOR2]))
    elif floor == 0.0 and memory[M_ROWS] * rules.period_s >= _SETTLE_S:
        floor = _STD_FLOORS * (memory[M_STD] if memory[M_SURE_ROWS] > 0.0 else s)
    return floor if floor > 0.0 else np.nan


@compiled
def _wanted(
    rules: Rules,
    memory: _F,
    a: float,
    s: float,
    growth: float,
    growth_std: float,
    floor: float,
    damping: float,
    out: _F,
) -> tuple[int, int]:
    """Return the state the numbers ask for, and the rows it must be asked for."""
    state = int(memory[M_STATE])
    trend = _trend(rules, memory)
    grows = growth > rules.sigma * growth_std and trend > 0.0
    falls = growth < -rules.sigma * growth_std and trend < 0.0
    disturbed = switched(
        memory[M_DISTURBED] > 0.0, a, rules.disturbed_in * floor, rules.disturbed_out * floor
    )
    memory[M_DISTURBED] = 1.0 if disturbed else 0.0
    probability = out[O_PROBABILITY]
    certain = probability
    # Near v_c the edge of the basin sinks into the noise: crossing it there means nothing.
    in_noise = a <= rules.disturbed_in * floor
    no_edge = math.isnan(out[O_UNSTABLE]) and not a > rules.disturbed_in * floor
    if (in_noise or no_edge) and not math.isnan(probability):
        certain = 0.0
    escaping = switched(
        memory[M_ESCAPING] > 0.0, certain, rules.probability_in, rules.probability_out
    )
    if math.isnan(certain):
        escaping = False
    memory[M_ESCAPING] = 1.0 if escaping else 0.0
    # Without a limit cycle in the form, or without a form, what is seen to grow is growing.
    growing = memory[M_GROWING] > 0.0
    learnt_s = max(memory[M_FLOOR_ROWS], 1.0) * rules.period_s
    clear = rules.growth_floor * (1.0 + _YOUNG_S / learnt_s)
    if falls:
        growing = False
    elif grows and a > clear * floor and math.isnan(out[O_STABLE]):
        growing = True
    memory[M_GROWING] = 1.0 if growing else 0.0

    # What has been seen to grow need not stand as far above the floor.
    least = rules.cycle_floor * floor
    if state in (_ESCAPING, _DECAYING):
        least = max(rules.disturbed_in * floor, 0.5 * memory[M_REFERENCE])
    steady = memory[M_SLOW] > least and _steady(rules, memory)
    if not steady and memory[M_SLOW] > rules.cycle_floor * _STD_FLOORS * memory[M_STD]:
        steady = s < _SURE * a and _very_steady(rules, memory)
    edge = out[O_UNSTABLE]
    if not math.isnan(edge) and a < _LINGER_HIGH * edge:
        steady = False  # below the edge, or lingering near it
    if a < _CYCLE_AT_LEAST * out[O_STABLE]:
        steady = False  # lingering where growth is slow: near the critical speed
    reached = rules.cycle_amplitude > 0.0 and a > rules.cycle_amplitude
    if a > rules.cycle_fraction * out[O_STABLE]:
        reached = reached or not math.isnan(edge) or a > rules.disturbed_in * floor
    if state == _LIMIT_CYCLE:
        lost = a < rules.decay_fraction * memory[M_REFERENCE]
        if lost or (falls and growth < -rules.decay_rate):
            return _DECAYING, rules.decay_hold
        return _LIMIT_CYCLE, 0
    if escaping and state in (_QUIET, _DISTURBED):
        return _ESCAPING, rules.escape_hold  # a bump may land on the limit cycle: no waiting
    if reached:
        return _LIMIT_CYCLE, rules.cycle_hold
    if steady:
        return _LIMIT_CYCLE, 3 * rules.cycle_hold
    if escaping:
        return _ESCAPING, rules.escape_hold
    if growing and math.isnan(out[O_STABLE]):
        return _ESCAPING, rules.growth_hold
    if state in (_ESCAPING, _DECAYING):
        return _after_hunting(rules, memory, state, a, disturbed, floor)
    if disturbed:
        return _DISTURBED, rules.disturbed_hold
    return _QUIET, rules.quiet_hold


@compiled
def _after_hunting(
    rules: Rules, memory: _F, state: int, a: float, disturbed: bool, floor: float
) -> tuple[int, int]:
    """From escaping or decaying: go on decaying until it is quiet."""
    unlearnt = math.isnan(memory[M_FLOOR2]) and rules.floor == 0.0
    over = not disturbed and not math.isnan(floor)
    if unlearnt:
        over = a < 0.1 * memory[M_REFERENCE]
    if over:
        return _QUIET, rules.quiet_hold
    return _DECAYING, rules.decay_hold if state == _ESCAPING else 0


@compiled
def _move(memory: _F, wanted: int, hold: int, a: float) -> None:
    """Go to the wanted state once it has been wanted for long enough."""
    state = int(memory[M_STATE])
    waited = int(memory[M_STATE_WAITED])
    if wanted != int(memory[M_STATE_WANTED]):
        waited = 0
    memory[M_STATE_WANTED] = wanted
    new, waited = held(state, wanted, waited, hold)
    memory[M_STATE] = new
    memory[M_STATE_WAITED] = waited
    if new in (_LIMIT_CYCLE, _ESCAPING):
        if new != state:
            memory[M_REFERENCE] = a
            if a * a < _FLOOR_CLEAR * memory[M_FLOOR2]:  # learnt on the hunting itself
                memory[M_FLOOR2] = np.nan
                memory[M_ROWS] = 0.0
        elif new == _ESCAPING:
            memory[M_REFERENCE] = max(memory[M_REFERENCE], a)
        else:  # follows the branch while the speed changes slowly
            memory[M_REFERENCE] += 0.002 * (a - memory[M_REFERENCE])


@compiled
def _hold_doubts(rules: Rules, memory: _F, disagree: bool, out: _F) -> None:
    low = switched(memory[M_MARGIN_LOW] > 0.0, -out[O_MARGIN], -rules.margin_in, -rules.margin_out)
    if math.isnan(out[O_MARGIN]):
        # no unstable branch: below v_n there is room enough, above v_c there is none
        low = memory[M_MARGIN_LOW] > 0.0 and int(memory[M_REGION]) >= 2
    now, waited = held(
        int(memory[M_MARGIN_LOW]), int(low), int(memory[M_MARGIN_WAITED]), rules.margin_hold
    )
    memory[M_MARGIN_LOW] = now
    memory[M_MARGIN_WAITED] = waited
    now, waited = held(
        int(memory[M_DISAGREE]),
        int(disagree),
        int(memory[M_DISAGREE_WAITED]),
        rules.disagree_hold,
    )
    memory[M_DISAGREE] = now
    memory[M_DISAGREE_WAITED] = waited


@compiled
def _latch(memory: _F, state: int) -> None:
    """Latch the alarm; an acknowledgement counts once the hunting is over."""
    if state in (_ESCAPING, _LIMIT_CYCLE):
        memory[M_ALARM] = 1.0
    elif memory[M_ACKNOWLEDGED] > 0.0:
        memory[M_ALARM] = 0.0
        memory[M_ACKNOWLEDGED] = 0.0


@compiled
def _time_to_cycle(form: FormNumbers, v: float, a: float, out: _F) -> float:
    """Time to 90 % of the stable branch along the form, s; Simpson's rule in ln A."""
    stable = out[O_STABLE]
    if math.isnan(stable):
        return np.nan
    end = math.log(0.9 * stable)
    begin = math.log(max(a, 1e-12))
    if not math.isnan(out[O_UNSTABLE]):
        begin = max(begin, math.log(1.02 * out[O_UNSTABLE]))
    if begin >= end:
        return 0.0
    pieces = 64
    step = (end - begin) / pieces
    total = 0.0
    for k in range(pieces + 1):
        rate = growth_at(form, v, math.exp(begin + k * step))
        if rate <= 0.0:
            return np.inf
        weight = 1.0 if k == 0 or k == pieces else 4.0 if k % 2 else 2.0
        total += weight / rate
    return total * step / 3.0
