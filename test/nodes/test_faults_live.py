"""
What happens to the roller when a process of the suite fails, one row a fault.

Every node runs in a process of its own, on the simulated rig. The suite is started once, and
one fault follows the other. How long it took is asserted nowhere.
"""

from __future__ import annotations

import itertools
import resource
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import fault_table
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from fault_table import Row, observed
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.nodes.support.conversions import read_diagnostic, to_ns
from hunt_ros.nodes.support.qos import STATUS, latched

pytestmark = [pytest.mark.ros, pytest.mark.slow]

#: Inside the hysteresis region, and v_n less the margin.
RUNNING, SAFE = 7.2, 5.906
#: Statuses of the speed node (10 Hz) in which nothing may happen where nothing shall.
_QUIET = 15
#: Of the sensors: five times fewer samples than usual leave a busy machine room for the rest.
_RATE_HZ = 100.0


class Suite:
    """Every node in a process of its own, on the simulated rig."""

    def __init__(self, graph, machine) -> None:
        self.graph = graph
        self._statuses = graph.collect(DiagnosticArray, 'speed/status', latched())
        self._targets = graph.collect(TwistStamped, 'speed/target')
        self._healths = graph.collect(DiagnosticArray, '/diagnostics', STATUS)
        self._storm: threading.Event | None = None
        self._form = graph.folder / 'normal_form.yaml'
        self._form.write_text(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml())
        # A machine that is busy must not look like nodes that are silent.
        self._least_s = self._patience_s = 0.3 * machine.measure()
        self.began_ns = 0
        self.start('hunting_detector')
        self.start('bag_recorder')
        graph.start(
            'rig_simulator',
            port=graph.port,
            sample_rate_hz=_RATE_HZ,
            initial_speed_mps=6.0,
            kick_m=0.0006,
        )
        self.start('yaw_sensor')
        self.start('lateral_sensor')
        graph.start(
            'roller_speed',
            port=graph.port,
            profile=graph.profile(
                f'hold: {{speed_mps: {RUNNING}, duration_s: 100000, rate_mps2: 1.0}}'
            ),
            status_timeout_s=self._patience_s,
            amplitude_limit_m=5e-3,
        )
        graph.spin_until(lambda: self._statuses, 60.0)

    def start(self, module: str) -> None:
        if module == 'hunting_detector':
            self.graph.start(module, self._form, sensor_timeout_s=0.5 * self._patience_s)
        elif module == 'bag_recorder':
            self.graph.start(module, directory=self.graph.folder / 'recordings')
        else:
            self.graph.start(module, port=self.graph.port, sample_rate_hz=_RATE_HZ)

    def kill(self, module: str) -> None:
        self.graph.end(module, signal.SIGKILL)

    def send(self, module: str, number: int) -> None:
        self.graph.process(module).send_signal(number)

    @property
    def status(self) -> dict[str, str]:
        """Of the speed node."""
        return read_diagnostic(self._statuses[-1])

    def health(self, node: str) -> str:
        """Return level and words of a node that has told its health since the fault."""
        for message in reversed(self._healths):
            said = read_diagnostic(message)
            if said['name'].endswith(node) and to_ns(message.header.stamp) > self.began_ns:
                words = said['message'].replace(f'{self.graph.folder}/', '')
                return f'{said["level"]}: {words}'
        return ''

    def be_patient(self, attempt: int) -> None:
        """Take silence for a fault later, at a further attempt."""
        patience_s, before_s = 2.0**attempt * self._least_s, self._patience_s
        if patience_s == before_s:
            return
        self._patience_s = patience_s
        self.graph.set_parameters('roller_speed', status_timeout_s=patience_s)
        self.kill('hunting_detector')
        # Else what is heard next of the interlock may be of the detector that is gone.
        self.graph.spin_until(lambda: self.status['interlock_state'] == 'tripped', 60.0)
        self.start('hunting_detector')

    def recover(self) -> None:
        """Arm, and run the profile, as often as it takes."""

        def running() -> bool:
            status = self.status
            if status['profile_state'] == 'running' and status['interlock_state'] == 'armed':
                faster = float(status['target_mps']) > SAFE + 0.2
                return faster and status['interlock_cause'] in ('no reason to trip', _REARMED)
            if self.graph.call('speed/rearm').success:
                self.graph.call('speed/start_profile')
            self.graph.spin(0.05)
            return False

        self.graph.spin_until(running, 60.0)

    def suffer(self, fault: Fault) -> Row | None:
        """Let a fault happen and end; None where what came of it has another cause."""
        self.began_ns = time.time_ns()
        fault.begin(self)
        try:
            return self._outcome(fault)
        finally:  # also where a wait was in vain: the next attempt needs a whole rig
            fault.end(self)

    def _outcome(self, fault: Fault) -> Row | None:
        """Wait for what comes of a fault; None where that has another cause."""
        count = len(self._statuses)
        if fault.state == 'tripped':
            self.graph.spin_until(lambda: self.status['interlock_state'] == 'tripped', 60.0)
        else:
            self.graph.spin_until(lambda: len(self._statuses) > count + _QUIET)
        status = self.status
        if (
            status['interlock_state'] != fault.state
            or fault.words not in status['interlock_cause']
        ):
            return None
        if fault.state == 'tripped':
            self.graph.spin_until(lambda: abs(self._targets[-1].twist.linear.x - SAFE) < 0.04)
        return Row(
            fault.what, 'protect', self._state(fault), self._until_lower_s(), fault.told(self)
        )

    def _state(self, fault: Fault) -> str:
        speed_mps = self._targets[-1].twist.linear.x
        return f'tripped, {speed_mps:.1f} m/s' if fault.state == 'tripped' else 'armed'

    def _until_lower_s(self) -> float | None:
        """Return when the set point first fell after the fault began, s; None: it did not."""
        for before, after in itertools.pairwise(self._targets):
            at_ns = to_ns(after.header.stamp)
            if at_ns > self.began_ns and after.twist.linear.x < before.twist.linear.x:
                return (at_ns - self.began_ns) / 1e9
        return None

    def storm(self) -> None:
        """Publish what is no number instead of the lateral sensor."""
        publisher = self.graph.node.create_publisher(JointState, 'lateral', 100)
        self.graph.spin_until(lambda: publisher.get_subscription_count() >= 2)
        self._storm = over = threading.Event()

        def blow() -> None:
            while not over.wait(0.005):
                message = JointState(name=['lateral'], position=[float('nan')])
                message.header.stamp = self.graph.node.get_clock().now().to_msg()
                publisher.publish(message)

        self.kill('lateral_sensor')
        self.began_ns = time.time_ns()
        threading.Thread(target=blow, daemon=True).start()

    def calm(self) -> None:
        self._storm.set()
        self.start('lateral_sensor')

    def fill_the_disk(self) -> None:
        """Let no file of the recorder become longer than it is now."""
        files = (self.graph.folder / 'recordings').rglob('*.mcap')
        longest = max(path.stat().st_size for path in files)
        pid = self.graph.process('bag_recorder').pid
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (longest, longest))
        self.graph.spin_until(lambda: self.health('bag_recorder').startswith('ERROR'))

    def another_disk(self) -> None:
        self.graph.end('bag_recorder')
        self.start('bag_recorder')

    def bump(self) -> None:
        """Hit the wheelset, at the speed at which it goes on hunting."""
        self.graph.spin_until(
            lambda: (
                float(self.status['speed_mps']) > RUNNING - 0.05
                or self.status['interlock_state'] == 'tripped'
            )
        )
        self.began_ns = time.time_ns()
        assert self.graph.call('simulator/kick').success


