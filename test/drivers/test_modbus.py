"""Modbus drivers against the real server of pymodbus, over TCP and over a serial line."""

from __future__ import annotations

import math
import socket
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.drivers.modbus import Drive, ModbusDrive, ModbusSensor, Sensor
from hunt_ros.drivers.modbus_link import FORMATS, ModbusBus, ModbusLink, Register
from hunt_ros.errors import ConfigError, DriverError

pytest.importorskip('pymodbus', reason='the extra modbus is not installed')


def _sensor(server, rate_hz: float = 200.0, **settings) -> Sensor:
    return Sensor(ModbusSensor(port=server.port, timeout_s=5.0, **settings), 'lateral', rate_hz)


def _read(driver, machine):
    """Return the next block that is not empty."""
    deadline = machine.deadline(10.0)
    while True:
        block = driver.read(0.5)
        if block.stamps_ns.size:
            return block
        assert not deadline.passed


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


def test_an_analog_input_is_scaled_and_signed(modbus_server, machine) -> None:
    modbus_server.put(30, -1234)
    sensor = _sensor(modbus_server, register=30, scale=0.5e-3)
    sensor.open()
    before = time.time_ns()
    block = _read(sensor, machine)
    assert block.values.tolist() == [-0.617]
    assert before - 1e9 < block.stamps_ns[0] < time.time_ns()
    sensor.close()


def test_an_encoder_counts_on_where_it_wraps_around(modbus_server, machine) -> None:
    sensor = _sensor(
        modbus_server, register=10, register_format='uint16', counter=True, scale=0.001
    )
    modbus_server.put(10, 65_500)
    sensor.open()
    values = []
    for count in (65_500, 65_530, 24, 1000, 65_000):  # forward over the end, and back over it
        modbus_server.put(10, count)
        values.append(_read(sensor, machine).values[0])
    assert values == pytest.approx([65.5, 65.53, 65.56, 66.536, 65.0])
    sensor.close()


