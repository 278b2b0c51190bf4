"""
The tables of the report, as HTML: every number rounded to its uncertainty.

A number carries its unrounded value in its `data` element; what is not known is shown
with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from decimal import Decimal
from html import escape
from pathlib import PurePath
from typing import TYPE_CHECKING

from hunt_ros.dynamics.normal_form import COEFFICIENTS, PAPER_NORMAL_FORM
from hunt_ros.report.events import sentence
from hunt_ros.report.numbers import interval, rounded, shown
from hunt_ros.report.response import Response
from hunt_ros.samples import NANOSECONDS, Record, Uncertain, Unknown

if TYPE_CHECKING:
    from hunt_ros.analysis.spectrum import Line
    from hunt_ros.detection import Event
    from hunt_ros.detection.words.clearance import Clearance
    from hunt_ros.identification.result import Identification

_MEANING = {
    'D1': 'growth rate per detuning',
    'D4': 'cubic',
    'D7': 'growth rate, second order',
    'D10': 'cubic per detuning',
    'D15': 'quintic',
}

#: Rows from which a table is folded at first.
LONG_TABLE = 30

#: How the symbols are set.
SYMBOLS = {
    'v_c': '<var>v</var><sub>c</sub>',
    'v_n': '<var>v</var><sub>n</sub>',
    'fold_amplitude': '<var>A</var><sub>n</sub>',
    'hysteresis_width': '<var>v</var><sub>c</sub> − <var>v</var><sub>n</sub>',
    'D1': '<var>D</var><sub>1</sub>',
    'D4': '<var>D</var><sub>4</sub>',
    'D7': '<var>D</var>′<sub>7</sub>',
    'D10': '<var>D</var>′<sub>10</sub>',
    'D15': '<var>D</var>′<sub>15</sub>',
}


def table(header: Sequence[str], rows: Sequence[Sequence[str]], caption: str) -> str:
    """Return an HTML table of cells that are HTML already; it scrolls by itself if too wide."""
    head = ''.join(f'<th scope="col">{cell}</th>' for cell in header)
    body = ''.join(
        '<tr>'
        + f'<th scope="row">{row[0]}</th>'
        + ''.join(f'<td>{cell}</td>' for cell in row[1:])
        + '</tr>'
        for row in rows
    )
    # The caption is no part of what scrolls: it stays readable on a phone.
    return (
        f'<figure class="table"><figcaption>{caption}</figcaption><div class="wide">'
        f'<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div></figure>'
    )


def place(source: str) -> str:
    """Return the last two parts of a path as HTML, which may be broken between them."""
    return '/<wbr>'.join(escape(part) for part in PurePath(source).parts[-2:] if part != '/')


def text(words: str) -> str:
    """Return words as HTML that keep some width on a phone."""
    return f'<span class="text">{escape(words)}</span>'


def folded(title: str, body: str) -> str:
    """Return a table under its title; folded at first where it is long."""
    opened = ' open' if body.count('<tr>') <= LONG_TABLE else ''
    return f'<details{opened}><summary>{escape(title)}</summary>{body}</details>'


def recordings(records: Sequence[Record]) -> str:
    """Table of what was read."""
    rows = []
    for record in records:
        start = datetime.fromtimestamp(record.start_ns // NANOSECONDS, timezone.utc)
        # A simulated recording starts at stamp zero: no date.
        dated = record.start_ns >= NANOSECONDS * 86400
        channels = '<br>'.join(
            escape(f'{name}: {len(series)}')
            + (f' at {series.rate_hz:.4g} Hz' if len(series) > 1 else '')
            for name, series in record.items()
        )
        notes = '<br>'.join(escape(f'{key}: {note}') for key, note in record.notes.items() if note)
        when = f'{start:%Y-%m-%d %H:%M:%S} UTC' if dated else 'at 0 s'
        rows.append(
            [
                f'<span class="path">{escape(record.source or "recording")}</span>',
                f'<span class="together">{when}</span>',
                f'{record.duration_s:.1f}',
                channels,
                notes,
            ]
        )
    body = table(['recording', 'start', 'length (s)', 'channels', 'notes'], rows, 'What was read.')
    return folded(f'{len(rows)} recordings', body) if len(rows) > 1 else body


def critical_speeds(one: Identification) -> str:
    """Table of v_c, v_n and the width: from the model, as observed, and the paper's."""
    paper, observed = PAPER_NORMAL_FORM, one.observed
    step = shown(_known(one, observed.step, 'observed.step_mps'), digits=2)
    rows = [
        [
            f'{words} {SYMBOLS[key]} (m/s)',
            shown(one.quantity(key)),
            interval(one.quantity(key)),
            shown(_known(one, seen, f'observed.{key}'), digits=3) + _between(bounds),
            *([rounded(published)[0] if published else ''] if _paper_rig(one) else []),
        ]
        for key, words, seen, bounds, published in (
            ('v_c', 'linear critical speed', observed.v_c, observed.v_c_between,
             paper.critical_speed),
            ('v_n', 'nonlinear critical speed', observed.v_n, observed.v_n_between,
             paper.nonlinear_critical_speed),
            ('hysteresis_width', 'hysteresis width', observed.hysteresis_width, (None, None),
             paper.hysteresis_width),
        )
    ]  # fmt: skip
    return table(
        ['', 'normal form', '95 % interval', 'read off the jumps', *_paper_header(one)],
        rows,
        f'Critical speeds. Step of the speed at the jumps (m/s): {step}.',
    )


