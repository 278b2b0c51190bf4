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
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from hunt_ros.drivers.alarm_output import AlarmOutput, AlarmSettings, Condition
from hunt_ros.drivers.modbus_link import ModbusBus
from hunt_ros.errors import ConfigError
from hunt_ros.nodes.support.conversions import read_diagnostic
from hunt_ros.nodes.support.diagnostics import Diagnostics, Health, one_line, steady_clock
from hunt_ros.nodes.support.parameters import declare, warn_unknown
from hunt_ros.nodes.support.qos import STATUS
from hunt_ros.nodes.support.sole import hold_name
from hunt_ros.nodes.support.worker import Worker

_LOOK_S = 0.05


class AlarmOutputsNode(Node):
    """Shows the detector's alarm outside of the screen."""

    closing_s = 5.0

    def __init__(self) -> None:
        super().__init__('alarm_outputs')
        hold_name(self)
        self._config = declare(self, AlarmSettings)
        self._outputs = self._config.outputs(declare(self, ModbusBus))
        warn_unknown(self)
        if not self._outputs:
            raise ConfigError('alarm_outputs: none of sound, command and relay_coil is given')
        self._condition, self._cause = Condition.WAITING, 'no status heard yet'
        self._heard_s = -float('inf')
        self._problems: dict[str, str] = {}
        self._changed = {name: threading.Event() for name in self._outputs}
        self._diagnostics = Diagnostics(self, self._health)
        self.create_subscription(DiagnosticArray, 'hunting/status', self._on_status, STATUS)
        self.create_timer(_LOOK_S, self._look, clock=steady_clock())
        self._workers = [
            Worker(self._diagnostics, name, partial(self._work, name)) for name in self._outputs
        ]

    def close(self) -> None:
        """End the outputs; a relay is switched off."""
        for worker in self._workers:
            worker.stopping.set()
        for changed in self._changed.values():
            changed.set()
        for worker in self._workers:
            worker.stop()

    def _on_status(self, message: DiagnosticArray) -> None:
        """Show what a status of the detector says."""
        status = read_diagnostic(message)
        if not status:
            return
        self._heard_s = time.monotonic()
        cause = f'{status["level"]}: {status["message"]}'
        if status['level'] == 'ERROR' or status.get('alarm') == 'True':
            self._show(Condition.ALARM, cause)
        elif status['level'] == 'STALE' and self._config.call_on_doubt:
            self._show(Condition.DOUBT, cause)
        else:
            self._show(Condition.WELL, cause)

    def _look(self) -> None:
        """Find silence, once something has been heard."""
        silent_s = time.monotonic() - self._heard_s
        if self._condition is Condition.WAITING or silent_s < self._config.silence_s:
            return
        if self._config.call_on_doubt and self._condition is not Condition.ALARM:
            self._show(Condition.DOUBT, f'no status for {self._config.silence_s:g} s')

    def _show(self, condition: Condition, cause: str) -> None:
        """Have every output show a condition that is new."""
        before, self._condition = self._condition, condition
        if condition is before:
            return
        self._cause = cause
        self.get_logger().info(f'{condition.value}: {cause}')
        for changed in self._changed.values():
            changed.set()

    def _work(self, name: str, stopping: threading.Event) -> None:
        """Keep one output at the present condition; what it raises is told, and tried again."""
        output, changed = self._outputs[name], self._changed[name]
        while not stopping.is_set():
            self._try(name, partial(self._show_on, output))
            changed.wait(output.repeat_s)
            changed.clear()
        self._try(name, output.close)

    def _show_on(self, output: AlarmOutput) -> None:
        if self._condition is not Condition.WAITING:
            output.show(self._condition, self._cause)

    def _try(self, name: str, act: Callable[[], object]) -> None:
        """Do what an output does; what fails is logged once, and told in the diagnostics."""
        try:
            act()
        except Exception as error:  # whatever a library of the hardware raises
            if name not in self._problems:
                self.get_logger().error(f'{name}: {one_line(error)}')
            self._problems[name] = one_line(error)
        else:
            self._problems.pop(name, None)

    def _health(self) -> Health:
        values = {'condition': self._condition.value, 'cause': self._cause}
        problems = [f'{name}: {problem}' for name, problem in list(self._problems.items())]
        if problems:
            return 'ERROR', '; '.join(problems), values
        if self._condition is Condition.WAITING:
            return 'WARN', self._cause, values
        return 'OK', self._condition.value, values


make_node = AlarmOutputsNode