def test_the_stamps_follow_the_clock_of_the_device(modbus_server, machine) -> None:
    """The device says when it sampled, in ms by its own clock; asked twice, it says so once."""
    sensor = _sensor(modbus_server, register=0, clock_register=4, clock_tick_s=1e-3)
    clock = Register(4, 'input', 'uint32', 'big')
    sensor.open()
    begin_ns = time.time_ns()
    last = 0
    for k in range(10):
        tick = last = max((time.time_ns() - begin_ns) // 1_000_000, last + 1)
        modbus_server.put(4, *clock.encode((2**32 - 20 + tick) % 2**32))  # it wraps around
        modbus_server.put(0, k)
        block = _read(sensor, machine)
        assert block.values.tolist() == [k]
        late_ns = block.stamps_ns[0] - begin_ns - 1_000_000 * tick
        assert -20_000_000 < late_ns < time.time_ns() - begin_ns - 1_000_000 * tick
        assert not sensor.read(0.5).stamps_ns.size
    sensor.close()


def test_polls_that_were_missed_are_counted(modbus_server, machine) -> None:
    sensor = _sensor(modbus_server, rate_hz=200.0)
    sensor.open()
    _read(sensor, machine)
    before_s = time.monotonic()
    time.sleep(0.2)
    block = sensor.read(0.5)
    passed_s = time.monotonic() - before_s
    assert 30 <= block.lost <= passed_s * 200.0 + 1.0
    sensor.close()


def test_a_drive_takes_its_set_point_and_tells_speed_and_angle(modbus_server, machine) -> None:
    drive = Drive(
        ModbusDrive(
            port=modbus_server.port,
            timeout_s=5.0,
            speed_register=40,
            speed_format='int32',
            speed_scale_mps=-0.001,
            word_order='little',
            actual_register=50,
            actual_scale_mps=-0.01,
            encoder_register=60,
            encoder_counts_per_turn=-1000.0,
            encoder_format='uint16',
        ),
        0.3,
    )
    modbus_server.put(50, -650)
    modbus_server.put(60, 65_536 - 250)
    drive.open()
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


def test_the_speed_of_a_drive_without_one_is_the_slope_of_its_encoder(
    modbus_server, machine
) -> None:
    drive = Drive(ModbusDrive(port=modbus_server.port, timeout_s=5.0, encoder_register=60), 0.3)
    drive.open()
    blocks = []
    for k in range(1, 40):
        modbus_server.put(60, *Register(0, 'input', 'uint32', 'big').encode(100 * k))
        blocks.append(_read(drive, machine))
    angles = np.array([block.angle_rad[0] for block in blocks])
    stamps = np.array([block.stamps_ns[0] for block in blocks])
    passed_s = (stamps[-1] - stamps[0]) * 1e-9
    mean = 0.15 * (angles[-1] - angles[0]) / passed_s
    speeds = [block.speed_mps[0] for block in blocks]
    assert 0.5 * mean < np.median(speeds) < 2.0 * mean
    drive.close()


def test_a_set_point_is_sent_while_another_thread_reads(modbus_server, machine) -> None:
    drive = Drive(
        ModbusDrive(port=modbus_server.port, timeout_s=5.0, actual_register=5, poll_hz=1000.0), 0.3
    )
    drive.open()
    ended = threading.Event()
    blocks = []

    def read() -> None:
        while not ended.is_set():
            blocks.append(drive.read(0.1))

    thread = threading.Thread(target=read)
    thread.start()
    for k in range(50):
        drive.set_speed(0.01 * k)
    ended.set()
    thread.join()
    assert [values for _, values in modbus_server.written] == [[k] for k in range(50)]
    assert {speed for block in blocks for speed in block.speed_mps} <= {0.0}
    drive.close()


def test_a_device_that_is_cut_is_one_line_and_is_read_again_when_it_is_back(
    modbus_server, machine
) -> None:
    modbus_server.put(3, 77)
    sensor = _sensor(modbus_server, register=3)
    sensor.open()
    _read(sensor, machine)
    modbus_server.stop()
    with pytest.raises(
        DriverError, match=rf'127\.0\.0\.1:{modbus_server.port}.* 3: no answer'
    ) as caught:
        _read(sensor, machine)
    assert '\n' not in str(caught.value)
    sensor.close()
    modbus_server.start()
    again = _sensor(modbus_server, register=3)
    again.open()
    assert _read(again, machine).values.tolist() == [77.0]
    again.close()


def test_closing_ends_a_read_under_way(modbus_server) -> None:
    sensor = _sensor(modbus_server, rate_hz=0.01)
    sensor.open()
    sensor.read(0.1)  # the first is due at once
    timer = threading.Timer(0.2, sensor.close)
    timer.start()
    assert not sensor.read(60.0).stamps_ns.size
    timer.join()
    sensor.close()


@pytest.mark.parametrize(
    ('settings', 'words'),
    [
        ({'register': 300}, 'input register 300: illegal data address'),
        ({'register': 199, 'register_format': 'float32'}, 'register 199: illegal data address'),
        ({'device_id': 9}, 'device 9: input register 0: '),
    ],
)
def test_a_bad_register_is_one_line(modbus_server, settings, words) -> None:
    sensor = _sensor(modbus_server, **settings)
    with pytest.raises(DriverError, match=words):
        sensor.open()
    sensor.close()


def test_a_device_that_is_not_there_is_one_line() -> None:
    with socket.create_server(('127.0.0.1', 0)) as silent:
        port = silent.getsockname()[1]
        sensor = Sensor(ModbusSensor(port=port, timeout_s=0.05), 'lateral', 100.0)
        with pytest.raises(DriverError, match=rf':{port} device 1: input register 0: no answer'):
            sensor.open()
        sensor.close()
    with pytest.raises(DriverError, match=rf'tcp 127\.0\.0\.1:{port} device 1: cannot connect'):
        sensor.open()
    missing = ModbusSensor(bus='rtu', serial_port='/dev/nowhere')
    with pytest.raises(DriverError, match='rtu /dev/nowhere device 1: cannot connect'):
        Sensor(missing, 'yaw', 100.0).open()


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (lambda: Drive(ModbusDrive(), 0.3), 'neither actual_register nor encoder_register'),
        (
            lambda: Drive(ModbusDrive(actual_register=1, speed_scale_mps=0.0), 0.3),
            'speed_scale_mps: 0',
        ),
        (lambda: Sensor(ModbusSensor(scale=math.inf), 'yaw', 100.0), 'scale: inf'),
        (
            lambda: Sensor(ModbusSensor(counter=True, register_format='float32'), 'yaw', 100.0),
            'counter is no float32',
        ),
        (
            lambda: Sensor(ModbusSensor(clock_register=500), 'yaw', 100.0),
            'clock_register 500 is more than 125',
        ),
        (lambda: ModbusSensor(register=70_000), 'register: 70000 is above 65535'),
        (lambda: ModbusSensor(device_id=300), 'device_id: 300'),
        (lambda: ModbusSensor(bus='profibus'), 'bus: .*tcp, rtu'),
    ],
)
def test_settings_that_do_not_fit_together_are_refused_before_anything_is_opened(
    make, words
) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        make()
    assert '\n' not in str(caught.value)


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
