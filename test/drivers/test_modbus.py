"""Modbus drivers against the real server of pymodbus, over TCP and over a serial line."""

from __future__ import annotations

import contextlib
import math
import socket
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.drivers.modbus import (
    FORMATS,
    Drive,
    ModbusBus,
    ModbusDrive,
    ModbusLink,
    ModbusSensor,
    Register,
    Sensor,
    _BusyError,
)
from hunt_ros.errors import DriverError, RefusedError

pytest.importorskip('pymodbus', reason='the extra modbus is not installed')


def _sensor(server, rate_hz: float = 200.0, **settings) -> Sensor:
    return Sensor(ModbusSensor(port=server.port, timeout_s=5.0, **settings), 'lateral', rate_hz)


def _drive(server, **settings) -> Drive:
    drive = Drive(ModbusDrive(port=server.port, timeout_s=0.5, **settings), 0.3)
    drive.open()
    return drive


def _link(slave, timeout_s: float = 5.0) -> ModbusLink:
    link = ModbusLink(ModbusBus(port=slave.port, timeout_s=timeout_s))
    link.open()
    return link


def _read(driver, machine):
    """Return the next block that is not empty."""
    deadline = machine.deadline(10.0)
    while True:
        block = driver.read(0.5)
        if block.stamps_ns.size:
            return block
        assert not deadline.passed


#: One input register.
SEVEN = Register(7, 'input', 'uint16', 'big')


@given(
    number=st.integers(-(2**31), 2**32 - 1),
    form=st.sampled_from(sorted(FORMATS)),
    order=st.sampled_from(['big', 'little']),
)
def test_a_number_is_written_as_it_is_read_or_refused(number, form, order) -> None:
    register = Register(7, 'holding', form, order)
    bits = 16 * register.words
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if form[0] == 'i' else (0, 2**bits - 1)
    if form == 'float32':
        assert register.decode(register.encode(number)) == np.float32(number)
    elif low <= number <= high:
        assert register.decode(register.encode(number)) == number
    else:
        with pytest.raises(DriverError, match=f'register 7: .* does not fit {form}'):
            register.encode(number)


def test_word_order_is_that_of_the_standard_unless_it_is_said_otherwise() -> None:
    assert Register(0, 'input', 'uint32', 'big').encode(0x0001_0002) == [1, 2]
    assert Register(0, 'input', 'uint32', 'little').encode(0x0001_0002) == [2, 1]


def test_an_analog_input_is_signed(modbus_server, machine) -> None:
    modbus_server.put(30, -1234)
    sensor = _sensor(modbus_server, register=30)
    sensor.open()
    before = time.time_ns()
    block = _read(sensor, machine)
    assert block.values.tolist() == [-1234.0]
    assert before - 1e9 < block.stamps_ns[0] < time.time_ns()
    sensor.close()


def test_polls_that_were_missed_are_counted(modbus_server, machine) -> None:
    sensor = _sensor(modbus_server, rate_hz=200.0)
    sensor.open()
    before_s = time.monotonic()
    _read(sensor, machine)
    time.sleep(0.2)
    block = sensor.read(0.5)
    passed_s = time.monotonic() - before_s
    assert 30 <= block.lost <= passed_s * 200.0 + 1.0
    sensor.close()


def test_a_drive_takes_its_set_point_and_tells_speed_and_angle(modbus_server, machine) -> None:
    modbus_server.put(50, -650)
    modbus_server.put(60, 65_536 - 250)
    drive = _drive(
        modbus_server,
        speed_register=40,
        speed_format='int32',
        speed_scale_mps=-0.001,
        word_order='little',
        actual_register=50,
        actual_scale_mps=-0.01,
        encoder_register=60,
        encoder_counts_per_turn=-1000.0,
        encoder_format='uint16',
    )
    drive.set_speed(7.25)
    assert modbus_server.written == [(40, [0xFFFF & -7250, 0xFFFF])]
    first = _read(drive, machine)
    assert first.speed_mps.tolist() == [6.5]
    modbus_server.put(60, 250)
    second = _read(drive, machine)
    assert second.angle_rad[0] - first.angle_rad[0] == pytest.approx(-math.pi)
    with pytest.raises(DriverError, match=r'holding register 40: .* does not fit int32'):
        drive.set_speed(1e9)
    with pytest.raises(DriverError, match='register 40'):
        drive.set_speed(math.nan)
    drive.close()


@pytest.mark.parametrize(
    ('settings', 'words'),
    [
        ({'register': 300}, 'input register 300: illegal data address'),
        ({'device_id': 9}, 'device 9: input register 0: '),
    ],
)
def test_a_bad_register_is_one_line(modbus_server, machine, settings, words) -> None:
    sensor = _sensor(modbus_server, **settings)
    sensor.open()
    with pytest.raises(DriverError, match=words):
        _read(sensor, machine)
    sensor.close()


