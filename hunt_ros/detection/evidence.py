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
from hunt_ros.detection import likelihood, prediction
from hunt_ros.detection.basin import FormNumbers
from hunt_ros.detection.regions import State, switched
from hunt_ros.detection.rules import Rules

#: What is remembered: answers with a memory, and the amplitude of the hunting (m, NaN before any).
EVIDENCE: np.dtype[np.void] = np.dtype(
    [('reference', np.float64), ('disturbed', np.bool_)], align=True
)

_ESCAPING = int(State.ESCAPING)

#: What the form says of how the motion ends.
RETURNS, OPEN, ESCAPES = -1, 0, 1

#: What has this part of the amplitude of the hunting, or more, may be the hunting.
_SAME = 0.7
#: An amplitude is sure to be less than it seems plus this many standard deviations.
_SURE = 3.0
#: To fall ends an alarm and raises none: it takes less than the whole evidence. To hold is asked
#: only of what is no noise: not once a mark, but once a kick.
FALLING, HOLDING = 2.0 / 3.0, 0.25
#: A limit cycle stands this many standard deviations of its amplitude clear of the noise.
_WANDERS = 2.0


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
        It grows, and is more than noise, where the form knows no limit cycle to escape to.
    arrived : bool
        It is on the stable branch of the form.
    steady : bool
        It holds, and is more than noise.
    falls : bool
        It falls.
    over : bool
        It is no more than noise, and small beside what it was.
    """

    disturbed: bool
    outcome: int
    growing: bool
    arrived: bool
    steady: bool
    falls: bool
    over: bool


@compiled_part
def gather(
    rules: Rules,
    form: FormNumbers,
    memory: Any,
    ratios: Any,
    hunting: int,
    a: float,
    s: float,
    outside: float,
    out: Any,
) -> Evidence:
    """
    Answer all questions about a row.

    Parameters
    ----------
    rules, form, memory, ratios
        Thresholds; normal form; records of EVIDENCE and LIKELIHOOD.
    hunting : int
        The word in force: to stay is easier than to enter.
    a, s : float
        Amplitude and its standard deviation, m.
    outside : float
        Amplitude of the motion outside the range that is followed, m; NaN: there is none.
        As large as the hunting was, it is the hunting: nothing says that this has ended.
    out
        Row of the estimates with noise floor and predictions filled in.
    """
    floor = out['noise_floor']
    disturbed = switched(
        memory['disturbed'], a, rules.disturbed_in * floor, rules.disturbed_out * floor
    )
    memory['disturbed'] = disturbed
    excess, some = likelihood.excess(rules, ratios), likelihood.SOME * rules.evidence
    falls = ratios['fall'] > FALLING * rules.evidence
    holds = ratios['hold'] > HOLDING * rules.evidence and not falls
    hunts = excess > rules.evidence and holds
    grows = ratios['growth'] > some
    # What is left of it is small for sure: an estimate that has just begun anew knows little.
    small = not a + _SURE * s > _SAME * memory['reference']
    over = likelihood.settled(ratios) and excess < some and small and not disturbed
    seen = not outside > _SAME * memory['reference']
    return Evidence(
        disturbed,
        _outcome(rules, form, hunting, disturbed, a, out),
        # Where the form knows a limit cycle, it says whether the motion escapes to it.
        math.isnan(out['stable_amplitude'])
        and excess > some
        and (ratios['growth'] > rules.evidence or (hunts and grows)),
        _arrived(rules, form, a, disturbed, out),
        hunts and not grows,
        falls and seen,
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
    """Return True if the limit cycle is so small that the noise takes it back to quiet."""
    cycle, diffusion = out['stable_amplitude'], out['noise_intensity']
    if math.isnan(cycle) or not diffusion > 0.0:
        return False
    least = cycle - _WANDERS * prediction.wander(form, out['speed'], cycle, diffusion)
    return bool(least < rules.disturbed_out * out['noise_floor'])


@compiled_part
def _arrived(rules: Rules, form: FormNumbers, a: float, disturbed: bool, out: Any) -> bool:
    """Return True on the stable branch; a branch that comes from zero has noise on it."""
    clear = not math.isnan(out['unstable_amplitude'])
    clear = clear or (disturbed and not _cycle_in_noise(rules, form, out))
    return bool(clear and a > rules.cycle_fraction * out['stable_amplitude'])
