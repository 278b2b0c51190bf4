"""The sections of the benchmark of the detector, from everything that was measured."""

from __future__ import annotations

import math

from detection_bounds import cusum_bound, window
from detection_kicks import WAITS, Verdict
from detection_measured import TRUTH, Measured, disturbed_against_cfr, limited_delay, missed
from detection_quiet import Watch, limits, microseconds
from detection_quiet import table as quiet_table
from detection_rigs import BENCHES
from detection_steady import criterion_errors, worst
from detection_steady import table as steady_table
from detection_sweeps import table as sweeps_table
from detection_verdicts import (
    Reliability,
    balanced_error,
    bounds_table,
    disturbed_delays,
    escape_delays,
    false_alarms,
    false_table,
    median_95,
    near_critical,
    near_critical_table,
    own_limits,
    reliability_table,
)
from tables import markdown

from hunt_ros.criteria import CRITERIA


def sections(measured: Measured) -> list[str]:
    """Return the tables, in order, each with what it is."""
    return [
        _set_up(measured),
        _quiet(measured),
        _near_critical(measured),
        _reliability(measured),
        _delays(measured),
        _bounds(measured),
        _knowledge(measured),
        _other_rig(measured),
        _amplitude(measured),
        _speeds(measured),
    ]


def _set_up(measured: Measured) -> str:
    paper, other = BENCHES['paper'], BENCHES['14 m/s']
    edges = ', '.join(f'{1e6 * paper.unstable(v):.0f} um at {v}' for v in paper.kick_speeds)
    far = ', '.join(f'{1e6 * other.unstable(v):.0f} um at {v}' for v in other.kick_speeds)
    return (
        f'Scale {measured.scale:g}. Unstable amplitudes {edges} m/s; on the rig of other creep,'
        f' conicity, size and frequency (v_c = 14 m/s, 2 Hz, {other.scale:.1f} times as large)'
        f' {far} m/s. Sensors at 500 Hz, 5 um and 20 urad of noise. Kicks in y, dy/dt, psi and'
        ' dpsi/dt in turn, without and with 20 um of roughness, each in units of the kick that'
        ' the full model, bisected without noise at the same phase of the roller, just survives.'
        ' Every kick has noise of its own and is followed until it hunts or is quiet.'
    )


def _quiet(measured: Measured) -> str:
    watches = measured.quiet_of(TRUTH)
    rows = sum(one.rows for one in watches)
    doubts = 100.0 * sum(one.disagreeing for one in watches) / max(rows, 1)
    return (
        '**Quiet running** at 6.0, 7.2 and 7.6 m/s, roughness 0, 20 and 50 um (a run ends where'
        ' the noise really throws the wheelset out):\n\n'
        + quiet_table(watches)
        + f'\n\nFilter and envelope disagreed in {doubts:.2f} % of the rows.'
    )


def _near_critical(measured: Measured) -> str:
    return (
        '**Kicks of 0.95 and 1.05 times the critical kick**: error of P > 0.5, balanced over'
        ' what really happened. The true chance is that of wheelsets which go on from the same'
        ' motion under other noise (a part of the kicks without roughness): knowing the motion'
        ' exactly nobody decides better, but for the scatter of seven such wheelsets.\n\n'
        + near_critical_table(measured.kicks)
    )


def _reliability(measured: Measured) -> str:
    return (
        '**P against what came of it**, all kicks; the sampling error is that of the share'
        ' escaped, were P true:\n\n'
        + reliability_table(measured.kicks)
        + '\n\nAlarms after which the wheelset came back:\n\n'
        + false_table(measured.kicks)
    )