_REARMED = 'armed again by a person'


def _of_speed(suite: Suite) -> str:
    return suite.status['message']


def _of_recorder(suite: Suite) -> str:
    health = suite.health('bag_recorder')
    return f'bag_recorder in /diagnostics: {health or "silent"}'


@dataclass(frozen=True)
class Fault(fault_table.Fault):
    """
    One row; what begins it gets the suite.

    Parameters
    ----------
    end : callable
        Mends it.
    told : callable
        Returns what the operator is told.
    """

    end: Callable[[Suite], object] = lambda suite: None
    told: Callable[[Suite], str] = _of_speed


def _killed(what: str, module: str, **row: object) -> Fault:
    return Fault(
        what, lambda suite: suite.kill(module), end=lambda suite: suite.start(module), **row
    )


def _frozen(what: str, module: str, **row: object) -> Fault:
    def freeze(suite: Suite) -> None:
        suite.send(module, signal.SIGSTOP)

    def go_on(suite: Suite) -> None:
        suite.send(module, signal.SIGCONT)

    return Fault(what, freeze, end=go_on, **row)


_RECORDER = {'state': 'armed', 'told': _of_recorder}
FAULTS = [
    _frozen('the recorder is stopped (SIGSTOP) and goes on', 'bag_recorder', **_RECORDER),
    Fault('the disk is full', Suite.fill_the_disk, end=Suite.another_disk, **_RECORDER),
    _killed('the recorder is killed', 'bag_recorder', **_RECORDER),
    _killed('a sensor node is killed', 'lateral_sensor', words='lateral'),
    _frozen('a sensor node is stopped (SIGSTOP) and goes on', 'yaw_sensor', words='yaw'),
    Fault('a sensor sends only NaN', Suite.storm, end=Suite.calm, words='lateral'),
    _frozen(
        'the detector is stopped (SIGSTOP) and goes on', 'hunting_detector', words='silent for'
    ),
    _killed('the detector is killed', 'hunting_detector', words='silent for'),
    _frozen('the whole rig stands still (SIGSTOP) and goes on', 'rig_simulator'),
    Fault('a bump beyond the basin: hunting', Suite.bump, words='says ERROR'),
]


def test_every_fault_of_a_process_ends_as_the_table_says(graph, table, machine) -> None:
    suite = Suite(graph, machine)
    for fault in FAULTS:

        def attempt(number: int, fault: Fault = fault) -> Row | None:
            suite.be_patient(number)
            suite.recover()
            return suite.suffer(fault)

        table.append(observed(fault.what, attempt, lambda: suite.status))
