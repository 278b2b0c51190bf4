"""
Every alarm by its code.

The codes are stable: a recording, a script and an operator know an alarm by them. What each means,
what follows, what to do and how soon stands in docs/alarm.md.
"""

from __future__ import annotations

from typing import NamedTuple

from hunt_ros.samples import CHANNELS

#: What trips the interlock, the gravest first.
TRIPS = ('speed', 'displacement', 'detector', 'inputs', 'drive', 'amplitude', 'hunting')
#: What the detector alarms for; CHANNEL stands for the name of each.
DETECTED = (
    *('escaping', 'limit_cycle'),
    *('alarm_lateral_mm', 'alarm_yaw_mrad', 'alarm_acceleration_mps2'),
    *('CHANNEL_waiting', 'CHANNEL_silent', 'CHANNEL_no_value'),
    *('CHANNEL_stuck', 'CHANNEL_saturated', 'CHANNEL_contradicted', 'CHANNEL_lost'),
)

#: Operating state -> codes of what calls nobody in it, by design (ISA-18.2): where the roller
#: stands nothing hunts, and sensors are moved by hand; in `measure` hunting is looked for.
OUT_OF_SERVICE = {
    'parked': {key.replace('CHANNEL', channel) for key in DETECTED for channel in CHANNELS},
    'measure': {'escaping', 'limit_cycle'},
}

#: Event -> code of the alarm that begins with it, or ends with it; that of a limit is its test.
_BEGINS = {
    'escaping': 'hunting',
    'limit_cycle': 'hunting',
    'limit_exceeded': '',
    'input_stale': 'CHANNEL_silent',
    'sensor_fault': 'CHANNEL_fault',
    'interlock_tripped': 'trip',
}
_ENDS = {
    'quiet': 'hunting',
    'disturbed': 'hunting',
    'limit_cleared': '',
    'input_recovered': 'CHANNEL_silent',
    'sensor_recovered': 'CHANNEL_fault',
    'interlock_armed': 'trip',
    'interlock_disarmed': 'trip',
}


class Told(NamedTuple):
    """What an event says of an alarm: its code, and whether it begins, or is over."""

    code: str
    begins: bool


def alarm_of(event: str, level: str, test: str, cause: str) -> Told | None:
    """
    Return the alarm that an event of `hunting/events` begins or ends; None where it does neither.

    Parameters
    ----------
    event, level, test, cause : str
        As they are published; what is OK or WARN calls nobody, and begins no alarm.
    """
    begins = event in _BEGINS
    code = (_BEGINS if begins else _ENDS).get(event)
    if code is None or (begins and level in ('OK', 'WARN')):
        return None
    if not code and not test.startswith('alarm_'):  # a warning beside an alarm
        return None
    channel = cause.partition(' ')[0].rstrip(':')
    return Told(code.replace('CHANNEL', channel) or test, begins)