def _delays(measured: Measured) -> str:
    """Ours and the criteria at the same false-alarm rate."""
    watches, verdicts = measured.quiet_of(TRUTH), measured.kicks
    one_limit, cells = limits(watches), own_limits(verdicts)
    cpu, errors = microseconds(watches), criterion_errors(measured.readings)
    escaped = [one for one in verdicts if one.escaped and one.kick.factor >= 1.2]
    back = [one for one in verdicts if not one.escaped]
    alarms = sum(sum(one.alarms) for one in watches)
    rows: list[list[object]] = []
    ours = escape_delays(escaped, 1.2, 2.0)
    false = sum(math.isfinite(one.alarm) for one in back)
    error = worst(measured.readings_of(TRUTH))
    row = ['ours: escaping', median_95(ours), missed(ours), f'{false} of {len(back)}', alarms]
    rows.append([*row, f'{error:.1f} %', f'{cpu["ours"]:.2f}'])
    for name in CRITERIA:
        for kind in ('one limit', 'own limits'):
            own = cells if kind == 'own limits' else None
            limit = one_limit[name]
            late = [limited_delay(one, name, limit, own) for one in escaped]
            false = sum(math.isfinite(limited_delay(one, name, limit, own)) for one in back)
            row = [f'{name}, {kind}', median_95(late), missed(late), f'{false} of {len(back)}']
            same = alarms if own is None else '-'
            rows.append([*row, same, f'{abs(errors[name]):.1f} %', f'{cpu[name]:.2f}'])
    hours = sum(one.hours for one in watches)
    header = ['detector', 'delay, s (median / 95 %)', 'missed within 8 s', 'came back after it']
    header += [f'false in {hours:.1f} h', 'amplitude error', 'CPU, us a sample']
    return (
        '**Kicks of 1.2 and 2 times the critical kick that escaped**, all noise. The criteria'
        ' with one limit have that which speaks in as many minutes of the quiet running as ours;'
        ' with own limits, one for each speed, noise and roughness, from the quiet seconds before'
        ' the kicks (nobody has these beforehand). Amplitude: ours at worst, theirs what'
        ' the index in the limit cycle implies at the nominal frequency. CPU: ours takes in the'
        ' yaw, roller and speed samples of a lateral sample too.\n\n' + markdown(header, rows)
    )


def _bounds(measured: Measured) -> str:
    ours, own, single = disturbed_against_cfr(measured)
    rows = [
        ['ours: disturbed', median_95(ours), missed(ours)],
        ['cfr_213_333, own limits', median_95(own), missed(own)],
        ['cfr_213_333, one limit', median_95(single), missed(single)],
    ]
    v, hours = BENCHES['paper'].kick_speeds[1], 24.0
    return (
        '**After any kick**, limits of the CFR structure that speak as often in quiet running as'
        ' `disturbed`. Given limits for each speed, noise and roughness it sees the jump'
        ' of the kick itself; but so it does of kicks that come back, as the table above says.\n\n'
        + markdown(['detector', 'delay, s (median / 95 %)', 'missed within 8 s'], rows)
        + '\n\n**Delays against the bounds**, A_rms/A_u up to 0.05, medians. The window is the'
        ' shortest in which any estimator can know the amplitude to 5 %, with a second mode of'
        ' unknown phasor and roughness and bias known from before; the sign bound is the closed'
        ' form of the time to know growth at 3 sigma, which knows no second mode and so is out of'
        ' reach in the first 0.3 s. By CUSUM a known-phase kick of 0.8 at 7.2 m/s takes'
        f' {1e3 * cusum_bound("paper", v, 0.8, hours):.0f} ms (one sample: it does not bind).\n\n'
        + bounds_table(measured.kicks)
    )


def _knowledge(measured: Measured) -> str:
    rows = []
    for watcher in dict.fromkeys(one.watcher for one in measured.other_kicks):
        some = [one for one in measured.other_kicks if one.watcher == watcher]
        watches = measured.quiet_of(watcher)
        rows.append([watcher.split(': ')[1], *_summary(some), _quiet_alarms(watches)])
    header = ['the detector has', *_SUMMARY, 'alarms in quiet, A_rms/A_u = 0.2']
    fits = measured.refits['paper']
    return (
        f'**What the detector knows, and what is wrong with its inputs**: the same'
        f' {len([o for o in measured.other_kicks if o.watcher == TRUTH])} kicks of all sizes at'
        ' A_rms/A_u = 0.05. Where there is no P, `escaping` or `limit_cycle` until then stands'
        f' for it. {fits} of 3 staircases gave a form.\n\n' + markdown(header, rows)
    )


