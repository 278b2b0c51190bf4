"""
The long tables of the report: steady states, branches, stretches, events, responses, nulls.

A long one is folded under its title, and can be unfolded by the reader.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from hunt_ros.analysis.frequency_amplitude import FrequencyLaw
from hunt_ros.analysis.spectrum import Line
from hunt_ros.report.figures.overview import RunEvent
from hunt_ros.report.numbers import measured, plain, rounded
from hunt_ros.report.response import Response
from hunt_ros.report.result import Result
from hunt_ros.report.tables import LONG_TABLE, data, folded, not_known, number, table


def steady_states(result: Result) -> str:
    """Table of the measured steady amplitudes: the hunting component, and the paper's."""
    entries: Sequence[Mapping[str, Any]] = result.get('steady_states') or ()
    order = sorted(range(len(entries)), key=lambda k: float(entries[k]['speed_mps']))
    rows = []
    for k in order:
        path = f'steady_states.{k}'
        rows.append(
            [
                f'{float(entries[k]["speed_mps"]):.3f}',
                escape(str(entries[k].get('direction'))),
                _spread(result, path, 'amplitude'),
                _spread(result, path, 'maxima') if 'maxima_m' in entries[k] else '',
                number(result, f'{path}.cycles'),
                escape(str(entries[k].get('source', ''))),
            ]
        )
    header = [
        'speed (m/s)',
        'speed was',
        'hunting component (mm)',
        'mean of the maxima (mm)',
        'cycles',
        'recording',
    ]
    caption = (
        'Steady amplitudes as measured, with the standard deviation of the mean: of the hunting '
        'component alone, and as the paper takes them (Sect. 2.4), roughness and noise included.'
    )
    return table(header, rows, caption)


def _spread(result: Result, path: str, name: str) -> str:
    """Return a number of a steady state with its standard deviation, in mm."""
    value, std = result.value(f'{path}.{name}_m'), result.value(f'{path}.{name}_std_m')
    if value is None:
        return not_known(result, f'{path}.{name}_m')
    shown = rounded(1e3 * value, None if std is None else 1e3 * std).html()
    if std is None:
        shown += ' (' + not_known(result, f'{path}.{name}_std_m') + ')'
    return data(f'{path}.{name}_m', value, shown)


def segments(result: Result) -> str:
    """Table of the stretches of the recordings: what each was used for, or why it was not."""
    rows = [
        [
            escape(str(entry.get('kind'))),
            escape(str(entry.get('source', ''))),
            f'{(float(entry["end_ns"]) - float(entry["start_ns"])) / 1e9:.1f}',
            f'{float(entry["speed_start_mps"]):.2f} … {float(entry["speed_end_mps"]):.2f}',
            _growth_rate(entry),
            'used' if entry.get('used') else '<b>dropped</b>',
            escape(str(entry.get('reason', ''))),
        ]
        for entry in result.get('segments') or ()
    ]
    header = [
        'stretch',
        'recording',
        'length (s)',
        'speed (m/s)',
        'growth rate (1/s)',
        '',
        'what for, or why not',
    ]
    return table(header, rows, 'What was found in the recordings.') if rows else ''


def _growth_rate(entry: Mapping[str, Any]) -> str:
    """Growth rate of a transient with its deviation; empty for what has none."""
    value, std = entry.get('growth_rate_per_s'), entry.get('growth_rate_std_per_s')
    return '' if value is None else rounded(float(value), std).html()


