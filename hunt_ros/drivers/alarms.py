"""
Every alarm by its code; and what is shelved.

The codes are stable: a recording, a script and an operator know an alarm by them. What each means,
what follows, what to do and how soon stands in docs/alarm.md. The trips of the interlock and a
silent detector cannot be shelved. What is shelved calls nobody (no sound, no command, no relay)
for a time; levels, latched alarm and interlock stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from typing import NamedTuple

from hunt_ros.errors import ConfigError
from hunt_ros.samples import CHANNELS
from hunt_ros.settings import Settings, setting

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


#: An alarm is shelved for no longer than this, min.
LONGEST_MIN = 480.0


@dataclass(frozen=True)
class Shelved(Settings):
    """
    One alarm that calls nobody for a time.

    Parameters
    ----------
    code : str
        One of `DETECTED`.
    until_s : float
        When that ends, s since 1970: it outlives the process.
    minutes : float
        For how long it was asked.
    reason : str
        Of the person who asked.
    """

    code: str = ''
    until_s: float = 0.0
    minutes: float = setting(0.0, 'How long it is shelved.', low=0.0, high=LONGEST_MIN)
    reason: str = ''

    @classmethod
    def asked(cls, words: str, now_s: float) -> Shelved:
        """
        Return what a person asked for: 'CODE MINUTES REASON'; 0 minutes end it.

        Raises
        ------
        ConfigError
            Saying what was expected.
        """
        code, minutes, reason = (*words.split(None, 2), '', '', '')[:3]
        if code not in OUT_OF_SERVICE['parked']:
            raise ConfigError(f'{code!r}: no alarm that can be shelved, docs/alarm.md has them')
        try:
            asked = cls(code, now_s, float(minutes), reason.replace(';', ','))
        except ValueError as error:  # which a ConfigError is, too
            why = f' ({error})' if isinstance(error, ConfigError) else ''
            raise ConfigError(f'{words!r}: expected CODE MINUTES REASON{why}') from error
        if asked.minutes and not reason:
            raise ConfigError(f'{words!r}: expected a reason behind the minutes')
        return replace(asked, until_s=now_s + 60.0 * asked.minutes)

    def lasts(self, now_s: float) -> bool:
        """Return True while it is in force; a clock that is set back makes it no longer."""
        return 0.0 < self.until_s - now_s <= 60.0 * self.minutes

    @property
    def until(self) -> str:
        """When it ends, as a clock of this machine shows it."""
        return f'{datetime.fromtimestamp(self.until_s):%H:%M}'
