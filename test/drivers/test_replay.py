"""A recording as if it were hardware."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.bag import read_record, write_record
from hunt_ros.drivers.replay import Drive, Replay, Sensor
from hunt_ros.errors import ConfigError, DriverError
from hunt_ros.samples import Record, Series

_LENGTH = 120


@pytest.fixture(scope='module')
def bag(tmp_path_factory) -> Path:
    """0.6 s at 200 Hz, and half as many readings of the drive."""
    stamps = 5_000_000_000 + 5_000_000 * np.arange(_LENGTH)
    channels = {
        'lateral': Series(stamps, 1e-3 * np.arange(_LENGTH)),
        'yaw': Series(stamps, -1e-3 * np.arange(_LENGTH)),
        'roller': Series(stamps, 0.1 * np.arange(_LENGTH)),
        'speed': Series(stamps[::2], np.full(_LENGTH // 2, 7.0)),
    }
    path = tmp_path_factory.mktemp('replay') / 'short'
    write_record(path, Record(channels))
    return path


def _collect(driver, count: int, machine):
    blocks, deadline = [], machine.deadline(20.0)
    while sum(block.stamps_ns.size for block in blocks) < count:
        blocks.append(driver.read(0.5))
        assert not deadline.passed
    return blocks


def test_samples_come_in_their_order_at_real_time_and_again(bag, machine) -> None:
    sensor = Sensor(Replay(bag=str(bag)), 'lateral', 200.0)
    sensor.open()
    blocks = _collect(sensor, 2 * _LENGTH, machine)
    values = np.concatenate([block.values for block in blocks])
    stamps = np.concatenate([block.stamps_ns for block in blocks])
    numbers = np.rint(1e3 * values).astype(int)
    assert (np.diff(numbers) % _LENGTH == 1).all()
    within = np.diff(stamps)[np.diff(numbers) > 0]
    assert (within == 5_000_000).all()
    assert np.diff(stamps)[np.diff(numbers) < 0].tolist()[0] == 1_000_000_000
    assert stamps[-1] <= time.time_ns() + 1_000_000
    assert time.time_ns() - stamps[-1] < machine.measure() * 5e9
    sensor.close()


def test_two_nodes_that_start_at_other_times_are_in_step(bag, machine) -> None:
    lateral = Sensor(Replay(bag=str(bag)), 'lateral', 200.0)
    lateral.open()
    one = _collect(lateral, 5, machine)[-1]
    yaw = Sensor(Replay(bag=str(bag), source='yaw*-1'), 'yaw', 200.0)
    yaw.open()
    other = _collect(yaw, 5, machine)[-1]
    round_ns = 595_000_000 + 1_000_000_000
    apart_ns = int(other.stamps_ns[-1] - one.stamps_ns[-1])
    recorded_ns = round(5e9 * (other.values[-1] - one.values[-1]))
    # The clock of the host may be slewed between the two.
    assert (apart_ns - recorded_ns + round_ns // 2) % round_ns == pytest.approx(
        round_ns // 2, abs=200_000
    )
    lateral.close()
    yaw.close()


def test_the_drive_of_a_recording_tells_speed_and_angle_and_takes_nothing(bag, machine) -> None:
    drive = Drive(Replay(bag=str(bag)), 0.3)
    drive.open()
    block = _collect(drive, 3, machine)[-1]
    assert set(block.speed_mps) == {7.0}
    assert (np.rint(10.0 * block.angle_rad).astype(int) % 2 == 0).all()
    with pytest.raises(DriverError, match='takes no set point'):
        drive.set_speed(7.0)
    drive.close()


def test_what_is_replayed_is_what_was_recorded_in_si(bag) -> None:
    record = read_record(bag)
    sensor = Sensor(Replay(bag=str(bag), source='lateral*2'), 'yaw', 200.0)
    sensor.open()
    assert np.array_equal(sensor._values, 2.0 * record['lateral'].values)
    sensor.close()


@pytest.mark.parametrize(
    ('settings', 'words'),
    [
        ({'bag': '/nowhere'}, 'replay: /nowhere'),
        ({'source': '/daq/ch0.data[3]'}, 'no topic'),
    ],
)
def test_a_recording_that_is_not_there_is_one_line(bag, settings, words) -> None:
    sensor = Sensor(Replay(**({'bag': str(bag)} | settings)), 'lateral', 200.0)
    with pytest.raises(DriverError, match=words) as caught:
        sensor.open()
    assert '\n' not in str(caught.value)
    with pytest.raises(ConfigError, match='source'):
        Sensor(Replay(source='/a.b/0'), 'lateral', 200.0)
