"""
The services by which an operator acts on a running rig: those of `hunt call` and docs/topics.md.

All are `std_srvs/Trigger`, but for a switch, which is a `std_srvs/SetBool`; named below the
namespace of the rig. Such a request carries nothing: who calls, and the words that go with it, are
published before it on `NODE/calls`, std_msgs/String, as JSON with `service`, `who` and `words`.
"""

from __future__ import annotations

import unicodedata
from functools import partial
from typing import NamedTuple

#: Characters that are kept of what a person says with a call.
_MOST_SAID = 200


class Service(NamedTuple):
    """
    One service.

    Parameters
    ----------
    node : str
        Which offers it.
    name : str
        Below the namespace.
    does : str
        What it is for, as a line of the help text.
    words : str
        What the words are that go with it, as a line of the help text; '' where it takes none.
    switch : str
        'on' or 'off' where the service is a switch; else ''.
    repeatable : bool
        True where a second call does no harm, whoever called something else in between: it only
        reads, or does what is on the safe side. A call whose answer was lost is then repeated.
    takes_s : float
        An answer that takes longer is none, s.
    """

    node: str
    name: str
    does: str
    words: str = ''
    switch: str = ''
    repeatable: bool = False
    takes_s: float = 10.0


def spoken(words: str) -> str:
    """
    Return words of a person, or of any topic, as one line that shows what it holds.

    Control and format characters go: some turn the direction of what follows them, so that one
    name is read as another, and some move a cursor. The line has at most 200 characters.
    """
    seen = (' ' if unicodedata.category(sign)[0] == 'C' else sign for sign in words)
    return ' '.join(''.join(seen).split())[:_MOST_SAID]


#: Key of `hunt run` and `hunt demo` on a terminal -> word of `hunt call`.
KEYS: dict[str, str] = {
    's': 'start-profile',
    ' ': 'stop-profile',
    'r': 'resume-profile',
    'e': 'emergency-stop',
    'a': 'acknowledge',
    'm': 'mark',
}
#: Of them, what sets the roller going: it wants a second key, and so does the end while it turns.
MOVING_KEYS, CONFIRM_KEY = 'sr', 'y'
#: Ends them, as Ctrl-C does.
QUIT_KEY = 'q'

_detector = partial(Service, 'hunting_detector')
_drive = partial(Service, 'roller_speed')
_recorder = partial(Service, 'bag_recorder')
_identifier = partial(Service, 'normal_form_identifier')
_replay = partial(Service, 'live_replay')
#: Word of `hunt call` -> service.
SERVICES: dict[str, Service] = {
    'acknowledge': _detector(
        'hunting/acknowledge_alarm', 'end an alarm whose cause is over', 'who acknowledges'
    ),
    'start-profile': _drive('speed/start_profile', 'start the speed profile from its beginning'),
    'stop-profile': _drive(
        'speed/stop_profile', 'hold the set point that the profile has now', repeatable=True
    ),
    'resume-profile': _drive(
        'speed/resume_profile', 'go on with the profile where it was stopped'
    ),
    'emergency-stop': _drive('speed/emergency_stop', 'stop the roller', repeatable=True),
    'rearm': _drive(
        'speed/rearm', 'end an emergency stop, and a trip of the interlock whose cause is over'
    ),
    'arm-interlock': _drive(
        'speed/arm_interlock', 'let the interlock guard the rig', switch='on', repeatable=True
    ),
    'disarm-interlock': _drive(
        'speed/arm_interlock',
        'let nothing slow the roller down but you: loud, and logged',
        switch='off',
    ),
    'start-recording': _recorder('recording/start', 'begin a recording'),
    # What was lost on the way comes first, then the disk.
    'stop-recording': _recorder('recording/stop', 'close the recording', takes_s=90.0),
    'split-recording': _recorder('recording/split', 'begin a new file of it'),
    'mark': _recorder('recording/mark', 'mark this moment in the recording', 'what the mark says'),
    'identify': _identifier('identify', 'refit the normal form from the recordings'),
    'accept-form': _detector(
        'hunting/accept_normal_form',
        'take the normal form that waits because it would alarm later',
    ),
    'revert-form': _identifier('hunting/revert_normal_form', 'go back to the normal form before'),
    'test-alarm': Service(
        'alarm_outputs',
        'alarm/test',
        'have sound, command and relay call for a moment',
        takes_s=90.0,
    ),
    'kick': Service('rig_simulator', 'simulator/kick', 'kick the simulated wheelset'),
    'pause-replay': _replay('replay/pause', 'hold a live replay', repeatable=True),
    'resume-replay': _replay('replay/resume', 'go on with a live replay'),
}
