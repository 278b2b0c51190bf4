"""
The detector node: measurements in, estimates, status, events and alarm out.

Once in 20 ms what the channels have said is taken and handed to the `HuntingDetector`,
and what it says is published. Silence enters through its `tick`, on the node's clock.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from queue import SimpleQueue

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import String

from hunt_ros.compiled import load
from hunt_ros.criteria import Verdict
from hunt_ros.detection.acceptance import objections
from hunt_ros.detection.companions import CompanionConfig, Companions, criterion_event
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.detector import HuntingDetector
from hunt_ros.detection.output import EVENT_NUMBERS, Event, Output
from hunt_ros.detection.regions import Level
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import ConfigError
from hunt_ros.nodes.support.conversions import diagnostic
from hunt_ros.nodes.support.diagnostics import Health, NewSince, log, steady_clock
from hunt_ros.nodes.support.estimate_publishers import EstimatePublishers
from hunt_ros.nodes.support.hearing import Calls, Channels, Said
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare, declare_normal_form
from hunt_ros.nodes.support.qos import announce, hear
from hunt_ros.rig import of_rig
from hunt_ros.samples import Uncertain
from hunt_ros.settings import Settings
from hunt_ros.suite import Awaited

#: Samples are handed over so often, s: less often costs less, and estimates are as much later.
_HAND_OVER_S = 0.02
#: A multiple of it: between two hand-overs a tick would make rows of its own.
_TICK_S = 0.06
_STATUS_S = 0.05
#: What has come is worked on this often, s: seldom enough to cost little.
_ROUND_S = 0.1
_TASK = 'criteria and forecast'


@dataclass(frozen=True)
class DetectorNodeConfig(Settings):
    """Parameters of the node itself; those of the detector are `DetectorConfig`."""

    rig_name: str = of_rig('rig_name')


class HuntingDetectorNode(SuiteNode):
    """Feeds a `HuntingDetector` from the topics, and publishes what it says."""

    def __init__(self) -> None:
        super().__init__('hunting_detector')
        self._settings = declare(self, DetectorNodeConfig)
        self._config = declare(self, DetectorConfig, self._reconfigure)
        self._form = declare_normal_form(self, self._settings.rig_name)
        self._beside = declare(self, CompanionConfig)
        self._waiting: IdentifiedNormalForm | None = None
        self._rig = self.get_namespace().strip('/')
        self._was_well = False
        self._diagnostics.judge('hunting_alarm', self._alarm, self._rig)
        self._new = NewSince()
        load()  # no first sample waits for its machine code
        self._detector = HuntingDetector(self._config, self._form)
        self._alarms_said = ''
        self._status = announce(self, 'hunting/status')
        self._events = announce(self, 'hunting/events')
        self._journal = announce(self, 'hunting/journal')
        beside, rig = self._beside, None
        if beside.forecast == 'wheelset':
            rig = RigParameters.read(beside.forecast_rig)
        self._companions = Companions(beside, self._config, rig)
        self._motions: SimpleQueue[NDArray[np.void]] = SimpleQueue()
        self.work(_TASK, self._accompany)
        hear(self, 'hunting/normal_form', self._on_form)
        self._alarms = announce(self, 'hunting/alarms')
        answers = {
            'acknowledge': self._acknowledge,
            'accept-form': self._accept,
        }
        Calls(self, answers)
        self._inbox = Channels(self, self._config.channels)
        self._estimates = EstimatePublishers(self, self._config.output_rate_hz)
        # A clock that is set back, or stands still, would hold a timer of its own up.
        self.create_timer(_HAND_OVER_S, self._drain, clock=steady_clock())
        self.create_timer(_TICK_S, self._tick, clock=steady_clock())
        self.create_timer(_STATUS_S, self._publish_status, clock=steady_clock())

    def _accompany(self, stopping: threading.Event) -> None:
        """Feed what runs beside the detector, in its own thread: a refit delays no estimate."""
        while not stopping.wait(_ROUND_S):
            waiting = [self._motions.get() for _ in range(self._motions.qsize())]
            try:
                for verdict in self._companions.update(np.concatenate(waiting)) if waiting else ():
                    self._on_verdict(verdict)
            except Exception as error:  # any: numbers of a rig that nobody has seen
                self._diagnostics.failed(_TASK, error)
                self._companions.reset()

    def _drain(self) -> None:
        """Hand what has come to the detector, and publish what it says."""
        if not self._inbox.begun():
            return
        taken = self._inbox.take()
        self._publish(self._detector.feed({name: (ns, values) for name, ns, values, _ in taken}))

    def _tick(self) -> None:
        """Let the detector know what time it is: channels may be silent."""
        if not self._inbox.begun():
            return
        # No backlog may be mistaken for silence; and the clock is read after the samples: on a
        # busy machine some would come from the future otherwise.
        self._drain()
        now_ns = self.get_clock().now().nanoseconds
        if now_ns > 0:
            self._publish(self._detector.tick(now_ns))

    def _publish(self, output: Output) -> None:
        """Publish what came of samples, a tick or an order."""
        if len(output.estimates):
            self._estimates.publish(output.estimates)
            if not self._companions.idle:
                self._motions.put(output.motion)
        for event in output.events:
            self._tell(event)
        if output.events and self._detector.history.alarms:
            text = self._detector.history.to_text()
            if text != self._alarms_said:
                self._alarms_said = text
                self._alarms.publish(String(data=text))
        if output.journal:
            entries = (entry.beside(self._beside) for entry in output.journal)
            lines = [entry.to_text() for entry in entries]
            self._journal.publish(String(data='\n'.join(lines)))

    def _tell(self, event: Event) -> None:
        """Publish a transition, and log it."""
        level, cause = event.level.label, event.cause
        self._events.publish(
            diagnostic(event.stamp_ns, event.event, level, cause, event.values, self._rig)
        )
        self._diagnostics.told = True
        speed_mps, amplitude_mm = event.number('speed_mps'), 1e3 * event.number('amplitude_m')
        log(self, level, f'{event.event} at {speed_mps:.2f} m/s, {amplitude_mm:.3f} mm: {cause}')

    def _publish_status(self) -> None:
        """Publish it, with what is known of the speed that is held, and of v_c."""
        status, v_c = self._detector.status, self._forecast()
        low, high = (math.nan, math.nan) if v_c is None else (v_c.low, v_c.high)
        doubt = '; '.join(status.reasons) if status.level is Level.STALE else ''
        values = {
            **status.values,
            **self._detector.clearances.now(doubt, high).values,
            'forecast_v_c_low_mps': low,
            'forecast_v_c_high_mps': high,
        }
        level, why = status.level.label, '; '.join(status.reasons)
        self._status.publish(diagnostic(status.stamp_ns, 'hunting', level, why, values, self._rig))
        value, std = self._config.critical_speed_mps or math.nan, math.nan
        if self._form is not None:
            value, std = self._form.form.critical_speed, self._form.std('v_c')
        elif math.isnan(value) and v_c is not None:
            value, std = v_c.value, v_c.std
        self._estimates.beside |= {'critical_speed': value, 'critical_speed_std': std}

    def _forecast(self) -> Uncertain | None:
        """Return the forecast of v_c; None where there is none."""
        forecast = self._companions.forecast
        return None if forecast is None else forecast.critical_speed

    def _on_verdict(self, verdict: Verdict) -> None:
        """Publish that a railway criterion began or ceased to exceed its limit."""
        status = self._detector.status
        known = {name: status.number(name) for name in EVENT_NUMBERS}
        self._tell(criterion_event(verdict, status.stamp_ns, status.level, known))

    def _reconfigure(self, config: DetectorConfig) -> None:
        """Take new settings from the next row on; the journal tells a replay of it."""
        self._drain()
        self._publish(self._detector.reconfigure(config))
        self._config = config

    def _on_form(self, message: String) -> None:
        """Take a new normal form over, or let it wait where it would alarm later."""
        try:
            form = IdentifiedNormalForm.from_yaml(message.data, 'hunting/normal_form')
            form.refuse_other(self._settings.rig_name, 'hunting/normal_form')
        except ConfigError as error:
            self.get_logger().error(f'{error}; the form in force stays')
            return
        against = objections(form, self._form)
        if against:
            self._waiting = form
            self.get_logger().warning(
                f'the new normal form {"; ".join(against)}:'
                ' it waits for hunting/accept_normal_form'
            )
            return
        self._take_over(form)

    def _take_over(self, form: IdentifiedNormalForm) -> None:
        """Use another normal form from now on."""
        self._form, self._waiting = form, None
        self._drain()
        output = self._detector.set_normal_form(form)
        self._publish(output)
        if not output.events:  # before the first row it is none
            self.get_logger().info('a new normal form is in force')

    def _accept(self, said: Said) -> str:
        if self._waiting is None:
            raise ConfigError('no normal form is waiting')
        self._take_over(self._waiting)
        return ''

    def _acknowledge(self, said: Said) -> str:
        self._drain()
        answer = '' if self._detector.history.codes else 'there was no alarm to acknowledge'
        now_ns = self.get_clock().now().nanoseconds
        self._publish(self._detector.acknowledge(now_ns, said.words or said.who))
        return answer

    def _health(self) -> Health:
        status = self._detector.status
        values: dict[str, object] = {
            'received': self._inbox.received,
            'unreadable': self._inbox.unreadable,
            'missed': self._inbox.missed,
            'dropped': sum(status.dropped.values()),
        }
        values |= {f'clock_offset_s {name}': x for name, x in status.clock_offsets_s.items()}
        if (forecast := self._companions.forecast) is not None:
            v_c = forecast.critical_speed
            values['forecast_v_c'] = forecast.reason if v_c is None else f'{v_c.value:.3f}'
            values['forecast_v_c_std'] = math.nan if v_c is None else v_c.std
        unreadable = self._new('unreadable', self._inbox.unreadable)
        lately = self._new('missed', self._inbox.missed)
        problems = [self._inbox.problem()]
        if unreadable:
            problems.append(f'{unreadable} messages that cannot be read')
        if lately:
            problems.append(f'{lately} samples lost on their way here')
        if self._waiting is not None:
            problems.append('a normal form waits for hunting/accept_normal_form')
        if said := '; '.join(filter(None, problems)):
            return 'WARN', said, values
        return 'OK', f'{self._inbox.received} samples taken', values

    def _alarm(self) -> Health:
        """Return what the detector judges of the motion."""
        status = self._detector.status
        text = f'{status.state.label}, region {status.region.label}'
        said = '; '.join([text, *status.reasons, *status.absent])
        self._was_well |= status.level is Level.OK
        # Nothing judged yet, or not yet whether what is there is more than noise.
        awaited = not status.stamp_ns or (status.level is Level.WARN and not self._was_well)
        level = Awaited(status.level.label) if awaited else status.level.label
        return level, said, status.values


make_node = HuntingDetectorNode