def branches(result: Result, count: int = 16) -> str:
    """Table of the branches of the model, thinned evenly to at most about `count` speeds."""
    entries: Sequence[Mapping[str, Any]] = result.get('branches') or ()
    stride = max(1, -(-len(entries) // count))
    rows = []
    for k in range(0, len(entries), stride):
        cells = [f'{float(entries[k]["speed_mps"]):.3f}']
        for key in ('unstable_amplitude_m', 'stable_amplitude_m'):
            path, value = f'branches.{k}.{key}', entries[k].get(key)
            if value is None:
                cells.append(not_known(result, path))
                continue
            std = entries[k].get(key.replace('amplitude', 'std'))
            shown = rounded(1e3 * float(value), None if std is None else 1e3 * float(std), None, 3)
            cells.append(data(path, float(value), shown.html()))
        rows.append(cells)
    header = ['speed (m/s)', 'unstable amplitude (mm)', 'stable amplitude (mm)']
    return table(header, rows, 'Branches of the identified normal form.')


def events(entries: Sequence[RunEvent]) -> str:
    """Table of the events of the runs, in the order of time."""
    if not entries:
        return '<p>The detector reported none.</p>'
    rows = [
        [
            escape(one.source),
            f'{one.seconds:.2f}',
            escape(f'{one.event} {one.cause}'.replace('_', ' ').strip()),
            _plain_or_unknown(one.speed, 1.0),
            _plain_or_unknown(one.amplitude, 1e3),
            _plain_or_unknown(one.growth_rate, 1.0),
            f'<span class="level-{escape(one.level)}">{escape(one.level)}</span>',
        ]
        for one in entries
    ]
    header = [
        'recording',
        'time (s)',
        'event',
        'speed (m/s)',
        'amplitude (mm)',
        'growth rate (1/s)',
        'level',
    ]
    caption = (
        'Events of the detector when it is given this normal form; time from the start of the '
        'recording.'
    )
    body = table(header, rows, caption)
    return folded(f'{len(rows)} events', body) if len(rows) > LONG_TABLE else body


def responses(shown: Mapping[str, Response]) -> str:
    """Table of what the panels of Fig. 5 say, by letter."""
    rows = []
    for letter, response in shown.items():
        hunting, roughness = (
            None if response.spectrum is None else response.spectrum.line(name)
            for name in ('hunting', 'roughness')
        )
        largest = None if response.lyapunov is None else response.lyapunov.exponent
        rows.append(
            [
                f'({escape(letter)}) {response.speed:.2f} m/s',
                _line(hunting),
                _line(roughness),
                escape(response.kind),
                '<span class="unknown">not known</span>'
                if largest is None
                else measured(largest.value, largest.std),
            ]
        )
    header = [
        '',
        'hunting line',
        'roughness line',
        'Poincaré section',
        'largest Lyapunov exponent (1/s)',
    ]
    return table(
        header, rows, 'Lines of the spectrum, with their amplitudes; sections; exponents.'
    )


def frequency_law(law: FrequencyLaw) -> str:
    """Table of the imaginary coefficients of Eq. (25) that the data support."""
    rows = [
        [
            f'<var>{name[:-1]}</var><sub>I</sub>' if name.endswith('I') else '<var>ω</var>',
            measured(one.value, one.std),
        ]
        for name, one in law.coefficients.items()
    ]
    caption = (
        'Imaginary coefficients of the normal form, Eq. (25), dimensionless; residual '
        f'{plain(1e3 * law.residual_rms_hz, 2)} mHz, condition number '
        f'{law.condition_number:.2g}. Terms that these data cannot tell '
        'apart are left out.'
    )
    return table(['', 'value'], rows, caption)


def _line(line: Line | None) -> str:
    if line is None:
        return 'none stands out'
    frequency = measured(line.frequency_hz, line.frequency_std)
    return f'{frequency} Hz, {rounded(1e3 * line.amplitude, digits=3).html()} mm'


def _plain_or_unknown(value: float | None, scale: float) -> str:
    if value is None:
        return '<span class="unknown">not known</span>'
    return rounded(scale * value, digits=3).html()


def unknowns(result: Result) -> str:
    """List everything that is null in the document with its reason; branches by reason."""
    groups: dict[str, list[str]] = {}
    for unknown in result.unknowns():
        groups.setdefault(unknown.reason, []).append(unknown.path)
    if not groups:
        return '<p>Nothing: every quantity of the result is known.</p>'
    items = ''.join(
        f'<li>not known: {_paths(paths)}<br><span class="reason">{escape(reason)}</span></li>'
        for reason, paths in groups.items()
    )
    return f'<ul class="unknowns">{items}</ul>'


def _paths(paths: Sequence[str]) -> str:
    """Return the paths as code; a long list is folded, with its first and its count in sight."""
    codes = [f'<code>{escape(path)}</code>' for path in paths]
    if len(codes) <= 6:
        return ', '.join(codes)
    return (
        f'<details><summary>{codes[0]} and {len(codes) - 1} more</summary>'
        f'{", ".join(codes)}</details>'
    )
