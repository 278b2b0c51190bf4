"""
Numbers as a paper prints them: rounded to their uncertainty, in text and in HTML.

The uncertainty keeps two significant digits (GUM, JCGM 100:2008, 7.2.6) and the
value ends at the same place. Rounding is decimal and half to even, so that what
is printed never depends on how a number happens to be stored in binary.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any

from hunt_ros.samples import NORMAL_95

#: Half an interval over what the deviation says, and over its other half, from which the
#: interval is printed and not the deviation.
_LONGER, _ONE_SIDED = 1.5, 2.5
#: Powers of ten from which a number is printed with an exponent.
_LARGE, _SMALL = 5, -4


@dataclass(frozen=True)
class Rounded:
    """
    A number, its uncertainty and its 95 % interval, ended at one decimal place.

    Parameters
    ----------
    value, std, low, high : str
        Digits with a true minus sign; empty where not given.
    exponent : int
        All four are to be multiplied by ten to this power; 0 for plain numbers.
    skewed : bool
        Whether a deviation would mislead: the interval is printed in its place.
    """

    value: str
    std: str = ''
    low: str = ''
    high: str = ''
    exponent: int = 0
    skewed: bool = False

    def text(self) -> str:
        """Return e.g. '8.013 ± 0.042' or '(−4.20 ± 0.13) × 10^7'."""
        return self._joined(f' × 10^{self.exponent}')

    def html(self) -> str:
        """Return the same for HTML."""
        return self._joined(f' × 10<sup>{str(self.exponent).replace("-", "−")}</sup>')

    def interval_html(self) -> str:
        """Return e.g. '7.931 … 8.095', with its power of ten, for HTML; '' without one."""
        if not self.low:
            return ''
        range_ = f'{self.low} … {self.high}'
        if not self.exponent:
            return range_
        return f'({range_}) × 10<sup>{str(self.exponent).replace("-", "−")}</sup>'

    def _joined(self, power: str) -> str:
        both = f'{self.value} ± {self.std}' if self.std else self.value
        if self.skewed:
            both = f'{self.value}, {self.low} … {self.high}'
        if not self.exponent:
            return both
        return f'({both}){power}' if self.std else f'{both}{power}'


def rounded(
    value: float,
    std: float | None = None,
    interval: tuple[float, float] | None = None,
    digits: int = 4,
) -> Rounded:
    """
    Round a value to two significant digits of its uncertainty.

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

    Raises
    ------
    ValueError
        If one of the numbers is not finite (what is not known has no digits).
    """
    numbers = [value, *([] if std is None else [std]), *(interval or ())]
    if not all(math.isfinite(x) for x in numbers):
        raise ValueError(f'only finite numbers have digits, got {numbers}')
    if std is None or std <= 0.0:
        place = _leading(value) - digits + 1 if value else -1
        std = None
    else:
        place = _leading(std) - 1
        # 0.0996 rounds to 0.10: one place up, or it would show three digits.
        place = max(place, _leading(float(_at(std, place))) - 1)
    leading = max((_leading(x) for x in (value, std or 0.0) if x), default=0)
    exponent = leading if leading >= _LARGE or leading <= _SMALL else 0
    low, high = interval if interval is not None else (None, None)
    value_, std_, low_, high_ = (
        '' if x is None else _digits(x, place, exponent) for x in (value, std, low, high)
    )
    skewed = std is not None and interval is not None and _skewed(value, std, interval)
    return Rounded(value_, std_, low_, high_, exponent, skewed)


def _skewed(value: float, std: float, interval: tuple[float, float]) -> bool:
    """Whether a 95 % interval is far from value -/+ 1.96 std: longer, or much to one side."""
    short, long = sorted((value - interval[0], interval[1] - value))
    return long > _LONGER * NORMAL_95 * std or long > _ONE_SIDED * short


def measured(value: float, std: float) -> str:
    """Return value and deviation as HTML; a deviation that is not finite is left out."""
    if not math.isfinite(value):
        return 'not known'
    return rounded(value, std if math.isfinite(std) else None).html()


def rounded_json(entry: Mapping[str, Any], scale: float = 1.0) -> Rounded:
    """
    Round the `{value, std, ci95}` of a result.

    Parameters
    ----------
    entry : mapping
        As `Uncertain.to_json` gives it; `std` and `ci95` may be None or absent.
    scale : float
        Of the unit printed: 1e3 prints metres as millimetres.
    """
    std, interval = entry.get('std'), entry.get('ci95')
    return rounded(
        scale * float(entry['value']),
        None if std is None else scale * float(std),
        None if interval is None else (scale * float(interval[0]), scale * float(interval[1])),
    )


def plain(value: float, digits: int = 4) -> str:
    """Return a number without uncertainty, to so many significant digits, for text."""
    return rounded(value, digits=digits).text()


def _leading(value: float) -> int:
    """Power of ten of the first significant digit; 0 for zero."""
    return Decimal(repr(abs(value))).adjusted() if value else 0


def _at(value: float, place: int) -> Decimal:
    """`value` rounded at a decimal place given as a power of ten."""
    unit = Decimal(1).scaleb(place)
    return (Decimal(repr(value)) / unit).quantize(Decimal(1), ROUND_HALF_EVEN) * unit


def _digits(value: float, place: int, exponent: int) -> str:
    """Digits of `value` / 10^exponent, ended at `place`, with a true minus sign."""
    scaled = _at(value, place).scaleb(-exponent)
    text = f'{abs(scaled):.{max(0, exponent - place)}f}'
    return f'−{text}' if scaled < 0 else text