def _between(bounds: tuple[float | None, float | None]) -> str:
    """Speeds between which an observed critical speed lies; '' where nothing bounds it."""
    low, high = bounds
    if low is not None and high is not None:
        return f'<br>between {shown(low)} and {shown(high)}'
    if low is None and high is None:
        return ''
    return f'<br>above {shown(low)}' if high is None else f'<br>below {shown(high)}'


def _known(one: Identification, value: float | None, key: str) -> float | Unknown:
    """Return a plain number, or why the entry of the JSON at `key` is null."""
    return one.why(key) if value is None or not math.isfinite(value) else value


def coefficients(one: Identification) -> str:
    """Table of the coefficients with intervals, the four-point recipe, and the paper's."""
    four = one.four_point
    rows = [
        [
            f'{SYMBOLS[name]} ({_MEANING[name]})',
            shown(one.quantity(name)),
            interval(one.quantity(name)),
            shown(None)
            if four is None
            else 'taken as known'
            if name == 'D1'
            else shown(getattr(four, name), digits=3),
            *([_as_published(getattr(PAPER_NORMAL_FORM, name))] if _paper_rig(one) else []),
        ]
        for name in COEFFICIENTS
    ]
    caption = (
        'Coefficients of the normal form, dimensionless, in the amplitude coordinate. '
        '<var>D</var>′<sub>7</sub>, <var>D</var>′<sub>10</sub> and <var>D</var>′<sub>15</sub> '
        'are effective: they hold for the speeds and amplitudes measured.'
    )
    if four is None:
        caption += f' The four-point recipe is {shown(one.why("four_point"))}.'
    header = ['', 'identified', '95 % interval', 'four-point recipe (3.3)', *_paper_header(one)]
    return table(header, rows, caption)


def _paper_rig(one: Identification) -> bool:
    """
    Whether the paper's values say anything of this rig.

    They do where amplitude and time are measured in the paper's units, and the rig was run
    at speeds between half of its v_n and twice its v_c.
    """
    paper = PAPER_NORMAL_FORM
    for theirs, ours in (
        (one.length_scale, paper.length_scale), (one.time_scale, paper.time_scale),
    ):  # fmt: skip
        if abs(theirs / ours - 1.0) > 0.02:
            return False
    low, high = 0.5 * (paper.nonlinear_critical_speed or 0.0), 2.0 * paper.critical_speed
    speeds = [state.speed for state in one.steady_states]
    return not speeds or any(low <= speed <= high for speed in speeds)


def _paper_header(one: Identification) -> list[str]:
    return ['paper, Eq. (33)'] if _paper_rig(one) else []


def _as_published(value: float) -> str:
    """Return a number with the digits it was published with."""
    digits = len(Decimal(repr(value)).normalize().as_tuple().digits)
    return rounded(value, digits=digits)[0]


def fit_quality(one: Identification) -> str:
    """Table of how the normal form was fitted, and how well it fits."""
    fit, four = one.fit, one.four_point
    because = '; '.join(fit.lack_of_fit_because) or 'the form does not describe these data'
    cells = {
        'criticality': one.criticality or shown(one.why('criticality')),
        'growth law': escape(fit.law),
        'segments': shown(fit.segments),
        'fit has converged': 'yes' if fit.converged else 'no',
        'residual, rms (µm)': shown(
            _known(one, fit.residual_rms, 'fit.residual_rms_m'), 1e6, digits=2
        ),
        'lack of fit': escape(f'yes: {because}') if fit.lack_of_fit else 'none found',
        'chance of so large a misfit were the law right': shown(
            _known(one, fit.lack_of_fit_p, 'fit.lack_of_fit_p'), digits=2
        ),
        'condition number of the four-point recipe': shown(
            one.why('four_point') if four is None else four.condition_number, digits=2
        ),
        'hunting frequency, mean over the motion (Hz)': shown(one.quantity('frequency_hz')),
        'length scale <var>d</var><sub>0</sub> (m)': f'{shown(one.length_scale)}'
        f' ({escape(one.scales_from["length"])})',
        'time scale 1/<var>ω</var><sub>ψ</sub> (s)': f'{shown(one.time_scale)}'
        f' ({escape(one.scales_from["time"])})',
        'coordinate of <var>r</var>': 'amplitude',
    }
    return table(['', ''], list(cells.items()), 'How the form was fitted.')


