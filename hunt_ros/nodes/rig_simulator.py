"""
The rig that is not there: simulates wheelset, roller and sensors, and serves them as hardware.

The sensor and speed nodes read it through the same drivers' interface as real
hardware. With a `time_scale` that is not 1 it runs so much faster than real time, or as fast as
the detector can follow, and publishes `/clock`, which the other nodes follow with
`use_sim_time`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from hunt_ros.drivers.simulated import Channel
from hunt_ros.drivers.simulator_server import SimulatorServer
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.simulation import RollerRig, Roughness, SensorModel, SimulationSettings
from hunt_ros.errors import ConfigError
from hunt_ros.nodes.support.conversions import to_ns, to_time
from hunt_ros.nodes.support.diagnostics import Health
from hunt_ros.nodes.support.hearing import Calls, Said
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.nodes.support.qos import announce, hear
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import Settings, setting

_DRIVE_HZ = 100.0
#: Size of the bump of the service `kick`.
_KICK_M = 0.3e-3
_DRIVE_STEP_NS = round(NANOSECONDS / _DRIVE_HZ)
#: Simulated time begins here, so that no stamp is 0, which ROS takes for 'not set'.
_FIRST_STAMP_NS = NANOSECONDS
#: Samples are handed over in blocks of so much, as buffered hardware does, s: every block wakes
#: all processes of the chain.
_BLOCK_S = 4e-3
#: After a pause of the machine, at most this much of the rig's time is caught up at once.
_MOST_BEHIND_S = 0.5
#: Below the time after which the detector calls a sensor silent where time runs fast: a pause of
#: the machine is then a longer one of the rig (`hunt demo` sets its `..._timeout_s` to 3 s).
_LEAD_NS = NANOSECONDS
#: A detector that makes no headway for so long is dead, s of real time: a busy machine may take a
#: minute for its turn. Until then time goes on by this share of real time: in that minute by the
#: 2 s that are left of the 3 s.
_DEAD_S, _CREEP = 60.0, 1.0 / 30.0
#: A roller, its excitation and sensors as they are in a lab.
_ORDINARY: dict[str, Any] = {
    'roughness': Roughness(amplitudes=(20e-6,)),
    'broadband': 8e-6,
    'lateral_sensor': SensorModel(noise=5e-6),
    'yaw_sensor': SensorModel(noise=2e-5),
}


@dataclass(frozen=True)
class SimulatorConfig(Settings):
    """Parameters of the rig simulator."""

    host: str = setting('127.0.0.1', 'Address to serve on.')
    port: int = setting(47100, 'TCP port to serve on.', low=1, high=65535)
    sample_rate_hz: float = setting(
        500.0, 'Rate of both sensors.', unit='Hz', low=100.0, high=2000.0
    )
    time_scale: float = setting(
        1.0,
        'Simulated seconds in a second, at most; not 1: /clock is published, begins when the'
        ' detector is heard, and waits for it.',
        low=0.01,
        high=50.0,
    )
    wheelset: str = setting('', 'YAML file of the simulated rig; empty: the built-in one.')
    initial_speed_mps: float = setting(
        6.0, 'Running speed at the start.', unit='m/s', low=0.1, high=100.0
    )
    kicks: tuple[float, ...] = setting(
        (), 'Times, s, and sizes, m, of bumps by themselves, in turn.'
    )
    seed: int = setting(0, 'Of everything random.', low=0)
    start_with_readers: int = setting(
        0, 'Hold the simulated time until so many drivers are connected.', low=0
    )


class Pace:
    """
    Compares simulated time with the newest estimate of the detector, once that is heard.

    A machine that is slow, or has other work, cannot follow a rig at any multiple of real time:
    samples would be lost between processes, and the run would show silence and faults that no rig
    had. Simulated time therefore waits for the detector, which is the last of the chain. It never
    stands still: the detector may wait in its turn for samples that come only as time goes on.

    Before its first estimate the time counts at which the simulation began: samples that come to
    it by several ways must not be seconds of the rig apart when it begins.

    Parameters
    ----------
    node : Node
        Gets the subscription to `hunting/status`.
    clock : callable, optional
        Real time, s.

    Attributes
    ----------
    heard : bool
        True once the detector has said anything.
    """

    def __init__(self, node: Node, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.heard = False
        self._judged_ns = 0
        self._progress_s = clock()
        hear(node, 'hunting/status', self._on_status)

    def must_wait(self, now_ns: int) -> bool:
        """Return True if simulated time `now_ns` is as far ahead as it may be."""
        if not self._judged_ns:
            self._judged_ns, self._progress_s = now_ns, self._clock()
        waited_s = self._clock() - self._progress_s
        ahead_ns = _LEAD_NS + _CREEP * waited_s * NANOSECONDS
        return waited_s < _DEAD_S and now_ns - self._judged_ns >= ahead_ns

    def _on_status(self, message: DiagnosticArray) -> None:
        self.heard = True
        judged_ns = to_ns(message.header.stamp)
        if judged_ns and judged_ns != self._judged_ns:
            self._judged_ns, self._progress_s = judged_ns, self._clock()


class RigSimulatorNode(SuiteNode):
    """Runs the simulation in real time, in a thread of its own."""

    def __init__(self) -> None:
        super().__init__('rig_simulator')
        self._config = config = declare(self, SimulatorConfig)
        if len(config.kicks) % 2:
            raise ConfigError(f'kicks: {config.kicks}, expected a time and a size of each')
        self._kicks = sorted(zip(config.kicks[::2], config.kicks[1::2], strict=True))
        settings = SimulationSettings(
            sample_rate_hz=config.sample_rate_hz,
            initial_speed=config.initial_speed_mps,
            **_ORDINARY,
        )
        self._rig = RollerRig(RigParameters.read(config.wheelset), settings, seed=config.seed)
        self._server = SimulatorServer(config.host, config.port)
        self._clock_publisher = self._pace = None
        if config.time_scale != 1.0:
            self._clock_publisher = announce(self, '/clock')
            self._pace = Pace(self)
        self._time_ns = 0
        self._origin_ns = _FIRST_STAMP_NS
        self._samples = 0
        self._behind_s = 0.0  # real time
        Calls(self, {'kick': self._on_kick})
        self.work('simulation', self._simulate)

    def close(self) -> None:
        """Stop simulating and disconnect the drivers."""
        super().close()
        self._server.close()

    def _simulate(self, stopping: threading.Event) -> None:
        """Advance the simulation with real time, a block every few milliseconds."""
        rate = self._config.sample_rate_hz * self._config.time_scale
        pause_s = max(_BLOCK_S, 1.0 / rate)
        most_behind_s = max(_MOST_BEHIND_S / max(1.0, self._config.time_scale), 5.0 * pause_s)
        real_time = self._clock_publisher is None
        self._rig.advance(0)  # compile before the clock starts
        while not stopping.is_set() and self._waits_for():
            self._server.poll()
            time.sleep(0.01)
        if real_time:
            # On whole readings of the drive, as a synchronised data acquisition samples.
            now_ns = self.get_clock().now().nanoseconds
            self._origin_ns = -(-now_ns // _DRIVE_STEP_NS) * _DRIVE_STEP_NS
            time.sleep((self._origin_ns - now_ns) / NANOSECONDS)
        before_s = next_wake = time.monotonic()
        while not stopping.is_set():
            passed_s = time.monotonic() - before_s
            before_s += passed_s
            self._behind_s += passed_s
            if self._behind_s > most_behind_s:
                # Nobody runs after lost time: the stamps jump with it, as those of a stalled rig
                # would; simulated time just stood still.
                steps = int(self._behind_s * _DRIVE_HZ)
                self._behind_s -= steps / _DRIVE_HZ
                self._origin_ns += steps * _DRIVE_STEP_NS if real_time else 0
            target = self._server.poll()
            if target is not None:
                self._rig.target_speed = target
            if self._pace is not None and self._pace.must_wait(self._time_ns):
                self._behind_s = 0.0  # real time
            elif due := int(self._behind_s * rate):
                self._advance(due)
                self._behind_s -= due / rate
            next_wake = max(next_wake + pause_s, time.monotonic())
            time.sleep(max(0.0, next_wake - time.monotonic()))

    def _waits_for(self) -> str:
        """Return who has to be there before the simulated time begins; '' when all are."""
        missing = self._config.start_with_readers - self._server.readers
        if missing > 0:
            return f'{missing} drivers'
        return '' if self._pace is None or self._pace.heard else 'the detector'

    def _advance(self, count: int) -> None:
        """Simulate so many samples, and send them to whoever is connected."""
        self._kick_if_due()
        block = self._rig.advance(count)
        stamps_ns = self._origin_ns + block.stamps_ns
        self._server.send(Channel.LATERAL, stamps_ns, block.lateral)
        self._server.send(Channel.YAW, stamps_ns, block.yaw)
        every = max(1, round(self._config.sample_rate_hz / _DRIVE_HZ))
        drive = (self._samples + np.arange(count)) % every == 0
        self._server.send(
            Channel.DRIVE, stamps_ns[drive], block.roller_angle[drive], block.speed[drive]
        )
        self._samples += count
        if self._clock_publisher is not None:
            self._time_ns = int(stamps_ns[-1])
            self._clock_publisher.publish(Clock(clock=to_time(self._time_ns)))

    def _kick_if_due(self) -> None:
        """Kick where the plan, or a service, says so."""
        elapsed_s = self._samples / self._config.sample_rate_hz
        while self._kicks and self._kicks[0][0] <= elapsed_s:
            self._rig.kick(self._kicks.pop(0)[1])

    def _on_kick(self, said: Said) -> str:
        self._kicks.insert(0, (0.0, _KICK_M))  # due at once
        return 'the wheelset was hit'

    def _health(self) -> Health:
        values = {
            'port': self._server.port,
            'drivers': self._server.readers,
            'samples': self._samples,
            'behind_s': round(self._behind_s, 4),
            'speed_mps': round(self._rig.speed, 4),
        }
        if self._behind_s > 0.1:
            return 'WARN', f'{self._behind_s:.2f} s behind real time', values
        if not self._samples and (who := self._waits_for()):
            return 'OK', f'waits for {who}', values
        return 'OK', f'{self._server.readers} drivers connected', values


make_node = RigSimulatorNode
