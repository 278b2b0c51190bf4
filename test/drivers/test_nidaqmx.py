"""The part of the nidaqmx driver that needs no hardware."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from hunt_ros.drivers.nidaqmx import NidaqmxInput, Sensor
from hunt_ros.errors import DriverError


class _Task:
    """What the driver uses of a task: a buffer that fills by 25 samples at a time."""

    made: ClassVar[list[_Task]] = []

    def __init__(self) -> None:
        self.made.append(self)
        self.calls: list[tuple] = []
        self.taken = 0
        self.failure = ''
        self.ai_channels = SimpleNamespace(
            add_ai_voltage_chan=lambda *a, **k: self.calls.append((a, k))
        )
        self.timing = SimpleNamespace(
            cfg_samp_clk_timing=lambda *a, **k: self.calls.append((a, k)), samp_clk_rate=500.25
        )
        self.in_stream = SimpleNamespace(avail_samp_per_chan=25)

    def start(self) -> None:
        self.calls.append(('start',))

    def read(self, number_of_samples_per_channel: int) -> list[float]:
        if self.failure:
            raise RuntimeError(self.failure)
        first, self.taken = self.taken, self.taken + number_of_samples_per_channel
        return [0.01 * k for k in range(first, self.taken)]

    def close(self) -> None:
        self.calls.append(('close',))


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> type[_Task]:
    """Stand in for the library, whose own part is not tested here."""
    module, constants = ModuleType('nidaqmx'), ModuleType('nidaqmx.constants')
    module.Task = _Task
    constants.AcquisitionType = SimpleNamespace(CONTINUOUS='continuous')
    constants.TerminalConfiguration = SimpleNamespace(DEFAULT='d', RSE='r', NRSE='n', DIFF='b')
    monkeypatch.setitem(sys.modules, 'nidaqmx', module)
    monkeypatch.setitem(sys.modules, 'nidaqmx.constants', constants)
    _Task.made.clear()
    return _Task


def test_samples_are_stamped_by_their_number_at_the_rate_of_the_device(library) -> None:
    settings = NidaqmxInput(physical_channel='cDAQ1/ai3', terminal='differential', largest_v=5.0)
    sensor = Sensor(settings, 'lateral', 500.0)
    assert sensor.range == (-10.0, 5.0)
    sensor.open()
    (task,) = library.made
    voltage, timing, start = task.calls
    assert voltage == (
        ('cDAQ1/ai3',), {'terminal_config': 'b', 'min_val': -10.0, 'max_val': 5.0}
    )  # fmt: skip
    assert timing == ((500.0,), {'sample_mode': 'continuous', 'samps_per_chan': 5000})
    assert start == ('start',)
    assert sensor.rate_hz == 500.25
    blocks = [sensor.read(0.1) for _ in range(4)]
    values = np.concatenate([block.values for block in blocks])
    stamps = np.concatenate([block.stamps_ns for block in blocks])
    assert values == pytest.approx(0.01 * np.arange(100))
    assert (np.diff(stamps) > 0).all()
    within = np.diff(blocks[0].stamps_ns)
    assert within == pytest.approx(1e9 / 500.25, rel=1e-6)
    task.in_stream.avail_samp_per_chan = 0
    assert not sensor.read(0.0).stamps_ns.size
    sensor.close()
    sensor.close()
    assert task.calls[-1] == ('close',)


def test_a_buffer_that_overran_is_one_line(library) -> None:
    sensor = Sensor(NidaqmxInput(), 'lateral', 500.0)
    sensor.open()
    library.made[0].failure = 'samples were overwritten\nTask Name: _x\n\nStatus Code: -200279'
    with pytest.raises(DriverError, match=r'nidaqmx Dev1/ai0: lost .*-200279') as caught:
        sensor.read(0.1)
    assert '\n' not in str(caught.value)
    sensor.close()
    with pytest.raises(DriverError, match='not open'):
        sensor.read(0.1)


def test_without_the_driver_of_the_vendor_the_reason_is_one_line() -> None:
    """The real library, where it is installed, on a machine that has no hardware."""
    pytest.importorskip('nidaqmx', reason='the extra nidaqmx is not installed')
    sensor = Sensor(NidaqmxInput(), 'lateral', 500.0)
    with pytest.raises(DriverError, match='nidaqmx Dev1/ai0: cannot open it') as caught:
        sensor.open()
    assert '\n' not in str(caught.value)
    sensor.close()
