"""
Modbus devices, TCP or RTU: an analog input as a sensor, a drive (extra `modbus`).

One transaction at a time: whoever calls from another thread waits for the one under way. A device
that is busy, and an answer that is lost, are asked for again on the open connection.

A device is polled on a grid of the steady clock. It samples when it answers: a sample's stamp is
the time of the request and half the shortest recent round trip, whenever the answer was read.
"""

from __future__ import annotations

import logging
import math
import struct
import threading
import time
from collections import deque
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from hunt_ros.drivers.base import DriveBlock, DriveDriver, Driver, SensorBlock, SensorDriver
from hunt_ros.drivers.sample_clock import Counter, host_less_steady_ns
from hunt_ros.errors import ConfigError, DriverError, RefusedError
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import Settings, setting

#: Format of a number -> (code of `struct`, registers).
FORMATS: dict[str, tuple[str, int]] = {
    'int16': ('h', 1),
    'uint16': ('H', 1),
    'int32': ('i', 2),
    'uint32': ('I', 2),
    'float32': ('f', 2),
}
#: What the protocol calls them (Modbus Application Protocol V1.1b3, section 7); after those of
#: `_BUSY` the same question is asked again.
_REFUSALS = {2: 'illegal data address', 3: 'illegal data value', 5: 'not yet', 6: 'device busy'}
_BUSY = (5, 6)
#: Call of pymodbus -> function of the protocol.
_FUNCTIONS = {
    'read_holding_registers': 3,
    'read_input_registers': 4,
    'write_coil': 5,
    'write_register': 6,
    'write_registers': 16,
}
#: For so long a device may be busy, and so long may a repeated question take, s: a gap of 0.3 s is
#: silence to the detector. It is asked again so often, s.
_BUDGET_S, _AGAIN_S = 0.1, 0.01
#: Time to connect, s.
_CONNECT_S = 1.0
_NONE = -1
#: Round trips among which the shortest is looked for.
_ROUND_TRIPS = 64
#: A set point that is none of the last ones (20 are a second, and a drive may show one of them) is
#: another master's where it is read back so often in a row.
_CONTRARY, _WRITTEN = 2, 20
#: The speed is the slope of the angle over so long, s.
_SLOPE_S = 0.1

_address = partial(setting, low=0, high=65535)
_kind = partial(setting, choices=('input', 'holding'))
_format = partial(setting, choices=tuple(FORMATS))
_word_order = partial(
    setting,
    'big',
    'Which word of a number of 32 bits comes first: that of higher value or of lower.',
    choices=('big', 'little'),
)
_patience = partial(
    setting,
    0.1,
    'An answer that takes longer is none; up to 0.1 s the question is repeated once.',
    unit='s',
    low=0.01,
)


@dataclass(frozen=True)
class ModbusBus(Settings):
    """Where a Modbus device is."""

    bus: str = setting('tcp', 'tcp: host and port; rtu: serial_port.', choices=('tcp', 'rtu'))
    host: str = setting('127.0.0.1', 'Address of the device or gateway (tcp).')
    port: int = setting(502, 'TCP port (tcp).', low=1, high=65535)
    serial_port: str = setting('/dev/ttyUSB0', 'Serial port (rtu).')
    baud_rate: int = setting(19200, 'Bits a second (rtu).', unit='1/s', low=300, high=4_000_000)
    parity: str = setting('E', 'Parity (rtu).', choices=('N', 'E', 'O'))
    device_id: int = setting(1, 'Number of the device on the bus.', low=0, high=247)
    timeout_s: float = _patience(high=10.0)

    def __str__(self) -> str:
        where = f'{self.host}:{self.port}' if self.bus == 'tcp' else self.serial_port
        return f'modbus {self.bus} {where} device {self.device_id}'


@dataclass(frozen=True)
class ModbusSensor(ModbusBus):
    """A number that a Modbus device measures."""

    register: int = _address(0, 'Address of the reading, as on the bus (from 0).')
    register_kind: str = _kind('input', 'Kind of the register.')
    register_format: str = _format('int16', 'Format of the reading.')
    word_order: str = _word_order()


