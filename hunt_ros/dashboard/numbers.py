"""
The numbers of the page as texts: each with its uncertainty, its unit, and what it means.

Each has a fixed count of decimals, so that only digits change from one reading to the next.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from hunt_ros.samples import Uncertain, number_of

_UNKNOWN = '–'
#: A greater margin says no more.
_MOST_MARGIN = 99.9
_HUNTS = ('escaping', 'limit_cycle')


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

    return [
        _tile('speed', 'speed v', 'm/s', value('speed_mps'), 2),
        _tile(
            'amplitude',
            'amplitude of y',
            'mm',
            value('amplitude_m', 1e3),
            3,
            _deviation(value('amplitude_std_m', 1e3), 3),
        ),
        _margin(status),
        _tile(
            'growth',
            'growth rate',
            '1/s',
            value('growth_rate_per_s'),
            2,
            _deviation(value('growth_rate_std_per_s'), 2),
            sign='+',
        ),
        _escape(status),
        _time(status),
        _distance('v_n', status),
        _distance('v_c', status),
        _forecast(health),
    ]


def _tile(
    key: str, label: str, unit: str, value: float, places: int, note: str = '', sign: str = ''
) -> dict[str, str]:
    """Return one number as the page shows it; a dash where it is not known."""
    if not math.isfinite(value):
        return {'key': key, 'label': label, 'text': _UNKNOWN, 'unit': '', 'note': ''}
    text = f'{value:{sign}.{places}f}'.replace('-', '−')
    return {'key': key, 'label': label, 'text': text, 'unit': unit, 'note': note}


def _deviation(std: float, places: int) -> str:
    return f'± {std:.{places}f}' if math.isfinite(std) else ''


def _interval(low: float, high: float, places: int) -> str:
    """Return e.g. '1.9 … 3.1'; '' without an interval, or where both ends read the same."""
    least, most = f'{low:.{places}f}', f'{high:.{places}f}'
    if not math.isfinite(low) or least == most:
        return ''
    return f'{least} … {most}' if math.isfinite(high) else f'≥ {least}'


def _margin(status: Mapping[str, str]) -> dict[str, str]:
    """Return the margin: the most dangerous state has a word in its place, not a dash."""
    margin = number_of(status, 'margin')
    low, high = number_of(status, 'margin_low'), number_of(status, 'margin_high')
    tile = _tile('margin', 'margin A_u / A', '', margin, 1, _interval(low, high, 1))
    region = status.get('region', '')
    words = {
        'stable': ('∞', 'motion decays'),
        'unstable': ('NONE', 'rest is unstable'),
    }
    if status.get('state') in _HUNTS:
        tile |= {'text': 'LOST', 'note': 'beyond A_u'}
    elif margin > _MOST_MARGIN and region != 'stable':
        tile |= {'text': f'> {_MOST_MARGIN:.0f}', 'note': ''}
    elif not math.isfinite(margin):
        none = 'no amplitude yet' if status.get('normal_form') else 'no normal form'
        text, note = words.get(region, (_UNKNOWN, none if status else ''))
        tile |= {'text': text, 'note': note}
    return tile


def _escape(status: Mapping[str, str]) -> dict[str, str]:
    """Return the chance that the present motion escapes, and that of the next minute."""
    chance, minute, low, high = (
        100.0 * number_of(status, f'escape_{name}')
        for name in ('probability', 'chance_next_minute', 'probability_low', 'probability_high')
    )
    tile = _tile('escape', 'chance of escape', '%', chance, 0)
    if not math.isfinite(chance):
        return tile
    if 0.0 < chance < 1.0 or 99.0 < chance < 100.0:
        tile['text'] = '< 1' if chance < 1.0 else '> 99'
    notes = [_interval(low, high, 0)]
    if math.isfinite(minute) and round(minute) != round(chance):
        notes.append(f'1 min: {minute:.0f}')
    return tile | {'note': '; '.join(filter(None, notes))}


def _time(status: Mapping[str, str]) -> dict[str, str]:
    """Return the time that is left to the limit cycle."""
    label = 'to the limit cycle'
    if status.get('state') == 'limit_cycle':
        return {'key': 'time', 'label': label, 'text': 'NOW', 'unit': '', 'note': 'it is reached'}
    return _tile('time', label, 's', number_of(status, 'time_to_limit_cycle_s'), 1)


def _distance(name: str, status: Mapping[str, str]) -> dict[str, str]:
    """Return how far the speed is below a critical speed: negative above it."""
    critical = number_of(status, f'{name}_mps')
    below = critical - number_of(status, 'speed_mps')
    return _tile(f'to_{name}', f'{name} − v', 'm/s', below, 2, f'{name} {critical:.2f}', '+')


def _forecast(health: Mapping[str, str]) -> dict[str, str]:
    """Return the forecast of the critical speed with its 95 % interval, or why there is none."""
    found = Uncertain(*(number_of(health, f'forecast_v_c{part}') for part in ('', '_std')))
    note = _interval(found.low, found.high, 2) or health.get('forecast_v_c', '') or 'none yet'
    return _tile('forecast', 'forecast of v_c', 'm/s', found.value, 2) | {'note': note}
