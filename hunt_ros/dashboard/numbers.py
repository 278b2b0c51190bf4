"""The numbers of the page as texts: each with its uncertainty, its unit, and what it means."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hunt_ros.report.numbers import rounded
from hunt_ros.samples import NORMAL_95, number_of

_UNKNOWN = '–'


def of_status(status: Mapping[str, str], health: Mapping[str, str]) -> list[dict[str, str]]:
    """
    Return what the tiles of the page show.

    Parameters
    ----------
    status : mapping of str to str
        Values of `hunting/status`; empty: all is unknown.
    health : mapping of str to str
        What the detector says on `/diagnostics`: the forecast of v_c.

    Returns
    -------
    list of dict
        `key`, `label`, `text`, `unit`, and `note`: the interval, or why there is no value.
    """

    def value(key: str, scale: float = 1.0) -> float:
        return scale * number_of(status, key)

    low, high = value('escape_probability_low', 100.0), value('escape_probability_high', 100.0)
    chance = value('escape_probability', 100.0)
    minute = value('escape_chance_next_minute', 100.0)
    margin = value('margin')
    return [
        _speed(value('speed_mps')),
        _tile(
            'amplitude',
            'amplitude of y',
            'mm',
            value('amplitude_m', 1e3),
            value('amplitude_std_m', 1e3),
        ),
        _tile(
            'margin',
            'margin A_u / A',
            '',
            margin,
            note=_interval(value('margin_low'), value('margin_high'), '')
            if math.isfinite(margin)
            else _no_margin(status),
            digits=3,
        ),
        _tile(
            'growth',
            'growth rate',
            '1/s',
            value('growth_rate_per_s'),
            value('growth_rate_std_per_s'),
        ),
        {
            'key': 'escape',
            'label': 'chance of escape',
            'text': _percent(chance),
            'unit': '%' if math.isfinite(chance) else '',
            'note': '; '.join(
                filter(
                    None,
                    (
                        _interval(low, high, '%', 0),
                        f'next minute {_percent(minute)} %' if math.isfinite(minute) else '',
                    ),
                )
            ),
        },
        _forecast(health),
    ]


def _tile(
    key: str,
    label: str,
    unit: str,
    value: float,
    std: float = math.nan,
    note: str = '',
    digits: int = 3,
) -> dict[str, str]:
    """Return one number with label, unit and deviation, as the page shows it."""
    if not math.isfinite(value):
        return {'key': key, 'label': label, 'text': _UNKNOWN, 'unit': '', 'note': note}
    shown = rounded(value, std if math.isfinite(std) else None, digits=digits)
    power = f'e{shown.exponent}' if shown.exponent else ''
    return {
        'key': key,
        'label': label,
        'text': shown.value + power,
        'unit': unit,
        'note': note or (f'± {shown.std}{power} {unit}' if shown.std else ''),
    }


def _speed(value: float) -> dict[str, str]:
    """Return the speed to the mm/s: the noise of a roller at rest is no number to read."""
    tile = _tile('speed', 'speed v', 'm/s', value)
    return {**tile, 'text': f'{value:.3f}'} if math.isfinite(value) else tile


def _forecast(health: Mapping[str, str]) -> dict[str, str]:
    """Return the forecast of the critical speed with its 95 % interval, or why there is none."""
    text = health.get('forecast_v_c', '')
    value, std = number_of(health, 'forecast_v_c'), number_of(health, 'forecast_v_c_std')
    tile = _tile('forecast', 'forecast of v_c', 'm/s', value, std)
    if math.isfinite(value):
        if math.isfinite(std):
            half = NORMAL_95 * std
            tile['note'] = _interval(value - half, value + half, 'm/s', 2)
        return tile
    return {**tile, 'note': text or 'none yet'}


def _no_margin(status: Mapping[str, str]) -> str:
    """Return why there is no margin."""
    reasons = {
        'stable': 'quiet motion of any amplitude is stable',
        'unstable': 'quiet motion is unstable',
        'hysteresis': 'no amplitude yet',
    }
    return reasons.get(status.get('region', ''), 'no normal form' if status else '')


def _interval(low: float, high: float, unit: str, places: int | None = None) -> str:
    """Return e.g. '1.9 … 3.1 mm'; '' without an interval."""
    if not math.isfinite(low):
        return ''
    form = '.3g' if places is None else f'.{places}f'
    tail = f' {unit}' if unit else ''
    return (
        f'{low:{form}} … {high:{form}}{tail}' if math.isfinite(high) else f'≥ {low:{form}}{tail}'
    )


def _percent(value: float) -> str:
    if not math.isfinite(value):
        return _UNKNOWN
    if 0.0 < value < 0.1:
        return '< 0.1'
    return f'{value:.1f}' if value < 10.0 else f'{value:.0f}'