def test_a_drive_that_cannot_be_read_takes_its_set_point(modbus_server, machine) -> None:
    drive = _drive(modbus_server, actual_register=300)
    drive.set_speed(4.5)
    assert modbus_server.written == [(0, [450])]
    with pytest.raises(DriverError, match='illegal data address'):
        _read(drive, machine)
    drive.close()


def test_a_device_that_is_not_there_is_one_line(machine) -> None:
    with socket.create_server(('127.0.0.1', 0)) as silent:
        port = silent.getsockname()[1]
        sensor = Sensor(ModbusSensor(port=port, timeout_s=0.05), 'lateral', 100.0)
        sensor.open()
        with pytest.raises(DriverError, match=rf':{port} device 1: input register 0: no answer'):
            _read(sensor, machine)
        sensor.close()
    missing = ModbusSensor(bus='rtu', serial_port='/dev/nowhere')
    with pytest.raises(DriverError, match='rtu /dev/nowhere device 1: cannot connect'):
        Sensor(missing, 'yaw', 100.0).open()


def test_a_device_on_a_serial_bus(modbus_rtu, machine) -> None:
    server, port = modbus_rtu
    bus = {'bus': 'rtu', 'serial_port': port, 'baud_rate': 115200, 'parity': 'N', 'timeout_s': 5.0}
    server.put(8, *Register(8, 'input', 'float32', 'big').encode(-2.5))
    sensor = Sensor(ModbusSensor(register=8, register_format='float32', **bus), 'yaw', 50.0)
    sensor.open()
    assert _read(sensor, machine).values.tolist() == [-2.5]
    link = ModbusLink(ModbusBus(**bus))
    with pytest.raises(DriverError, match='cannot connect'):
        link.open()  # the port is taken: never two on one device
    sensor.close()
    link.open()
    link.write_coil(3, True)
    assert server.written == [(3, [True])]
    link.close()


class _Slave:
    """
    A device at the far end of a TCP connection or a serial line, frame by frame.

    Parameters
    ----------
    answer : callable
        Gets the question (function and data) and returns its answer, and after how many seconds.
    port : str
        Serial line; empty: TCP.
    """

    def __init__(self, answer, port: str = '') -> None:
        self.questions: list[bytes] = []
        self.connections = 0
        self._answer, self._serial = answer, port
        if port:
            run = self._serve_rtu
        else:
            self._listener = socket.create_server(('127.0.0.1', 0))
            self.port = self._listener.getsockname()[1]
            run = self._serve_tcp
        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def _serve_tcp(self) -> None:
        while True:
            connection, _ = self._listener.accept()
            self.connections += 1
            threading.Thread(target=self._answer_tcp, args=(connection,), daemon=True).start()

    def _answer_tcp(self, connection: socket.socket) -> None:
        with connection:
            while len(head := connection.recv(7, socket.MSG_WAITALL)) == 7:
                body = connection.recv(int.from_bytes(head[4:6], 'big') - 1, socket.MSG_WAITALL)
                self.questions.append(body)
                answer, wait_s = self._answer(body)
                time.sleep(wait_s)
                if answer:
                    count = (len(answer) + 1).to_bytes(2, 'big')
                    connection.sendall(head[:4] + count + head[6:] + answer)

    def _serve_rtu(self) -> None:
        import serial
        from pymodbus.framer import FramerRTU

        with (
            contextlib.suppress(OSError, TypeError),  # the test is over
            serial.Serial(self._serial, 115200, timeout=None) as line,
        ):
            while True:
                body = line.read(8)[1:-2]
                self.questions.append(body)
                answer, wait_s = self._answer(body)
                time.sleep(wait_s)
                if answer:
                    frame = b'\x01' + answer
                    line.write(frame + FramerRTU.compute_CRC(frame).to_bytes(2, 'big'))


def _number(value: int) -> bytes:
    """Return the answer to a question for one input register."""
    return b'\x04\x02' + value.to_bytes(2, 'big')


def test_a_device_that_is_busy_is_asked_again_on_the_open_connection() -> None:
    answers = iter([b'\x84\x06', b'\x84\x05', _number(42)])
    slave = _Slave(lambda question: (next(answers), 0.0))
    link = _link(slave)
    assert link.read(SEVEN) == [42]
    assert (len(slave.questions), slave.connections) == (3, 1)
    link.close()
    always = _Slave(lambda question: (b'\x84\x06', 0.0))
    link = _link(always)
    with pytest.raises(RefusedError, match='register 7: device busy'):
        link.read(SEVEN)
    assert len(always.questions) > 1
    link.close()


