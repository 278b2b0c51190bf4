"""
One Modbus device: its bus, TCP or RTU, and numbers in its registers (pymodbus, extra `modbus`).

One transaction at a time: whoever calls from another thread waits for the one under way. A device
that is busy, and an answer that is lost, are asked for again on the open connection.
"""

from __future__ import annotations

import logging
import math
import struct
import threading
import time
from dataclasses import dataclass
from typing import Any, NamedTuple

from hunt_ros.errors import ConfigError, DriverError, RefusedError
from hunt_ros.settings import Settings, setting

#: Format of a number -> (code of `struct`, registers).
FORMATS: dict[str, tuple[str, int]] = {
    'int16': ('h', 1),
    'uint16': ('H', 1),
    'int32': ('i', 2),
    'uint32': ('I', 2),
    'float32': ('f', 2),
}
#: What the protocol calls them (Modbus Application Protocol V1.1b3, section 7).
_REFUSALS = {
    1: 'illegal function',
    2: 'illegal data address',
    3: 'illegal data value',
    4: 'device failure',
    5: 'acknowledged, but not done yet',
    6: 'device busy',
    8: 'memory parity error',
    10: 'gateway has no path',
    11: 'no answer behind the gateway',
}
#: Call of pymodbus -> function of the protocol.
_FUNCTIONS = {
    'read_holding_registers': 3,
    'read_input_registers': 4,
    'write_coil': 5,
    'write_register': 6,
    'write_registers': 16,
}
#: Refusals after which the same question is asked again.
_BUSY = (5, 6)
#: For so long a device may be busy, and so long may a repeated question take, s: a gap of 0.3 s is
#: silence to the detector. It is asked again so often, s.
_BUDGET_S, _AGAIN_S = 0.1, 0.01
#: Time to connect, s.
_CONNECT_S = 1.0


