"""
The decisions, row by row: what is quiet, what the form says, and what follows.

One compiled kernel over a block of rows, with its memory in a record, so that an hour
of rows costs a fraction of a second and the live detector runs the very same code on one
row. Its parts are `likelihood`, `noise_floor` and `noise_intensity` (what quiet is),
`prediction` (what the form says), `evidence`, `states` and `doubts` (what follows).
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, R1, compiled, compiled_part
from hunt_ros.detection import regions
from hunt_ros.detection.decision import (
    doubts,
    evidence,
    likelihood,
    noise_floor,
    noise_intensity,
    prediction,
    states,
)
from hunt_ros.detection.decision.outlook import NO_OUTLOOK, OUTLOOK, FormNumbers
from hunt_ros.detection.decision.rules import Rules
from hunt_ros.detection.output import ESTIMATE_DTYPE
from hunt_ros.detection.regions import hold, latch, region_of

_F = NDArray[np.float64]

#: All that is remembered from row to row, by the part that owns it.
MEMORY: np.dtype[np.void] = np.dtype(
    [
        ('floor', noise_floor.NOISE_FLOOR),
        ('ratios', likelihood.LIKELIHOOD),
        ('noise', noise_intensity.NOISE_INTENSITY),
        ('outlook', OUTLOOK),
        ('region', regions.HELD),
        ('evidence', evidence.EVIDENCE),
        ('state', states.STATE),
        ('doubts', doubts.DOUBTS),
    ],
    align=True,
)


def fresh_memory() -> NDArray[np.void]:
    """Return the memory of a detector that has seen nothing: MEMORY, shape (1,)."""
    memory = np.zeros(1, dtype=MEMORY)
    memory['floor']['square'] = math.nan
    memory['noise']['intensity'] = math.nan
    memory['evidence']['reference'] = math.nan
    memory['outlook'] = NO_OUTLOOK
    return memory


@compiled
def decide(
    rules: Rules,
    form: FormNumbers,
    memory: Annotated[NDArray[np.void], 1, MEMORY],
    amplitude: R1,
    amplitude_std: R1,
    outside: R1,
    disagree: B1,
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
    amplitude, amplitude_std : ndarray, shape (m,)
        Of the channel that is judged, m; NaN where unknown or not to be trusted.
    outside : ndarray, shape (m,)
        Amplitude of its motion outside the range that is followed, m; NaN: there is none.
    disagree : ndarray of bool, shape (m,)
        The two amplitude estimates differ in this row.
    rows : ndarray of ESTIMATE_DTYPE, shape (m,)
        With the fields of the tracker, the speed, the step of the readings, and the doubts
        about these. Filled in: noise floor and intensity, all that `prediction` knows, region
        and state with their beginning and cause, doubts, alarm.
    """
    m = memory[0]
    for k in range(amplitude.size):
        out = rows[k]
        a, s, v = amplitude[k], amplitude_std[k], out['speed']
        known = not math.isnan(a)
        prediction.clear(out)
        stamp_ns = out['stamp_ns']
        region = _region(rules, m['region'], v, stamp_ns)
        predictable = form.known and not math.isnan(v)
        if predictable:
            damping = prediction.branches(form, v, out['lateral_roughness'], out)
            if known:
                prediction.judge(
                    form,
                    m['outlook'],
                    v,
                    a,
                    s,
                    damping,
                    rules.outlook_s,
                    out,
                )
        quiet = other = undecided = False
        idle = m['state']['hunting']['word'] == states.NO
        if idle and likelihood.moved_on(rules, m['ratios'], v):
            likelihood.begin_anew(m['ratios'], v)
            if not predictable or m['outlook']['quiet'] > 0.5:  # else there is none to learn
                noise_floor.begin_anew(m['floor'])
        if known:
            drift = prediction.growth_at(form, v, a) if predictable else math.nan
            likelihood.watch(rules, m['ratios'], a, math.hypot(s, 0.5 * out['step']), drift)
            noise_floor.observe(rules, m['floor'], a)
            if m['state']['hunting']['word'] == states.NO:
                # By the form, what grows from here is hunting that begins.
                sure = rules.probability_in
                beyond = out['escape_probability'] > sure
                beyond |= predictable and m['outlook']['quiet'] < 1.0 - sure
                quiet = noise_floor.learn(rules, m['floor'], m['ratios'], a, not beyond)
        else:
            likelihood.interrupt(m['ratios'])
        if quiet and predictable:
            noise_intensity.learn(rules, form, m['noise'], v, a, out['phase'])
        else:
            noise_intensity.interrupt(m['noise'])
        out['noise_floor'] = noise_floor.floor_of(m['floor'], m['ratios'], s)
        out['noise_intensity'] = m['noise']['intensity']
        if known:
            # What has begun to hunt is the hunting, at whatever frequency it goes on.
            of_the_form = m['state']['hunting']['word'] != states.NO or not predictable
            if not of_the_form:
                hz, std_hz = out['frequency_hz'], out['frequency_hz_std']
                of_the_form = prediction.is_hunting_of(form, rules.nominal_hz, v, hz, std_hz)
                of_the_form &= prediction.is_cycle_of(form, a, out)
            found = evidence.gather(
                rules,
                m['evidence'],
                m['ratios'],
                m['state']['hunting']['word'],
                a,
                s,
                outside[k],
                of_the_form,
                out,
            )
            other, undecided = found.other, found.undecided
            states.next_state(rules, m['state'], m['evidence'], m['floor'], found, a, s, stamp_ns)
        state = states.shown(m['state'])
        if known and form.known and state == states.ESCAPING:
            out['time_to_limit_cycle'] = prediction.time_to_cycle(form, v, a, out)
        bits = doubts.hold_doubts(
            rules, m['doubts'], region, state, known, disagree[k], out['margin'], stamp_ns
        )
        latch(m['state'], states.hunts(m['state']))
        out['region'] = region
        out['region_since_ns'] = m['region']['since_ns']
        out['state'] = state
        out['state_since_ns'] = states.since_ns(m['state'])
        cause = m['state']['cause']
        out['state_cause'] = cause
        ratio, limit = states.ratio_behind(rules, m['ratios'], cause)
        out['log_likelihood_ratio'] = ratio
        out['log_likelihood_ratio_limit'] = limit
        out['margin_since_ns'] = m['doubts']['margin']['since_ns']
        out['alarm'] = m['state']['alarm']
        settling = state == states.QUIET and noise_floor.unlearnt(m['floor'])
        settling |= undecided and state < states.ESCAPING
        out['doubts'] |= bits | doubts.present(region, state, v, known, settling, other)


@compiled_part
def _region(rules: Rules, memory: Any, v: float, stamp_ns: int) -> int:
    wanted = region_of(memory['word'], v, rules.v_n, rules.v_c, rules.region_band)
    rows = 0 if memory['word'] == 0 or wanted == 0 else rules.region_hold
    hold(memory, wanted, rows, stamp_ns)
    return int(memory['word'])
