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
    beside = ''
    if isinstance(number, Uncertain):
        text, _ = _of(number, scale)
        if not math.isfinite(number.std):
            beside = ' <span class="unknown">(uncertainty not known)</span>'
    else:
        text = str(value) if isinstance(value, int) else rounded(scale * value, digits=digits)[0]
    return f'<data value="{float(value)!r}">{text}</data>{beside}'


def interval(number: Uncertain | Unknown, scale: float = 1.0) -> str:
    """Return the 95 % interval of a number as HTML, or 'not known'; why stands at the value."""
    text = '' if isinstance(number, Unknown) else _of(number, scale)[1]
    return text or '<span class="unknown">not known</span>'


def _of(number: Uncertain, scale: float) -> tuple[str, str]:
    ends = (scale * number.low, scale * number.high)
    return rounded(
        scale * number.value,
        scale * number.std if math.isfinite(number.std) else None,
        ends if math.isfinite(sum(ends)) else None,
    )


def rounded(
    value: float,
    std: float | None = None,
    interval: tuple[float, float] | None = None,
    digits: int = 4,
) -> tuple[str, str]:
    """
    Round a value to two significant digits of its uncertainty; all numbers are finite.

    Parameters
    ----------
    value : float
        The estimate.
    std : float, optional
        Its standard deviation; None or 0 where there is none.
    interval : (float, float), optional
        Its 95 % interval, printed to the same place.
    digits : int
        Significant digits of the value where there is no uncertainty.

    Returns
    -------
    str, str
        As HTML: '8.013 ± 0.042' or, where a deviation would mislead, '0.070, −0.260 … 0.390';
        and the interval, '7.931 … 8.095', '' without one.

    """
    std = None if std is None or std <= 0.0 else std
    texts, exponent = decimal_digits([value, *(interval or ()), std or 0.0], std, digits)
    text, *ends, deviation = (each.replace('-', '−') for each in texts)
    range_ = ' … '.join(ends)
    if std is not None and interval is not None and _skewed(value, std, interval):
        text = f'{text}, {range_}'
    elif std is not None:
        text = f'{text} ± {deviation}'
    if exponent:
        power = f' × 10<sup>{str(exponent).replace("-", "−")}</sup>'
        text = f'({text}){power}' if std is not None else f'{text}{power}'
        range_ = f'({range_}){power}' if range_ else ''
    return text, range_


def _skewed(value: float, std: float, interval: tuple[float, float]) -> bool:
    """Whether a 95 % interval is far from value -/+ 1.96 std: longer, or much to one side."""
    short, long = sorted((value - interval[0], interval[1] - value))
    return long > _LONGER * NORMAL_95 * std or long > _ONE_SIDED * short