@dataclass(frozen=True)
class ModbusDrive(ModbusBus):
    """A drive with a set point and readings in registers."""

    timeout_s: float = _patience(high=0.5)
    speed_register: int = _address(0, 'Holding register of the set point.')
    speed_format: str = _format('int16', 'Format of the set point.')
    speed_scale_mps: float = setting(
        0.01,
        'Running speed = number * this; negative where the drive counts the other way.',
        unit='m/s',
    )
    word_order: str = _word_order()
    actual_register: int = _address(_NONE, 'Address of the actual speed; -1: none.', low=_NONE)
    actual_kind: str = _kind('input', 'Kind of that register.')
    actual_format: str = _format('int16', 'Format of the actual speed.')
    actual_scale_mps: float = setting(0.01, 'As speed_scale_mps.', unit='m/s')
    encoder_register: int = _address(
        _NONE, "Address of the roller's encoder counter; -1: none.", low=_NONE
    )
    encoder_kind: str = _kind('input', 'Kind of that register.')
    encoder_format: str = setting(
        'uint32', 'Format of the counter, which wraps around.', choices=('uint16', 'uint32')
    )
    encoder_counts_per_turn: float = setting(
        4096.0, 'Counts a turn of the roller; negative where it counts down running forward.'
    )
    poll_hz: float = setting(100.0, 'Readings a second.', unit='Hz', low=1.0, high=1000.0)


class _BusyError(RefusedError):
    """A device that is busy for longer than may be waited."""


class Register(NamedTuple):
    """
    A number in one register or two.

    `kind` is 'input' or 'holding', `format` one of `FORMATS`, `word_order` 'big' (the word of
    higher value first, as the standard has it) or 'little'.
    """

    address: int
    kind: str
    format: str
    word_order: str

    @property
    def words(self) -> int:
        """Registers that the number takes."""
        return FORMATS[self.format][1]

    def decode(self, words: list[int]) -> float:
        """Return the number that the registers hold."""
        words = words[::-1] if self.word_order == 'little' else words
        data = struct.pack(f'>{len(words)}H', *words)
        return float(struct.unpack('>' + FORMATS[self.format][0], data)[0])

    def encode(self, value: float) -> list[int]:
        """Return the words of a number; raises DriverError if it does not fit."""
        code, count = FORMATS[self.format]
        try:
            data = struct.pack('>' + code, value if code == 'f' else round(value))
        except (struct.error, OverflowError, ValueError) as error:
            raise DriverError(f'{self}: {value:g} does not fit {self.format}') from error
        if not math.isfinite(value):
            raise DriverError(f'{self}: {value:g} is not finite')
        words = list(struct.unpack(f'>{count}H', data))
        return words[::-1] if self.word_order == 'little' else words

    def __str__(self) -> str:
        return f'{self.kind} register {self.address}'


