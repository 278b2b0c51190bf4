"""
What the terminal shows of a running rig: a small state, and the rows that are drawn of it.

A row says how soon it is left out where the terminal is short. All that the colours say stands
there in words and signs too. A row is made for a width; no row is ever wrapped by the terminal.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from hunt_ros.cli.support.narration import STYLES

#: A wider bar says no more.
_WIDEST = 120
_SIGNS = {'OK': '✓', 'WARN': '▲', 'ERROR': '■', 'STALE': '?'}
_LOUD, _QUIET = 'bold red', 'dim'
#: Where a bar may end: this times a power of ten, so that it does not change all the time.
_ENDS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
#: A bar is at least so long: a rig that stands still, or its noise, does not fill it.
_SHORTEST_MPS, _SHORTEST_MM = 1.0, 0.1
#: For terminals without these signs.
_ASCII = str.maketrans(
    {'✓': '+', '▲': '^', '■': '#', '█': '#', '─': '-', '┃': '|', '║': 'I', '◇': 'o', '±': '~'}
    | {'–': '-', '−': '-', '…': '~', '≥': '>', 'ψ': 'p', '░': '.'}
)
#: The lines of the log that stay before anything of lesser rank.
_NEWEST = 3


class _Row(NamedTuple):
    """A row of the screen; of a high rank it is left out first."""

    rank: float
    text: Text


@dataclass(frozen=True)
class Screen:
    """
    What is to be drawn; a renderable of rich.

    Parameters
    ----------
    sections : mapping of str to object
        What the rig has said of itself: `hunt_ros.dashboard.told.Told.sections`.
    log : sequence of (str, str)
        Lines with their style, the newest last: events, answers, what the program says.
    keys : sequence of str
        What each key does.
    """

    sections: Mapping[str, Any]
    log: Sequence[tuple[str, str]] = ()
    keys: Sequence[str] = field(default=('Ctrl-C: quit',))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for row in self.rows(options.max_width, options.height or options.size.height):
            if options.ascii_only:
                plain = row.plain.translate(_ASCII).encode('ascii', 'replace').decode()
                row = Text(plain, row.style)
            yield row

    def rows(self, width: int, height: int) -> list[Text]:
        """
        Return the rows that a terminal of this size shows.

        Parameters
        ----------
        width, height : int
            Columns and rows.

        Returns
        -------
        list of Text
            At most `height` of them. Longer ones than `width` are cut by rich, which happens
            only where a single word is longer, or the terminal is narrower than the words of a
            bar.
        """
        wide = max(10, min(width, _WIDEST))
        rows = [
            *self._level(wide),
            *self._doubts(wide),
            *self._speed(wide),
            *self._amplitude(wide),
            *self._numbers(wide),
            *self._profile(wide),
            *self._log(wide, height),
            *self._keys(wide),
        ]
        kept = sorted(sorted(range(len(rows)), key=lambda each: rows[each].rank)[:height])
        return [rows[each].text for each in kept]

    @property
    def _silent(self) -> bool:
        silent: bool = self.sections['status']['silent']
        return silent

    @property
    def _drive(self) -> Mapping[str, Any] | None:
        """What the drive says, as long as it says so."""
        drive: Mapping[str, Any] | None = self.sections['drive']
        return None if drive is None or drive['silent'] else drive

    def _level(self, width: int) -> Iterator[_Row]:
        """Yield level, state and why: the first of all."""
        status = self.sections['status']
        level = status['level']
        region = status['region']
        state = f'{status["state"]}, {region} region'.replace('_', ' ')
        if self._silent:
            state = 'NO WORD FROM THE DETECTOR'
        elif region == 'unknown':
            state = f'{status["state"]}, region unknown'.replace('_', ' ')
        since = status['since_s']
        lasts = ''
        if since and not self._silent and status['stamp_s'] >= since:
            lasts = f' for {_duration(status["stamp_s"] - since)}'
        words = f' {_SIGNS.get(level, "?")} {level}{lasts}  {state}'
        yield _row(0, words.ljust(width), f'bold reverse {_colour(level)}')
        if status['alarm']:
            yield _row(1.5, ' ALARM NOT ACKNOWLEDGED'.ljust(width), f'reverse {_LOUD}')
        reasons = [*status['why'].split('; '), *filter(None, status['absent'].split('; '))]
        for number, reason in enumerate(reasons):
            style = STYLES.get(level, '') if number == 0 else ''
            for part, words in enumerate(_wrapped(reason, width, ' ')):
                yield _row(1 + 3 * min(number, 4) + 0.2 * part, words, style)

    def _doubts(self, width: int) -> Iterator[_Row]:
        """Yield what is wrong beside the level: drive, interlock, nodes."""
        drive = self._drive
        if drive is None and self.sections['drive']:
            words = ' THE SPEED NODE IS SILENT: profile and interlock are not known'
            yield from _wrapped_rows(2.0, words, width, _LOUD)
        if drive:
            if drive['emergency_stop']:
                yield _row(2.0, ' EMERGENCY STOP IS IN FORCE', _LOUD)
            loud = drive['interlock_state'] != 'armed' or drive['interlock'] == 'off'
            state = f'interlock {drive["interlock_state"]}'
            words = f' {state.upper() if loud else state}, mode {drive["interlock"]}'
            words += f': {drive["interlock_cause"]}' if drive['interlock_cause'] else ''
            for part in _wrapped(words, width, ' '):
                yield _row(2.1 if loud else 8.0, part, _LOUD if loud else '')
        for node in self.sections['nodes']:
            if node['level'] != 'OK':
                # In one row: the log has the whole of it.
                words = f' {node["name"]} {node["level"]}: {node["message"]}'
                yield _row(5.5, words, STYLES.get(node['level'], ''))

    def _speed(self, width: int) -> Iterator[_Row]:
        """Yield the gauge of the speed, with v_n and v_c."""
        status, drive = self.sections['status'], self._drive
        speed = None if self._silent else status['speed_mps']
        words = f' v  {_fixed(speed, 2)} m/s'
        if speed is None and drive and drive['speed_mps'] is not None:
            speed = drive['speed_mps']
            words = f' v  {_fixed(speed, 2)} m/s by the drive'
        target = drive['target_mps'] if drive else None
        if target is not None:
            words += f', set point ◇ {target:.2f}'
        marks = [('v_n', '┃', status['v_n_mps']), ('v_c', '┃', status['v_c_mps'])]
        if self._silent:
            marks = []
        elif not status['normal_form']:
            words += ', no normal form: v_n and v_c are not known'
        known = [x for x in (speed, target, *(x for *_, x in marks)) if x is not None]
        end = _end(max(_SHORTEST_MPS, 1.12 * max(known, default=0.0)))
        yield from _wrapped_rows(2.5, words, width, 'bold')
        yield _row(6.0, *_bar(width, end, speed, [*marks, ('', '◇', target)]))
        if known:
            yield _row(8.5, _scale(width, end, marks, 'm/s', 2), _QUIET)

    def _amplitude(self, width: int) -> Iterator[_Row]:
        """Yield the bar of the amplitude, against the unstable branch and the limit cycle."""
        status = self.sections['status']
        size = None if self._silent else status['amplitude_mm']
        words = f' A  {_fixed(size, 3)} mm'
        if size is not None and status['amplitude_std_mm'] is not None:
            words += f' ± {status["amplitude_std_mm"]:.3f}'
        unstable = None if self._silent else status['unstable_mm']
        stable = None if self._silent else status['stable_mm']
        if size is not None and unstable is not None:
            side = 'BEYOND' if size >= unstable else 'below'
            words += f', {side} the unstable branch A_u {unstable:.3f}'
        marks = [('A_u', '┃', unstable), ('limit cycle', '║', stable)]
        # The fold gives the bar the same length before the branches begin.
        fold = None if self._silent else status['fold_mm']
        known = [x for x in (size, unstable, stable, fold) if x is not None]
        end = _end(max(_SHORTEST_MM, 1.05 * max(known, default=0.0)))
        beyond = size is not None and unstable is not None and size >= unstable
        yield from _wrapped_rows(3.0, words, width, _LOUD if beyond else 'bold')
        yield _row(5.0, *_bar(width, end, size, marks))
        if known:
            yield _row(8.4, _scale(width, end, marks, 'mm', 2), _QUIET)

    def _numbers(self, width: int) -> Iterator[_Row]:
        """Yield the other numbers, with what is known of them."""
        if self._silent:
            return
        items = []
        for tile in self.sections['numbers']:
            if tile['key'] not in ('speed', 'amplitude'):
                value = f'{tile["text"]} {tile["unit"]}'.strip()
                note = f' ({tile["note"]})' if tile['note'] else ''
                items.append(f'{tile["label"]} {value}{note}')
        for words in _joined(items, width):
            yield _row(9.0, words, '')

    def _profile(self, width: int) -> Iterator[_Row]:
        """Yield the progress of the profile."""
        drive = self._drive
        if drive is None:
            if self.sections['drive'] is None:
                words = ' no word from a drive: profile and interlock are not known'
                yield from _wrapped_rows(9.5, words, width, _QUIET)
            return
        if not drive['profile']:
            yield _row(9.5, ' no profile', _QUIET)
            return
        words = f' profile {_printable(drive["profile"])}: {drive["profile_state"]}'
        done, left = drive['progress'], drive['remaining_s']
        if done is None:
            yield from _wrapped_rows(7.5, words, width, '')
            return
        tail = f' {100 * done:.0f} %' + ('' if left is None else f', {_duration(left)} left')
        cells = max(0, min(30, width - len(words) - len(tail) - 1))
        full = round(cells * done)
        yield _row(7.5, f'{words} {"█" * full}{"░" * (cells - full)}{tail}', '')

    def _log(self, width: int, height: int) -> Iterator[_Row]:
        """Yield the newest lines, each whole."""
        newest = self.log[-height:]
        for number, (line, style) in enumerate(newest):
            age = len(newest) - number - 1
            rank = 7.0 + 0.1 * age if age < _NEWEST else 20.0 + age
            yield from _wrapped_rows(rank, line, width, style)

    def _keys(self, width: int) -> Iterator[_Row]:
        """Yield what the keys do."""
        for words in _joined(self.keys, width):
            yield _row(6.5, words, _QUIET)


def _row(rank: float, words: str, style: str) -> _Row:
    return _Row(rank, Text(_printable(words), style=style, no_wrap=True, overflow='ellipsis'))


def _wrapped_rows(rank: float, words: str, width: int, style: str) -> Iterator[_Row]:
    for part in _wrapped(words, width, ' '):
        yield _row(rank, part, style)


def _wrapped(words: str, width: int, indent: str) -> list[str]:
    """Return a text in rows; what follows the first is indented more."""
    return textwrap.wrap(
        _printable(words),
        width,
        initial_indent='' if words.startswith(' ') else indent,
        subsequent_indent=3 * indent,
        break_on_hyphens=False,
        drop_whitespace=True,
    )


def _joined(items: Sequence[str], width: int) -> Iterator[str]:
    """Yield items side by side, in as many rows as they need."""
    row = ''
    for item in items:
        if row and len(row) + 3 + len(item) > width:
            yield row
            row = ''
        row += f'   {item}' if row else f' {item}'
    if row:
        yield row


def _bar(
    width: int, end: float, value: float | None, marks: Sequence[tuple[str, str, float | None]]
) -> tuple[str, str]:
    """Return a bar from 0 to `end` that is full up to `value`, with marks, and its style."""
    cells = width - 2
    if value is None:
        row = ['?' if cell % 4 == 1 else ' ' for cell in range(cells)]
    else:
        full = round(cells * min(max(value / end, 0.0), 1.0))
        row = ['█'] * full + ['─'] * (cells - full)
    for _, sign, place in marks:
        if place is not None:
            row[_cell(place, end, cells)] = sign
    return ' ' + ''.join(row), STYLES['STALE'] if value is None else ''


def _scale(
    width: int,
    end: float,
    marks: Sequence[tuple[str, str, float | None]],
    unit: str,
    digits: int,
) -> str:
    """Return the names of the marks under a bar: those that have room, and its end."""
    cells = width - 2
    tail = f'{end:g} {unit}'
    row = [' '] * cells
    row[0] = '0'
    row[max(0, cells - len(tail)) :] = tail[:cells]
    taken = [(-1, 1), (cells - len(tail), cells)]
    for name, _, place in marks:
        if place is None:
            continue
        words = f'{name} {place:.{digits}f}'
        at = _cell(place, end, cells)
        # Centred under its mark, or beside what is there already.
        for begin in (at - len(words) // 2, at, at - len(words) + 1):
            stop = begin + len(words)
            if begin >= 0 and all(stop < low or begin > high for low, high in taken):
                row[begin:stop] = words
                taken.append((begin, stop))
                break
    return ' ' + ''.join(row)


def _cell(value: float, end: float, cells: int) -> int:
    return min(max(round(cells * value / end), 0), cells - 1)


def _end(least: float) -> float:
    """Return the end of a bar that holds `least`."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next(step * decade for step in _ENDS if step * decade >= least * (1.0 - 1e-12))


def _fixed(value: float | None, digits: int) -> str:
    return '–' if value is None else f'{value:.{digits}f}'


def _duration(seconds: float) -> str:
    """Return e.g. '7 s', '3:20 min' or '1:03:20 h'."""
    whole = round(seconds)
    if whole < 60:
        return f'{whole} s'
    if whole < 3600:
        return f'{whole // 60}:{whole % 60:02} min'
    return f'{whole // 3600}:{whole // 60 % 60:02}:{whole % 60:02} h'


def _colour(level: str) -> str:
    return STYLES.get(level, STYLES['STALE']).split()[-1]


def _printable(words: str) -> str:
    """Return a text that cannot move the cursor: what a topic says is not trusted."""
    return ''.join(sign if sign.isprintable() else ' ' for sign in words)
