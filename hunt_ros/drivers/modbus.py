"""
Modbus devices: an analog input or an encoder counter as a sensor, a drive with its registers.

A device is polled on a grid of the steady clock. It samples when it answers: a sample's stamp is
the time of the request and half the shortest recent round trip, whenever the answer was read.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from dataclasses import dataclass

import numpy as np

from hunt_ros.drivers.base import DriveBlock, DriveDriver, SensorBlock, SensorDriver
from hunt_ros.drivers.modbus_link import (
    FORMATS,
    ModbusBus,
    ModbusLink,
    Register,
)
from hunt_ros.drivers.sample_clock import Counter, host_less_steady_ns
from hunt_ros.errors import ConfigError, RefusedError
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import setting

_WORD_ORDER = 'Which word of a number of 32 bits comes first: that of higher value or of lower.'
_NONE = -1
#: Round trips among which the shortest is looked for.
_ROUND_TRIPS = 64
#: The set point is read back so often, s; another one so often in a row is that of another master.
#: A drive may show one of the last ones (20 are a second).
_LOOK_S, _CONTRARY, _WRITTEN = 0.1, 2, 20
#: The speed is the slope of the angle over so long, s.
_SLOPE_S = 0.1


@dataclass(frozen=True)
class ModbusSensor(ModbusBus):
    """A number that a Modbus device measures."""

    register: int = setting(
        0, 'Address of the reading, as on the bus (from 0).', low=0, high=65535, fixed=True
    )
    register_kind: str = setting(
        'input', 'Kind of the register.', choices=('input', 'holding'), fixed=True
    )
    register_format: str = setting(
        'int16', 'Format of the reading.', choices=tuple(FORMATS), fixed=True
    )
    word_order: str = setting('big', _WORD_ORDER, choices=('big', 'little'), fixed=True)
    scale: float = setting(
        1.0, 'Reading = number in the register * scale (V, mm or SI for a count).', fixed=True
    )
    counter: bool = setting(
        False, 'The register is a counter (an encoder): it wraps around.', fixed=True
    )


@dataclass(frozen=True)
class ModbusDrive(ModbusBus):
    """A drive with a set point and readings in registers."""

    timeout_s: float = setting(
        0.1,
        'An answer that takes longer is none; up to 0.1 s the question is repeated once.',
        unit='s',
        low=0.01,
        high=0.5,
        fixed=True,
    )

    speed_register: int = setting(
        0, 'Holding register of the set point.', low=0, high=65535, fixed=True
    )
    speed_format: str = setting(
        'int16', 'Format of the set point.', choices=tuple(FORMATS), fixed=True
    )
    speed_scale_mps: float = setting(
        0.01,
        'Running speed = number * this; negative where the drive counts the other way.',
        unit='m/s',
        fixed=True,
    )
    word_order: str = setting('big', _WORD_ORDER, choices=('big', 'little'), fixed=True)
    actual_register: int = setting(
        _NONE, 'Address of the actual speed; -1: none.', low=-1, high=65535, fixed=True
    )
    actual_kind: str = setting(
        'input', 'Kind of that register.', choices=('input', 'holding'), fixed=True
    )
    actual_format: str = setting(
        'int16', 'Format of the actual speed.', choices=tuple(FORMATS), fixed=True
    )
    actual_scale_mps: float = setting(0.01, 'As speed_scale_mps.', unit='m/s', fixed=True)
    encoder_register: int = setting(
        _NONE, "Address of the roller's encoder counter; -1: none.", low=-1, high=65535, fixed=True
    )
    encoder_kind: str = setting(
        'input', 'Kind of that register.', choices=('input', 'holding'), fixed=True
    )
    encoder_format: str = setting(
        'uint32',
        'Format of the counter, which wraps around.',
        choices=('uint16', 'uint32'),
        fixed=True,
    )
    encoder_counts_per_turn: float = setting(
        4096.0,
        'Counts a turn of the roller; negative where it counts down running forward.',
        fixed=True,
    )
    poll_hz: float = setting(
        100.0, 'Readings a second.', unit='Hz', low=1.0, high=1000.0, fixed=True
    )


class _Pace:
    """Waits for the next of evenly spaced moments on the steady clock."""

    def __init__(self, rate_hz: float) -> None:
        self._step_ns = NANOSECONDS / rate_hz
        self._begin_ns = time.monotonic_ns()
        self._due = 0
        self._ended = threading.Event()

    def wait(self, timeout_s: float) -> int | None:
        """Return how many moments were missed; None where the next is not due in time."""
        now_ns = time.monotonic_ns()
        missed = max(0, math.floor((now_ns - self._begin_ns) / self._step_ns) - self._due)
        due_ns = self._begin_ns + (self._due + missed) * self._step_ns
        wait_s = max(0.0, (due_ns - now_ns) / NANOSECONDS)
        if self._ended.wait(min(wait_s, timeout_s)) or wait_s > timeout_s:
            return None
        self._due += missed + 1
        return missed

    def end(self) -> None:
        """End a wait under way in another thread."""
        self._ended.set()


class _Poll:
    """Reads a number of a device whose link is open, and says when it took it."""

    def __init__(self, link: ModbusLink, register: Register) -> None:
        self._link, self._register = link, register
        self._trips_ns: deque[int] = deque(maxlen=_ROUND_TRIPS)
        self.sampled_ns = 0  # steady clock

    def __call__(self) -> tuple[int, float]:
        """Return stamp, ns on the host's clock, and number."""
        asked_ns = time.monotonic_ns()
        number = self._link.read_number(self._register)
        self._trips_ns.append(time.monotonic_ns() - asked_ns)
        self.sampled_ns = asked_ns + min(self._trips_ns) // 2
        return self.sampled_ns + host_less_steady_ns(), number


