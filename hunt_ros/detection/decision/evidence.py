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
from hunt_ros.detection.decision import likelihood
from hunt_ros.detection.decision.rules import Rules
from hunt_ros.detection.regions import State, switched

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


class Evidence(NamedTuple):
    """
    The answers.

    Fields
    ------
    disturbed : bool
        The amplitude stands clear of the noise floor.
    outcome : int
        By the form: `ESCAPES`, it reaches the limit cycle before it is quiet again with the set
        probability; `RETURNS`, it does not; `OPEN`, the form does not say.
    growing : bool
        It grows, and is more than noise, where the form knows no limit cycle to escape to.
    arrived : bool
        It is on the stable branch of the form.
    steady : bool
        It holds, and is more than noise, and may be the hunting.
    other : bool
        It holds, and is more than noise, and is not at the frequency of the hunting.
    falls : bool
        It falls.
    undecided : bool
        It may be more than noise, and neither falls nor is known to return.
    over : bool
        It is no more than noise, and small beside what it was.
    """

    disturbed: bool
    outcome: int
    growing: bool
    arrived: bool
    steady: bool
    other: bool
    falls: bool
    undecided: bool
    over: bool


@compiled_part
def gather(
    rules: Rules,
    memory: Any,
    ratios: Any,
    hunting: int,
    a: float,
    s: float,
    outside: float,
    of_the_form: bool,
    out: Any,
) -> Evidence:
    """
    Answer all questions about a row.

    Parameters
    ----------
    rules, memory, ratios
        Thresholds; records of EVIDENCE and LIKELIHOOD.
    hunting : int
        The word in force: to stay is easier than to enter.
    a, s : float
        Amplitude and its standard deviation, m.
    outside : float
        Amplitude of the motion outside the range that is followed, m; NaN: there is none.
        As large as the hunting was, it is the hunting: nothing says that this has ended.
    of_the_form : bool
        Its frequency and size may be those of the hunting, by the form; True without a form, and
        while it hunts.
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
    steady = hunts and not grows
    # What is left of it is small for sure: an estimate that has just begun anew knows little.
    small = not a + _SURE * s > _SAME * memory['reference']
    over = likelihood.settled(ratios) and excess < some and small and not disturbed
    seen = not outside > _SAME * memory['reference']
    return Evidence(
        disturbed,
        _outcome(rules, hunting, disturbed, out),
        # Where the form knows a limit cycle, it says whether the motion escapes to it.
        math.isnan(out['stable_amplitude'])
        and excess > some
        and (ratios['growth'] > rules.evidence or (hunts and grows)),
        _arrived(rules, a, disturbed, out),
        steady and of_the_form,
        steady and not of_the_form,
        falls and seen,
        excess > likelihood.DOUBT and not falls and math.isnan(out['escape_probability']),
        over and seen,
    )


@compiled_part
def _outcome(rules: Rules, hunting: int, disturbed: bool, out: Any) -> int:
    """Return how it ends by the chance of escape: to stay in it, less will do."""
    needed = rules.probability_out if hunting == _ESCAPING else rules.probability_in
    if math.isnan(out['escape_probability']):
        return OPEN
    if out['escape_probability'] <= needed:
        return RETURNS
    return ESCAPES if disturbed or math.isnan(out['noise_floor']) else RETURNS


@compiled_part
def _arrived(rules: Rules, a: float, disturbed: bool, out: Any) -> bool:
    """Return True for an amplitude on the stable branch that will not come back from there."""
    # A branch that comes from zero has the noise on it.
    clear = disturbed or not math.isnan(out['unstable_amplitude'])
    stays = out['escape_probability'] > rules.probability_out
    return bool(clear and stays and a > rules.cycle_fraction * out['stable_amplitude'])