def test_one_lost_answer_is_no_gap_and_a_second_one_is_an_error() -> None:
    answers = iter([b'', _number(42), b'', b''])
    slave = _Slave(lambda question: (next(answers, _number(1)), 0.0))
    link = _link(slave, 0.1)
    assert link.read(SEVEN) == [42]
    with pytest.raises(DriverError, match='register 7: no answer'):
        link.read(SEVEN)
    assert len(slave.questions) == 4
    assert link.read(SEVEN) == [1]
    assert slave.connections == 1
    link.close()


def test_a_late_answer_to_a_write_is_never_read_as_the_speed(serial_cable, machine) -> None:
    """A half-duplex slave that needs longer for a write than the master waits."""

    def answer(question: bytes) -> tuple[bytes, float]:
        held = b'\x03\x02\x00\x00' if question[0] == 3 else _number(880)
        return (question, 0.35) if question[0] == 6 else (held, 0.0)

    slave = _Slave(answer, serial_cable[0])
    drive = Drive(
        ModbusDrive(
            bus='rtu', serial_port=serial_cable[1], baud_rate=115200, parity='N',
            timeout_s=0.2, actual_register=50,
        ),
        0.3,
    )  # fmt: skip
    deadline, opened = machine.deadline(10.0), False
    while not (opened or deadline.passed):  # a busy machine answers late
        with contextlib.suppress(DriverError):
            drive.open()
            opened = True
    speeds = []
    for _ in range(3):
        with pytest.raises(DriverError, match='no answer'):
            drive.set_speed(0.0)
        with contextlib.suppress(DriverError):  # never a number that is another's
            speeds += drive.read(0.5).speed_mps.tolist()
    for _ in range(3):
        with contextlib.suppress(DriverError):
            speeds += drive.read(0.5).speed_mps.tolist()
    assert speeds
    assert set(speeds) == {8.8}
    assert slave.questions
    drive.close()


def test_an_answer_with_too_many_words_or_of_another_function_is_none() -> None:
    for wrong in (b'\x04\x04\x00\x01\x00\x02', b'\x03\x02\x00\x09'):
        slave = _Slave(lambda question, wrong=wrong: (wrong, 0.0))
        link = _link(slave, 0.5)
        with pytest.raises(DriverError, match='no answer'):
            link.read(SEVEN)
        link.close()


def test_a_clock_that_is_set_does_not_change_the_speed_of_an_encoder(
    modbus_server, monkeypatch
) -> None:
    drive = _drive(modbus_server, encoder_register=60)
    real, shift_ns = time.time_ns, 0
    monkeypatch.setattr('hunt_ros.drivers.sample_clock.time.time_ns', lambda: real() + shift_ns)
    monkeypatch.setattr(
        'hunt_ros.drivers.modbus.host_less_steady_ns',
        lambda: real() + shift_ns - time.monotonic_ns(),
    )

    def poll(link: ModbusLink, register: Register) -> tuple[int, float]:
        """Return the count of a roller at 8 m/s, however busy the machine is."""
        now_ns = time.monotonic_ns()
        return now_ns, round(now_ns * 1e-9 * 8.0 / 0.15 / (2.0 * math.pi) * 4096) % 2**32

    monkeypatch.setattr(ModbusLink, 'poll', poll)
    speeds = []
    for k in range(60):
        shift_ns = 0 if k < 20 else 10**9 if k < 40 else -3600 * 10**9
        speeds += drive.read(0.5).speed_mps.tolist()
    assert len(speeds) > 50, 'a clock that is set back is no silence'
    assert speeds == pytest.approx([8.0] * len(speeds), rel=0.01)
    drive.close()


def test_a_second_master_is_found_by_reading_the_set_point_back(modbus_server, machine) -> None:
    def foreign(write: float, other: int | None, read_first: bool = False) -> set[float]:
        drive = _drive(modbus_server, speed_register=40, actual_register=50)
        read, found = drive._link.read, set()

        def busy(register: Register) -> list[int]:
            if register.address != 40:
                return read(register)
            drive._link.read = read
            raise _BusyError('device busy')

        drive._link.read = busy  # it is looked again
        deadline = machine.deadline(1.0)
        while not deadline.passed and len(found) < 2:
            drive.set_speed(write)
            block = drive.read(0.5) if read_first else None
            modbus_server.put(40, round(100 * write) if other is None else other)
            block = block or drive.read(0.5)
            if block.stamps_ns.size:
                found.add(block.foreign_mps)
        drive.close()
        return {x for x in found if not math.isnan(x)}

    assert foreign(5.0, None) == set()
    assert foreign(5.0, 750) == {7.5}
    assert foreign(5.0, 530, read_first=True) == {5.3}, 'between a reading and the next set point'
