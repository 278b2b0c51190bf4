"""The goals of the detector, what was measured, and whether they are met."""

from __future__ import annotations

import math

import numpy as np
from detection_bounds import window
from detection_kicks import WAITS
from detection_measured import TRUTH, Measured, disturbed_against_cfr
from detection_rigs import BENCHES
from detection_steady import bias, unknown, worst
from detection_verdicts import (
    Reliability,
    balanced_error,
    escape_delays,
    false_alarms,
    median,
    near_critical,
)
from tables import markdown

_CALM = (0.02, 0.05)
_LOUD = (0.1, 0.2)


def goals(measured: Measured) -> str:
    """Return the table of goals, and what falls short in a line."""
    rows = [
        *_disturbed(measured),
        *_escaping(measured),
        *_false(measured),
        *_calibration(measured),
        *_other_rig(measured),
        *_amplitude(measured),
        *_speeds(measured),
    ]
    short = [str(row[0]) for row in rows if row[3] == '**no**']
    what = '; '.join(short) if short else 'nothing'
    return (
        '**Goals**\n\n'
        + markdown(['goal', 'wanted', 'measured', 'met'], rows)
        + f'\n\nWhat falls short: {what}.'
    )


def _row(name: str, wanted: str, measured: str, met: bool) -> list[object]:
    return [name, wanted, measured, 'yes' if met else '**no**']


def _disturbed(measured: Measured) -> list[list[object]]:
    ours, own, single = disturbed_against_cfr(measured)
    share = [
        one.disturbed / window(one.kick.bench, one.kick.speed, one.kick.factor)
        for one in measured.kicks
        if not math.isnan(one.disturbed)
    ]
    late, sooner = median(share), median(own) / median(ours)
    far = median(single) / median(ours)
    text = f'{far:.1f} times (given a limit for each speed, noise and roughness: {sooner:.1f})'
    return [
        _row('`disturbed` after a kick, in 5 % windows', '<= 0.6', f'{late:.2f}', late <= 0.6),
        _row('`disturbed` sooner than the CFR structure', '>= 8 times', text, far >= 8.0),
    ]


def _escaping(measured: Measured) -> list[list[object]]:
    near = near_critical(measured.kicks, _CALM)
    asked = [one for one in near if one.foretold]
    rows = []
    for wait, limit in ((WAITS[0], 10.0), (WAITS[2], 3.0)):
        error = balanced_error(near, wait)
        text = f'{error:.1f} %'
        if asked:
            text += (
                f' ({balanced_error(asked, wait):.1f} % where the true chance has'
                f' {balanced_error(asked, wait, True):.1f} %)'
            )
        name = f'kicks of 0.95 and 1.05, A_rms/A_u <= 0.05: balanced error after {wait:g} s'
        rows.append(_row(name, f'<= {limit:g} %', text, error <= limit))
    calm = [one for one in measured.kicks if one.kick.ratio in _CALM]
    late = median(escape_delays(calm, 1.2))
    name = 'kicks of 1.2, A_rms/A_u <= 0.05: median delay of `escaping`'
    rows.append(_row(name, '<= 0.4 s', f'{late:.2f} s', late <= 0.4))
    return rows


def _false(measured: Measured) -> list[list[object]]:
    watches = measured.quiet_of(TRUTH)
    alarms, hours = sum(sum(one.alarms) for one in watches), sum(one.hours for one in watches)
    rows = [
        _row('false `escaping` in quiet running', '0', f'{alarms} in {hours:.1f} h', not alarms)
    ]
    for name, ratios in (('A_rms/A_u 0.1 and 0.2', _LOUD), ('A_rms/A_u <= 0.05', _CALM)):
        some = [one for one in measured.kicks if one.kick.ratio in ratios]
        false, total, said = false_alarms(some)
        # As many as 1 - P says, to within two of their own sampling errors.
        allowed = said + 2.0 * math.sqrt(max(said, 1.0))
        text = f'{false} of {total} alarms, 1 - P adds up to {said:.1f}'
        label = f'false `escaping` after kicks, {name}'
        rows.append(_row(label, 'no more than 1 - P says', text, false <= allowed))
    return rows


