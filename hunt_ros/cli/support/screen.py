"""
What the terminal shows of a running rig below its log: some rows, the gravest first.

A terminal that is too short for them shows the first ones. All that the colours say stands there
in words too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rich.text import Text

from hunt_ros.report.events import sentence
from hunt_ros.samples import number_of

#: Colour of a level.
STYLES: dict[str, str] = {'OK': 'green', 'WARN': 'yellow', 'ERROR': 'bold red', 'STALE': 'magenta'}
_LOUD, _QUIET = 'bold red', 'dim'
_REARM = 'until rearmed (hunt call rearm)'


def rows(sections: Mapping[str, Any], keys: Sequence[str], width: int) -> Iterator[Text]:
    """
    Yield the rows.

    Parameters
    ----------
    sections : mapping of str to object
        What the rig has said of itself: `hunt_ros.dashboard.told.Told.sections`.
    keys : sequence of str
        What each key does.
    width : int
        Of the terminal.
    """
    status = sections['status']
    level, region, since = status['level'], status['region'], status['since_s']
    style = STYLES.get(level, STYLES['STALE'])
    place = 'region unknown' if region == 'unknown' else f'{region} region'
    state = f'{status["state"]}, {place}'.replace('_', ' ')
    if status['silent']:
        state = 'NO WORD FROM THE DETECTOR'
    lasts = f' for {_duration(status["stamp_s"] - since)}' if since else ''
    yield _row(f'{level}{lasts}  {state}', f'bold reverse {style.split()[-1]}')
    if status['alarm']:
        yield _row('ALARM NOT ACKNOWLEDGED', f'reverse {_LOUD}')
    drive = sections['drive']
    yield from _interlock(drive)
    for reason in filter(None, [*status['why'].split('; '), *status['absent'].split('; ')]):
        yield _row(reason, style, wrap=True)
    for node in sections['nodes']:
        if node['level'] != 'OK':  # in one row: the log has the whole of it
            words = f'{node["name"]} {node["level"]}: {node["message"]}'
            yield _row(words, STYLES.get(node['level'], ''))
    if not status['silent']:
        if status['clearance']:
            yield _row(status['clearance'], wrap=True)
        yield from map(_row, _joined(_numbers(sections), width))
    yield _row(_profile(drive), _QUIET if drive is None else '')
    for line in _joined(keys, width):
        yield _row(line, _QUIET)


def _interlock(drive: Mapping[str, Any] | None) -> Iterator[Text]:
    """Yield what holds the roller, or may."""
    if drive is None:
        return
    if drive['silent']:
        yield _row('THE SPEED NODE IS SILENT: profile and interlock are not known', _LOUD, True)
        return
    if drive['emergency_stop']:
        yield _row(f'EMERGENCY STOP IS IN FORCE, {_REARM}', _LOUD)
    loud = drive['interlock_state'] != 'armed' or drive['interlock'] == 'off'
    state = f'interlock {drive["interlock_state"]}'
    words = f'{state.upper() if loud else state}, mode {drive["interlock"]}'
    words += f', {_REARM}' if drive['interlock_state'] == 'tripped' else ''
    words += f': {drive["interlock_cause"]}' if drive['interlock_cause'] else ''
    yield _row(words, _LOUD if loud else '', wrap=True)


def _numbers(sections: Mapping[str, Any]) -> Iterator[str]:
    """Yield the numbers, each with what is known of it."""
    for tile in sections['numbers']:
        note = f' ({tile["note"]})' if tile['note'] else ''
        yield f'{tile["label"]} {tile["text"]} {tile["unit"]}'.rstrip() + note
    drive = sections['drive']
    if drive and not drive['silent'] and drive['target'] is not None:
        yield f'set point {drive["target"]:.2f} {sections["speed_unit"]}'


def _joined(items: Iterable[str], width: int) -> Iterator[str]:
    """Yield items side by side, in as many lines as they need."""
    line = ''
    for item in items:
        if line and len(line) + 4 + len(item) > width:
            yield line
            line = ''
        line += f'   {item}' if line else item
    yield line


def _profile(drive: Mapping[str, Any] | None) -> str:
    """Return the progress of the profile."""
    if drive is None:
        return 'no word from a drive: profile and interlock are not known'
    if drive['silent'] or not drive['profile']:
        return '' if drive['silent'] else 'no profile'
    words, left = f'profile {drive["profile"]}: {drive["profile_state"]}', drive['remaining_s']
    if drive['progress'] is not None:
        words += f', {100 * drive["progress"]:.0f} %'
        words += '' if left is None else f', {_duration(left)} left'
    return words


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
    happened, reason = sentence(event.get('event', '')), event.get('message', '')
    text = f'{seconds:8.1f} s  {numbers[0]:>10}  {numbers[1]:>9}  {happened}'
    return f'{text} ({reason})' if reason else text


def printable(words: str) -> str:
    """Return a text that cannot move the cursor: what a topic says is not trusted."""
    return ''.join(sign if sign.isprintable() or sign == '\n' else ' ' for sign in words)


def _row(words: str, style: str = '', wrap: bool = False) -> Text:
    """Return a row; one that may not wrap is cut where the terminal ends."""
    words = printable(words).replace('\n', ' ')
    return Text(f' {words}', style, no_wrap=not wrap, overflow='fold' if wrap else 'ellipsis')


def _duration(seconds: float) -> str:
    """Return e.g. '7 s', '3:20 min' or '1:03:20 h'."""
    whole = round(max(0.0, seconds))
    if whole < 60:
        return f'{whole} s'
    if whole < 3600:
        return f'{whole // 60}:{whole % 60:02} min'
    return f'{whole // 3600}:{whole // 60 % 60:02}:{whole % 60:02} h'