class ModbusLink:
    """
    A connection to one device.

    Parameters
    ----------
    bus : ModbusBus
        Where it is.
    """

    def __init__(self, bus: ModbusBus) -> None:
        self._bus = bus
        self._client: Any = None
        self._lock = threading.Lock()
        self._clear_s = 0.0  # before this an answer to an earlier question may come (rtu)
        self._trips_ns: deque[int] = deque(maxlen=_ROUND_TRIPS)

    def open(self) -> None:
        """
        Connect.

        Raises
        ------
        ImportError
            If pymodbus is not installed.
        RefusedError
            If nobody answers there: no device starts together with the nodes.
        """
        from pymodbus.client import ModbusSerialClient, ModbusTcpClient

        # What it logs is said by our errors; without a handler it goes to standard error.
        logging.getLogger('pymodbus').addHandler(logging.NullHandler())
        bus = self._bus
        client: Any
        again = int(bus.timeout_s <= _BUDGET_S)
        if bus.bus == 'tcp':
            patience_s = max(_CONNECT_S, bus.timeout_s)
            client = ModbusTcpClient(bus.host, port=bus.port, timeout=patience_s, retries=again)
        else:
            client = ModbusSerialClient(
                bus.serial_port,
                baudrate=bus.baud_rate,
                parity=bus.parity,
                timeout=bus.timeout_s,
                retries=again,
            )
        with self._lock:
            if not client.connect():
                raise RefusedError(f'{bus}: cannot connect')
            client.comm_params.timeout_connect = bus.timeout_s  # from now on that of an answer
            self._client, self._clear_s = client, 0.0
            self._trips_ns.clear()

    def close(self) -> None:
        """Disconnect; a transaction under way in another thread ends first."""
        with self._lock:
            client, self._client = self._client, None
            if client is not None:
                client.close()

    def read(self, register: Register) -> list[int]:
        """Return the words of a register; raises DriverError where there is no such answer."""
        call = f'read_{register.kind}_registers'
        response = self._transact(call, str(register), register.address, count=register.words)
        return list(response.registers)

    def poll(self, register: Register) -> tuple[int, float]:
        """Return when a number was sampled, ns on the steady clock, and the number."""
        asked_ns = time.monotonic_ns()
        words = self.read(register)
        self._trips_ns.append(time.monotonic_ns() - asked_ns)
        return asked_ns + min(self._trips_ns) // 2, register.decode(words)

    def write(self, register: Register, value: float) -> list[int]:
        """Write a number, and return its words; raises DriverError if it is not taken."""
        words = register.encode(value)
        one = len(words) == 1
        call, data = ('write_register', words[0]) if one else ('write_registers', words)
        self._transact(call, f'{register} = {value:g}', register.address, data)
        return words

    def write_coil(self, address: int, on: bool) -> None:
        """Switch a coil; raises DriverError if that is not taken."""
        self._transact('write_coil', f'coil {address}', address, on)

    def _transact(self, call: str, what: str, *arguments: Any, **options: Any) -> Any:
        from pymodbus.exceptions import ModbusException

        bus, began_s = self._bus, time.monotonic()
        with self._lock:
            while True:
                if self._client is None:
                    raise DriverError(f'{bus}: not open')
                try:
                    response = self._ask(call, *arguments, **options)
                except (ModbusException, OSError) as error:
                    self._clear_s = time.monotonic() + bus.timeout_s
                    text = ' '.join(str(error).split())
                    raise DriverError(f'{bus}: {what}: no answer ({text})') from error
                if not response.isError():
                    return response
                code = getattr(response, 'exception_code', 0)
                if code not in _BUSY or time.monotonic() - began_s > _BUDGET_S:
                    reason = _REFUSALS.get(code, f'exception {code}')
                    kind = _BusyError if code in _BUSY else RefusedError
                    raise kind(f'{bus}: {what}: {reason}')
                time.sleep(_AGAIN_S)

    def _ask(self, call: str, *arguments: Any, **options: Any) -> Any:
        """
        Send one question, and return the answer to it and no other.

        Frames on a serial bus have no number: what comes late is the answer to an earlier one.
        To the same question it is as good; before another one the line has to be clear.
        """
        from pymodbus.exceptions import ModbusIOException

        if self._bus.bus == 'rtu':
            time.sleep(max(0.0, self._clear_s - time.monotonic()))
        response = getattr(self._client, call)(
            *arguments, **options, device_id=self._bus.device_id
        )
        code, count = _FUNCTIONS[call], options.get('count')
        other = response.function_code & 0x7F != code
        if other or (count and not response.isError() and len(response.registers) != count):
            raise ModbusIOException(f'an answer to another question, function {code} expected')
        return response


class _Polled(Driver):
    """A device of which some registers are read at evenly spaced moments of the steady clock."""

    settings: ModbusBus

    def _use(self, rate_hz: float, *registers: Register) -> None:
        """Make the link; nothing is opened yet."""
        self._link, self._registers = ModbusLink(self.settings), registers
        self._step_ns, self._closed = NANOSECONDS / rate_hz, threading.Event()

    def open(self) -> None:
        """Connect; raises DriverError where that fails."""
        self._closed.clear()
        self._link.open()
        self._begin_ns, self._due = time.monotonic_ns(), 0

    def _wait(self, timeout_s: float) -> int | None:
        """Return how many moments were missed; None where the next is not due in time."""
        now_ns = time.monotonic_ns()
        missed = max(0, math.floor((now_ns - self._begin_ns) / self._step_ns) - self._due)
        due_ns = self._begin_ns + (self._due + missed) * self._step_ns
        wait_s = max(0.0, (due_ns - now_ns) / NANOSECONDS)
        if self._closed.wait(min(wait_s, timeout_s)) or wait_s > timeout_s:
            return None
        self._due += missed + 1
        return missed

    def close(self) -> None:
        """Disconnect; a wait under way in another thread ends."""
        self._closed.set()
        self._link.close()


class Sensor(_Polled, SensorDriver):
    """An analog input module, polled at the rate that the node expects."""

    Settings = ModbusSensor
    settings: ModbusSensor

    def __init__(self, settings: ModbusSensor, channel: str, rate_hz: float) -> None:
        super().__init__(settings, channel, rate_hz)
        kind, order = settings.register_kind, settings.word_order
        self._use(rate_hz, Register(settings.register, kind, settings.register_format, order))

    def read(self, timeout_s: float) -> SensorBlock:
        """Poll once; raises DriverError when the device is lost or refuses."""
        missed = self._wait(timeout_s)
        if missed is None:
            return SensorBlock()
        sampled_ns, number = self._link.poll(*self._registers)
        stamps_ns = np.array([sampled_ns + host_less_steady_ns()])
        return SensorBlock(stamps_ns, np.array([number]), missed)


