"""
The evidence: what a row says about the motion, as plain yes and no.

Each question is one function; what follows from the answers is in `states`. Called by the
kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection import noise_floor, prediction, steadiness
from hunt_ros.detection.basin import FormNumbers
from hunt_ros.detection.regions import State, switched
from hunt_ros.detection.rules import Rules

#: What is remembered: answers with a memory, and the amplitude of the hunting (m, NaN before any).
EVIDENCE: np.dtype[np.void] = np.dtype(
    [('reference', np.float64), ('disturbed', np.bool_), ('growing', np.bool_)], align=True
)

_ESCAPING, _DECAYING = int(State.ESCAPING), int(State.DECAYING)

#: What the form says of how the motion ends.
RETURNS, OPEN, ESCAPES = -1, 0, 1

#: About the unstable branch a motion lingers without being a limit cycle.
_LINGER_HIGH = 1.35
#: With a stable branch in the form, a limit cycle is at least this share of it.
_CYCLE_AT_LEAST = 0.5
#: A limit cycle stands this many standard deviations of its amplitude clear of the noise.
_WANDERS = 2.0
#: Without a noise floor, hunting is over below this part of its amplitude.
_OVER = 0.1


class Evidence(NamedTuple):
    """
    The answers.

    Fields
    ------
    disturbed : bool
        The amplitude stands clear of the noise floor.
    outcome : int
        By the form: `ESCAPES`, it ends on the limit cycle with the set probability - near v_c,
        where noise alone carries it over the edge, without coming back into the noise before;
        `RETURNS`, it comes back; `OPEN`, the form does not say.
    growing : bool
        It has been seen to grow for sure, where the form knows no limit cycle to escape to.
    arrived : bool
        It is on the stable branch, or above the amplitude that is a limit cycle anyway.
    steady : bool
        It stays as a limit cycle does.
    falls : bool
        It falls for sure.
    lost : bool
        It has left the limit cycle it was on: much smaller for sure, or falling fast.
    over : bool
        Nothing is left of the hunting.
    """

    disturbed: bool
    outcome: int
    growing: bool
    arrived: bool
    steady: bool
    falls: bool
    lost: bool
    over: bool


@compiled_part
def gather(
    rules: Rules,
    form: FormNumbers,
    memory: Any,
    floor_memory: Any,
    steady_memory: Any,
    hunting: int,
    a: float,
    s: float,
    outside: float,
    growth: float,
    growth_std: float,
    out: Any,
) -> Evidence:
    """
    Answer all questions about a row.

    Parameters
    ----------
    rules, form, memory, floor_memory, steady_memory
        Thresholds; normal form; records of EVIDENCE, NOISE_FLOOR and STEADINESS.
    hunting : int
        The word in force: to stay is easier than to enter.
    a, s, growth, growth_std : float
        Amplitude, m, and growth rate, 1/s, with their standard deviations.
    outside : float
        Amplitude of the motion outside the range that is followed, m; NaN: there is none.
        As large as the hunting was, it is the hunting: nothing says that this has ended.
    out
        Row of the estimates with noise floor and predictions filled in.
    """
    floor, stable = out['noise_floor'], out['stable_amplitude']
    trend = steadiness.trend(rules, steady_memory)
    grows = growth > rules.sigma * growth_std and trend > 0.0
    falls = growth < -rules.sigma * growth_std and trend < 0.0
    disturbed = switched(
        memory['disturbed'], a, rules.disturbed_in * floor, rules.disturbed_out * floor
    )
    memory['disturbed'] = disturbed
    clear = rules.growth_floor * noise_floor.clearance(rules, floor_memory)
    over = not disturbed and not math.isnan(floor)
    if falls or over or not math.isnan(stable):
        memory['growing'] = False
    elif grows and a > clear * floor:
        memory['growing'] = True
    most = a + rules.sigma * s  # after a kick, or a new start of the filter, little is known
    if noise_floor.unlearnt(rules, floor_memory):
        over = most < _OVER * memory['reference']
    lost = most < rules.decay_fraction * memory['reference']
    seen = not outside > rules.decay_fraction * memory['reference']
    return Evidence(
        disturbed,
        _outcome(rules, form, hunting, disturbed, a, out),
        memory['growing'],
        _arrived(rules, form, a, disturbed, out),
        # What falls for sure, however slowly, is no limit cycle.
        not falls and _steady(rules, form, memory, steady_memory, hunting, a, s, out),
        falls and seen,
        (lost or (falls and growth < -rules.decay_rate)) and seen,
        over and seen,
    )


@compiled_part
def _outcome(
    rules: Rules, form: FormNumbers, hunting: int, disturbed: bool, a: float, out: Any
) -> int:
    """Return how it ends by the chance of escape: to stay in it, less will do."""
    needed = rules.probability_out if hunting == _ESCAPING else rules.probability_in
    floor, edge, chance = out['noise_floor'], out['unstable_amplitude'], out['escape_probability']
    if math.isnan(chance):
        return OPEN
    if chance <= needed:
        return RETURNS
    if math.isnan(floor):
        return ESCAPES if disturbed or not math.isnan(edge) else OPEN
    if not disturbed:
        return RETURNS
    # Near v_c the edge of the basin sinks into the noise, and all that is quiet is beyond it.
    # Sooner or later it hunts: it escapes when it does not come back into the noise before.
    back, diffusion = rules.disturbed_out * floor, out['noise_intensity']
    if edge > back or math.isnan(out['stable_amplitude']) or not diffusion > 0.0:
        return ESCAPES
    if _cycle_in_noise(rules, form, out):
        return RETURNS
    cycle = rules.cycle_fraction * out['stable_amplitude']
    stays = prediction.stays_up(form, out['speed'], a, back, cycle, diffusion)
    return ESCAPES if stays > needed else RETURNS


@compiled_part
def _cycle_in_noise(rules: Rules, form: FormNumbers, out: Any) -> bool:
    """Tell a limit cycle so small that the noise takes it back to what counts as quiet."""
    cycle, diffusion = out['stable_amplitude'], out['noise_intensity']
    if math.isnan(cycle) or not diffusion > 0.0:
        return False
    least = cycle - _WANDERS * prediction.wander(form, out['speed'], cycle, diffusion)
    return bool(least < rules.disturbed_out * out['noise_floor'])


@compiled_part
def _arrived(rules: Rules, form: FormNumbers, a: float, disturbed: bool, out: Any) -> bool:
    """Tell an amplitude on the stable branch; a branch that comes from zero has noise on it."""
    if rules.cycle_amplitude > 0.0 and a > rules.cycle_amplitude:
        return True
    clear = not math.isnan(out['unstable_amplitude'])
    clear = clear or (disturbed and not _cycle_in_noise(rules, form, out))
    return bool(clear and a > rules.cycle_fraction * out['stable_amplitude'])


@compiled_part
def _steady(
    rules: Rules,
    form: FormNumbers,
    memory: Any,
    steady_memory: Any,
    hunting: int,
    a: float,
    s: float,
    out: Any,
) -> bool:
    """Tell an amplitude that stays, and at which a limit cycle can be."""
    if a < _LINGER_HIGH * out['unstable_amplitude']:
        return False  # below the edge of the basin, or lingering near it
    if a < _CYCLE_AT_LEAST * out['stable_amplitude']:
        return False  # lingering where growth is slow: near the critical speed
    floor = out['noise_floor']
    least = rules.cycle_floor * floor
    dies = out['escape_probability'] < rules.probability_out or _cycle_in_noise(rules, form, out)
    if hunting in (_ESCAPING, _DECAYING) and not dies:
        # What was seen to grow need not stand as far above it.
        least = max(rules.disturbed_in * floor, 0.5 * memory['reference'])
    if steady_memory['slow'] > least and steadiness.steady(rules, steady_memory):
        return True
    # The floor may have been learnt on the hunting itself: the sensor noise has not.
    least = rules.cycle_floor * noise_floor.STD_FLOORS * steady_memory['std']
    sure = steady_memory['slow'] > least and steadiness.well_known(a, s)
    return bool(sure and steadiness.very_steady(rules, steady_memory))
