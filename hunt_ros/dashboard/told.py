"""
What a rig has said of itself: status, events, drive and health, as the operator is shown them.

The one reader of these messages, for the page and for the terminal. It knows no ROS: what goes
in are texts, with the time at which they came on a clock that nobody sets. A word that is not
renewed in time is not shown as if it were true: without a status for `SILENT_S` the level is
STALE and says so, whatever it was before.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Mapping
from typing import Any

from hunt_ros.dashboard.words import Tile, Words
from hunt_ros.report.events import sentence
from hunt_ros.samples import known, number_of
from hunt_ros.services import spoken
from hunt_ros.suite import DRIVE, SENSORS

#: The detector speaks 20 times a second: so much silence is no delay of a busy machine, s.
SILENT_S = 0.5
#: A node tells its health once a second: it is silent after this, s.
_NODE_SILENT_S = 3.5
#: The drive tells ten times a second how things stand: it is silent after this, s.
_DRIVE_SILENT_S = 1.0
_EVENTS, _ALARMS = 60, 20
#: Digits that change more often cannot be read, s.
_NUMBERS_S = 0.25
#: The node that plays a recording to these topics, and those that speak for a rig.
_REPLAY, _RIG = 'live_replay', (DRIVE, *SENSORS.values())
#: What a node publishes, to show its rate; others say it in the values of their diagnostics.
_RATE_KEYS = ('rate_hz', 'readings')


class Told:
    """
    What the topics have said, as small documents for JSON: `sections`.

    Parameters
    ----------
    namespace : str
        Of the rig. `/diagnostics` is that of the whole ROS domain: what nodes of another
        namespace say there is of another rig, and is not taken.
    speed_unit : str
        In which speeds are shown: see `Words`.
    """

    def __init__(self, namespace: str = 'rig', speed_unit: str = 'm/s') -> None:
        self.words = Words(speed_unit)
        self._prefix = f'/{namespace.strip("/")}/'.replace('//', '/')
        self._status: Mapping[str, str] = {}
        self._stamp_s = 0.0
        self._status_s = -math.inf
        self._health: dict[str, tuple[float, Mapping[str, str]]] = {}
        self._events: deque[Mapping[str, Any]] = deque(maxlen=_EVENTS)
        self._speed: Mapping[str, str] = {}
        self._speed_s = -math.inf
        #: Sections that are said once, and not again.
        self._said: dict[str, Any] = {}
        self._numbers_s = -math.inf
        self._numbers: list[Tile] = []

    def take_status(self, stamp_ns: int, status: Mapping[str, str], now_s: float) -> None:
        """
        Take a message of `hunting/status`.

        Parameters
        ----------
        stamp_ns : int
            Its header stamp; 0: the detector has no data yet.
        status : mapping of str to str
            Its level, message and values.
        now_s : float
            When it came, on the steady clock.
        """
        self._status, self._status_s = status, now_s
        if stamp_ns:
            self._stamp_s = stamp_ns * 1e-9

    def take_event(self, stamp_ns: int, event: Mapping[str, str]) -> None:
        """Take a message of `hunting/events`."""
        self._events.append(
            {
                'at_s': round(stamp_ns * 1e-9, 3),
                'since_s': known(number_of(event, 'since_s')),
                'event': event.get('event', event.get('name', '')),
                'level': event.get('level', 'STALE'),
                'words': sentence(event.get('event', event.get('name', ''))),
                'cause': self.words.in_unit(event.get('message', '')),
                'speed': self.words.speed(number_of(event, 'speed_mps')),
            }
        )
        self._said['events'] = list(reversed(self._events))

    def take_mark(self, words: str) -> None:
        """Take a mark of the recording: it stands among the events."""
        told = {'event': 'mark', 'level': 'OK', 'message': spoken(words)}
        self.take_event(round(1e9 * self._stamp_s), told)

    def take_alarms(self, text: str) -> None:
        """Take the history of the alarms: JSON of `hunting/alarms`."""
        try:
            history = json.loads(text)
            alarms = [dict(alarm) for alarm in history['alarms']][-_ALARMS:]
            for alarm in alarms:
                alarm['cause'] = self.words.in_unit(alarm['cause'])
        except (ValueError, KeyError, TypeError, AttributeError):
            return
        self._said['alarms'] = list(reversed(alarms))

    def take_health(self, health: Mapping[str, str], now_s: float) -> None:
        """Take one status of `/diagnostics`, unless it is of another rig."""
        full = '/' + health.get('name', '').lstrip('/')
        name = full.removeprefix(self._prefix)
        if name != full and (self._prefix != '/' or '/' not in name):
            self._health[name] = (now_s, health)

    def take_speed_status(self, status: Mapping[str, str], now_s: float) -> None:
        """Take a message of `speed/status`: profile, interlock and emergency stop."""
        self._speed, self._speed_s = status, now_s

    def drive_mps(self, name: str, now_s: float) -> float:
        """Return a speed of `speed/status`, m/s; NaN where the drive is silent."""
        heard = now_s - self._speed_s <= _DRIVE_SILENT_S
        return number_of(self._speed, name) if heard else math.nan

    def sections(self, now_s: float) -> dict[str, Any]:
        """
        Return what is to be shown, by name.

        Parameters
        ----------
        now_s : float
            On the steady clock of the messages' arrivals.

        Returns
        -------
        dict
            `status`, `numbers`, `drive` (None where no drive tells of itself), `nodes`, `replay`
            (None where the topics are those of a rig), `recorder` (None where none tells of
            itself), `speed_unit`, and what has been said of `events` and `alarms` (the newest
            first).
        """
        if now_s - self._numbers_s >= _NUMBERS_S:
            self._numbers_s = now_s
            forecast = self._heard('hunting_detector', now_s) or {}
            self._numbers = self.words.tiles(self._status, forecast)
        return {
            'status': self._shown_status(now_s),
            'numbers': self._numbers,
            'drive': self._shown_drive(now_s),
            'nodes': self._shown_nodes(now_s),
            'replay': self._shown_replay(now_s),
            'recorder': self._shown_recorder(now_s),
            'speed_unit': self.words.unit,
            **self._said,
        }

    def _shown_status(self, now_s: float) -> Mapping[str, Any]:
        """Return what the detector says, or that it is silent."""
        status = self._status
        silent_s = now_s - self._status_s
        level, why = status.get('level', 'STALE'), self.words.in_unit(status.get('message', ''))
        replay = self._shown_replay(now_s)
        # What is published with the stamps of a slow replay comes slowly, and of a pause not.
        pace = 1.0 if replay is None else min(1.0, replay['rate'])
        silent = not status or silent_s > (SILENT_S / pace if pace else math.inf)
        if silent:
            level = 'STALE'
            since = f'for {silent_s:.0f} s' if math.isfinite(silent_s) else 'since this view began'
            said = status.get('level', ''), status.get('state', '').replace('_', ' ')
            last = f'; last word: {", ".join(filter(None, said))}' if status else ''
            why = f'The detector is silent {since}: nothing here is up to date{last}'
        elif not why:
            why = 'Quiet motion, all inputs good'
        return {
            'level': level,
            'silent': silent,
            'why': why,
            'state': 'unknown' if silent else status.get('state', 'unknown'),
            'region': 'unknown' if silent else status.get('region', 'unknown'),
            'alarm': status.get('alarm') == 'True',
            'absent': status.get('absent', ''),
            'clearance': '' if silent else self.words.in_unit(status.get('clearance', '')),
            'since_s': None if silent else known(number_of(status, 'since_s')),
            'stamp_s': round(self._stamp_s, 3),
            'speed': self.words.speed(number_of(status, 'speed_mps')),
            'amplitude_mm': known(1e3 * number_of(status, 'amplitude_m')),
            'amplitude_std_mm': known(1e3 * number_of(status, 'amplitude_std_m')),
        }

    def _heard(self, node: str, now_s: float) -> Mapping[str, str] | None:
        """Return what a node said last on `/diagnostics`; None where it says nothing any more."""
        heard_s, health = self._health.get(node, (-math.inf, {}))
        return health if now_s - heard_s <= _NODE_SILENT_S else None

    def _shown_replay(self, now_s: float) -> Mapping[str, Any] | None:
        """Return where a replay is that plays to these topics; None where they are of a rig."""
        heard_s, told = self._health.get(_REPLAY, (-math.inf, {}))
        rig_s = max(self._speed_s, *(self._health.get(each, (-math.inf,))[0] for each in _RIG))
        # A replay that says nothing for a moment is one still, until nodes of a rig speak.
        if not told or rig_s > heard_s + _NODE_SILENT_S:
            return None
        plays = told.get('playing') == 'True'
        rests = 'waits for a detector' if told.get('listening') == 'False' else 'paused'
        rate = number_of(told, 'rate')
        return {
            'name': told.get('bag', ''),
            'at_s': _tenths(number_of(told, 'position_s')),
            'length_s': _tenths(number_of(told, 'length_s')),
            'state': 'plays' if plays else 'ended' if told.get('finished') == 'True' else rests,
            'rate': (rate if rate > 0.0 else 1.0) if plays else 0.0,
        }

    def _shown_recorder(self, now_s: float) -> Mapping[str, Any] | None:
        """Return what is recorded now, and the room that the disk has."""
        told = self._heard('bag_recorder', now_s)
        if told is None:
            return None
        return {
            'recording': told.get('path', '').rpartition('/')[2].removesuffix('.active'),
            'recorded_s': known(number_of(told, 'recorded_s')),
            'bytes': known(number_of(told, 'bytes')),
            'free_bytes': known(number_of(told, 'free_bytes')),
        }

    def _shown_drive(self, now_s: float) -> Mapping[str, Any] | None:
        """Return profile, interlock and emergency stop; None where no drive tells of them."""
        if not self._speed:
            return None
        told = dict(self._speed)
        silent = now_s - self._speed_s > _DRIVE_SILENT_S
        elapsed = number_of(told, 'profile_elapsed_s')
        remaining = number_of(told, 'profile_remaining_s')
        whole = elapsed + remaining
        return {
            'silent': silent,
            'level': told.get('level', 'STALE'),
            'message': self.words.in_unit(told.get('message', '')),
            'speed': self.words.speed(number_of(told, 'speed_mps')),
            'target': self.words.speed(number_of(told, 'target_mps')),
            'profile': told.get('profile', ''),
            'profile_state': told.get('profile_state', ''),
            'elapsed_s': _tenths(elapsed),
            'remaining_s': _tenths(remaining),
            'progress': round(elapsed / whole, 4) if whole > 0.0 else None,
            'interlock': told.get('interlock', ''),
            'interlock_state': told.get('interlock_state', ''),
            'interlock_cause': self.words.in_unit(told.get('interlock_cause', '')),
            'alarm_kept': self.words.in_unit(told.get('alarm_kept', '')),
            'emergency_stop': told.get('emergency_stop', '').lower() == 'true',
            'safe_speed': self.words.speed(number_of(told, 'safe_speed_mps')),
            'speed_ceiling': self.words.speed(number_of(told, 'speed_ceiling_mps')),
        }

    def _shown_nodes(self, now_s: float) -> list[Mapping[str, Any]]:
        """Return the health of every node; one that is silent is STALE."""
        nodes: list[Mapping[str, Any]] = []
        for name, (heard_s, health) in sorted(self._health.items()):
            silent_s = now_s - heard_s
            silent = silent_s > _NODE_SILENT_S
            rates = [number_of(health, key) for key in _RATE_KEYS if key in health]
            rate = 0.0 if silent else next(iter(rates), math.nan)
            said = f'silent for {silent_s:.0f} s' if silent else health.get('message', '')
            nodes.append(
                {
                    'name': name,
                    'silent': silent,
                    'level': 'STALE' if silent else health.get('level', 'STALE'),
                    'message': self.words.in_unit(said),
                    'rate_hz': known(rate),
                }
            )
        return nodes


def _tenths(seconds: float) -> float | None:
    return round(seconds, 1) if math.isfinite(seconds) else None
