"""
The state of the page: what the topics have said, and its figures, as one immutable `View`.

It knows no ROS and no web. What goes in are numbers and texts, with the time at which they came
on a clock that nobody sets; what comes out is made once for all viewers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dashboard.diagram import branches
from hunt_ros.dashboard.spectra import Waterfall, named_lines, section, spectrum
from hunt_ros.dashboard.told import Told
from hunt_ros.dashboard.traces import SHOWN_S, Trace, short
from hunt_ros.dashboard.view import Rows, Section, View
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import ConfigError
from hunt_ros.rig import of_rig
from hunt_ros.samples import number_of
from hunt_ros.settings import Settings, setting

#: Spectra are made so often, s.
_SPECTRUM_S = 1.0
#: Spacing and length of the trail in the diagram, s of the stamps.
_TRAIL_S, _TRAIL_LENGTH_S = 0.2, 240.0
_STATUS_HZ = 20.0
#: A longer silence breaks the lines: nobody knows what the rig has done meanwhile, s.
_GAP_S = 1.0


@dataclass(frozen=True)
class PageSettings(Settings):
    """What the picture needs to know of the rig: the same names as in the other nodes."""

    speed_unit: str = of_rig('speed_unit')
    lines: tuple[float, ...] = of_rig('lines')
    roller_diameter_m: float = of_rig('roller_diameter_m')
    wheel_diameter_m: float = of_rig('wheel_diameter_m')
    spectrum_max_hz: float = setting(
        25.0, 'Highest frequency that is shown.', unit='Hz', low=1.0, high=500.0
    )


class PageModel(Told):
    """
    What the topics have said, with the figures.

    Parameters
    ----------
    settings : PageSettings
    form : IdentifiedNormalForm, optional
        The form that the detector was started with, if it is known.
    namespace : str
        Of the rig.
    """

    def __init__(
        self,
        settings: PageSettings,
        form: IdentifiedNormalForm | None = None,
        namespace: str = 'rig',
    ) -> None:
        super().__init__(namespace, settings.speed_unit)
        self._settings = settings
        self._traces = {'lateral': Trace(1e3), 'yaw': Trace(1e3)}
        self._amplitudes = Rows(round(_STATUS_HZ * SHOWN_S))
        self._trail = Rows(round(_TRAIL_LENGTH_S / _TRAIL_S))
        self._trail_s = -math.inf
        self._waterfall = Waterfall(settings.spectrum_max_hz)
        self._forms: list[Mapping[str, Any]] = []
        self._spectrum_s = -math.inf
        self._sections: dict[str, Section] = {}
        self._version = 0
        if form is not None:
            self._forms.append(branches(form, self.words))

    def take_samples(
        self, channel: str, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Take samples of `lateral` (m) or `yaw` (rad), in the order in which they came."""
        self._traces[channel].append(stamps_ns, values)

    def take_status(self, stamp_ns: int, status: Mapping[str, str], now_s: float) -> None:
        """Take a message of `hunting/status`: see `Told`."""
        previous = self._stamp_s
        super().take_status(stamp_ns, status, now_s)
        second = self._stamp_s
        if second < previous - 1.0:
            self._start_anew()
        if second == previous:
            return
        if second > previous + _GAP_S and len(self._amplitudes):
            self._amplitudes.append([(round(previous, 3), *[None] * 4)])
            self._trail.append([(None, None)])
        speed, size = number_of(status, 'speed_mps'), 1e3 * number_of(status, 'amplitude_m')
        self._amplitudes.append(
            [
                (
                    round(second, 3),
                    short(size),
                    short(1e3 * number_of(status, 'envelope_m')),
                    short(1e3 * number_of(status, 'yaw_amplitude_rad')),
                    short(1e3 * number_of(status, 'yaw_envelope_rad')),
                )
            ]
        )
        if abs(second - self._trail_s) >= _TRAIL_S and math.isfinite(speed + size):
            self._trail_s = second
            self._trail.append([(short(self.words.factor * speed), short(size))])

    def take_viewers(self, count: int) -> None:
        """Take how many browsers look at the page."""
        self._said['viewers'] = count

    def take_form(self, text: str) -> str:
        """
        Take a normal form from `hunting/normal_form`; it is drawn once the detector uses it.

        Returns
        -------
        str
            Why it cannot be drawn; '' where it can.
        """
        try:
            form = IdentifiedNormalForm.from_yaml(text, 'hunting/normal_form')
            drawn = branches(form, self.words)
        except ConfigError as error:
            return str(error)
        self._forms = [*self._forms[-3:], drawn]
        return ''

    def view(self, now_s: float) -> View:
        """
        Return what is to be shown.

        Parameters
        ----------
        now_s : float
            On the steady clock of the messages' arrivals.
        """
        for name, data in self.sections(now_s).items():
            self._put(name, data)
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
                number_of(self._status, 'speed_mps'),
                number_of(self._status, 'frequency_hz'),
                self._settings.lines,
                self._settings.roller_diameter_m or RigParameters.roller_diameter_m,
                self._settings.wheel_diameter_m,
            )
            shown = [line for line in lines if line[1] <= self._settings.spectrum_max_hz]
            return section(*found, shown, channel)
        return None