_SUMMARY = [
    'error 0.4 s, 0.95 and 1.05',
    'error 2 s',
    'Brier 1 s',
    'disturbed, s',
    'escaping, s: 1.2',
    'escaping, s: 2',
    'missed',
    'alarms that came back (1 - P)',
    'alarms before',
]


def _summary(verdicts: list[Verdict]) -> list[object]:
    near = near_critical(verdicts)
    known = any(one.probability[1] >= 0.0 for one in verdicts)
    false, alarms, said = false_alarms(verdicts)
    late = escape_delays(verdicts, 1.2, 2.0)
    return [
        f'{balanced_error(near, 0.4):.1f} %',
        f'{balanced_error(near, 2.0):.1f} %',
        f'{Reliability.of(verdicts, WAITS[1]).brier:.3f}' if known else '-',
        median_95(disturbed_delays(verdicts)),
        median_95(escape_delays(verdicts, 1.2)),
        median_95(escape_delays(verdicts, 2.0)),
        missed(late),
        f'{false} of {alarms}' + (f' ({said:.1f})' if known else ''),
        sum(one.alarms_before for one in verdicts),
    ]


def _quiet_alarms(watches: list[Watch]) -> str:
    if not watches:
        return '-'
    return f'{sum(sum(o.alarms) for o in watches)} in {sum(o.hours for o in watches):.1f} h'


def _other_rig(measured: Measured) -> str:
    rows = []
    for key in dict.fromkeys((one.watcher, one.kick.ratio) for one in measured.rig_kicks):
        some = [one for one in measured.rig_kicks if (one.watcher, one.kick.ratio) == key]
        rows.append([key[0].split(': ')[1], key[1], *_summary(some)])
    kicks = sum(one.watcher == '14 m/s: true form' for one in measured.rig_kicks)
    shortest = window('14 m/s', BENCHES['14 m/s'].kick_speeds[1], 1.2)
    return (
        f'**The rig of 14 m/s and 2 Hz**, {kicks} kicks, nominal'
        f' frequency 2 Hz, all else as it comes; 5 % window {shortest:.2f} s. Quiet running:'
        f' {_quiet_alarms(measured.quiet_of("14 m/s: true form"))} alarms.\n\n'
        + markdown(['the detector has', 'A_rms/A_u', *_SUMMARY], rows)
    )


def _amplitude(measured: Measured) -> str:
    return (
        '**Amplitude in the limit cycle**, roughness 30 um, broadband 8e-6: error of the mean'
        ' over 20 s against the true motion, mean (largest) over the seeds. A dead sensor is dead'
        ' from 2 s on, before the hunting begins.\n\n'
        + '\n\n'.join(
            steady_table([one for one in measured.readings if one.task.bench == rig])
            for rig in dict.fromkeys(one.task.bench for one in measured.readings)
        )
    )


def _speeds(measured: Measured) -> str:
    return (
        '**Changing speed**: sweeps of 0.004 v_c a second and staircases of 0.025 v_c with 25 s'
        ' holds, 0.75 to 1.1 v_c and back; roughness 20 um, broadband 8e-6. Hunting in earnest is'
        ' half the limit cycle at 1.05 v_c; medians (ranges). Staircases gave'
        f' {measured.refits["supercritical"]} of 3 forms of the supercritical rig.\n\n'
        + sweeps_table(measured.courses)
        + f'\n\nQuiet running of the supercritical rig: {_supercritical(measured)}.'
    )


def _supercritical(measured: Measured) -> str:
    told = [one for one in measured.quiet if one.watcher.startswith('supercritical')]
    claimed = sum(one.hysteresis_claimed for one in told)
    return f'{_quiet_alarms(told)} alarms, hysteresis region claimed {claimed} times'
