"""
What happens to the roller when something fails, one row a fault: detector and drive are played.

Asserted is what happens and what the operator is told. How long it took is printed into
docs/faults.md (`make faults`), and asserted nowhere.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import fault_table
import pytest
from fault_table import Row, observed
from speed_rig import Detector, Drive, Rig

pytestmark = [pytest.mark.ros, pytest.mark.slow]

RUNNING = 6.0
#: v_n of the detector less the margin.
SAFE = 4.5


@dataclass(frozen=True)
class Fault(fault_table.Fault):
    """
    One row; what begins it gets detector, drive and rig.

    Parameters
    ----------
    speed : float
        Set point at the end, m/s.
    mode : str
        Of the interlock.
    also : str
        Stands in what the operator is told, after a while.
    """

    speed: float = SAFE
    mode: str = 'protect'
    also: str = ''


def _set(**values: object) -> Callable[[Detector, Drive, Rig], None]:
    """Change attributes of the detector, or of the drive where it has them."""

    def begin(detector: Detector, drive: Drive, rig: Rig) -> None:
        for name, value in values.items():
            setattr(detector if hasattr(detector, name) else drive, name, value)

    return begin


def _say(**numbers: object) -> Callable[[Detector, Drive, Rig], None]:
    return lambda detector, drive, rig: detector.numbers.update(numbers)


def _late(detector: Detector, drive: Drive, rig: Rig) -> None:
    limit_s = rig.node.get_parameter('status_timeout_s').value
    detector.delay_s = max(1.0, 3.0 * limit_s)


def _withdraw(detector: Detector, drive: Drive, rig: Rig) -> None:
    detector.numbers['v_n_mps'] = float('nan')
    rig.graph.spin_until(lambda: rig.status['safe_speed_mps'] == '0.0')
    detector.level = 'ERROR'


def _disarmed(detector: Detector, drive: Drive, rig: Rig) -> None:
    assert rig.arm(False).success
    detector.level = 'ERROR'


def _deactivate(detector: Detector, drive: Drive, rig: Rig) -> None:
    from lifecycle_msgs.msg import Transition

    detector.level = 'ERROR'
    rig.until(interlock_state='tripped')
    rig.graph.change_state('roller_speed', Transition.TRANSITION_DEACTIVATE)
    rig.graph.change_state('roller_speed', Transition.TRANSITION_ACTIVATE)


def _stuck(detector: Detector, drive: Drive, rig: Rig) -> None:
    drive.obeys = False
    detector.level = 'ERROR'


def _gone_and_back(detector: Detector, drive: Drive, rig: Rig) -> None:
    drive.absent = True
    rig.until(interlock_state='tripped')
    drive.absent = False


FAULTS = [
    Fault('the detector ends', _set(silent=True), words='silent for'),
    Fault('its statuses come late, from now on', _late, words='silent for'),
    Fault('every third status is lost', _set(lose_every=3), 'armed', speed=RUNNING),
    Fault('it answers and judges nothing new', _set(frozen=True), words='nothing new'),
    Fault('its statuses fall behind more and more', _set(falls_behind_s=0.04), words='late'),
    Fault('its clock is set ahead by an hour', _set(clock_s=3600.0), 'armed', speed=RUNNING),
    Fault('its clock is set back by an hour', _set(clock_s=-3600.0), 'armed', speed=RUNNING),
    Fault('a sensor is lost (STALE)', _set(level='STALE'), words='its inputs'),
    Fault('a sensor is lost (STALE)', _set(level='STALE'), words='its inputs', mode='measure'),
    Fault('hunting (ERROR)', _set(level='ERROR'), words='says ERROR: its reasons'),
    Fault('hunting (ERROR)', _set(level='ERROR'), 'armed', speed=RUNNING, mode='measure'),
    Fault('a warning (WARN)', _set(level='WARN'), 'armed', speed=RUNNING),
    Fault('the amplitude is above the limit', _say(amplitude_m=2e-3), words='2.000 mm above'),
    Fault(
        'the amplitude is above the limit', _say(amplitude_m=2e-3), words='above', mode='measure'
    ),
    Fault('the second estimate is above it', _say(envelope_m=2e-3), words='2.000 mm above'),
    Fault('the amplitude is infinite', _say(amplitude_m=float('inf')), words='above the limit'),
    Fault('the amplitude is not known', _say(amplitude_m=float('nan')), 'armed', speed=RUNNING),
    Fault('the amplitude is no number', _say(amplitude_m='?'), 'armed', speed=RUNNING),
    Fault('a level that nobody knows', _set(raw_level=b'\x09'), words='its inputs'),
    Fault('no v_n is known, and hunting', _withdraw, words='ERROR', speed=0.0),
    Fault('the drive refuses the set point', _set(refusal='no such register'), words='no such'),
    Fault('the drive is gone', _set(absent=True), words='gone'),
    Fault('the drive is gone and comes back', _gone_and_back, words='gone'),
    Fault('the drive is there and says nothing', _set(mute=True), words='sent nothing for'),
    Fault(
        'the drive takes the set point and does not obey',
        _stuck,
        words='ERROR',
        also='hard-wired stop',
    ),
    Fault('hunting, while the interlock is disarmed', _disarmed, 'disarmed', 'disarmed', RUNNING),
    Fault('the speed node is deactivated after a trip', _deactivate, words='ERROR'),
]


def test_every_fault_ends_as_the_table_says(graph, resident, detector, table, machine) -> None:
    drive = Drive(RUNNING)
    timeout_s = 0.15 * machine.measure()
    rig = Rig(
        graph,
        resident,
        drive,
        profile=graph.profile(
            f'hold: {{speed_mps: {RUNNING}, duration_s: 100000, rate_mps2: 20}}'
        ),
        status_timeout_s=timeout_s,
        amplitude_limit_m=1e-3,
        acceleration_mps2=20.0,
        jerk_mps3=1000.0,
        safe_deceleration_mps2=10.0,
    )
    for fault in FAULTS:

        def attempt(number: int, fault: Fault = fault) -> Row | None:
            rig.set(status_timeout_s=2.0**number * timeout_s)
            _recover(rig, detector, drive, fault.mode)
            return _suffer(rig, detector, drive, fault)

        table.append(observed(fault.what, attempt, lambda: rig.status))


def _recover(rig: Rig, detector: Detector, drive: Drive, mode: str) -> None:
    """Mend everything, arm, and run the profile again."""
    detector.reset()
    drive.reset()
    rig.set(interlock=mode)

    expected = {'interlock_state': 'armed', 'target_mps': str(RUNNING), 'level': 'OK'}

    def running() -> bool:
        status = rig.status
        if status.items() >= expected.items():
            return True
        if status['interlock_state'] == 'disarmed':
            rig.arm(True)
        # On a busy machine something may look silent meanwhile: again, and again.
        stands = status['interlock_state'] == 'tripped' or status['profile_state'] != 'running'
        if stands and rig.graph.call('speed/rearm').success:
            rig.graph.call('speed/start_profile')
        rig.graph.spin(0.05)
        return False

    rig.graph.spin_until(running)


def _suffer(rig: Rig, detector: Detector, drive: Drive, fault: Fault) -> Row | None:
    """Let a fault happen, and wait for what comes of it; None where it is something else."""
    began_s, sent = time.monotonic(), detector.sent
    fault.begin(detector, drive, rig)
    if fault.state == 'tripped':
        rig.graph.spin_until(lambda: rig.status['interlock_state'] == 'tripped')
    else:
        rig.graph.spin_until(lambda: detector.sent > sent + 20)
    status = rig.status
    if status['interlock_state'] != fault.state or fault.words not in status['interlock_cause']:
        return None
    if not (drive.refusal or drive.absent):
        rig.until(target_mps=str(fault.speed))
    rig.graph.spin_until(lambda: fault.also in rig.status['message'])
    told = {'tripped': 'ERROR', 'disarmed': 'WARN', 'armed': 'OK'}[fault.state]
    assert rig.status['level'] == told, fault.what
    lower = [
        at_s - began_s
        for at_s, speed in zip(drive.taken_s, drive.set_points, strict=False)
        if at_s > began_s and speed < RUNNING
    ]
    first_s = lower[0] if lower and fault.state == 'tripped' else None
    state = f'{fault.state}, {fault.speed:g} m/s'
    return Row(fault.what, fault.mode, state, first_s, rig.status['message'])
