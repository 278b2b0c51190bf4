"""The sentences of the report: what the numbers say, and what they do not."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from hunt_ros.report.numbers import rounded_json
from hunt_ros.report.result import Result
from hunt_ros.report.tables import SYMBOLS, folded, not_known, number, table
from hunt_ros.samples import NANOSECONDS, Record

EQUATION = (
    '<p class="equation">d<var>r</var>/d<var>t</var>* = '
    f'{SYMBOLS["D1"]} <var>ε</var> <var>r</var> + {SYMBOLS["D4"]} <var>r</var><sup>3</sup> + '
    f'{SYMBOLS["D7"]} <var>ε</var><sup>2</sup> <var>r</var> + '
    f'{SYMBOLS["D10"]} <var>ε</var> <var>r</var><sup>3</sup> + '
    f'{SYMBOLS["D15"]} <var>r</var><sup>5</sup></p>'
    f'<p class="muted">with <var>ε</var> = <var>v</var>/{SYMBOLS["v_c"]} − 1, '
    '<var>r</var> = <var>y</var><sub>amp</sub>/(2<var>d</var><sub>0</sub>) and '
    '<var>t</var>* = <var>ω</var><sub>ψ</sub> <var>t</var>, Eqs. (5), (24), (32).</p>'
)


def lead(result: Result) -> str:
    """Return the result in a few sentences of HTML, with what is not known said as such."""
    v_c, v_n = (_speed(result, key) for key in ('v_c', 'v_n'))
    width = _speed(result, 'hysteresis_width')
    criticality = result.get('criticality')
    if criticality is None:
        first = f'The kind of bifurcation is {not_known(result, "criticality")}.'
    else:
        first = f'The Hopf bifurcation is <b>{escape(str(criticality))}</b>.'
    sentences = [first]
    if result.value('v_c') is None:
        sentences.append(f'The linear critical speed {SYMBOLS["v_c"]} is {v_c}.')
    else:
        sentences.append(f'The quiet wheelset loses its stability at {SYMBOLS["v_c"]} = {v_c}.')
    if criticality == 'supercritical':
        sentences.append('Its amplitude grows from zero there, without hysteresis.')
    elif result.value('v_n') is None:
        sentences.append(f'Down to which speed hunting persists is {v_n}.')
    else:
        sentences.append(
            f'Hunting that has begun persists down to {SYMBOLS["v_n"]} = {v_n}; '
            f'between the two, over {width}, a disturbance decides which of both is seen.'
        )
    if result.get('fit.lack_of_fit'):
        sentences.append(
            '<b>The normal form does not fit these data</b> (lack of fit): '
            'its fold and branches are not to be relied on.'
        )
    if result.notices:
        count = len(result.notices)
        verb = 'is a warning' if count == 1 else f'are {count} warnings'
        sentences.append(f'There {verb} <a href="#warnings">below</a>.')
    return f'<p>{" ".join(sentences)}</p>'


def _speed(result: Result, path: str) -> str:
    entry = result.get(path)
    if not isinstance(entry, dict) or entry.get('value') is None:
        return '<a class="unknown" href="#unknown">not known</a>'
    return f'<b>{rounded_json(entry).html()} m/s</b>'


def disturbance(result: Result) -> str:
    """Return the disturbance from the width of the hysteresis as a sentence."""
    unit = '' if result.get('disturbance_m') is None else ' mm'
    shown = number(result, 'disturbance_m', 1e3)
    return f'<p>Disturbance from the width of the hysteresis (Appendix A): {shown}{unit}.</p>'


def recording(record: Record) -> list[str]:
    """Return the cells of a recording for the table: name, start, length, channels, notes."""
    from datetime import datetime, timezone

    start = datetime.fromtimestamp(record.start_ns // NANOSECONDS, timezone.utc)
    # A simulated recording starts at stamp zero: no date.
    dated = f'{start:%Y-%m-%d %H:%M:%S} UTC' if record.start_ns >= 10**9 * 86400 else 'at 0 s'
    channels = '; '.join(
        f'{name}: {len(series)} at {series.rate_hz:.4g} Hz'
        if len(series) > 1
        else f'{name}: {len(series)}'
        for name, series in record.items()
    )
    notes = '; '.join(f'{key}: {text}' for key, text in record.notes.items())
    return [
        escape(record.source or 'recording'),
        f'<span class="together">{dated}</span>',
        f'{record.duration_s:.1f}',
        escape(channels),
        escape(notes),
    ]


def recordings(records: Sequence[Record]) -> str:
    """Return the table of what was read."""
    header = ['recording', 'start', 'length (s)', 'channels', 'notes']
    body = table(header, [recording(record) for record in records], 'What was read.')
    count = len(records)
    return folded(f'{count} recordings', body) if count > 1 else body


def warnings(result: Result) -> str:
    """Return the warnings as a list."""
    if not result.notices:
        return '<p>None.</p>'
    items = ''.join(f'<li>{escape(line)}</li>' for line in result.notices)
    return f'<ul class="warnings">{items}</ul>'
