"""Numbers and tables from the verdicts on kicks."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from detection_bounds import sign_bound, window
from detection_kicks import EACH, FACTORS, NEAR, RATIOS, WAITS, Verdict
from detection_rigs import BENCHES, RATE_HZ
from detection_scenarios import Kick
from tables import markdown

from hunt_ros.criteria import CRITERIA

_BINS = (0.0, 0.05, 0.3, 0.7, 0.95, 1.0001)


def median_95(values: list[float]) -> str:
    """Median and 95 % quantile; a miss counts as infinitely late."""
    if not values:
        return '-'
    return ' / '.join(f'{np.quantile(values, q, method="higher"):.2f}' for q in (0.5, 0.95))


def median(values: list[float]) -> float:
    return float(np.quantile(values, 0.5, method='higher')) if values else math.nan


def balanced_error(verdicts: list[Verdict], wait: float, foretold: bool = False) -> float:
    """
    Error of `P > 0.5` (of `hunting`, where there is no P), balanced over the outcomes, %.

    With `foretold` that of the true chance: nobody can do better who has not seen the noise
    to come. A chance of one half is half an error.
    """
    place = WAITS.index(wait)
    wrong: dict[bool, list[float]] = {True: [], False: []}
    for one in verdicts:
        p = one.foretold[place] if foretold else one.probability[place]
        if math.isnan(p):
            p = float(one.hunting[place])
        wrong[one.escaped].append(0.5 if p == 0.5 else float((p > 0.5) != one.escaped))
    return 50.0 * sum(float(np.mean(side)) if side else 0.0 for side in wrong.values())


def disturbed_delays(verdicts: list[Verdict]) -> list[float]:
    """Delays of `disturbed` of the kicks that found the detector quiet."""
    return [one.disturbed for one in verdicts if not math.isnan(one.disturbed)]


def escape_delays(verdicts: list[Verdict], *factors: float) -> list[float]:
    """Delays of the alarm on kicks of these factors that did escape."""
    return [one.alarm for one in verdicts if one.escaped and one.kick.factor in factors]


def criterion_delay(one: Verdict, name: str, limit: float) -> float:
    """Delay of a criterion with this limit, s; inf where it does not answer in time."""
    over = np.flatnonzero(one.indices[name] > limit)
    return float(over[0] + 1) * EACH / RATE_HZ if over.size else math.inf


Cell = tuple[float, float, float]


def cell_of(kick: Kick) -> Cell:
    """Speed, noise and roughness: what a limit of its own can be set for."""
    return kick.speed, kick.ratio, kick.roughness


def own_limits(verdicts: list[Verdict], before: str = 'alarms_before') -> dict[Cell, dict]:
    """
    Limits of the criteria for each speed, noise and roughness by itself.

    In the quiet running before the kicks each is exceeded as often as ours spoke there:
    `before` is 'alarms_before' or 'disturbed_before'.
    """
    cells: dict[Cell, dict] = {}
    for cell in {cell_of(one.kick) for one in verdicts}:
        some = [one for one in verdicts if cell_of(one.kick) == cell]
        ours = sum(getattr(one, before) > 0 for one in some)
        cells[cell] = {}
        for name in CRITERIA:
            largest = sorted((one.indices_before[name] for one in some), reverse=True)
            cells[cell][name] = largest[min(ours, len(largest) - 1)]
    return cells


def false_alarms(verdicts: list[Verdict]) -> tuple[int, int, float]:
    """Alarms whose wheelset came back; all alarms; what 1 - P at the alarms adds up to."""
    alarms = [one for one in verdicts if math.isfinite(one.alarm)]
    false = sum(not one.escaped for one in alarms)
    said = sum(1.0 - one.alarm_probability for one in alarms if one.alarm_probability >= 0.0)
    return false, len(alarms), said


@dataclass(frozen=True)
class Reliability:
    """P against what came of it: bins of (kicks, mean P, share escaped, its error), and Brier."""

    bins: list[tuple[str, int, float, float, float]]
    brier: float

    @classmethod
    def of(cls, verdicts: list[Verdict], wait: float) -> Reliability:
        place = WAITS.index(wait)
        pairs = [(one.probability[place], one.escaped) for one in verdicts]
        p, truth = np.array([pair for pair in pairs if pair[0] >= 0.0], dtype=float).T
        bins = []
        for low, high in itertools.pairwise(_BINS):
            inside = (p >= low) & (p < high)
            count = int(inside.sum())
            if count:
                mean = float(p[inside].mean())
                # Were P true, the share would scatter by this much.
                error = math.sqrt(float((p[inside] * (1.0 - p[inside])).sum())) / count
                share = float(truth[inside].mean())
                bins.append((f'{low:g} to {min(high, 1):g}', count, mean, share, error))
        return cls(bins, float(np.mean((p - truth) ** 2)))

    @property
    def worst(self) -> tuple[float, float]:
        """Largest difference of P and share, and the same in sampling errors."""
        gaps = [(abs(mean - share), error) for _, _, mean, share, error in self.bins]
        gap, error = max(gaps)
        return gap, gap / max(error, 1e-12)


# --- tables ---------------------------------------------------------------------------------


def near_critical(verdicts: list[Verdict], ratios: tuple[float, ...] = RATIOS) -> list[Verdict]:
    """Kicks of 0.95 and 1.05 with noise of these sizes."""
    return [one for one in verdicts if one.kick.factor in NEAR and one.kick.ratio in ratios]


def near_critical_table(verdicts: list[Verdict]) -> str:
    """Balanced error of the kicks of 0.95 and 1.05, by noise; and that of the true chance."""
    rows: list[list[object]] = []
    for ratio in RATIOS:
        near = near_critical(verdicts, (ratio,))
        if not near:
            continue
        row: list[object] = [ratio, len(near), sum(one.escaped for one in near)]
        row += [f'{balanced_error(near, wait):.1f} %' for wait in WAITS]
        asked = [one for one in near if one.foretold]
        for wait in WAITS:
            best = '-'
            if asked:
                pair = balanced_error(asked, wait, True), balanced_error(asked, wait)
                best = '{:.1f} % ({:.1f} %)'.format(*pair)
            row.append(best)
        rows.append(row)
    errors = [f'error after {wait:g} s' for wait in WAITS]
    true = [f'true chance, {wait:g} s (ours on the same)' for wait in WAITS]
    return markdown(['A_rms/A_u', 'kicks', 'escaped', *errors, *true], rows)


def reliability_table(verdicts: list[Verdict]) -> str:
    """P at each of the times, with sampling errors and Brier score."""
    rows: list[list[object]] = []
    for wait in WAITS:
        found = Reliability.of(verdicts, wait)
        for name, count, mean, share, error in found.bins:
            difference = f'{share - mean:+.3f} ({(share - mean) / max(error, 1e-12):+.1f})'
            row = [wait, name, count, f'{mean:.3f}', f'{share:.3f}', f'{error:.3f}', difference]
            rows.append(row)
        rows.append([wait, 'Brier score', len(verdicts), '', f'{found.brier:.4f}', '', ''])
    header = [
        'after, s',
        'P',
        'kicks',
        'mean P',
        'escaped',
        'sampling error',
        'difference (errors)',
    ]
    return markdown(header, rows)


def false_table(verdicts: list[Verdict]) -> str:
    """False `escaping` against what 1 - P says, by noise."""
    rows: list[list[object]] = []
    for ratio in RATIOS:
        false, alarms, said = false_alarms([v for v in verdicts if v.kick.ratio == ratio])
        rows.append([ratio, alarms, false, f'{said:.1f}'])
    return markdown(['A_rms/A_u', 'alarms', 'came back', 'sum of 1 - P'], rows)


def bounds_table(verdicts: list[Verdict]) -> str:
    """Delays as ratios to the bounds, by speed and factor."""
    rows: list[list[object]] = []
    bench = verdicts[0].kick.bench
    calm = [one for one in verdicts if one.kick.ratio <= 0.05]
    for speed, factor in itertools.product(BENCHES[bench].kick_speeds, FACTORS):
        some = [v for v in calm if v.kick.speed == speed and v.kick.factor == factor]
        shortest = window(bench, speed, factor)
        disturbed = median(disturbed_delays(some))
        row: list[object] = [speed, factor, f'{shortest:.3f}', f'{disturbed:.2f}']
        row.append(f'{disturbed / shortest:.2f}')
        if factor >= 1.2:
            alarm, sign = median(escape_delays(some, factor)), sign_bound(bench, speed, factor)
            row += [
                f'{alarm:.2f}',
                f'{alarm / shortest:.2f}',
                f'{sign:.3f}',
                f'{alarm / sign:.2f}',
            ]
        else:
            row += ['-'] * 4
        rows.append(row)
    return markdown(
        [
            'm/s',
            'kick',
            '5 % window, s',
            'disturbed, s',
            '/ window',
            'escaping, s',
            '/ window',
            'sign bound, s',
            '/ sign bound',
        ],
        rows,
    )