def _calibration(measured: Measured) -> list[list[object]]:
    rows = []
    for wait in WAITS:
        found = Reliability.of(measured.kicks, wait)
        gap, errors = found.worst
        text = f'{gap:.3f}, {errors:.1f} sampling errors; Brier {found.brier:.4f}'
        name = f'reliability of P {wait:g} s after a kick, worst bin'
        row = _row(name, '<= 0.05', text, gap <= 0.05)
        if gap > 0.05 and errors < 2.0:
            row[3] = 'open: too few kicks to tell'
        rows.append(row)
    return rows


def _amplitude(measured: Measured) -> list[list[object]]:
    """One row a condition, the rigs side by side."""
    rows = []
    names = [one.task.knowledge.name.split(': ') for one in measured.readings]
    for condition in dict.fromkeys(name for _, name in names):
        text, errors = [], []
        for rig in dict.fromkeys(rig for rig, name in names if name == condition):
            some = measured.readings_of(f'{rig}: {condition}')
            errors.append(worst(some))
            words = f'{errors[-1]:.2f} % at worst, mean {bias(some):+.2f} %'
            if unknown(some):
                words += f', {unknown(some)} of {len(some)} unknown'
            text.append(f'{words} ({rig})')
        name = f'amplitude in steady state: {condition}'
        rows.append(_row(name, '<= 3 %', '; '.join(text), max(errors) <= 3.0))
    return rows


def _other_rig(measured: Measured) -> list[list[object]]:
    """The goals of the kicks once more, on a rig nothing was tried on."""
    rows = []
    for watcher in dict.fromkeys(one.watcher for one in measured.rig_kicks):
        some = [one for one in measured.rig_kicks if one.watcher == watcher]
        near, calm = near_critical(some, _CALM), [o for o in some if o.kick.ratio in _CALM]
        first, last = balanced_error(near, WAITS[0]), balanced_error(near, WAITS[2])
        late = median(escape_delays(calm, 1.2))
        false, total, said = false_alarms(some)
        allowed = said + 2.0 * math.sqrt(max(said, 1.0))
        text = (
            f'{first:.1f} %, {last:.1f} %, {late:.2f} s; {false} false of {total}'
            f' ({said:.1f} by 1 - P)'
        )
        met = first <= 10.0 and last <= 3.0 and late <= 0.4 and false <= allowed
        name = f'the same of the rig of {watcher}'
        rows.append(_row(name, '<= 10 %, 3 %, 0.4 s, 1 - P', text, met))
    return rows


def _speeds(measured: Measured) -> list[list[object]]:
    hunting = [one for one in measured.courses if one.hunted]
    found = sum(not math.isnan(one.lead) for one in hunting)
    false = sum(len(one.false_speeds) for one in measured.courses)
    supercritical = [one for one in measured.courses if one.run.bench == 'supercritical']
    v_c = BENCHES['supercritical'].v_c
    below = sum(
        any(np.array(one.false_speeds) < 0.999 * v_c) or one.alarm_speed < 0.98 * v_c
        for one in supercritical
    )
    claimed = sum(one.hysteresis_claimed for one in supercritical)
    runs = len(measured.courses)
    return [
        _row(
            'sweeps, staircases: hunting found',
            'all',
            f'{found} of {len(hunting)}',
            found == len(hunting),
        ),
        _row(
            'sweeps, staircases: alarms without hunting', '0', f'{false} in {runs} runs', not false
        ),
        _row(
            'supercritical rig: hysteresis claimed, alarms below v_c',
            '0, 0',
            f'{claimed}, {below} in {len(supercritical)} runs',
            not claimed and not below,
        ),
    ]
