"""
The tables of the report, as HTML: every number rounded to its uncertainty.

A number carries its unrounded value in its `data` element, under the path it has in
the JSON document; a null is shown as 'not known' with its reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import Decimal
from html import escape

from hunt_ros.dynamics.normal_form import COEFFICIENTS, PAPER_NORMAL_FORM
from hunt_ros.report.numbers import plain, rounded, rounded_json
from hunt_ros.report.result import Result

_MEANING = {
    'D1': 'growth rate per detuning',
    'D4': 'cubic',
    'D7': 'growth rate, second order',
    'D10': 'cubic per detuning',
    'D15': 'quintic',
}

_FIT = {
    'criticality': 'criticality',
    'fit.method': 'method',
    'fit.law': 'growth law',
    'fit.why': 'chosen because',
    'fit.segments': 'segments used',
    'fit.initial_amplitudes': 'stretches with an initial amplitude of their own',
    'fit.converged': 'fit has converged',
    'fit.clusters': 'independent runs or blocks behind the intervals',
    'fit.residual_rms_m': 'residual, rms (µm)',
    'fit.lack_of_fit': 'lack of fit',
    'fit.lack_of_fit_p': 'chance of so large a misfit were the law right',
    'fit.condition_number': 'condition number',
    'four_point': 'condition number of the four-point recipe',
    'frequency_hz': 'hunting frequency, mean over the motion (Hz)',
    'length_scale_m': 'length scale <var>d</var><sub>0</sub> (m)',
    'time_scale_s': 'time scale 1/<var>ω</var><sub>ψ</sub> (s)',
    'coordinate': 'coordinate of <var>r</var>',
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
    return (
        f'<div class="wide"><table><caption>{caption}</caption>'
        f'<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def folded(title: str, body: str) -> str:
    """Return a table under its title; folded at first where it is long."""
    shown = ' open' if body.count('<tr>') <= LONG_TABLE else ''
    return f'<details{shown}><summary>{escape(title)}</summary>{body}</details>'


def number(result: Result, path: str, scale: float = 1.0, digits: int = 4) -> str:
    """
    Return the number at a path as HTML, or 'not known' with its reason.

    Parameters
    ----------
    result : Result
        What is shown.
    path : str
        Of a plain number or of a `{value, std, ci95}`.
    scale : float
        Of the unit printed; the `data` element keeps the SI value.
    digits : int
        Significant digits where there is no uncertainty.
    """
    entry = result.get(path)
    if entry is None or (isinstance(entry, Mapping) and entry.get('value') is None):
        return not_known(result, path)
    if isinstance(entry, Mapping):
        shown = rounded_json(entry, scale).html()
        if entry.get('std') is None:
            shown += ' (uncertainty ' + not_known(result, f'{path}.std') + ')'
        return data(f'{path}.value', float(entry['value']), shown)
    value = float(entry)
    if isinstance(entry, int):
        return data(path, value, str(entry))  # a count
    return data(path, value, rounded(scale * value, digits=digits).html())


def interval(result: Result, path: str, scale: float = 1.0) -> str:
    """Return the 95 % interval of the number at a path as HTML, or 'not known'."""
    entry = result.get(path)
    if not isinstance(entry, Mapping) or entry.get('value') is None:
        return '<span class="unknown">not known</span>'  # the reason stands with the value
    if entry.get('ci95') is None:
        return not_known(result, f'{path}.ci95')
    return rounded_json(entry, scale).interval_html()


def not_known(result: Result, path: str) -> str:
    """Return 'not known' with its reason, as HTML."""
    return (
        f'<span class="unknown" data-key="{escape(path)}">not known: '
        f'{escape(result.reason(path))}</span>'
    )


def critical_speeds(result: Result) -> str:
    """Table of v_c, v_n and the width: from the model, as observed, and the paper's."""
    paper = PAPER_NORMAL_FORM
    published = {
        'v_c': paper.critical_speed,
        'v_n': paper.nonlinear_critical_speed,
        'hysteresis_width': paper.hysteresis_width,
    }
    names = {
        'v_c': 'linear critical speed',
        'v_n': 'nonlinear critical speed',
        'hysteresis_width': 'hysteresis width',
    }
    rows = [
        [
            f'{names[key]} {SYMBOLS[key]} (m/s)',
            number(result, key),
            interval(result, key),
            number(result, f'observed.{key}', digits=3) + _between(result, key),
            *([plain(value) if value is not None else ''] if _paper_rig(result) else []),
        ]
        for key, value in published.items()
    ]
    step = number(result, 'observed.step_mps', digits=2)
    unit = '' if result.get('observed.step_mps') is None else ' m/s'
    return table(
        ['', 'normal form', '95 % interval', 'read off the jumps', *_paper_header(result)],
        rows,
        f'Critical speeds. Step of the speed at the jumps: {step}{unit}.',
    )


def correlations(result: Result) -> str:
    """Table of the correlations of what was identified; what it is known to, together."""
    entry = result.get('correlations')
    if entry is None:
        return f'<p>Correlations: {not_known(result, "correlations")}.</p>'
    names = [SYMBOLS[name] for name in entry['of']]
    rows = [
        [name, *('' if x is None else f'{x:+.2f}'.replace('-', '−') for x in row[: k + 1])]
        for k, (name, row) in enumerate(zip(names, entry['matrix'], strict=True))
    ]
    caption = (
        'Rank correlations of the forms that the data allow. Near ±1 only a combination of the '
        'two is known well.'
    )
    return table(['', *names], [row + [''] * (len(names) + 1 - len(row)) for row in rows], caption)


