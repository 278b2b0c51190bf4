"""
The state of the page: what the topics have said, as one immutable `View`.

It knows no ROS and no web. What goes in are numbers and texts, with the time at which they came
on a clock that nobody sets; what comes out is made once for all viewers. A word that is not
renewed in time is not shown as if it were true: without a status for `SILENT_S` the level is
STALE and says so, whatever it was before.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dashboard import numbers
from hunt_ros.dashboard.diagram import branches
from hunt_ros.dashboard.spectra import Waterfall, named_lines, section, spectrum
from hunt_ros.dashboard.traces import SHOWN_S, Trace, short
from hunt_ros.dashboard.view import Rows, Section, View
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import ConfigError
from hunt_ros.rig import of_rig
from hunt_ros.settings import Settings, setting

#: The detector speaks 20 times a second: so much silence is no delay of a busy machine, s.
SILENT_S = 0.5
#: A node tells its health once a second: it is silent after this, s.
_NODE_SILENT_S = 3.5
#: Spectra are made so often, s.
_SPECTRUM_S = 1.0
#: Spacing and length of the trail in the diagram, s of the stamps.
_TRAIL_S, _TRAIL_LENGTH_S = 0.2, 240.0
_EVENTS, _ALARMS = 60, 20
_STATUS_HZ = 20.0
#: What a node publishes, to show its rate; others say it in the values of their diagnostics.
_RATE_KEYS = ('rate_hz', 'readings')


@dataclass(frozen=True)
class PageSettings(Settings):
    """What the picture needs to know of the rig: the same names as in the other nodes."""

    lines: tuple[float, ...] = of_rig('lines')
    roller_diameter_m: float = of_rig('roller_diameter_m')
    wheel_diameter_m: float = of_rig('wheel_diameter_m')
    spectrum_max_hz: float = setting(
        25.0, 'Highest frequency that is shown.', unit='Hz', low=1.0, high=500.0, fixed=True
    )


class PageModel:
    """
    What the topics have said.

    Parameters
    ----------
    settings : PageSettings
    form : IdentifiedNormalForm, optional
        The form that the detector was started with, if it is known.
    """

    def __init__(self, settings: PageSettings, form: IdentifiedNormalForm | None = None) -> None:
        self._settings = settings
        self._traces = {'lateral': Trace(1e3), 'yaw': Trace(1e3)}
        self._amplitudes = Rows(round(_STATUS_HZ * SHOWN_S))
        self._trail = Rows(round(_TRAIL_LENGTH_S / _TRAIL_S))
        self._waterfall = Waterfall(settings.spectrum_max_hz)
        self._status: Mapping[str, str] = {}
        self._stamp_s = 0.0
        self._status_s = -math.inf
        self._health: dict[str, tuple[float, Mapping[str, str]]] = {}
        self._events: deque[Mapping[str, Any]] = deque(maxlen=_EVENTS)
        self._speed: Mapping[str, str] = {}
        self._speed_s = -math.inf
        self._forms: list[Mapping[str, Any]] = []
        self._spectrum_s = -math.inf
        self._sections: dict[str, Section] = {}
        self._version = 0
        if form is not None:
            self._forms.append(branches(form))

    def take_samples(
        self, channel: str, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Take samples of `lateral` (m) or `yaw` (rad), in the order in which they came."""
        self._traces[channel].append(stamps_ns, values)

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
        second = stamp_ns * 1e-9
        if second and second < self._stamp_s - 1.0:
            self._start_anew()
        self._status, self._status_s = status, now_s
        if not second or second == self._stamp_s:
            return
        previous, self._stamp_s = self._stamp_s, second
        speed, size = _number(status, 'speed_mps'), 1e3 * _number(status, 'amplitude_m')
        self._amplitudes.append(
            [
                (
                    round(second, 3),
                    short(size),
                    short(1e3 * _number(status, 'envelope_m')),
                    short(1e3 * _number(status, 'yaw_amplitude_rad')),
                    short(1e3 * _number(status, 'yaw_envelope_rad')),
                )
            ]
        )
        if second // _TRAIL_S != previous // _TRAIL_S and math.isfinite(speed + size):
            self._trail.append([(short(speed), short(size))])

    def take_event(self, stamp_ns: int, event: Mapping[str, str]) -> None:
        """Take a message of `hunting/events`."""
        self._events.append(
            {
                'at_s': round(stamp_ns * 1e-9, 3),
                'since_s': _known(_number(event, 'since_s')),
                'event': event.get('event', event.get('name', '')),
                'level': event.get('level', 'STALE'),
                'cause': event.get('message', ''),
                'speed_mps': _known(_number(event, 'speed_mps')),
            }
        )
        self._put('events', list(reversed(self._events)))

    def take_alarms(self, text: str) -> None:
        """Take the history of the alarms: JSON of `hunting/alarms`."""
        try:
            history = json.loads(text)
            alarms = [dict(alarm) for alarm in history['alarms']][-_ALARMS:]
        except (ValueError, KeyError, TypeError):
            return
        self._put('alarms', list(reversed(alarms)))

    def take_health(self, health: Mapping[str, str], now_s: float) -> None:
        """Take one status of `/diagnostics`."""
        self._health[health.get('name', '')] = (now_s, health)

    def take_speed_status(self, status: Mapping[str, str], now_s: float) -> None:
        """Take a message of `speed/status`: profile, interlock and emergency stop."""
        self._speed, self._speed_s = status, now_s

    def take_form(self, text: str) -> str:
        """
        Take a normal form from `hunting/normal_form`; it is drawn once the detector uses it.

        Returns
        -------
        str
            Why it cannot be drawn; '' where it can.
        """
        try:
            drawn = branches(IdentifiedNormalForm.from_yaml(text, 'hunting/normal_form'))
        except ConfigError as error:
            return str(error)
        self._forms = [*self._forms[-3:], drawn]
        return ''

    def take_recording(self, path: str) -> None:
        """Take the path of a recording that was closed."""
        self._put('recording', path)

    def view(self, now_s: float) -> View:
        """
        Return what is to be shown.

        Parameters
        ----------
        now_s : float
            On the steady clock of the messages' arrivals.
        """
        self._put('status', self._shown_status(now_s))
        self._put('numbers', numbers.of_status(self._status, self._forecast()))
        self._put('drive', self._shown_drive(now_s))
        self._put('nodes', self._shown_nodes(now_s))
        self._put('diagram', self._shown_diagram())
        if now_s - self._spectrum_s >= _SPECTRUM_S:
            self._spectrum_s = now_s
            self._put('spectrum', self._new_spectrum())
        streams = {name: trace.rows.stream for name, trace in self._traces.items()}
        streams['amplitude'] = self._amplitudes.stream
        streams['trail'] = self._trail.stream
        streams['waterfall'] = self._waterfall.rows.stream
        return View(dict(self._sections), streams)

    def _put(self, name: str, data: Any) -> None:
        """Replace a section where it has changed."""
        old = self._sections.get(name)
        if old is None or old.data != data:
            self._version += 1
            self._sections[name] = Section(self._version, data)

    def _start_anew(self) -> None:
        """Forget what has stamps: they begin anew (a replay in a loop, a clock set back)."""
        for trace in self._traces.values():
            trace.clear()
        for rows in (self._amplitudes, self._trail):
            rows.replace(())
        self._waterfall.clear()
        self._stamp_s = 0.0

    def _shown_status(self, now_s: float) -> Mapping[str, Any]:
        status = self._status
        silent_s = now_s - self._status_s
        level, why = status.get('level', 'STALE'), status.get('message', '')
        silent = silent_s > SILENT_S
        if silent:
            level = 'STALE'
            since = f'for {silent_s:.0f} s' if math.isfinite(silent_s) else 'since this page began'
            last = f'; last word: {status["level"]}, {status["state"]}' if status else ''
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
            'normal_form': status.get('normal_form', ''),
            'since_s': _known(_number(status, 'since_s')),
            'stamp_s': round(self._stamp_s, 3),
            'speed_mps': _known(_number(status, 'speed_mps')),
            'amplitude_mm': _known(1e3 * _number(status, 'amplitude_m')),
            'amplitude_std_mm': _known(1e3 * _number(status, 'amplitude_std_m')),
            'unstable_mm': _known(1e3 * _number(status, 'unstable_amplitude_m')),
        }

    def _forecast(self) -> Mapping[str, str]:
        """Return what the detector says on `/diagnostics`: it has the forecast of v_c."""
        for name, (_, health) in self._health.items():
            if name.rsplit('/', 1)[-1] == 'hunting_detector':
                return health
        return {}

    def _shown_drive(self, now_s: float) -> Mapping[str, Any] | None:
        """Return profile, interlock and emergency stop; None where no drive tells of them."""
        if not self._speed:
            return None
        told = dict(self._speed)
        silent = now_s - self._speed_s > 1.0
        elapsed = _number(told, 'profile_elapsed_s')
        remaining = _number(told, 'profile_remaining_s')
        whole = elapsed + remaining
        return {
            'silent': silent,
            'speed_mps': _known(_number(told, 'speed_mps')),
            'target_mps': _known(_number(told, 'target_mps')),
            'profile': told.get('profile', ''),
            'profile_state': told.get('profile_state', ''),
            'elapsed_s': _tenths(elapsed),
            'remaining_s': _tenths(remaining),
            'progress': short(elapsed / whole) if whole > 0.0 else None,
            'interlock': told.get('interlock', ''),
            'interlock_state': told.get('interlock_state', ''),
            'interlock_cause': told.get('interlock_cause', ''),
            'emergency_stop': told.get('emergency_stop', '').lower() == 'true',
            'safe_speed_mps': _known(_number(told, 'safe_speed_mps')),
            'speed_ceiling_mps': _known(_number(told, 'speed_ceiling_mps')),
        }

    def _shown_nodes(self, now_s: float) -> list[Mapping[str, Any]]:
        nodes: list[Mapping[str, Any]] = []
        for name, (heard_s, health) in sorted(self._health.items()):
            silent_s = now_s - heard_s
            silent = silent_s > _NODE_SILENT_S
            rates = [_number(health, key) for key in _RATE_KEYS if key in health]
            rate = 0.0 if silent else next(iter(rates), math.nan)
            message = f'silent for {silent_s:.0f} s' if silent else health.get('message', '')
            nodes.append(
                {
                    'name': name.rsplit('/', 1)[-1],
                    'level': 'STALE' if silent else health.get('level', 'STALE'),
                    'message': message,
                    'rate_hz': _known(rate),
                }
            )
        return nodes

    def _shown_diagram(self) -> Mapping[str, Any] | None:
        """Return the branches of the form that the detector uses; None where it is not known."""
        used = self._status.get('normal_form', '')
        return next((form for form in reversed(self._forms) if form['words'] == used), None)

    def _new_spectrum(self) -> Mapping[str, Any] | None:
        """Compute spectrum and waterfall of lateral, or of yaw where there is no lateral."""
        for channel, trace in self._traces.items():
            stamps_ns, values = trace.samples()
            if stamps_ns.size and stamps_ns[-1] * 1e-9 < self._stamp_s - 2.0:
                continue  # that channel is silent
            found = spectrum(stamps_ns, values, self._settings.spectrum_max_hz)
            if found is None:
                continue
            self._waterfall.append(float(stamps_ns[-1]) * 1e-9, *found)
            lines = named_lines(
                _number(self._status, 'speed_mps'),
                _number(self._status, 'frequency_hz'),
                self._settings.lines,
                self._settings.roller_diameter_m or RigParameters.roller_diameter_m,
                self._settings.wheel_diameter_m,
            )
            shown = [line for line in lines if line[1] <= self._settings.spectrum_max_hz]
            return section(*found, shown, channel)
        return None


def _number(texts: Mapping[str, str], key: str) -> float:
    """Return a value of a status as a number; NaN where it is none."""
    try:
        return float(texts.get(key, 'nan'))
    except ValueError:
        return math.nan


def _known(value: float) -> float | None:
    """Return a number for JSON: None where it is not known."""
    return value if math.isfinite(value) else None


def _tenths(seconds: float) -> float | None:
    return round(seconds, 1) if math.isfinite(seconds) else None
