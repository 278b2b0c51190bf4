"""
What happens to the roller when something fails, one row a fault: detector and drive are played.

Asserted is what happens and what the operator is told. How long it took is printed into
docs/faults.md (`make faults`), and asserted nowhere.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from speed_rig import Detector, Drive, Rig

pytestmark = [pytest.mark.ros, pytest.mark.slow]

RUNNING = 6.0
#: v_n of the detector less the margin.
SAFE = 4.5
#: How often a fault is tried.
_ATTEMPTS = 5
_HEAD = '| fault | mode | interlock | until the set point falls, s | told |'


@dataclass(frozen=True)
class Fault:
    """
    One row.

    Parameters
    ----------
    what : str
        For the table.
    begin : callable
        Makes it happen; gets detector, drive and rig.
    state : str
        Of the interlock after it: tripped, armed, disarmed.
    words : str
        Stands in the cause that the operator is told.
    speed : float
        Set point at the end, m/s.
    mode : str
        Of the interlock.
    also : str
        Stands in what the operator is told, after a while.
    """

    what: str
    begin: Callable[[Detector, Drive, Rig], object]
    state: str = 'tripped'
    words: str = ''
    speed: float = SAFE
    mode: str = 'protect'
    also: str = ''


@dataclass
class Row:
    """
    What came of a fault.

    Parameters
    ----------
    what : str
        The fault.
    mode : str
        Of the interlock.
    state : str
        Of the interlock after it, and the set point.
    safe_s : float or None
        Until the first lower set point; None where it does not fall.
    told : str
        What the operator is told.
    """

    what: str
    mode: str
    state: str
    safe_s: float | None
    told: str

    def __str__(self) -> str:
        slow = '-' if self.safe_s is None else f'{self.safe_s:.2f}'
        return f'| {self.what} | {self.mode} | {self.state} | {slow} | {self.told} |'


def observed(
    what: str,
    attempt: Callable[[int], Row | None],
    status: Callable[[], object],
) -> Row:
    """
    Return what came of a fault, by the first attempt that shows it.

    A busy machine may be silent by itself, and then that is the cause: it is tried again, with
    more patience by the number of the attempt.
    """
    why = ''
    for number in range(_ATTEMPTS):
        try:
            row = attempt(number)
        except AssertionError as error:  # a wait was in vain
            row, why = None, str(error)
        if row is not None:
            return row
    pytest.fail(f'{what}: {why or status()}')


def publish(rows: list[Row], path: Path) -> None:
    """Put the rows in the place of those of a file."""
    before, _, table = path.read_text(encoding='utf-8').partition(_HEAD)
    after = itertools.dropwhile(lambda line: line.startswith('|'), table.splitlines()[1:])
    lines = [_HEAD, '|---|---|---|---|---|', *map(str, rows), *after]
    path.write_text(before + '\n'.join(lines) + '\n', encoding='utf-8')


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


def test_every_fault_ends_as_the_table_says(graph, resident, detector, machine) -> None:
    table: list[Row] = []
    drive = Drive(RUNNING)
    timeout_s = 0.3 * machine.measure()
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
    if path := os.environ.get('HUNT_FAULT_TABLE'):
        publish(table, Path(path))


def _recover(rig: Rig, detector: Detector, drive: Drive, mode: str) -> None:
    """Mend everything, arm, and run the profile again."""
    detector.reset()
    drive.reset()
    rig.set(interlock=mode)

    expected = {'interlock_state': 'armed', 'target_mps': str(RUNNING), 'level': 'OK'}

    def running() -> bool:
        status = rig.status
        if status.items() >= expected.items():
            # Silence trips it only once all has been well for a while.
            return not status['interlock_cause'].startswith('waits')
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
