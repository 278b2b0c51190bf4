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
from typing import Any

from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from hunt_ros.report.events import sentence
from hunt_ros.samples import number_of

#: Colour of a level.
STYLES: dict[str, str] = {'OK': 'green', 'WARN': 'yellow', 'ERROR': 'bold red', 'STALE': 'magenta'}
#: A wider bar says no more.
_WIDEST = 120
_SIGNS = {'OK': '✓', 'WARN': '▲', 'ERROR': '■', 'STALE': '?'}
_LOUD, _QUIET = 'bold red', 'dim'
#: Where a bar may end: this times a power of ten, so that it does not change all the time.
_ENDS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
#: A bar is at least so long: a rig that stands still, or its noise, does not fill it (mm).
_SHORTEST_SPEED, _SHORTEST_MM = 1.0, 0.1
#: For terminals without these signs.
_ASCII = str.maketrans(
    {'✓': '+', '▲': '^', '■': '#', '█': '#', '─': '-', '┃': '|', '║': 'I', '◇': 'o', '±': '~'}
    | {'–': '-', '−': '-', '…': '~', '≥': '>', 'ψ': 'p', '░': '.'}
)
#: The lines of the log that stay before anything of lesser rank.
_NEWEST = 3

#: How soon it is left out (a high one first), what it says, its style.
_Row = tuple[float, str, str]


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
        rows: list[_Row] = []
        parts = (self._level, self._doubts, self._speed, self._amplitude, self._numbers)
        for part in (*parts, self._profile, self._log, self._keys):
            rows += part(wide)
        kept = sorted(sorted(range(len(rows)), key=lambda each: rows[each][0])[:height])
        return [_text(*rows[each][1:]) for each in kept]

    def _level(self, width: int) -> Iterator[_Row]:
        """Yield level, state and why: the first of all."""
        status = self.sections['status']
        level, region, since = status['level'], status['region'], status['since_s']
        place = 'region unknown' if region == 'unknown' else f'{region} region'
        state = f'{status["state"]}, {place}'.replace('_', ' ')
        if status['silent']:
            state = 'NO WORD FROM THE DETECTOR'
        lasts = f' for {_duration(status["stamp_s"] - since)}' if since else ''
        words = f' {_SIGNS.get(level, "?")} {level}{lasts}  {state}'
        colour = STYLES.get(level, STYLES['STALE']).split()[-1]
        yield 0, words.ljust(width), f'bold reverse {colour}'
        if status['alarm']:
            yield 1.5, ' ALARM NOT ACKNOWLEDGED'.ljust(width), f'reverse {_LOUD}'
        reasons = [*status['why'].split('; '), *filter(None, status['absent'].split('; '))]
        for number, reason in enumerate(reasons):
            style = STYLES.get(level, '') if number == 0 else ''
            for part, (_, words, _) in enumerate(_wrapped(0.0, f' {reason}', width)):
                yield 1 + 3 * min(number, 4) + 0.2 * part, words, style

    def _doubts(self, width: int) -> Iterator[_Row]:
        """Yield what is wrong beside the level: drive, interlock, nodes."""
        drive = self.sections['drive']
        if drive and drive['silent']:
            words = ' THE SPEED NODE IS SILENT: profile and interlock are not known'
            yield from _wrapped(2.0, words, width, _LOUD)
        elif drive:
            if drive['emergency_stop']:
                yield 2.0, ' EMERGENCY STOP IS IN FORCE', _LOUD
            loud = drive['interlock_state'] != 'armed' or drive['interlock'] == 'off'
            state = f'interlock {drive["interlock_state"]}'
            words = f' {state.upper() if loud else state}, mode {drive["interlock"]}'
            words += f': {drive["interlock_cause"]}' if drive['interlock_cause'] else ''
            yield from _wrapped(2.1 if loud else 8.0, words, width, _LOUD if loud else '')
        for node in self.sections['nodes']:
            if node['level'] != 'OK':  # in one row: the log has the whole of it
                words = f' {node["name"]} {node["level"]}: {node["message"]}'
                yield 5.5, words, STYLES.get(node['level'], '')

    def _speed(self, width: int) -> Iterator[_Row]:
        """Yield the gauge of the speed, with v_n, v_c and the set point."""
        status, drive, unit = (self.sections[name] for name in ('status', 'drive', 'speed_unit'))
        drive = None if drive is None or drive['silent'] else drive
        speed = None if status['silent'] else status['speed']
        by = ''
        if speed is None and drive and drive['speed'] is not None:
            speed, by = drive['speed'], ' by the drive'
        marks = {f'{name} ┃': status[name] for name in ('v_n', 'v_c') if not status['silent']}
        marks['set point ◇'] = drive['target'] if drive else None
        words = f' v  {_fixed(speed, 2)} {unit}{by}{_said(marks, 2)}'
        if not status['silent'] and not status['normal_form']:
            words += ', no normal form: v_n and v_c are not known'
        yield from _wrapped(2.5, words, width, 'bold')
        if status['clearance']:
            yield from _wrapped(4.0, f' {status["clearance"]}', width)
        yield 6.0, *_bar(width, _SHORTEST_SPEED, 1.12, speed, marks)

    def _amplitude(self, width: int) -> Iterator[_Row]:
        """Yield the bar of the amplitude, against the unstable branch and the limit cycle."""
        silent = self.sections['status']['silent']
        status = {} if silent else self.sections['status']
        size, std, unstable, stable, fold = (
            status.get(f'{name}_mm')
            for name in ('amplitude', 'amplitude_std', 'unstable', 'stable', 'fold')
        )
        words = f' A  {_fixed(size, 3)} mm'
        if size is not None and std is not None:
            words += f' ± {std:.3f}'
        beyond = size is not None and unstable is not None and size >= unstable
        if size is not None and unstable is not None:
            words += f', {"BEYOND" if beyond else "below"} the unstable branch'
        marks = {'A_u ┃': unstable, 'limit cycle ║': stable}
        yield from _wrapped(3.0, words + _said(marks, 3), width, _LOUD if beyond else 'bold')
        # The fold gives the bar the same length before the branches begin.
        yield 5.0, *_bar(width, _SHORTEST_MM, 1.05, size, marks, fold)

    def _numbers(self, width: int) -> Iterator[_Row]:
        """Yield the other numbers, with what is known of them."""
        if self.sections['status']['silent']:
            return
        items = []
        for tile in self.sections['numbers']:
            if tile['key'] not in ('speed', 'amplitude'):
                note = f' ({tile["note"]})' if tile['note'] else ''
                items.append(f'{tile["label"]} {tile["text"]} {tile["unit"]}'.rstrip() + note)
        yield from _joined(9.0, items, width, '')

    def _profile(self, width: int) -> Iterator[_Row]:
        """Yield the progress of the profile."""
        drive = self.sections['drive']
        if drive is None:
            words = ' no word from a drive: profile and interlock are not known'
            yield from _wrapped(9.5, words, width, _QUIET)
        elif not drive['silent'] and not drive['profile']:
            yield 9.5, ' no profile', _QUIET
        elif not drive['silent']:
            words = f' profile {_printable(drive["profile"])}: {drive["profile_state"]}'
            done, left = drive['progress'], drive['remaining_s']
            if done is not None:
                tail = f' {100 * done:.0f} %' + (
                    '' if left is None else f', {_duration(left)} left'
                )
                cells = max(0, min(30, width - len(words) - len(tail) - 1))
                full = round(cells * done)
                words = f'{words} {"█" * full}{"░" * (cells - full)}{tail}'
            yield 7.5, words, ''

    def _log(self, width: int) -> Iterator[_Row]:
        """Yield the newest lines, each whole."""
        newest = self.log[-200:]
        for age, (line, style) in zip(range(len(newest) - 1, -1, -1), newest, strict=True):
            rank = 7.0 + 0.1 * age if age < _NEWEST else 20.0 + age
            yield from _wrapped(rank, f' {line}', width, style)

    def _keys(self, width: int) -> Iterator[_Row]:
        """Yield what the keys do."""
        yield from _joined(6.5, self.keys, width, _QUIET)