class Sensor(SensorDriver):
    """An analog input module or an encoder counter, polled at the rate that the node expects."""

    Settings = ModbusSensor
    settings: ModbusSensor

    def __init__(self, settings: ModbusSensor, channel: str, rate_hz: float) -> None:
        super().__init__(settings, channel, rate_hz)
        kind, order = settings.register_kind, settings.word_order
        self._reading = Register(settings.register, kind, settings.register_format, order)
        if settings.counter and settings.register_format == 'float32':
            raise ConfigError(f'{settings}: register_format: a counter is no float32')
        _check_scale(settings, 'scale', settings.scale)
        self._link = ModbusLink(settings)
        self._pace = _Pace(rate_hz)

    def open(self) -> None:
        """Connect, and read once; raises DriverError where that fails."""
        self._link.open()
        self._poll = _Poll(self._link, self._reading)
        self._counter = Counter(16 * self._reading.words) if self.settings.counter else None
        self._poll()
        self._pace = _Pace(self.rate_hz)

    def read(self, timeout_s: float) -> SensorBlock:
        """Poll once; raises DriverError when the device is lost or refuses."""
        missed = self._pace.wait(timeout_s)
        if missed is None:
            return SensorBlock()
        stamp_ns, number = self._poll()
        if self._counter is not None:
            number = float(self._counter.unwrap([round(number)])[0])
        return SensorBlock(np.array([stamp_ns]), np.array([number * self.settings.scale]), missed)

    def close(self) -> None:
        """Disconnect."""
        self._pace.end()
        self._link.close()

    def __str__(self) -> str:
        return str(self.settings)


