"""
What an operator reads, on the page and on the terminal: numbers and sentences in his units.

Messages and recordings are SI; a `Words` turns what they say into the unit of speeds that the
rig file asks for (`speed_unit`), numbers and sentences alike. A number has a fixed count of
decimals, so that only digits change from one reading to the next.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from hunt_ros.rig import SPEED_UNITS
from hunt_ros.samples import Uncertain, known, number_of

_NUMBER = r'(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?'
#: A speed in a sentence: a number, one with its deviation, a range, or one with its interval.
_SPEEDS = re.compile(
    rf'({_NUMBER}(?:(?: \+/- | ± | … | to | and ){_NUMBER})*) m/s(?![\w^²])(?: \(95 %: ([^)]*)\))?'
)
_UNKNOWN = '–'
#: A greater margin says no more.
_MOST_MARGIN = 99.9
_HUNTS = ('escaping', 'limit_cycle')

Tile = dict[str, str]


class Words:
    """
    Numbers and sentences for an operator.

    Parameters
    ----------
    unit : str
        Of speeds: 'm/s' or 'km/h'.
    """

    def __init__(self, unit: str = 'm/s') -> None:
        self.unit = unit
        self.factor = SPEED_UNITS[unit]
        self.places = 2 if self.factor == 1.0 else 1

    def speed(self, mps: float) -> float | None:
        """Return a speed, m/s, in the unit that is shown; None where it is not known."""
        return known(self.factor * mps)

    def in_unit(self, words: str) -> str:
        """Return a sentence with the speeds in it, m/s, in the unit that is shown."""
        return words if self.factor == 1.0 else _SPEEDS.sub(self._converted, words)

    def _converted(self, found: re.Match[str]) -> str:
        numbers, interval = (re.sub(_NUMBER, self._number, part or '') for part in found.groups())
        return f'{numbers} {self.unit}' + (f' (95 %: {interval})' if interval else '')

    def _number(self, found: re.Match[str]) -> str:
        decimals = len(found[0].partition('.')[2])
        return f'{self.factor * float(found[0]):.{max(1, decimals - 1)}f}'

    def tiles(self, status: Mapping[str, str], health: Mapping[str, str]) -> list[Tile]:
        """
        Return the numbers that are shown.

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
        speed = number_of(status, 'speed_mps')
        critical = {name: number_of(status, f'{name}_mps') for name in ('v_n', 'v_c')}
        amplitude, std = (1e3 * number_of(status, f'amplitude{part}') for part in ('_m', '_std_m'))
        growth = number_of(status, 'growth_rate_per_s')
        growth_std = _deviation(number_of(status, 'growth_rate_std_per_s'), 2)
        return [
            self._speed_tile('speed', 'speed v', speed),
            _tile('amplitude', 'amplitude of y', 'mm', amplitude, 3, _deviation(std, 3)),
            _margin(status),
            _tile('growth', 'growth rate', '1/s', growth, 2, growth_std, '+'),
            _escape(status),
            _time(status),
            *(self._distance(name, value, speed) for name, value in critical.items()),
            self._forecast(health),
        ]

    def _speed_tile(
        self, key: str, label: str, mps: float, note: str = '', sign: str = ''
    ) -> Tile:
        return _tile(key, label, self.unit, self.factor * mps, self.places, note, sign)

    def _distance(self, name: str, critical: float, speed: float) -> Tile:
        """Return how far the speed is below a critical speed: negative above it."""
        note = f'{name} {self.factor * critical:.{self.places}f}'
        return self._speed_tile(f'to_{name}', f'{name} − v', critical - speed, note, '+')

    def _forecast(self, health: Mapping[str, str]) -> Tile:
        """Return the forecast of the critical speed with its 95 % interval, or why not."""
        found = Uncertain(*(number_of(health, f'forecast_v_c{part}') for part in ('', '_std')))
        note = _interval(self.factor * found.low, self.factor * found.high, self.places)
        note = note or health.get('forecast_v_c', '') or 'none yet'
        return self._speed_tile('forecast', 'forecast of v_c', found.value) | {'note': note}


def _tile(
    key: str, label: str, unit: str, value: float, places: int, note: str = '', sign: str = ''
) -> Tile:
    """Return one number; a dash where it is not known."""
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


def _margin(status: Mapping[str, str]) -> Tile:
    """Return the margin: the most dangerous state has a word in its place, not a dash."""
    margin = number_of(status, 'margin')
    low, high = number_of(status, 'margin_low'), number_of(status, 'margin_high')
    tile = _tile('margin', 'margin A_u / A', '', margin, 1, _interval(low, high, 1))
    region = status.get('region', '')
    words = {'stable': ('∞', 'motion decays'), 'unstable': ('NONE', 'rest is unstable')}
    if status.get('state') in _HUNTS:
        tile |= {'text': 'LOST', 'note': 'beyond A_u'}
    elif margin > _MOST_MARGIN and region != 'stable':
        tile |= {'text': f'> {_MOST_MARGIN:.0f}', 'note': ''}
    elif not math.isfinite(margin):
        none = 'no amplitude yet' if status.get('normal_form') else 'no normal form'
        text, note = words.get(region, (_UNKNOWN, none if status else ''))
        tile |= {'text': text, 'note': note}
    return tile


def _escape(status: Mapping[str, str]) -> Tile:
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


def _time(status: Mapping[str, str]) -> Tile:
    """Return the time that is left to the limit cycle."""
    label = 'to the limit cycle'
    if status.get('state') == 'limit_cycle':
        return {'key': 'time', 'label': label, 'text': 'NOW', 'unit': '', 'note': 'it is reached'}
    return _tile('time', label, 's', number_of(status, 'time_to_limit_cycle_s'), 1)
