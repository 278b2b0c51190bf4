"""The sentences of the report: what the numbers say, and what they do not."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from hunt_ros.report.numbers import shown
from hunt_ros.report.tables import SYMBOLS
from hunt_ros.samples import Unknown

if TYPE_CHECKING:
    from hunt_ros.identification.result import Identification

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


def lead(one: Identification) -> str:
    """Return the result in a few sentences of HTML, with what is not known said as such."""
    sentences = [seen(one), f'Hopf bifurcation: <b>{one.onset}</b>.']
    v_c, v_n, width = (_speed(one, key) for key in ('v_c', 'v_n', 'hysteresis_width'))
    if one.v_c is None:
        sentences.append(f'The linear critical speed {SYMBOLS["v_c"]} is {v_c}.')
    else:
        sentences.append(f'The quiet wheelset loses its stability at {SYMBOLS["v_c"]} = {v_c}.')
    if one.criticality == 'supercritical':
        sentences.append('Its amplitude grows from zero there.')
    elif one.v_n is None:
        sentences.append(f'Down to which speed hunting persists is {v_n}.')
    else:
        sentences.append(
            f'Hunting that has begun persists down to {SYMBOLS["v_n"]} = {v_n}; '
            f'between the two, over {width}, a disturbance decides which of both is seen.'
        )
    if one.fit.lack_of_fit:
        sentences.append(
            '<b>The normal form does not fit these data everywhere</b> (lack of fit): '
            f'{escape("; ".join(one.fit.lack_of_fit_because))}.'
        )
    if count := len(one.notices):
        verb = 'is a warning' if count == 1 else f'are {count} warnings'
        sentences.append(f'There {verb} <a href="#warnings">below</a>.')
    return f'<p>{" ".join(sentences)}</p>'


def seen(one: Identification) -> str:
    """Return what was seen without any model, a line each; '' where that is nothing."""
    lines = one.bracket.lines()
    return ''.join(f'{escape(line[:1].upper() + line[1:])}.<br>' for line in lines)


def _speed(one: Identification, name: str) -> str:
    speed = one.quantity(name)
    if isinstance(speed, Unknown):
        return '<a class="unknown" href="#unknown">not known</a>'
    return f'<b>{shown(speed)} m/s</b>'


def disturbance(one: Identification) -> str:
    """Return the disturbance from the width of the hysteresis as a sentence."""
    size = shown(one.quantity('disturbance'), 1e3)
    return f'<p>Disturbance from the width of the hysteresis (Appendix A), mm: {size}.</p>'