def event_line(event: Mapping[str, str], origin_ns: int) -> str:
    """
    Return an event as one line.

    Parameters
    ----------
    event : mapping
        As printed by the console: stamp_ns, event, speed_mps, amplitude_m, message.
    origin_ns : int
        Time zero of the first column.
    """
    seconds = (int(event['stamp_ns']) - origin_ns) / 1e9
    speed, amplitude = number_of(event, 'speed_mps'), 1e3 * number_of(event, 'amplitude_m')
    numbers = [
        f'{value:{form}} {unit}' if math.isfinite(value) else '-'
        for value, form, unit in ((speed, '.2f', 'm/s'), (amplitude, '.3f', 'mm'))
    ]
    text = f'{seconds:8.1f} s  {numbers[0]:>10}  {numbers[1]:>9}  {sentence(event["event"])}'
    reason = event.get('message', '')
    return f'{text} ({reason})' if reason else text


def _text(words: str, style: str) -> Text:
    return Text(_printable(words), style=style, no_wrap=True, overflow='ellipsis')


def _wrapped(rank: float, words: str, width: int, style: str = '') -> Iterator[_Row]:
    """Yield a text in rows; what follows the first is indented more."""
    for row in textwrap.wrap(
        _printable(words), width, subsequent_indent='   ', break_on_hyphens=False
    ):
        yield rank, row, style


