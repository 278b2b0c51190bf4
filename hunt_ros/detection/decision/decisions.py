"""
The decisions, row by row: what is quiet, what the form says, and what follows.

One compiled kernel over a block of rows, with its memory in a record, so that an hour
of rows costs a fraction of a second and the live detector runs the very same code on one
row. Its parts are `switching` (what the amplitude does, and the noise), `form`
(what the form says), `states` and `limits` (what follows).
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, compiled, compiled_part
from hunt_ros.detection import doubts
from hunt_ros.detection.decision import limits, states, switching
from hunt_ros.detection.decision.form import (
    SMALLEST,
    FormNumbers,
    growth_at,
    is_hunting_of,
    predict,
    time_to_cycle,
)
from hunt_ros.detection.decision.outlook import NO_OUTLOOK, OUTLOOK
from hunt_ros.detection.decision.rules import Rules, rows_of
from hunt_ros.detection.output import ESTIMATE_DTYPE
from hunt_ros.detection.regions import HELD, hold, region_of

#: The noise of the quiet motion as it was seen last: mean square of its amplitude and of what the
#: filter misses of it, m^2, and the rows they were learnt from; the intensity D, m^2/s, and the
#: deviation of its logarithm; NaN before it is known.
_FLOOR: np.dtype[np.void] = np.dtype(
    [(name, np.float64) for name in ('square', 'missed', 'learnt', 'intensity', 'spread')],
    align=True,
)
#: All that is remembered from row to row: by the part that owns it, and the doubts that are held;
#: the causes of an alarm that last, the latched alarm, and that it has been acknowledged.
MEMORY: np.dtype[np.void] = np.dtype(
    [
        ('floor', _FLOOR),
        ('motion', switching.SWITCHING),
        ('outlook', OUTLOOK),
        ('region', HELD),
        ('state', states.STATE),
        ('margin', HELD),
        ('disagree', HELD),
        ('limits', HELD, (len(limits.LIMITS),)),
        ('limit_since_ns', np.int64),
        ('causes', np.int64),
        ('alarm', np.bool_),
        ('acknowledged', np.bool_),
    ],
    align=True,
)

#: A region is left this far beyond its boundary, m/s, and changed after this time, s: the reading
#: of a speed that is held wanders by less.
_REGION_BAND_MPS, _REGION_S = 0.02, 0.2
#: The margin is low after the first time, s, restored after it where there is room, and after the
#: second in the hysteresis region, where the noise that made it low comes back.
MARGIN_S, MARGIN_RESTORE_S = 0.1, 20.0
#: Time constant of the noise floor, s: some thirty periods tell a mean square to 18 %.
_FLOOR_S = 10.0
#: The logarithm of the noise intensity is known no better: simulated, with filters of no lag and
#: of 0.15 s.
_INTENSITY = 0.25
#: Without a floor yet, the standard deviation of the amplitude estimate stands in, so often.
_STD_FLOORS = 1.5
#: The two amplitudes disagree after this time, s: the envelope needs as long to follow.
_DISAGREE_S = 1.0


def fresh_memory() -> NDArray[np.void]:
    """Return the memory of a detector that has seen nothing: MEMORY, shape (1,)."""
    memory = np.zeros(1, dtype=MEMORY)
    for name in ('square', 'missed', 'intensity'):
        memory['floor'][name] = math.nan
    for name in ('mean', 'speed', 'at'):
        memory['motion'][name] = math.nan
    memory['motion']['prior'] = switching.BEGINS
    memory['state']['reference'] = math.nan
    memory['outlook'] = NO_OUTLOOK
    return memory


def kept(memory: NDArray[np.void], *, floor: bool, reference: bool) -> NDArray[np.void]:
    """
    Return a fresh memory with what no new beginning ends.

    That are limits, hunting and alarm, for nothing has been seen of their end; and, where the
    sizes are still those of the same coordinate, the noise floor and the size of the hunting.
    """
    fresh = fresh_memory()
    for name in ('limits', 'limit_since_ns', 'causes', 'alarm', 'acknowledged'):
        fresh[name] = memory[name]
    state, old = fresh['state'], memory['state']
    state['hunting'], state['cause'] = old['hunting'], old['cause']
    state['hunting']['wanted'], state['hunting']['waited'] = old['hunting']['word'], 0
    if old['hunting']['word'][0] != states.NO:
        fresh['motion']['prior'] = 1.0
    if reference:
        state['reference'] = old['reference']
    if floor:
        fresh['floor'] = memory['floor']
    return fresh


def acknowledge(memory: Any) -> None:
    """Take the alarm back: at once, or once its causes are over."""
    if memory['alarm']:
        memory['acknowledged'] = memory['alarm'] = memory['causes'] != 0


@compiled
def decide(
    rules: Rules,
    form: FormNumbers,
    memory: Annotated[NDArray[np.void], 1, MEMORY],
    disagree: B1,
    trusted: B1,
    rows: Annotated[NDArray[np.void], 1, ESTIMATE_DTYPE],
) -> None:
    """
    Judge rows in order.

    Parameters
    ----------
    rules, form
        Thresholds and normal form; the latter is not used with `form.known` false.
    memory : ndarray of MEMORY, shape (1,)
        What is remembered from the rows before.
    disagree : ndarray of bool, shape (m,)
        The two amplitude estimates differ in this row.
    trusted : ndarray of bool, shape (m,)
        There is a motion sensor to trust.
    rows : ndarray of ESTIMATE_DTYPE, shape (m,)
        With the fields of the tracker, the speed, what is judged, and the doubts about these.
        Filled in: noise floor and intensity, all that `form` knows, region
        and state with their beginning and cause, limits, doubts, alarm.
    """
    m = memory[0]
    for k in range(rows.size):
        out = rows[k]
        a, s, v = out['judged'], out['judged_std'], out['speed']
        known = not math.isnan(a)
        _take_region(rules, m['region'], v, out)
        predictable = form.known and not math.isnan(v)
        predict(form, m['outlook'], v, a, s, out)
        _learn(rules, form, m, a, s, predictable, out)
        other = undecided = False
        if known:
            # What has begun to hunt is the hunting, at whatever frequency it goes on. A motion is
            # not the more one for a speed that is not read any more: the last one stands.
            of_the_form = m['state']['hunting']['word'] != states.NO or not form.known
            if not of_the_form:
                of_the_form = is_hunting_of(form, rules.nominal_hz, m['motion']['speed'], a, out)
            parts = m['state'], m['motion']
            other, undecided = states.judge(rules, *parts, a, s, of_the_form, out)
        states.tell(m['state'], m['motion'], out)
        if out['state'] == states.LIMIT_CYCLE:
            _hold_to_form(rules, out)
        if known and form.known and out['state'] == states.ESCAPING:
            out['time_to_limit_cycle'] = time_to_cycle(form, v, a, out)
        undecided &= out['state'] < states.ESCAPING
        undecided |= out['state'] == states.QUIET and math.isnan(m['floor']['square'])
        if a > SMALLEST * form.fold_amplitude and out['state'] < states.ESCAPING:
            # A form may be wrong about the speed, and a floor be learnt on hunting: as large as a
            # limit cycle, what may hunt, or passes for quiet, is not well.
            undecided |= switching.hunts(m['motion']) > 1.0 - states.LIKELY
            undecided |= out['state'] == states.QUIET
        if known and not undecided:
            out['doubts'] -= out['doubts'] & doubts.ON_LINE
        _doubt(rules, m, known, disagree[k], other, undecided, out)
        period_rows = 1.0 / (rules.period_s * rules.nominal_hz)
        over = limits.watch(rules.limits, period_rows, m, trusted[k], out) & limits.ALARMS
        hunts = m['state']['hunting']['word'] in (states.ESCAPING, states.LIMIT_CYCLE)
        causes = 2 * over + hunts
        if causes & ~m['causes']:
            m['alarm'], m['acknowledged'] = True, False
        elif causes == 0 and m['acknowledged']:
            m['alarm'] = m['acknowledged'] = False
        m['causes'] = causes
        out['alarm'] = m['alarm']


@compiled_part
def _hold_to_form(rules: Rules, out: Any) -> None:
    """Take back what a form says of a limit cycle that it has die out: it is refuted."""
    if out['escape_probability'] < 1.0 - rules.probability_in:
        out['doubts'] |= doubts.REFUTED
        out['margin'] = out['margin_low'] = out['margin_high'] = math.nan
        out['escape_probability'] = out['outlook'] = math.nan
        out['escape_probability_low'] = out['escape_probability_high'] = math.nan


@compiled_part
def _take_region(rules: Rules, memory: Any, v: float, out: Any) -> None:
    wanted = region_of(memory['word'], v, rules.v_n, rules.v_c, _REGION_BAND_MPS)
    rows = 0 if memory['word'] == 0 or wanted == 0 else rows_of(rules, _REGION_S)
    hold(memory, wanted, rows, out['stamp_ns'])
    out['region'] = memory['word']
    out['region_since_ns'] = memory['since_ns']


@compiled_part
def _learn(
    rules: Rules, form: FormNumbers, m: Any, a: float, s: float, predictable: bool, out: Any
) -> None:
    """Learn from a row what is quiet, and what its amplitude does."""
    v, word = out['speed'], m['state']['hunting']['word']
    drift = growth_at(form, v, a) if predictable else math.nan
    line = (out['doubts'] & doubts.ON_LINE) != 0
    spread = math.hypot(s, 0.5 * out['step'])
    basin = not (predictable and growth_at(form, v, 0.0) > 0.0)
    switching.watch(rules, m['motion'], v, a, spread, drift, basin, line)
    motion, floor = m['motion'], m['floor']
    noise = switching.settled(motion) and word in (states.NO, states.DECAYING)
    noise &= switching.hunts(motion) < states.AS_LIKELY
    # By the form, what is as likely as not on its way to the cycle is no quiet motion,
    # and what grows at this speed is hunting that begins.
    noise &= not out['escape_probability'] > states.AS_LIKELY
    noise &= not (predictable and m['outlook']['quiet'] < 1.0 - rules.probability_in)
    if noise and not math.isnan(a):
        floor['learnt'] += 1.0
        weight = max(1.0 / floor['learnt'], rules.stride / _FLOOR_S)
        before = 0.0 if math.isnan(floor['square']) else floor['square']
        # What was kicked and dies out is more than noise alone makes.
        floor['square'] = before + weight * (min(a * a, motion['alone']) - before)
        # A kick tells nothing of the noise, nor does the error of the filter behind it.
        if a * a < states.CALM**2 * floor['square']:
            error = 2.0 * s * s
            missed = error if math.isnan(floor['missed']) else floor['missed']
            floor['missed'] = missed + weight * (error - missed)
            damping = -growth_at(form, v, 0.0) if predictable else 0.0
            # What the tracker makes of the motion and what it misses add up to its mean square.
            driven = max(damping * (floor['square'] + floor['missed']), motion['driven'])
            floor['intensity'] = 0.5 * driven
            lasts = 2.0 * max(damping, rules.least_damping) * _FLOOR_S / rules.faster
            floor['spread'] = math.hypot(_INTENSITY, 1.0 / math.sqrt(1.0 + lasts))
    if not math.isnan(floor['square']):
        out['noise_floor'] = math.sqrt(floor['square'])
    elif switching.settled(motion) and s > 0.0:
        out['noise_floor'] = _STD_FLOORS * s
    out['noise_intensity'] = floor['intensity']


@compiled_part
def _doubt(
    rules: Rules, m: Any, known: bool, disagree: bool, other: bool, settling: bool, out: Any
) -> None:
    """Fill in the doubts of a row that is judged but for them."""
    region, state, stamp_ns = out['region'], out['state'], out['stamp_ns']
    on = m['margin']['word'] > 0
    low = out['margin'] < rules.margin_in
    wait = MARGIN_S
    if math.isnan(out['margin']):
        # No unstable branch: below v_n there is room enough, above v_c there is none. What
        # hunts, or is not known, has none to be restored.
        low = on and (region != 1 or state >= states.ESCAPING or not known)
    elif on:
        wait = MARGIN_RESTORE_S
    hold(m['margin'], int(low), rows_of(rules, wait), stamp_ns)
    out['margin_since_ns'] = m['margin']['since_ns']
    hold(m['disagree'], int(disagree), rows_of(rules, _DISAGREE_S), stamp_ns)
    bits = doubts.MARGIN if m['margin']['word'] > 0 else 0
    if m['disagree']['word'] > 0:
        bits |= doubts.DISAGREE
    if math.isnan(out['speed']):
        bits |= doubts.NO_SPEED
    elif region == 0:
        bits |= doubts.NO_FORM
    if not known:
        bits |= doubts.NO_ESTIMATE
    elif settling:
        bits |= doubts.SETTLING
    if other:
        bits |= doubts.OTHER
    if state == states.DECAYING:
        bits |= doubts.DECAYING
    if region == 2:
        bits |= doubts.HYSTERESIS
    elif region == 3:
        bits |= doubts.UNSTABLE
    out['doubts'] |= bits
