"""
The node that calls somebody: sound, command and relay, from `hunting/status`.

It only listens, and acts on its own steady clock: a detector that falls silent is a reason to
call. Each output has a thread of its own, so that one that hangs holds up no other. What fails is
an ERROR on `/diagnostics` until it works again. It is no safety function.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from functools import partial
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray

from hunt_ros.drivers.alarm_output import AlarmOutput, AlarmSettings, Call, Condition
from hunt_ros.errors import ConfigError, DriverError, one_line
from hunt_ros.nodes.support.conversions import read_diagnostic
from hunt_ros.nodes.support.diagnostics import Health, steady_clock
from hunt_ros.nodes.support.ending import abandoned
from hunt_ros.nodes.support.hearing import Calls, Said
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.nodes.support.qos import hear
from hunt_ros.suite import Awaited

_LOOK_S = 0.05
#: What failed is tried again after this, after twice as long, and so on, s.
_AGAIN_S, _AGAIN_MOST_S = 5.0, 60.0
#: A test holds a relay for so long, s.
_TEST_S = 2.0
_ABANDONED = 'what started the nodes has died: nobody watches the rig any more'
_TEST = 'test of the alarm, asked for by a person'


class AlarmOutputsNode(SuiteNode):
    """Shows the detector's alarm outside of the screen."""

    closing_s = 5.0
    winding_s = 30.0

    def __init__(self) -> None:
        super().__init__('alarm_outputs')
        self._config = declare(self, AlarmSettings)
        self._outputs = self._config.outputs()
        if not self._outputs:
            raise ConfigError('alarm_outputs: none of sound, command and relay_coil is given')
        self._call = Call(self._config.silence_s, time.monotonic())
        self._testing = self._left = False
        self._proof = Path(self._config.tested_file) if self._config.tested_file else None
        self._tested = 'never'
        if self._proof is not None and self._proof.exists():
            self._tested = _as_clock(self._proof.stat().st_mtime)
        self._changed = {name: threading.Event() for name in self._outputs}
        hear(self, 'hunting/status', self._on_status)
        hear(self, 'speed/status', self._on_drive)
        hear(self, 'hunting/events', self._on_event)
        self.create_timer(_LOOK_S, self._look, clock=steady_clock())
        Calls(self, {'test-alarm': self._on_test}, beside=['test-alarm'])
        for name in self._outputs:
            self.work(name, partial(self._keep, name))

    def wind_down(self) -> bool:
        """Call where nobody is left who could; what was shown so stays shown."""
        if abandoned() and not self._left:
            self._left = True
            for name in self._outputs:
                self._try(name, lambda output: output.show(Condition.DOUBT, _ABANDONED))
        return True

    def _on_status(self, message: DiagnosticArray) -> None:
        """Take a status of the detector."""
        self._call.hear(time.monotonic(), read_diagnostic(message))
        self._look()

    def _on_drive(self, message: DiagnosticArray) -> None:
        self._call.hear_drive(time.monotonic(), read_diagnostic(message))

    def _on_event(self, message: DiagnosticArray) -> None:
        self._call.hear_event(read_diagnostic(message).get('event', ''))

    def _look(self) -> None:
        """Have every output show a condition that is new."""
        if self._call.look(time.monotonic()):
            self.get_logger().info(f'{self._call.condition.value}: {self._call.cause}')
            self.wake()

    def wake(self) -> None:
        """Have every output look."""
        for changed in self._changed.values():
            changed.set()

    def _keep(self, name: str, stopping: threading.Event) -> None:
        """
        Keep one output at the present condition; what fails is told, and tried again.

        At the end a relay is switched off.
        """
        output, changed = self._outputs[name], self._changed[name]
        again_s = _AGAIN_S
        while not stopping.is_set():
            silent = self._left or (output.horn and self._call.acknowledged)
            failed = '' if silent else self._try(name, self._show)
            changed.wait(again_s if failed else output.repeat_s)
            changed.clear()
            again_s = min(2.0 * again_s, _AGAIN_MOST_S) if failed else _AGAIN_S
        if not self._left:
            self._try(name, lambda output: output.close())

    def _show(self, output: AlarmOutput) -> None:
        """Show the present condition; where it calls nobody, a test that is under way."""
        if self._testing and not self._call.condition.calls:
            _show_test(output)
        else:
            output.show(self._call.condition, self._call.cause)

    def _try(self, name: str, act: Callable[[AlarmOutput], object]) -> str:
        """Do what an output does; return '' or what failed, logged once and in the diagnostics."""
        try:
            act(self._outputs[name])
        except Exception as error:  # whatever a library of the hardware raises
            self._diagnostics.failed(name, error)
            return one_line(error)
        self._diagnostics.done(name)
        return ''

    def _on_test(self, said: Said) -> str:
        """Have every output call for a moment, as a status of the detector would."""
        if not self._call.heard(time.monotonic()):
            raise DriverError('the detector is not heard: an alarm of it would call nobody')
        self._testing = True
        failed = [f'{x}: {why}' for x in self._outputs if (why := self._try(x, _show_test))]
        time.sleep(_TEST_S)
        self._testing = False
        self.wake()  # what they show again is how things stand
        if failed:
            raise DriverError('; '.join(failed))
        before, self._tested = self._tested, _as_clock(time.time())
        if self._proof is not None:
            with suppress(OSError):  # a full disk takes nothing from the test
                self._proof.touch()
        names = ' and '.join(self._outputs)
        return f'{names} called, and the detector is heard; last test before: {before}'

    def _health(self) -> Health:
        values = {
            'condition': self._call.condition.value,
            'cause': self._call.cause,
            'acknowledged': self._call.acknowledged,
            'tested': self._tested,
        }
        if self._call.condition is Condition.WAITING:
            return Awaited('WARN'), self._call.cause, values
        words = f'{self._call.condition.value}; tested from detector to output: {self._tested}'
        return 'OK', words, values


def _show_test(output: AlarmOutput) -> None:
    output.show(Condition.ALARM, _TEST)


def _as_clock(at_s: float) -> str:
    return f'{datetime.fromtimestamp(at_s):%Y-%m-%d %H:%M:%S}'


make_node = AlarmOutputsNode