class Drive(DriveDriver):
    """A drive's set point, and its actual speed, its encoder, or both."""

    Settings = ModbusDrive
    settings: ModbusDrive

    def __init__(self, settings: ModbusDrive, roller_diameter_m: float) -> None:
        super().__init__(settings, roller_diameter_m)
        if settings.actual_register == _NONE and settings.encoder_register == _NONE:
            raise ConfigError(
                f'{settings}: neither actual_register nor encoder_register is given: expected one'
                ' that tells how fast the roller runs'
            )
        for name in ('speed_scale_mps', 'actual_scale_mps', 'encoder_counts_per_turn'):
            _check_scale(settings, name, getattr(settings, name))
        order = settings.word_order
        self._target = Register(settings.speed_register, 'holding', settings.speed_format, order)
        self._actual = Register(
            settings.actual_register, settings.actual_kind, settings.actual_format, order
        )
        self._encoder = Register(
            settings.encoder_register, settings.encoder_kind, settings.encoder_format, order
        )
        self._link = ModbusLink(settings)
        self._pace = _Pace(settings.poll_hz)

    def open(self) -> None:
        """Connect, and read once; raises DriverError where that fails."""
        self._link.open()
        registers = (self._encoder, self._actual)
        self._polls = {r: _Poll(self._link, r) for r in registers if r.address != _NONE}
        self._counter = Counter(16 * self._encoder.words)
        self._angles: deque[tuple[int, float]] = deque()
        self._written: deque[list[int]] = deque(maxlen=_WRITTEN)
        self._looked_s, self._contrary, self._foreign_mps = -math.inf, 0, math.nan
        for poll in self._polls.values():
            poll()
        self._pace = _Pace(self.settings.poll_hz)

    def read(self, timeout_s: float) -> DriveBlock:
        """Poll once; raises DriverError when the drive is lost or refuses."""
        if self._pace.wait(timeout_s) is None:
            return DriveBlock()
        stamp_ns, angle_rad, speed_mps = 0, math.nan, math.nan
        if self._actual in self._polls:
            stamp_ns, number = self._polls[self._actual]()
            speed_mps = number * self.settings.actual_scale_mps
        if self._encoder in self._polls:
            stamp_ns, number = self._polls[self._encoder]()
            turns = self._counter.unwrap([round(number)])[0]
            angle_rad = 2.0 * math.pi * float(turns) / self.settings.encoder_counts_per_turn
            if self._actual not in self._polls:
                # On the steady clock: that of the host may be set.
                sampled_ns = self._polls[self._encoder].sampled_ns
                speed_mps = self._speed_mps(sampled_ns, angle_rad)
                if math.isnan(speed_mps):
                    return DriveBlock()
        self._read_back()
        return DriveBlock(
            np.array([stamp_ns]), np.array([angle_rad]), np.array([speed_mps]), self._foreign_mps
        )

    def set_speed(self, speed_mps: float) -> None:
        """Write the set point; raises DriverError if it does not fit or is not taken."""
        number = speed_mps / self.settings.speed_scale_mps
        self._written.append(self._target.encode(number))  # also one that is not answered
        self._link.write_number(self._target, number)

    def _read_back(self) -> None:
        """Look now and then whether the drive holds the set point that was written last."""
        now_s = time.monotonic()
        if not self._written or now_s - self._looked_s < _LOOK_S:
            return
        self._looked_s = now_s
        try:
            held = self._link.read('holding', self._target.address, self._target.words)
        except RefusedError:  # a register that can only be written
            self._written = deque(maxlen=0)
            return
        self._contrary = 0 if held in self._written else self._contrary + 1
        number = self._target.decode(held) * self.settings.speed_scale_mps
        self._foreign_mps = number if self._contrary >= _CONTRARY else math.nan

    def close(self) -> None:
        """Disconnect."""
        self._pace.end()
        self._link.close()

    def _speed_mps(self, stamp_ns: int, angle_rad: float) -> float:
        """Return the slope of the angle over the last moments; NaN at the first reading."""
        self._angles.append((stamp_ns, angle_rad))
        while stamp_ns - self._angles[0][0] > _SLOPE_S * NANOSECONDS and len(self._angles) > 2:
            self._angles.popleft()
        first_ns, first_rad = self._angles[0]
        if stamp_ns <= first_ns:
            return math.nan
        rate = (angle_rad - first_rad) / ((stamp_ns - first_ns) / NANOSECONDS)
        return 0.5 * rate * self.roller_diameter_m

    def __str__(self) -> str:
        return str(self.settings)


def _check_scale(settings: ModbusBus, name: str, value: float) -> None:
    if value == 0.0 or not math.isfinite(value):
        raise ConfigError(f'{settings}: {name}: {value:g}, expected a finite number that is not 0')