def steady_states(one: Identification) -> str:
    """Table of the measured steady amplitudes: the hunting component, and the paper's."""
    rows = [
        [
            f'{state.speed:.3f}',
            state.direction,
            shown(Uncertain(state.amplitude, state.amplitude_std), 1e3),
            shown(Uncertain(state.maxima, state.maxima_std), 1e3),
            str(state.cycles),
            place(state.source),
        ]
        for state in sorted(one.steady_states, key=lambda state: state.speed)
    ]
    header = [
        'speed (m/s)', 'speed was', 'hunting component (mm)', 'mean of the maxima (mm)', 'cycles',
        'recording',
    ]  # fmt: skip
    caption = (
        'Steady amplitudes as measured, with the standard deviation of the mean: of the hunting '
        'component alone, and as the paper takes them (Sect. 2.4), roughness and noise included.'
    )
    return table(header, rows, caption)


def events(seen: Mapping[str, Sequence[Event]], records: Sequence[Record]) -> str:
    """Table of the events of the runs, in the order of time."""
    rows = [
        [
            place(record.source),
            f'{(event.stamp_ns - record.start_ns) / NANOSECONDS:.2f}',
            text(': '.join(filter(None, (sentence(event.event), event.cause)))),
            shown(event.number('speed_mps'), digits=3),
            shown(event.number('amplitude_m'), 1e3, digits=3),
            shown(event.number('growth_rate_per_s'), digits=3),
            f'<span class="level-{event.level.label}">{event.level.label}</span>',
        ]
        for record in records
        for event in seen.get(record.source, ())
    ]
    if not rows:
        return '<p>The detector reported none.</p>'
    header = [
        'recording', 'time (s)', 'event', 'speed (m/s)', 'amplitude (mm)', 'growth rate (1/s)',
        'level',
    ]  # fmt: skip
    caption = (
        'Events of the detector when it is given this normal form; time from the start of the '
        'recording.'
    )
    body = table(header, rows, caption)
    return folded(f'{len(rows)} events', body) if len(rows) > LONG_TABLE else body


def clearances(held: Mapping[str, Sequence[Clearance]]) -> str:
    """Table of the speeds that were held, by recording, and the verdict on each."""
    rows = [
        [
            place(source),
            f'{one.speed_mps:.2f}',
            f'{one.held_s:.0f}',
            '∞' if one.margin == math.inf else shown(one.margin, digits=2),
            shown(one.escape_chance, 100.0, digits=2),
            'cleared' if one.cleared else f'<b>not cleared</b>: {escape(one.reason)}',
        ]
        for source, found in held.items()
        for one in found
    ]
    if not rows:
        return '<p>No speed was held for long enough to be judged.</p>'
    header = [
        'recording', 'speed (m/s)', 'held for (s)', 'margin (95 %)', 'escape in 10 min (%)',
        'verdict',
    ]  # fmt: skip
    caption = (
        'Speeds that were held, and whether they are cleared, with this normal form: the least'
        ' margin of the last seconds at the lower end of its interval, and the chance that noise'
        ' starts hunting within 10 minutes.'
    )
    return table(header, rows, caption)


def responses(panels: Mapping[str, Response]) -> str:
    """Table of what the panels of Fig. 5 say, by letter."""
    rows = []
    for letter, response in panels.items():
        hunting, roughness = (
            None if response.spectrum is None else response.spectrum.line(name)
            for name in ('hunting', 'roughness')
        )
        head = f'({letter}) {response.speed:.2f} m/s'
        rows.append([head, _line(hunting), _line(roughness), escape(response.kind)])
    header = ['', 'hunting line', 'roughness line', 'Poincaré section']
    return table(header, rows, 'Lines of the spectrum, with their amplitudes; sections.')


def _line(line: Line | None) -> str:
    if line is None:
        return 'none stands out'
    frequency = Uncertain(line.frequency_hz, line.frequency_std)
    return f'{rounded(frequency)[0]} Hz, {rounded(line.amplitude, 1e3, 3)[0]} mm'


def warnings(one: Identification) -> str:
    """Return the warnings as a list."""
    items = ''.join(f'<li>{escape(line)}</li>' for line in one.notices)
    return f'<ul class="warnings">{items}</ul>' if items else '<p>None.</p>'


def unknowns(one: Identification) -> str:
    """List the keys of the JSON that are null, by the reason for it."""
    groups: dict[str, list[str]] = {}
    for key, reason in one.unknown.items():
        groups.setdefault(reason, []).append(f'<code>{escape(key)}</code>')
    items = ''.join(
        f'<li>not known: {", ".join(keys)}<br><span class="reason">{escape(reason)}</span></li>'
        for reason, keys in groups.items()
    )
    if not items:
        return '<p>Nothing: every quantity of the result is known.</p>'
    return f'<ul class="unknowns">{items}</ul>'
