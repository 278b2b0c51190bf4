"""
The two machines: what the motion is, and whether it hunts.

The motion is quiet or disturbed, by the noise floor alone. Whether it hunts is another
question, with a machine of its own. From each word, the first line whose evidence holds
names the word that is wanted; it is taken when it has been wanted for its hold time on end.
No line without evidence: what cannot be seen does not end.

===========  ============================  ===========  ====================
hunting      evidence                      to           hold time
===========  ============================  ===========  ====================
no           beyond                        escaping     escape
             arrived                       limit cycle  escape
             steady                        limit cycle  -
             growing                       escaping     -
escaping     arrived                       limit cycle  escape
             steady                        limit cycle  -
             beyond, growing               escaping     -
             returns                       decaying     quiet
             falls, or over                decaying     -
decaying     arrived                       limit cycle  escape
             steady                        limit cycle  -
             beyond                        escaping     escape
             growing                       escaping     -
             over                          no           quiet
limit cycle  falls, or over                decaying     -
===========  ============================  ===========  ====================

*Beyond*: by the form, it reaches the limit cycle before it is quiet again with the set
probability; *returns*: it does not. *Arrived*: it is on the stable branch. By the model that
switches (`switching`): *growing*: it hunts, and grows rather than being in a cycle, where the form
knows no limit cycle to escape to; *steady*: it hunts, is in a cycle, may be the hunting of the
form, and is not on its way to a limit cycle of the form; *falls*: it does not hunt.
*Over*: it does not, as likely as not, and is small beside what it was.
The two are shown as one word, the `State`: while it hunts that of the hunting, else that of
the motion. Called by the kernel of the decisions, row by row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hunt_ros.compiled import compiled_part
from hunt_ros.detection.decision import switching
from hunt_ros.detection.decision.form import SMALLEST
from hunt_ros.detection.decision.rules import Rules, rows_of
from hunt_ros.detection.regions import HELD, State, hold

#: What is remembered: the two machines; the cause of the last step of the hunting (one of those
#: below); the amplitude of the hunting (m, NaN before any), and whether the motion stands clear
#: of the noise floor.
STATE: np.dtype[np.void] = np.dtype(
    [
        ('motion', HELD),
        ('hunting', HELD),
        ('cause', np.int64),
        ('reference', np.float64),
        ('disturbed', np.bool_),
    ],
    align=True,
)

#: The words as the kernel compares them; a motion that is no hunting has the word 0.
QUIET, DISTURBED, ESCAPING, LIMIT_CYCLE, DECAYING = map(int, State)
NO = 0

#: Which evidence led to the word of the hunting that is in force.
BEYOND, ARRIVED, STEADY, GROWING, COMES_BACK, FALLS, OVER = range(1, 8)

#: Disturbed above, quiet again below this many noise floors. The amplitude of Gaussian noise is
#: above k of them with the probability exp(-k^2): 1e-4 and 2 %.
CLEAR, CALM = 3.0, 2.0
# Hold times, s of the reference rig. A blow is a disturbance at once; what crosses zero growth on
# its way down is not quiet yet; what the filter overshoots after a kick is over before it counts.
DISTURBED_S, QUIET_S, ESCAPE_S = 0.02, 0.5, 0.1
#: On the limit cycle from this part of the stable branch on, whose place is known to 10 % or so.
_CYCLE = 0.85
#: `escaping` is withdrawn once it is as likely to come back.
AS_LIKELY = 0.5
#: What has this part of the amplitude of the hunting, or more, may be the hunting.
_SAME = 0.7
#: What has less than this part of it, for sure, is what is left of it.
_GONE = 0.1
#: An amplitude is sure to be less than it seems plus this many standard deviations.
_SURE = 3.0
#: A growth rate is positive for sure from so many of them.
_SURE_GROWTH = 2.0
#: It hunts from this posterior probability on, and not any more as far below one; between them it
#: is not decided.
LIKELY = 0.98
#: An amplitude is well known when its standard deviation is below this part of it.
_WELL_KNOWN = 0.1
#: The amplitude of the limit cycle is followed at this pace while the speed changes, s.
_FOLLOW_S = 5.0


@compiled_part
def judge(
    rules: Rules,
    memory: Any,
    motion: Any,
    a: float,
    s: float,
    of_the_form: bool,
    out: Any,
) -> tuple[bool, bool]:
    """
    Let both machines take the word that is wanted, once it has been for long enough.

    Parameters
    ----------
    rules, memory, motion
        Thresholds; records of STATE and SWITCHING.
    a, s : float
        Amplitude and its standard deviation, m.
    of_the_form : bool
        Its frequency and size may be those of the hunting, by the form; True without a form, and
        while it hunts.
    out
        Row of the estimates with noise floor and predictions filled in.

    Returns
    -------
    other, undecided : bool
        It is steady, and not of the form; it may hunt, and is not known to return.
    """
    hunting, stamp_ns, quiet = memory['hunting']['word'], out['stamp_ns'], out['noise_floor']
    disturbed = a > (CALM if memory['disturbed'] else CLEAR) * quiet
    disturbed |= memory['disturbed'] and math.isnan(quiet)
    memory['disturbed'] = disturbed
    hunts, told = switching.hunts(motion), switching.told(motion)
    likely, falls = hunts > LIKELY, told and hunts < 1.0 - LIKELY
    chance = out['escape_probability']
    beyond = chance > (AS_LIKELY if hunting == ESCAPING else rules.probability_in)
    beyond &= disturbed or math.isnan(quiet)
    steady = likely and motion['cycles'] > motion['grows']
    # On its way to the limit cycle of the form is what grows for sure, up to its amplitude, and
    # what has less than half of that, slow as it may be.
    grows = out['growth_rate'] > _SURE_GROWTH * out['growth_rate_std']
    away = a < (1.0 if grows else SMALLEST) * out['stable_amplitude']
    steady &= not (beyond and away)
    growing = likely and not steady and math.isnan(out['stable_amplitude'])
    # What is left of it is small for sure: an estimate that has just begun anew knows little.
    small = not a + _SURE * s > _SAME * memory['reference']
    # As large as the hunting was, it is the hunting: nothing says that this has ended.
    seen = not out['outside_judged'] > _SAME * memory['reference']
    over = switching.settled(motion) and small and not disturbed and seen
    # In strong noise a cycle dips into it; far below what it was it is over for sure.
    over &= hunts < AS_LIKELY or a + _SURE * s < _GONE * memory['reference']
    # A branch that comes from zero has the noise on it.
    arrived = chance > AS_LIKELY and a > _CYCLE * out['stable_amplitude'] and not away
    arrived &= disturbed or not math.isnan(out['unstable_amplitude'])
    # On the stable branch it falls as that does, with the speed.
    ends = falls and seen and not arrived

    if disturbed:
        hold(memory['motion'], DISTURBED, rows_of(rules, DISTURBED_S), stamp_ns)
    else:
        hold(memory['motion'], QUIET, rows_of(rules, QUIET_S), stamp_ns)
    want, wait, cause = hunting, 0.0, 0
    if hunting == LIMIT_CYCLE:
        if ends or over:
            want, cause = DECAYING, FALLS if ends else OVER
    elif beyond and hunting == NO:  # before `arrived`: a bump may land on the limit cycle
        want, wait, cause = ESCAPING, ESCAPE_S, BEYOND
    elif arrived:
        want, wait, cause = LIMIT_CYCLE, ESCAPE_S, ARRIVED
    elif steady and of_the_form:
        want, cause = LIMIT_CYCLE, STEADY
    elif beyond:
        want, wait, cause = ESCAPING, ESCAPE_S, BEYOND
    elif growing:
        want, cause = ESCAPING, GROWING
    elif hunting == ESCAPING and not math.isnan(chance):
        want, wait, cause = DECAYING, QUIET_S, COMES_BACK
    elif hunting == ESCAPING and (ends or over):
        want, cause = DECAYING, FALLS if ends else OVER
    elif hunting == DECAYING and over:
        want, wait, cause = NO, QUIET_S, OVER
    changed = hold(memory['hunting'], want, rows_of(rules, wait), stamp_ns)
    if changed:
        memory['cause'] = cause
    _follow(rules, memory, changed, a, s)
    undecided = hunts > 1.0 - LIKELY and math.isnan(chance)
    return steady and not of_the_form, undecided


@compiled_part
def _follow(rules: Rules, memory: Any, changed: bool, a: float, s: float) -> None:
    """Remember how large the hunting is."""
    hunting = memory['hunting']['word']
    if hunting not in (ESCAPING, LIMIT_CYCLE):
        return
    sure = s < _WELL_KNOWN * a
    if changed or math.isnan(memory['reference']):
        memory['reference'] = a if changed or sure else math.nan
    elif hunting == ESCAPING:
        memory['reference'] = max(memory['reference'], a)
    elif sure:
        memory['reference'] += rules.stride / _FOLLOW_S * (a - memory['reference'])


def word_of(memory: Any) -> int:
    """Return the one word for both machines, a `State`."""
    hunting = memory['hunting']['word']
    return int(hunting if hunting != NO else memory['motion']['word'])


#: The same for kernels: called from Python it would be compiled anew in each process.
shown = compiled_part(word_of)


@compiled_part
def tell(memory: Any, motion: Any, out: Any) -> None:
    """Fill in the state of a row, since when it is, its cause, and how likely it hunts."""
    hunting = memory['hunting']
    out['state'] = shown(memory)
    # When it is quiet again the last to come to an end has made it so.
    since_ns = hunting['since_ns']
    if hunting['word'] == NO:
        since_ns = max(since_ns, memory['motion']['since_ns'])
    out['state_since_ns'] = since_ns
    out['state_cause'] = memory['cause']
    out['hunting_probability'] = switching.hunts(motion) if motion['marks'] > 0 else math.nan
