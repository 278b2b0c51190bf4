"""
The node that calls somebody: sound, command and relay, from `hunting/status`.

It only listens, and acts on its own steady clock: a detector that falls silent is a reason to
call. Each output has a thread of its own, so that one that hangs holds up no other. What fails is
an ERROR on `/diagnostics` until it works again. It is no safety function.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from hunt_ros.drivers.alarm_output import AlarmOutput, Command, Condition, Relay, Sound
from hunt_ros.drivers.modbus_link import ModbusBus
from hunt_ros.errors import ConfigError
from hunt_ros.nodes.conversions import read_diagnostic
from hunt_ros.nodes.diagnostics import Diagnostics, Health, one_line, steady_clock
from hunt_ros.nodes.parameters import declare, warn_unknown
from hunt_ros.nodes.qos import STATUS
from hunt_ros.nodes.sole import hold_name
from hunt_ros.nodes.worker import Worker
from hunt_ros.settings import Settings, setting

_LOOK_S = 0.05


@dataclass(frozen=True)
class AlarmConfig(Settings):
    """Parameters of the alarm outputs."""

    sound: str = setting(
        '', "'bell' of the terminal, or a command: 'aplay alarm.wav'; empty: none.", fixed=True
    )
    sound_every_s: float = setting(
        2.0, 'How often it sounds.', unit='s', low=0.2, high=3600.0, fixed=True
    )
    command: str = setting(
        '',
        'Run at each change; last arguments: well, alarm or doubt, and the cause; empty: none.',
        fixed=True,
    )
    command_timeout_s: float = setting(
        10.0, 'The command is ended after so long.', unit='s', low=0.1, high=3600.0, fixed=True
    )
    relay_coil: int = setting(
        -1, 'Modbus coil of a relay; -1: none.', low=-1, high=65535, fixed=True
    )
    relay_inverted: bool = setting(
        False, 'The relay is on while all is well: a cut wire calls too.', fixed=True
    )
    silence_s: float = setting(
        1.0, 'No status for so long is doubt.', unit='s', low=0.2, high=3600.0, fixed=True
    )
    call_on_doubt: bool = setting(
        True, 'Call for silence and level STALE too, not only for an alarm.', fixed=True
    )


class AlarmOutputsNode(Node):
    """Shows the detector's alarm outside of the screen."""

    closing_s = 5.0

    def __init__(self) -> None:
        super().__init__('alarm_outputs')
        hold_name(self)
        self._config = declare(self, AlarmConfig)
        self._outputs = _outputs(self._config, declare(self, ModbusBus))
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

    def _try(self, name: str, act) -> None:
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


def _outputs(config: AlarmConfig, bus: ModbusBus) -> dict[str, AlarmOutput]:
    """Return the outputs that are wanted, by name."""
    wanted: dict[str, AlarmOutput] = {}
    if config.sound:
        wanted['sound'] = Sound(config.sound, config.sound_every_s)
    if config.command:
        wanted['command'] = Command(config.command, config.command_timeout_s)
    if config.relay_coil >= 0:
        wanted['relay'] = Relay(bus, config.relay_coil, config.relay_inverted)
    return wanted


make_node = AlarmOutputsNode