class Drive(_Polled, DriveDriver):
    """A drive's set point, and its actual speed, its encoder, or both."""

    Settings = ModbusDrive
    settings: ModbusDrive

    def __init__(self, settings: ModbusDrive, roller_diameter_m: float) -> None:
        super().__init__(settings, roller_diameter_m)
        actual, encoder = settings.actual_register, settings.encoder_register
        if actual == encoder == _NONE:
            raise ConfigError(
                f'{settings}: neither actual_register nor encoder_register is given: expected one'
                ' that tells how fast the roller runs'
            )
        for name in ('speed_scale_mps', 'actual_scale_mps', 'encoder_counts_per_turn'):
            value = getattr(settings, name)
            if value == 0.0 or not math.isfinite(value):
                raise ConfigError(
                    f'{settings}: {name}: {value:g}, expected a finite number that is not 0'
                )
        order = settings.word_order
        self._target = Register(settings.speed_register, 'holding', settings.speed_format, order)
        self._actual = Register(actual, settings.actual_kind, settings.actual_format, order)
        self._encoder = Register(encoder, settings.encoder_kind, settings.encoder_format, order)
        given = [each for each in (self._encoder, self._actual) if each.address != _NONE]
        self._use(settings.poll_hz, *given)
        self._counter = Counter(16 * self._encoder.words)
        self._angles: deque[tuple[int, float]] = deque()
        self._written: deque[list[int]] = deque(maxlen=_WRITTEN)
        self._contrary, self._foreign_mps = 0, math.nan

    def read(self, timeout_s: float) -> DriveBlock:
        """Poll once; raises DriverError when the drive is lost or refuses."""
        if self._wait(timeout_s) is None:
            return DriveBlock()
        sampled_ns, angle_rad, speed_mps = 0, math.nan, math.nan
        if self._actual in self._registers:
            sampled_ns, number = self._link.poll(self._actual)
            speed_mps = number * self.settings.actual_scale_mps
        if self._encoder in self._registers:
            sampled_ns, number = self._link.poll(self._encoder)
            count = self._counter.unwrap(round(number))
            angle_rad = 2.0 * math.pi * count / self.settings.encoder_counts_per_turn
            if self._actual not in self._registers:
                # On the steady clock: that of the host may be set.
                speed_mps = self._slope_mps(sampled_ns, angle_rad)
                if math.isnan(speed_mps):
                    return DriveBlock()
        stamps_ns = np.array([sampled_ns + host_less_steady_ns()])
        angles, speeds = np.array([angle_rad]), np.array([speed_mps])
        return DriveBlock(stamps_ns, angles, speeds, self._foreign_mps)

    def set_speed(self, speed_mps: float) -> None:
        """Write the set point; raises DriverError if it does not fit or is not taken."""
        number = speed_mps / self.settings.speed_scale_mps
        self._read_back()
        self._written.append(self._target.encode(number))  # also one that is not answered
        self._link.write(self._target, number)

    def _read_back(self) -> None:
        """
        Look whether the drive still holds a set point of this driver.

        To be done before another one is written: right after it, what a second master at the same
        pace writes is not to be seen.
        """
        if not self._written:
            return
        try:
            held = self._link.read(self._target)
        except DriverError as error:  # nothing of it holds the new one up
            if isinstance(error, RefusedError) and not isinstance(error, _BusyError):
                self._written = deque(maxlen=0)  # a register that can only be written
            return
        self._contrary = 0 if held in self._written else self._contrary + 1
        number = self._target.decode(held) * self.settings.speed_scale_mps
        self._foreign_mps = number if self._contrary >= _CONTRARY else math.nan

    def _slope_mps(self, sampled_ns: int, angle_rad: float) -> float:
        """Return the slope of the angle over the last moments; NaN at the first reading."""
        self._angles.append((sampled_ns, angle_rad))
        while sampled_ns - self._angles[0][0] > _SLOPE_S * NANOSECONDS and len(self._angles) > 2:
            self._angles.popleft()
        first_ns, first_rad = self._angles[0]
        if sampled_ns <= first_ns:
            return math.nan
        rate = (angle_rad - first_rad) / ((sampled_ns - first_ns) / NANOSECONDS)
        return 0.5 * rate * self.roller_diameter_m
