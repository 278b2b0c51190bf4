"""
Every alarm: its code, what it means, what follows, what to do and how soon; and what is shelved.

The codes are stable: a recording, a script and an operator know an alarm by them. The trips of
the interlock and a silent detector cannot be shelved. What is shelved calls nobody (no sound, no
command, no relay) for a time; levels, latched alarm and interlock stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from typing import NamedTuple

from hunt_ros.errors import ConfigError
from hunt_ros.samples import CHANNELS
from hunt_ros.settings import Settings, setting


class Alarm(NamedTuple):
    """Cause, what follows by itself, what a person does, and how soon."""

    cause: str
    consequence: str
    what_to_do: str
    how_soon: str


_TRIP = 'trips in protect and measure'
_STALE = 'STALE; trips in protect and measure (`inputs`)'
_ERROR = 'ERROR, latched; trips in protect (`hunting`)'
_WAIT = 'wait until the motion has died out, then rearm'

#: Code -> what trips the interlock, the gravest first.
TRIPS: dict[str, Alarm] = {
    'speed': Alarm(
        'the measured speed is above the ceiling, does not follow the set point, contradicts the'
        ' encoder, or another master commands the drive',
        f'{_TRIP}; the set point goes to 0',
        'use the hard-wired stop; then look at the drive and its scale',
        'at once',
    ),
    'displacement': Alarm(
        'the lateral sensor itself shows more than the limit',
        _TRIP,
        'look whether the roller slows down; then at the zero of the sensor',
        'at once',
    ),
    'detector': Alarm(
        'the detector is silent, judges nothing new, or comes late',
        _TRIP,
        'look whether its process runs and the machine keeps up',
        'in a minute',
    ),
    'inputs': Alarm(
        'the detector cannot trust its inputs',
        _TRIP,
        'look for the sensor that the cause names',
        'in a minute',
    ),
    'drive': Alarm(
        'the drive is gone, sends nothing, or refuses set points',
        f'{_TRIP}; the safe set point is sent again and again',
        'use the hard-wired stop while the roller turns; then look at the line to the drive',
        'at once',
    ),
    'amplitude': Alarm('an estimate of the amplitude is above the limit', _TRIP, _WAIT, 'at once'),
    'hunting': Alarm('the wheelset hunts, or will for sure', 'trips in protect', _WAIT, 'at once'),
}

#: Code -> what the detector alarms for; CHANNEL stands for the name of each.
DETECTED: dict[str, Alarm] = {
    'escaping': Alarm(
        'the amplitude is beyond the unstable one, or grows for sure',
        _ERROR,
        'slow down below v_n where the interlock does not',
        'at once',
    ),
    'limit_cycle': Alarm(
        'the wheelset hunts', _ERROR, 'slow down below v_n where the interlock does not', 'at once'
    ),
    **{
        f'alarm_{name}': Alarm(
            f'the {what} is above the limit of the lab', _ERROR, 'slow down', 'in a minute'
        )
        for name, what in (
            ('lateral_mm', 'lateral amplitude'),
            ('yaw_mrad', 'yaw amplitude'),
            ('acceleration_mps2', 'lateral acceleration'),
        )
    },
    **{
        f'CHANNEL_{name}': Alarm(f'the channel {words}', _STALE, do, 'in a minute')
        for name, words, do in (
            ('waiting', 'has sent no sample yet', 'start its node'),
            ('silent', 'has fallen silent', 'look for its node, its cable, its power'),
            ('no_value', 'sends NaN or infinite values only', 'look at the sensor and its cable'),
            ('stuck', 'repeats one value', 'look at the sensor and its cable'),
            ('saturated', 'is at an end of its range', 'look at its zero and its range'),
            ('contradicted', 'contradicts the roller angle', 'look at encoder and diameter'),
        )
    },
}


def table() -> str:
    """Return the table of docs/alarm.md."""
    rows = [('code', *(name.replace('_', ' ') for name in Alarm._fields))]
    rows += [('---',) * len(rows[0])]
    rows += [(f'`{code}`', *alarm) for code, alarm in {**TRIPS, **DETECTED}.items()]
    return ''.join(f'| {" | ".join(row)} |\n' for row in rows)


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
        A key of `DETECTED`.
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
        known = {key.replace('CHANNEL', channel) for key in DETECTED for channel in CHANNELS}
        if code not in known:
            raise ConfigError(f'{code!r}: no alarm that can be shelved, docs/alarm.md has them')
        try:
            asked = cls(code, now_s, float(minutes), reason.replace(';', ','))
        except ValueError as error:  # which a ConfigError is, too
            raise ConfigError(f'{words!r}: expected CODE MINUTES REASON ({error})') from error
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
