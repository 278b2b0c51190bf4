"""Text lines over a serial port that is a pseudo-terminal: torn, mixed with garbage, and gone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hunt_ros.drivers.serial_line import Sensor, SerialLine
from hunt_ros.errors import DriverError, RefusedError

pytest.importorskip('serial', reason='the extra serial is not installed')


def _open(terminal, rate_hz: float = 500.0, **settings) -> Sensor:
    sensor = Sensor(SerialLine(serial_port=terminal.port, **settings), 'lateral', rate_hz)
    sensor.open()
    return sensor


def _read(sensor: Sensor, count: int, machine) -> tuple[list[float], list[int], int]:
    """Return values, stamps and lost samples, once `count` were read or lost."""
    values, stamps, lost = [], [], 0
    deadline = machine.deadline(10.0)
    while len(values) + lost < count:
        block = sensor.read(0.2)
        values += block.values.tolist()
        stamps += block.stamps_ns.tolist()
        lost += block.lost
        assert not deadline.passed, (values, lost)
    return values, stamps, lost


def _read_on(sensor: Sensor) -> None:
    for _ in range(1000):
        sensor.read(0.2)


def test_lines_become_samples_however_they_are_cut(terminal, machine) -> None:
    sensor = _open(terminal, separator=',', column=1, columns=3)
    wire = b'81,9\n' + b''.join(b'%d,%d.5,x\r\n' % (k, -k) for k in range(60))
    got: list[float] = []
    rng = np.random.default_rng(1)
    while wire:
        length = int(rng.integers(1, 9))
        terminal.send(wire[:length])
        wire = wire[length:]
        got += sensor.read(0.01).values.tolist()
    if len(got) < 60:
        got += _read(sensor, 60 - len(got), machine)[0]
    assert got == [-(k + 0.5) if k else 0.5 for k in range(60)]
    assert len(got) == 60
    sensor.close()


def test_torn_lines_and_garbage_are_lost_and_counted_and_nothing_else_is(
    terminal, machine
) -> None:
    sensor = _open(terminal, columns=2, column=1)
    good = [b'a %d\n' % k for k in range(10)]
    bad = [b'a\n', b'a 1 2\n', b'a 1.2.3\n', b'\xff\xfe \x80\n', b'a b\n']
    terminal.send(b'7\n' + good[0] + bad[0] + bad[1] + b''.join(good[1:5]) + b''.join(bad[2:]))
    terminal.send(b'\n  \n' + b''.join(good[5:]) + b'a nan\n')
    values, stamps, lost = _read(sensor, 16, machine)
    assert values[:10] == list(range(10))
    assert math.isnan(values[10])
    assert lost == 5
    assert (np.diff(stamps) > 0).all()
    steps = np.diff(stamps)
    assert steps[0] == pytest.approx(3 * 2e6, rel=0.06), 'lines that were lost had their turn'
    sensor.close()


def test_the_stamps_follow_the_clock_column_over_its_end(terminal, machine) -> None:
    sensor = _open(terminal, column=1, clock_column=0, clock_tick_s=1e-3, clock_bits=16)
    ticks = [65_530 + 2 * k for k in range(20) if k != 7]  # one is missing
    wire = b'1 1\n' + b''.join(b'%d %d\n' % (t % 65_536, t) for t in ticks)
    torn = b'9553 3\n'  # bytes were lost: far from what is due
    repeated = b'%d 0\n' % (ticks[-1] % 65_536)
    terminal.send(wire + torn + repeated)
    values, stamps, lost = _read(sensor, len(ticks) + 1, machine)
    assert values == ticks
    assert lost == 1
    assert np.diff(stamps) == pytest.approx(1e6 * np.diff(ticks), rel=0.06)
    sensor.close()


def test_nothing_but_other_lines_is_one_line_with_an_example(terminal) -> None:
    sensor = _open(terminal, separator=';', column=2)
    terminal.send(b'\n' + b'T=20.1;P=1013\n' * 150)
    with pytest.raises(DriverError, match=r"100 lines such as b'T=20\.1;P=1013': .*column 2") as e:
        _read_on(sensor)
    assert '\n' not in str(e.value)
    assert terminal.port in str(e.value)
    sensor.close()


def test_bytes_without_an_end_of_a_line_are_no_text(terminal) -> None:
    sensor = _open(terminal)
    terminal.send(b'\x00\xff' * 800)
    with pytest.raises(DriverError, match=r'no end of a line.*baud rate'):
        _read_on(sensor)
    sensor.close()


def test_a_plug_that_is_pulled_is_one_line(terminal) -> None:
    sensor = _open(terminal)
    terminal.close()
    with pytest.raises(DriverError, match=r'serial line /dev/.*: lost') as caught:
        _read_on(sensor)
    assert '\n' not in str(caught.value)
    sensor.close()
    with pytest.raises(DriverError, match='cannot open it'):
        sensor.open()


def test_a_port_is_read_by_one_driver_only(terminal) -> None:
    sensor = _open(terminal)
    with pytest.raises(DriverError, match='cannot open it'):
        _open(terminal)
    sensor.close()
    _open(terminal).close()


def test_a_first_clock_that_is_none_is_a_lost_line(terminal, machine) -> None:
    sensor = _open(terminal, columns=2, column=1, clock_column=0, clock_bits=16)
    terminal.send(b'x\n' + b'9' * 30 + b' 1\n-4 1\n70000 1\n100 2\n1100 3\n')
    values, _, lost = _read(sensor, 5, machine)
    assert (values, lost) == ([2.0, 3.0], 3)
    sensor.close()


def test_a_port_that_is_not_there_is_said_at_once() -> None:
    """As what refuses: no port starts together with the nodes."""
    sensor = Sensor(SerialLine(serial_port='/dev/no_such_port'), 'lateral', 500.0)
    words = '/dev/no_such_port at 115200 baud: cannot open it .*No such file or directory'
    with pytest.raises(RefusedError, match=words):
        sensor.open()