def _joined(rank: float, items: Sequence[str], width: int, style: str) -> Iterator[_Row]:
    """Yield items side by side, in as many rows as they need."""
    row = ''
    for item in items:
        if row and len(row) + 3 + len(item) > width:
            yield rank, row, style
            row = ''
        row += f'   {item}' if row else f' {item}'
    if row:
        yield rank, row, style


def _said(marks: Mapping[str, float | None], digits: int) -> str:
    """Return where the marks of a bar are; each is a name and its sign."""
    return ''.join(
        f', {name} {_fixed(at, digits)}' for name, at in marks.items() if at is not None
    )


def _bar(
    width: int,
    shortest: float,
    room: float,
    value: float | None,
    marks: Mapping[str, float | None],
    least: float | None = None,
) -> tuple[str, str]:
    """Return a bar that is full up to `value` and has room for marks and `least`; its style."""
    known = [at for at in (value, least, *marks.values()) if at is not None]
    longest = max(shortest, room * max(known, default=0.0))
    decade = 10.0 ** math.floor(math.log10(longest))
    end = next(step * decade for step in _ENDS if step * decade >= longest * (1.0 - 1e-12))
    cells = width - 2
    if value is None:
        row = ['?' if cell % 4 == 1 else ' ' for cell in range(cells)]
    else:
        full = round(cells * min(max(value / end, 0.0), 1.0))
        row = ['█'] * full + ['─'] * (cells - full)
    for name, at in marks.items():
        if at is not None:
            row[min(max(round(cells * at / end), 0), cells - 1)] = name[-1]
    return ' ' + ''.join(row), STYLES['STALE'] if value is None else ''


def _fixed(value: float | None, digits: int) -> str:
    return '–' if value is None else f'{value:.{digits}f}'


def _duration(seconds: float) -> str:
    """Return e.g. '7 s', '3:20 min' or '1:03:20 h'."""
    whole = round(max(0.0, seconds))
    if whole < 60:
        return f'{whole} s'
    if whole < 3600:
        return f'{whole // 60}:{whole % 60:02} min'
    return f'{whole // 3600}:{whole // 60 % 60:02}:{whole % 60:02} h'


def _printable(words: str) -> str:
    """Return a text that cannot move the cursor: what a topic says is not trusted."""
    return ''.join(sign if sign.isprintable() else ' ' for sign in words)
