"""What an operator reads while the rig runs: events as sentences, levels as colours."""

from __future__ import annotations

import math
from collections.abc import Mapping

_SENTENCES: dict[str, str] = {
    'hysteresis_entered': 'entered the hysteresis region: a bump can now start hunting',
    'hysteresis_left': 'left the hysteresis region',
    'unstable_entered': 'above the critical speed: the quiet state is unstable',
    'unstable_left': 'below the critical speed again',
    'escaping': 'ESCAPING: the motion is growing towards the limit cycle',
    'limit_cycle': 'LIMIT CYCLE: full hunting',
    'decaying': 'hunting is dying out',
    'quiet': 'quiet',
    'disturbed': 'disturbed, inside the basin of the quiet state',
    'margin_low': 'margin is low',
    'margin_restored': 'margin is restored',
    'limit_exceeded': 'AMPLITUDE LIMIT EXCEEDED',
    'limit_cleared': 'amplitude limit kept again',
    'motion_outside_range': 'MOTION OUTSIDE THE RANGE THAT IS FOLLOWED',
    'motion_outside_range_over': 'no more motion outside the range that is followed',
    'sensor_fault': 'SENSOR FAULT',
    'sensor_recovered': 'sensor recovered',
    'input_stale': 'INPUT STALE: the estimates cannot be trusted',
    'input_recovered': 'input recovered',
    'interlock_tripped': 'INTERLOCK TRIPPED',
    'interlock_armed': 'interlock armed',
    'interlock_disarmed': 'INTERLOCK DISARMED',
    'acknowledged': 'alarm acknowledged',
    'criterion_exceeded': 'CRITERION EXCEEDED',
    'criterion_cleared': 'criterion no longer exceeded',
}

#: Colour of a level on a terminal.
STYLES: dict[str, str] = {'OK': 'green', 'WARN': 'yellow', 'ERROR': 'bold red', 'STALE': 'magenta'}


def length(metres: float) -> str:
    """Return a length with the unit that makes it readable."""
    if not math.isfinite(metres):
        return '-'
    if abs(metres) >= 9.95e-3:
        return f'{metres * 1e3:.1f} mm'
    return f'{metres * 1e3:.3f} mm'


def event_line(event: Mapping[str, str], origin_ns: int) -> str:
    """
    Return an event as one line.

    Parameters
    ----------
    event : mapping
        As printed by the console: stamp_ns, event, level, speed_mps, amplitude_m, message.
    origin_ns : int
        Time zero of the first column.
    """
    seconds = (int(event['stamp_ns']) - origin_ns) / 1e9
    name = event.get('event', event.get('name', ''))
    sentence = _SENTENCES.get(name, name.replace('_', ' '))
    reason = event.get('message', '')
    from hunt_ros.samples import number_of  # numpy: not for a line of help

    speed, amplitude = number_of(event, 'speed_mps'), number_of(event, 'amplitude_m')
    text = f'{seconds:8.1f} s  {_speed(speed)}  {length(amplitude):>9}  {sentence}'
    return f'{text} ({reason})' if reason else text


def _speed(value: float) -> str:
    """Return a speed in columns of one width; a dash where it is not known."""
    return f'{value:6.2f} m/s' if math.isfinite(value) else f'{"-":>6}    '
