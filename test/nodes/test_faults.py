"""
What happens to the roller when something fails, one row a fault: detector and drive are played.

What the speed node decides with runs here in memory, by a clock that is played too. How long it
takes on that clock stands in docs/faults.md, which `make faults` prints.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.drivers.base import DriveBlock
from hunt_ros.drivers.command import DriveLimits
from hunt_ros.drivers.interlock import InterlockSettings
from hunt_ros.drivers.safety_state import SafetyState
from hunt_ros.drivers.speed_guard import SpeedGuard
from hunt_ros.dynamics.profile import Profile
from hunt_ros.errors import DriverError
from hunt_ros.nodes.support.conversions import diagnostic, heard_of

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'faults.md'
RUNNING = 6.0
#: v_n of the detector less the margin.
SAFE = 4.5
_HEAD = '| fault | mode | interlock | until the set point falls, s | told |'
_TICK_NS, _SECOND_NS = 10_000_000, 1_000_000_000


class Detector:
    """Says the same thing 20 times a second."""

    def __init__(self) -> None:
        self.level, self.raw_level = 'OK', b''
        self.silent = self.frozen = False
        self.numbers: dict[str, object] = {'amplitude_m': 1e-5, 'v_n_mps': 5.0, 'v_c_mps': 7.0}
        self.clock_s = self.delay_s = self.falls_behind_s = self._behind_s = 0.0
        self.lose_every = 0
        self._sent = self._sequence = 0
        self._late: deque = deque()

    def said(self, now_ns: int) -> list:
        """Return the statuses that come at this moment."""
        if now_ns % (5 * _TICK_NS) == 0 and not self.silent:
            self._sent += 1
            self._sequence += 0 if self.frozen else 5
            self._behind_s += self.falls_behind_s
            stamp_ns = now_ns + round(1e9 * (self.clock_s - self._behind_s)) + 10**13
            values = {'sequence': self._sequence, **self.numbers}
            message = diagnostic(stamp_ns, 'hunting', self.level, 'its reasons', values, 'rig')
            if self.raw_level:
                message.status[0].level = self.raw_level
            if not (self.lose_every and self._sent % self.lose_every == 0):
                self._late.append((now_ns + round(1e9 * self.delay_s), message))
        come = []
        while self._late and self._late[0][0] <= now_ns:
            come.append(self._late.popleft()[1])
        return come


class Drive:
    """A drive in memory: the roller runs at the set point at once."""

    def __init__(self) -> None:
        self.speed_mps, self.obeys, self.scale = RUNNING, True, 1.0
        self.refusal, self.absent, self.mute = '', False, False

    def set_speed(self, speed_mps: float) -> None:
        if self.refusal:
            raise DriverError(self.refusal)
        if self.obeys:
            self.speed_mps = self.scale * speed_mps


class Bench:
    """What a speed node decides with, and what it hears, from one moment to the next."""

    def __init__(self, mode: str) -> None:
        limits = DriveLimits(
            acceleration_mps2=20.0,
            jerk_mps3=1e3,
            safe_deceleration_mps2=10.0,
            speed_ceiling_mps=8.0,
        )
        settings = InterlockSettings(interlock=mode, amplitude_limit_m=1e-3)
        self.detector, self.drive = Detector(), Drive()
        self.now_ns = self._read_ns = 0
        self.guard = SpeedGuard(
            limits, settings, 0.0, SafetyState(), longest_step_s=0.25,
            connection=lambda: ('ERROR', 'drive: gone') if self.drive.absent else ('OK', ''),
            silent_s=lambda: (self.now_ns - self._read_ns) / _SECOND_NS,
        )  # fmt: skip
        self.guard.command.profile = Profile.read(
            f'profile: [{{hold: {{speed_mps: {RUNNING}, duration_s: 100000}}}}]'
        )
        self.taken: list[tuple[int, float]] = []  # when, and which set points
        self.until(lambda: self.guard.target_mps == RUNNING or self._start())
        self.until(lambda: self.guard.interlock.cause == 'no reason to trip')

    def _start(self) -> bool:
        self.guard.start(self.now_ns)
        return False

    def until(self, done: Callable[[], object], most_s: float = 10.0) -> float:
        """Let time pass until something is so; return how long that was, s."""
        began_ns = self.now_ns
        while not done():
            passed_s = (self.now_ns - began_ns) / _SECOND_NS
            assert passed_s < most_s, self.told
            self._step()
        return (self.now_ns - began_ns) / _SECOND_NS

    def run(self, seconds: float) -> None:
        end_ns = self.now_ns + round(seconds * _SECOND_NS)
        self.until(lambda: self.now_ns >= end_ns, 2.0 * seconds)

    def _step(self) -> None:
        self.now_ns += _TICK_NS
        for message in self.detector.said(self.now_ns):
            self.guard.hear(self.now_ns, heard_of(message))
        if not self.drive.absent:
            if (speed_mps := self.guard.hand_over(self.drive)) is not None:
                self.taken.append((self.now_ns, speed_mps))
            if not self.drive.mute:
                self._read_ns = self.now_ns
                speeds = np.array([self.drive.speed_mps])
                block = DriveBlock(np.array([self.now_ns]), np.array([math.nan]), speeds)
                self.guard.readings.take(self.now_ns / _SECOND_NS, block)
        self.guard.watch(self.now_ns, self.now_ns)
        if self.now_ns % (5 * _TICK_NS) == 0:
            self.guard.decide(self.now_ns, self.now_ns, True)

    @property
    def told(self) -> tuple[str, str]:
        """What the operator is told: level and words."""
        return self.guard.present()


@dataclass(frozen=True)
class Fault:
    """One row; `words` are in the cause, `also` in what the operator is told after a while."""

    what: str
    begin: Callable[[Bench], object]
    state: str = 'tripped'
    words: str = ''
    speed: float = SAFE
    mode: str = 'protect'
    also: str = ''


def publish(rows: list[str]) -> None:
    """Put the rows in the place of those of the page."""
    before, _, table = PAGE.read_text(encoding='utf-8').partition(_HEAD)
    after = itertools.dropwhile(lambda line: line.startswith('|'), table.splitlines()[1:])
    lines = [_HEAD, '|---|---|---|---|---|', *rows, *after]
    PAGE.write_text(before + '\n'.join(lines) + '\n', encoding='utf-8')


def _set(**values: object) -> Callable[[Bench], None]:
    """Change attributes of the detector, or of the drive where it has them."""

    def begin(bench: Bench) -> None:
        for name, value in values.items():
            setattr(bench.detector if hasattr(bench.detector, name) else bench.drive, name, value)

    return begin


def _say(**numbers: object) -> Callable[[Bench], None]:
    return lambda bench: bench.detector.numbers.update(numbers)


def _withdraw(bench: Bench) -> None:
    bench.detector.numbers['v_n_mps'] = math.nan
    bench.until(lambda: bench.guard.interlock.safe_speed_mps() == 0.0)
    bench.detector.level = 'ERROR'


def _disarmed(bench: Bench) -> None:
    bench.guard.arm(bench.now_ns, False)
    bench.detector.level = 'ERROR'


def _gone_and_back(bench: Bench) -> None:
    bench.drive.absent = True
    bench.until(lambda: bench.guard.interlock.state == 'tripped')
    bench.drive.absent = False


FAULTS = [
    Fault('the detector ends', _set(silent=True), words='silent for'),
    Fault('its statuses come late, from now on', _set(delay_s=1.0), words='silent for'),
    Fault('every third status is lost', _set(lose_every=3), 'armed', speed=RUNNING),
    Fault('it answers and judges nothing new', _set(frozen=True), words='nothing new'),
    Fault('its statuses fall behind more and more', _set(falls_behind_s=0.04), words='late'),
    Fault('its clock is set ahead by an hour', _set(clock_s=3600.0), 'armed', speed=RUNNING),
    Fault('its clock is set back by an hour', _set(clock_s=-3600.0), 'armed', speed=RUNNING),
    Fault('a sensor is lost (STALE)', _set(level='STALE'), words='its inputs'),
    Fault('a sensor is lost (STALE)', _set(level='STALE'), words='its inputs', mode='measure'),
    Fault('hunting (ERROR)', _set(level='ERROR'), words='says ERROR: its reasons', speed=0.0),
    Fault('hunting (ERROR)', _set(level='ERROR'), 'armed', speed=RUNNING, mode='measure'),
    Fault('a warning (WARN)', _set(level='WARN'), 'armed', speed=RUNNING),
    Fault(
        'the amplitude is above the limit',
        _say(amplitude_m=2e-3),
        words='2.000 mm above',
        speed=0.0,
    ),
    Fault('the amplitude is above the limit', _say(amplitude_m=2e-3), speed=0.0, mode='measure'),
    Fault(
        'the second estimate is above it', _say(envelope_m=2e-3), words='2.000 mm above', speed=0.0
    ),
    Fault('the amplitude is infinite', _say(amplitude_m=float('inf')), words='inf mm', speed=0.0),
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
        _set(obeys=False, level='ERROR'),
        words='ERROR',
        also='hard-wired stop',
    ),
    Fault(
        'the roller runs at three times its set point',
        _set(scale=3.0),
        words='18.00 m/s, above the ceiling, 8.00 m/s',
        speed=0.0,
        mode='measure',
        also='hard-wired stop',
    ),
    Fault(
        'the roller does not follow its set point',
        _set(obeys=False, speed_mps=3.0),
        words='does not follow its set point, 6.00 m/s',
        speed=0.0,
        mode='measure',
        also='hard-wired stop',
    ),
    Fault('hunting, while the interlock is disarmed', _disarmed, 'disarmed', 'disarmed', RUNNING),
]


@pytest.mark.parametrize('fault', FAULTS, ids=lambda fault: f'{fault.what}, {fault.mode}')
def test_a_fault_ends_as_the_table_says(fault: Fault) -> None:
    assert f'{_suffer(fault)}\n' in PAGE.read_text(encoding='utf-8'), 'make faults'


def test_hunting_at_a_speed_that_a_wrong_form_calls_safe_is_driven_down_until_it_dies() -> None:
    """The form says v_n 9.6; the wheelset hunts above 3 m/s, and dies out below."""
    bench = Bench('protect')
    bench.detector.numbers |= {'v_n_mps': 9.6, 'noise_floor_m': 1e-5}
    bench.run(0.2)

    def quiet() -> bool:
        bench.detector.level = 'ERROR' if bench.drive.speed_mps > 3.0 else 'WARN'
        return bench.drive.speed_mps <= 3.0

    bench.until(quiet)
    bench.run(1.0)
    assert 1.0 < bench.drive.speed_mps <= 3.0, 'where it is quiet the roller stays'
    speeds = [speed for _, speed in bench.taken]
    assert speeds[speeds.index(RUNNING) :] == sorted(speeds[speeds.index(RUNNING) :], reverse=True)


def _suffer(fault: Fault) -> str:
    """Let a fault happen, and return its row of the table."""
    bench = Bench(fault.mode)
    interlock, began_ns = bench.guard.interlock, bench.now_ns
    fault.begin(bench)
    if fault.state == 'tripped':
        bench.until(lambda: interlock.state == 'tripped')
    else:
        bench.run(1.0)
    assert interlock.state == fault.state
    assert fault.words in interlock.cause
    if not (bench.drive.refusal or bench.drive.absent):
        bench.until(lambda: bench.guard.target_mps == fault.speed)
    bench.until(lambda: fault.also in bench.told[1])
    level, words = bench.told
    assert level == {'tripped': 'ERROR', 'disarmed': 'WARN', 'armed': 'OK'}[fault.state]
    lower = [at for at, speed in bench.taken if at > began_ns and speed < RUNNING]
    slow = f'{(lower[0] - began_ns) / _SECOND_NS:.2f}' if lower else '-'
    ends = f'{fault.state}, {fault.speed:g} m/s'
    return f'| {fault.what} | {fault.mode} | {ends} | {slow} | {words} |'


if __name__ == '__main__':
    publish([_suffer(fault) for fault in FAULTS])
