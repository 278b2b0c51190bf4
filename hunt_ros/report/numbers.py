"""Numbers as a paper prints them: rounded to their uncertainty, in HTML."""

from __future__ import annotations

import math
from html import escape

from hunt_ros.samples import NORMAL_95, Uncertain, Unknown
from hunt_ros.samples import rounded as decimal_digits

#: Half an interval over what the deviation says, and over its other half, from which the
#: interval is printed and not the deviation.
_LONGER, _ONE_SIDED = 1.5, 2.5


def shown(number: Uncertain | Unknown | float | None, scale: float = 1.0, digits: int = 4) -> str:
    """
    Return a number as HTML, or 'not known' with the reason.

    Parameters
    ----------
    number : Uncertain, Unknown, float or None
        One that is not finite is not known either; a whole number is a count.
    scale : float
        Of the unit printed; the `data` element keeps the SI value.
    digits : int
        Significant digits where there is no uncertainty.
    """
    if isinstance(number, Unknown):
        return f'<span class="unknown">{escape(str(number))}</span>'
    value = number.value if isinstance(number, Uncertain) else number
    if value is None or not math.isfinite(value):
        return '<span class="unknown">not known</span>'
    one = number if isinstance(number, Uncertain) else value
    text = str(one) if isinstance(one, int) else rounded(one, scale, digits)[0]
    beside = ''
    if isinstance(one, Uncertain) and not math.isfinite(one.std):
        beside = ' <span class="unknown">(uncertainty not known)</span>'
    return f'<data value="{float(value)!r}">{text}</data>{beside}'


def interval(number: Uncertain | Unknown, scale: float = 1.0) -> str:
    """Return the 95 % interval of a number as HTML, or 'not known'; why stands at the value."""
    text = '' if isinstance(number, Unknown) else rounded(number, scale)[1]
    return text or '<span class="unknown">not known</span>'


def rounded(number: Uncertain | float, scale: float = 1.0, digits: int = 4) -> tuple[str, str]:
    """
    Round a number to two significant digits of its uncertainty.

    Parameters
    ----------
    number : Uncertain or float
        Its value is finite.
    scale : float
        Of the unit printed.
    digits : int
        Significant digits of the value where there is no uncertainty.

    Returns
    -------
    str, str
        As HTML: '8.013 ± 0.042' or, where a deviation would mislead, '0.070, −0.260 … 0.390';
        and the 95 % interval, '7.931 … 8.095', '' without one.
    """
    known = number if isinstance(number, Uncertain) else Uncertain(number, 0.0, math.inf)
    value, std = scale * known.value, scale * known.std
    low, high = scale * known.low, scale * known.high
    interval = [low, high] if math.isfinite(low + high) else []
    std = std if 0.0 < std < math.inf else 0.0
    texts, exponent = decimal_digits([value, *interval, std], std, digits)
    text, *ends, deviation = (each.replace('-', '−') for each in texts)
    range_ = ' … '.join(ends)
    if std and interval and _skewed(value, std, low, high):
        text = f'{text}, {range_}'
    elif std:
        text = f'{text} ± {deviation}'
    if exponent:
        power = f' × 10<sup>{str(exponent).replace("-", "−")}</sup>'
        text = f'({text}){power}' if std else f'{text}{power}'
        range_ = f'({range_}){power}' if range_ else ''
    return text, range_


def _skewed(value: float, std: float, low: float, high: float) -> bool:
    """Whether a 95 % interval is far from value -/+ 1.96 std: longer, or much to one side."""
    short, long = sorted((value - low, high - value))
    return long > _LONGER * NORMAL_95 * std or long > _ONE_SIDED * short