def _between(result: Result, key: str) -> str:
    """Speeds between which an observed critical speed lies; '' where nothing bounds it."""
    path = f'observed.{key}_between_mps'
    low, high = (result.value(f'{path}.{side}') for side in (0, 1))
    if low is None and high is None:
        return ''
    cells = [
        data(f'{path}.{side}', value, rounded(value).html())
        for side, value in enumerate((low, high))
        if value is not None
    ]
    if len(cells) == 2:
        return f'<br>between {" and ".join(cells)}'
    return f'<br>{"below" if low is None else "above"} {cells[0]}'


def coefficients(result: Result) -> str:
    """Table of the coefficients with intervals, the four-point recipe, and the paper's."""
    rows = [
        [
            f'{SYMBOLS[name]} ({_MEANING[name]})',
            number(result, f'coefficients.{name}'),
            interval(result, f'coefficients.{name}'),
            _four_point(result, name),
            *([_as_published(getattr(PAPER_NORMAL_FORM, name))] if _paper_rig(result) else []),
        ]
        for name in COEFFICIENTS
    ]
    caption = (
        'Coefficients of the normal form, dimensionless, in the amplitude coordinate. '
        '<var>D</var>′<sub>7</sub>, <var>D</var>′<sub>10</sub> and <var>D</var>′<sub>15</sub> '
        'are effective: they hold for the speeds and amplitudes measured.'
    )
    if result.get('four_point') is None:
        caption += f' The four-point recipe is {not_known(result, "four_point")}.'
    header = ['', 'identified', '95 % interval', 'four-point recipe (3.3)', *_paper_header(result)]
    return table(header, rows, caption)


def _paper_rig(result: Result) -> bool:
    """
    Whether the paper's values say anything of this rig.

    They do where amplitude and time are measured in the paper's units, and the rig was run
    at speeds between half of its v_n and twice its v_c.
    """
    scales = (
        ('length_scale_m', PAPER_NORMAL_FORM.length_scale),
        ('time_scale_s', PAPER_NORMAL_FORM.time_scale),
    )
    for key, ours in scales:
        theirs = result.value(key)
        if theirs is not None and abs(theirs / ours - 1.0) > 0.02:
            return False
    low = 0.5 * (PAPER_NORMAL_FORM.nonlinear_critical_speed or 0.0)
    high = 2.0 * PAPER_NORMAL_FORM.critical_speed
    speeds = [float(state['speed_mps']) for state in result.steady_states()]
    return not speeds or any(low <= speed <= high for speed in speeds)


def _paper_header(result: Result) -> list[str]:
    return ['paper, Eq. (33)'] if _paper_rig(result) else []


def _as_published(value: float) -> str:
    """Return a number with the digits it was published with."""
    digits = len(Decimal(repr(value)).normalize().as_tuple().digits)
    return rounded(value, digits=digits).html()


def _four_point(result: Result, name: str) -> str:
    if result.get('four_point') is None:
        return '<span class="unknown">not known</span>'  # the reason stands in the caption
    return 'taken as known' if name == 'D1' else number(result, f'four_point.{name}', digits=3)


def fit_quality(result: Result) -> str:
    """Table of how the normal form was fitted, and how well it fits; older keys may be absent."""
    lack = result.get('fit.lack_of_fit')
    because = result.get('fit.lack_of_fit_because') or ['the form does not describe these data']
    verdict = {True: escape(f'yes: {"; ".join(because)}'), False: 'none found'}
    shown = {
        'criticality': _word(result, 'criticality'),
        'fit.method': _word(result, 'fit.method'),
        'fit.law': _word(result, 'fit.law'),
        'fit.why': _word(result, 'fit.why'),
        'fit.segments': number(result, 'fit.segments'),
        'fit.initial_amplitudes': number(result, 'fit.initial_amplitudes'),
        'fit.converged': {True: 'yes', False: 'no'}.get(result.get('fit.converged'), ''),
        'fit.clusters': number(result, 'fit.clusters'),
        'fit.residual_rms_m': number(result, 'fit.residual_rms_m', 1e6, 2),
        'fit.lack_of_fit': not_known(result, 'fit.lack_of_fit')
        if lack is None
        else verdict[bool(lack)],
        'fit.lack_of_fit_p': number(result, 'fit.lack_of_fit_p', digits=2),
        'fit.condition_number': number(result, 'fit.condition_number', digits=2),
        'four_point': not_known(result, 'four_point')
        if result.get('four_point') is None
        else number(result, 'four_point.condition_number', digits=2),
        'frequency_hz': number(result, 'frequency_hz'),
        'length_scale_m': number(result, 'length_scale_m') + _from(result, 'length'),
        'time_scale_s': number(result, 'time_scale_s') + _from(result, 'time'),
        'coordinate': _word(result, 'coordinate'),
    }
    rows = [[_FIT[path], cell] for path, cell in shown.items() if result.has(path) and cell]
    return table(['', ''], rows, 'How the form was fitted.')


def _from(result: Result, scale: str) -> str:
    """Where a scale comes from, in brackets; '' where the document does not say."""
    source = result.get(f'scales_from.{scale}')
    return '' if source is None else f' ({escape(str(source))})'


def _word(result: Result, path: str) -> str:
    entry = result.get(path)
    return not_known(result, path) if entry is None else escape(str(entry))


def data(path: str, value: float, shown: str) -> str:
    """Return a number as it is shown, with its SI value and its path in the document."""
    return f'<data value="{value!r}" data-key="{escape(path)}">{shown}</data>'