@dataclass(frozen=True)
class ModbusBus(Settings):
    """Where a Modbus device is."""

    bus: str = setting(
        'tcp', 'tcp: host and port; rtu: serial_port.', choices=('tcp', 'rtu'), fixed=True
    )
    host: str = setting('127.0.0.1', 'Address of the device or gateway (tcp).', fixed=True)
    port: int = setting(502, 'TCP port (tcp).', low=1, high=65535, fixed=True)
    serial_port: str = setting('/dev/ttyUSB0', 'Serial port (rtu).', fixed=True)
    baud_rate: int = setting(
        19200, 'Bits a second (rtu).', unit='1/s', low=300, high=4_000_000, fixed=True
    )
    parity: str = setting('E', 'Parity (rtu).', choices=('N', 'E', 'O'), fixed=True)
    device_id: int = setting(1, 'Number of the device on the bus.', low=0, high=247, fixed=True)
    timeout_s: float = setting(
        0.1,
        'An answer that takes longer is none; up to 0.1 s the question is repeated once.',
        unit='s',
        low=0.01,
        high=10.0,
        fixed=True,
    )

    def __str__(self) -> str:
        where = f'{self.host}:{self.port}' if self.bus == 'tcp' else self.serial_port
        return f'modbus {self.bus} {where} device {self.device_id}'


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
        if self.word_order == 'little':
            words = words[::-1]
        (value,) = struct.unpack(
            '>' + FORMATS[self.format][0], struct.pack(f'>{len(words)}H', *words)
        )
        return float(value)

    def encode(self, value: float) -> list[int]:
        """
        Return the words of a number.

        Raises
        ------
        DriverError
            If it does not fit.
        """
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

    def open(self) -> None:
        """
        Connect.

        Raises
        ------
        ConfigError
            If pymodbus is not installed.
        DriverError
            If nobody answers there.
        """
        try:
            from pymodbus.client import ModbusSerialClient, ModbusTcpClient
        except ImportError as error:
            raise ConfigError(
                f"{self._bus}: pymodbus is not installed (pip install 'hunt_ros[modbus]')"
            ) from error
        # What it logs is said by our errors; without a handler it goes to standard error.
        logging.getLogger('pymodbus').addHandler(logging.NullHandler())
        bus = self._bus
        client: Any
        if bus.bus == 'tcp':
            patience_s = max(_CONNECT_S, bus.timeout_s)
            client = ModbusTcpClient(bus.host, port=bus.port, timeout=patience_s, retries=0)
        else:
            client = ModbusSerialClient(
                bus.serial_port,
                baudrate=bus.baud_rate,
                parity=bus.parity,
                timeout=bus.timeout_s,
                retries=0,
            )
        with self._lock:
            if not client.connect():
                raise DriverError(f'{bus}: cannot connect')
            client.comm_params.timeout_connect = bus.timeout_s  # from now on that of an answer
            self._client, self._clear_s = client, 0.0

    def close(self) -> None:
        """Disconnect; a transaction under way in another thread ends first."""
        with self._lock:
            client, self._client = self._client, None
            if client is not None:
                client.close()

    def read(self, kind: str, address: int, count: int) -> list[int]:
        """
        Read registers, each 0 to 65535.

        Raises
        ------
        DriverError
            If the device refuses, or does not answer.
        """
        call = f'read_{kind}_registers'
        response = self._transact(call, f'{kind} register {address}', address, count=count)
        return list(response.registers)

    def read_number(self, register: Register) -> float:
        """Read a number. Raises as `read`."""
        return register.decode(self.read(register.kind, register.address, register.words))

    def write_number(self, register: Register, value: float) -> None:
        """
        Write a number into holding registers.

        Raises
        ------
        DriverError
            If it does not fit, the device refuses, or does not answer.
        """
        words = register.encode(value)
        name = f'{register} = {value:g}'
        if len(words) == 1:
            self._transact('write_register', name, register.address, words[0])
        else:
            self._transact('write_registers', name, register.address, words)

    def write_coil(self, address: int, on: bool) -> None:
        """
        Switch a coil.

        Raises
        ------
        DriverError
            If the device refuses, or does not answer.
        """
        self._transact('write_coil', f'coil {address}', address, on)

    def _transact(self, call: str, what: str, *arguments: Any, **options: Any) -> Any:
        from pymodbus.exceptions import ModbusException, ModbusIOException

        bus, began_s, missed = self._bus, time.monotonic(), False
        with self._lock:
            while True:
                if self._client is None:
                    raise DriverError(f'{bus}: not open')
                try:
                    response = self._ask(missed, call, *arguments, **options)
                except (ModbusException, OSError) as error:
                    lost = isinstance(error, ModbusIOException)
                    self._clear_s = time.monotonic() + bus.timeout_s
                    if lost and not missed and bus.timeout_s <= _BUDGET_S:
                        missed = True
                        continue
                    text = ' '.join(str(error).split())
                    raise DriverError(f'{bus}: {what}: no answer ({text})') from error
                if not response.isError():
                    return response
                code = getattr(response, 'exception_code', 0)
                if code not in _BUSY or time.monotonic() - began_s > _BUDGET_S:
                    reason = _REFUSALS.get(code, f'exception {code}')
                    raise RefusedError(f'{bus}: {what}: {reason}')
                time.sleep(_AGAIN_S)

    def _ask(self, again: bool, call: str, *arguments: Any, **options: Any) -> Any:
        """
        Send one question, and return the answer to it and no other.

        Frames on a serial bus have no number: what comes late is the answer to an earlier one.
        To the same question it is as good; before another one the line has to be clear.
        """
        from pymodbus.exceptions import ModbusIOException

        if self._bus.bus == 'rtu':
            if not again:
                time.sleep(max(0.0, self._clear_s - time.monotonic()))
            if self._client.socket is not None:
                self._client.socket.reset_input_buffer()
        response = getattr(self._client, call)(
            *arguments, **options, device_id=self._bus.device_id
        )
        code = _FUNCTIONS[call]
        count = options.get('count')
        other = response.function_code & 0x7F != code
        if other or (count and not response.isError() and len(response.registers) != count):
            raise ModbusIOException(f'an answer to another question, function {code} expected')
        return response

    def __str__(self) -> str:
        return str(self._bus)
