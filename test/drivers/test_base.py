"""Which drivers there are, and what is said where there is none."""

from __future__ import annotations

import contextlib
import re
import sys
import threading
from pathlib import Path

import pytest
from made import install_driver

from hunt_ros.drivers.base import driver_class
from hunt_ros.errors import ConfigError, DriverError, one_line


@pytest.fixture
def third_party(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(tmp_path)
    installed: list[str] = []

    def install(name: str, code: str) -> None:
        installed.append(name)
        install_driver(tmp_path, name, code)

    yield install
    for name in installed:
        sys.modules.pop(name, None)


def test_a_module_that_cannot_be_imported_is_named_with_the_reason(third_party) -> None:
    third_party('lab_broken', 'import nowhere_to_be_found')
    with pytest.raises(ConfigError, match=r"'lab_broken'.*nowhere_to_be_found"):
        driver_class('lab_broken', 'Sensor')


def test_a_sensor_alone_cannot_command_a_roller(third_party) -> None:
    third_party('lab_empty', 'Sensor = object')
    with pytest.raises(ConfigError, match='lab_empty has no class Drive'):
        driver_class('lab_empty', 'Drive')
    with pytest.raises(ConfigError, match=r'lab_empty has no class Sensor, .*SensorDriver'):
        driver_class('lab_empty', 'Sensor')


def test_an_old_description_of_the_package_hides_no_driver(tmp_path, monkeypatch) -> None:
    """A source tree may hold a `hunt_ros.egg-info` of before, which Python finds first."""
    old = tmp_path / 'hunt_ros.egg-info'
    old.mkdir()
    (old / 'PKG-INFO').write_text('Metadata-Version: 2.1\nName: hunt_ros\nVersion: 0.1.0\n')
    (old / 'entry_points.txt').write_text('[console_scripts]\n')
    monkeypatch.syspath_prepend(tmp_path)
    assert driver_class('simulated', 'Sensor')


@pytest.mark.parametrize('name', ['modbus', 'serial_line', 'nidaqmx'])
def test_a_library_that_is_missing_is_said_with_what_pip_installs(name, monkeypatch) -> None:
    library = {'modbus': 'pymodbus', 'serial_line': 'serial', 'nidaqmx': 'nidaqmx'}[name]
    for known in [known for known in sys.modules if known.partition('.')[0] == library]:
        monkeypatch.delitem(sys.modules, known)
    monkeypatch.setitem(sys.modules, library, None)
    kind = driver_class(name, 'Sensor')
    with pytest.raises(ImportError) as caught:
        kind(kind.Settings(), 'yaw', 100.0).open()
    assert re.match(rf'(py)?{library} is not installed: pip install', one_line(caught.value))


@pytest.mark.parametrize(
    ('driver', 'settings', 'words'),
    [
        ('serial_line Sensor', {'columns': 2, 'column': 2}, 'column 2 of 2'),
        ('nidaqmx Sensor', {'least_v': 10.0}, 'least_v: 10 V is not below largest_v'),
        ('modbus Drive', {'actual_register': 1, 'speed_scale_mps': 0.0}, 'speed_scale_mps: 0'),
        ('modbus Drive', {'timeout_s': 3.0}, r'timeout_s: 3\.0 is above 0\.5'),
    ],
)
def test_settings_that_are_impossible_are_refused(driver, settings, words) -> None:
    name, role = driver.split()
    kind = driver_class(name, role)
    place = ('yaw', 500.0) if role == 'Sensor' else (0.3,)
    with pytest.raises(ConfigError, match=words):
        kind(kind.Settings(**settings), *place)


@pytest.mark.parametrize('bus', ['modbus', 'serial line'])
def test_closing_ends_a_read_under_way(request, bus) -> None:
    if bus == 'modbus':
        server = request.getfixturevalue('modbus_server')
        modbus = driver_class('modbus', 'Sensor')
        sensor = modbus(modbus.Settings(port=server.port, timeout_s=5.0), 'lateral', 0.01)
    else:
        terminal = request.getfixturevalue('terminal')
        line = driver_class('serial_line', 'Sensor')
        sensor = line(line.Settings(serial_port=terminal.port), 'lateral', 500.0)
    sensor.open()
    sensor.read(0.1)  # the first is due at once
    timer = threading.Timer(0.2, sensor.close)
    timer.start()
    with contextlib.suppress(DriverError):  # it says that the port is closed, or nothing
        assert not sensor.read(60.0).stamps_ns.size
    timer.join()
    sensor.close()
