"""
The state machine: from the numbers of a row to the state, and the alarm that it latches.

`_wanted` names the state that the numbers ask for and for how long they must; nothing
else decides. Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection import noise_floor, steadiness
from hunt_ros.detection.regions import State, held, switched
from hunt_ros.detection.rules import Rules

#: What is remembered: the state, the state that was asked for and for how many rows; the
#: amplitude of the hunting (m, NaN before any); comparisons in force.
STATE: np.dtype[np.void] = np.dtype(
    [
        ('state', np.int64),
        ('wanted', np.int64),
        ('waited', np.int64),
        ('reference', np.float64),
        ('disturbed', np.bool_),
        ('growing', np.bool_),
        ('alarm', np.bool_),
        ('acknowledged', np.bool_),
    ],
    align=True,
)

#: The states as the kernel compares them.
QUIET, DISTURBED, ESCAPING, LIMIT_CYCLE, DECAYING = map(int, State)

#: About the unstable branch a motion lingers without being a limit cycle.
_LINGER_HIGH = 1.35
#: With a stable branch in the form, a limit cycle is at least this share of it.
_CYCLE_AT_LEAST = 0.5


@compiled_part
def next_state(
    rules: Rules,
    memory: Any,
    floor_memory: Any,
    steady_memory: Any,
    a: float,
    s: float,
    growth: float,
    growth_std: float,
    out: Any,
) -> None:
    """
    Take the state a row asks for, once it has been asked for long enough.

    Parameters
    ----------
    rules, memory, floor_memory, steady_memory
        Thresholds, and what is remembered of state, noise floor and steadiness.
    a, s, growth, growth_std : float
        Amplitude, m, and growth rate, 1/s, with their standard deviations.
    out
        Row of the estimates with noise floor and predictions filled in.
    """
    wanted, hold = _wanted(
        rules, memory, floor_memory, steady_memory, a, s, growth, growth_std, out
    )
    state = memory['state']
    waited = memory['waited']
    if wanted != memory['wanted']:
        waited = 0
    memory['wanted'] = wanted
    new, waited = held(state, wanted, waited, hold)
    memory['state'] = new
    memory['waited'] = waited
    if new in (LIMIT_CYCLE, ESCAPING):
        if new != state:
            memory['reference'] = a
            noise_floor.reconsider(floor_memory, a)
        elif new == ESCAPING:
            memory['reference'] = max(memory['reference'], a)
        else:  # follows the branch while the speed changes slowly
            memory['reference'] += 0.002 * (a - memory['reference'])


@compiled_part
def _wanted(
    rules: Rules,
    memory: Any,
    floor_memory: Any,
    steady_memory: Any,
    a: float,
    s: float,
    growth: float,
    growth_std: float,
    out: Any,
) -> tuple[int, int]:
    """Return the state the numbers ask for, and the rows it must be asked for."""
    state = memory['state']
    floor = out['noise_floor']
    trend = steadiness.trend(rules, steady_memory)
    grows = growth > rules.sigma * growth_std and trend > 0.0
    falls = growth < -rules.sigma * growth_std and trend < 0.0
    disturbed = switched(
        memory['disturbed'], a, rules.disturbed_in * floor, rules.disturbed_out * floor
    )
    memory['disturbed'] = disturbed
    edge, stable = out['unstable_amplitude'], out['stable_amplitude']
    # Near v_c the edge of the basin sinks into the noise: crossing it there means nothing.
    clear_of_noise = disturbed or (math.isnan(floor) and not math.isnan(edge))
    # The easier threshold is for staying: one row above the other does not open it.
    needed = rules.probability_out if state == ESCAPING else rules.probability_in
    escaping = clear_of_noise and out['escape_probability'] > needed
    # Without a limit cycle in the form, or without a form, what is seen to grow is growing.
    growing = memory['growing']
    clear = rules.growth_floor * noise_floor.clearance(rules, floor_memory)
    if falls:
        growing = False
    elif grows and a > clear * floor and math.isnan(stable):
        growing = True
    memory['growing'] = growing

    # What has been seen to grow need not stand as far above the floor.
    least = rules.cycle_floor * floor
    if state in (ESCAPING, DECAYING):
        least = max(rules.disturbed_in * floor, 0.5 * memory['reference'])
    steady = steady_memory['slow'] > least and steadiness.steady(rules, steady_memory)
    above_noise = rules.cycle_floor * noise_floor.STD_FLOORS * steady_memory['std']
    if not steady and steady_memory['slow'] > above_noise:
        steady = steadiness.well_known(a, s) and steadiness.very_steady(rules, steady_memory)
    if not math.isnan(edge) and a < _LINGER_HIGH * edge:
        steady = False  # below the edge, or lingering near it
    if a < _CYCLE_AT_LEAST * stable:
        steady = False  # lingering where growth is slow: near the critical speed
    reached = rules.cycle_amplitude > 0.0 and a > rules.cycle_amplitude
    if a > rules.cycle_fraction * stable:
        reached = reached or not math.isnan(edge) or a > rules.disturbed_in * floor
    if state == LIMIT_CYCLE:
        lost = a < rules.decay_fraction * memory['reference']
        if lost or (falls and growth < -rules.decay_rate):
            return DECAYING, rules.decay_hold
        return LIMIT_CYCLE, 0
    if escaping and state in (QUIET, DISTURBED):
        return ESCAPING, rules.escape_hold  # a bump may land on the limit cycle: no waiting
    if reached:
        return LIMIT_CYCLE, rules.cycle_hold
    if steady:
        return LIMIT_CYCLE, 3 * rules.cycle_hold
    if escaping:
        return ESCAPING, rules.escape_hold
    if growing and math.isnan(stable):
        return ESCAPING, rules.growth_hold
    if state in (ESCAPING, DECAYING):
        return _after_hunting(rules, memory, floor_memory, a, disturbed, floor)
    if disturbed:
        return DISTURBED, rules.disturbed_hold
    return QUIET, rules.quiet_hold


@compiled_part
def _after_hunting(
    rules: Rules, memory: Any, floor_memory: Any, a: float, disturbed: bool, floor: float
) -> tuple[int, int]:
    """From escaping or decaying: go on decaying until it is quiet."""
    over = not disturbed and not math.isnan(floor)
    if noise_floor.unlearnt(rules, floor_memory):
        over = a < 0.1 * memory['reference']
    if over:
        return QUIET, rules.quiet_hold
    return DECAYING, rules.decay_hold if memory['state'] == ESCAPING else 0


@compiled_part
def latch(memory: Any) -> None:
    """Latch the alarm; an acknowledgement counts once the hunting is over."""
    if memory['state'] == ESCAPING or memory['state'] == LIMIT_CYCLE:
        memory['alarm'] = True
    elif memory['acknowledged']:
        memory['alarm'] = False
        memory['acknowledged'] = False
