"""
An analog input of National Instruments hardware: timed by its own clock, buffered (nidaqmx).

The device samples into a buffer; what has come is fetched in blocks. A sample's stamp follows its
number, so the clock of the device, disciplined to that of the host. A buffer that overran is an
error of the library: the node says so, and opens the device again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from hunt_ros.drivers.base import SensorBlock, SensorDriver
from hunt_ros.drivers.sample_clock import SampleClock
from hunt_ros.errors import ConfigError, DriverError, RefusedError, one_line
from hunt_ros.settings import Settings, setting

#: Samples are fetched so often, and the buffer of the device holds so much, s.
_FETCH_S, _BUFFER_S = 0.01, 10.0

TERMINALS = {'default': 'DEFAULT', 'rse': 'RSE', 'nrse': 'NRSE', 'differential': 'DIFF'}


@dataclass(frozen=True)
class NidaqmxInput(Settings):
    """One voltage input."""

    physical_channel: str = setting('Dev1/ai0', 'Input, as NI MAX names it.')
    least_v: float = setting(-10.0, 'Least voltage expected.', unit='V')
    largest_v: float = setting(10.0, 'Largest voltage expected.', unit='V')
    terminal: str = setting('default', 'Wiring.', choices=tuple(TERMINALS))

    def __str__(self) -> str:
        return f'nidaqmx {self.physical_channel}'


class Sensor(SensorDriver):
    """A voltage input, sampled at the rate that the node expects; readings in V."""

    Settings = NidaqmxInput
    settings: NidaqmxInput

    def __init__(self, settings: NidaqmxInput, channel: str, rate_hz: float) -> None:
        super().__init__(settings, channel, rate_hz)
        if not settings.least_v < settings.largest_v:
            raise ConfigError(
                f'{settings}: least_v: {settings.least_v:g} V is not below largest_v,'
                f' {settings.largest_v:g} V'
            )
        self.range = (settings.least_v, settings.largest_v)

    def open(self) -> None:
        """
        Configure the input and start to sample.

        Raises
        ------
        ImportError
            If the library is not installed.
        DriverError
            With the reason of NI-DAQmx.
        """
        import nidaqmx
        from nidaqmx.constants import AcquisitionType, TerminalConfiguration

        settings = self.settings
        try:
            self.handle = task = nidaqmx.Task()
            task.ai_channels.add_ai_voltage_chan(
                settings.physical_channel,
                terminal_config=getattr(TerminalConfiguration, TERMINALS[settings.terminal]),
                min_val=settings.least_v,
                max_val=settings.largest_v,
            )
            task.timing.cfg_samp_clk_timing(
                self.rate_hz,
                sample_mode=AcquisitionType.CONTINUOUS,
                samps_per_chan=round(_BUFFER_S * self.rate_hz),
            )
            # The device takes the nearest rate that its clock can be divided to.
            self.rate_hz = float(task.timing.samp_clk_rate)
            task.start()
        except Exception as error:  # the library has its own for every state of its driver
            raise RefusedError(f'{self}: cannot open it ({one_line(error)})') from error
        self._clock = SampleClock(1.0 / self.rate_hz)
        self._count = 0

    def read(self, timeout_s: float) -> SensorBlock:
        """Fetch what has come; raises DriverError where the device or its buffer failed."""
        task = self.opened()
        deadline_s = time.monotonic() + timeout_s
        try:
            while not (waiting := task.in_stream.avail_samp_per_chan):
                if time.monotonic() >= deadline_s:
                    return SensorBlock()
                time.sleep(_FETCH_S)
            arrived_ns = time.monotonic_ns()
            values = np.array(
                task.read(number_of_samples_per_channel=waiting), np.float64, ndmin=1
            )
        except Exception as error:
            raise DriverError(f'{self}: lost ({one_line(error)})') from error
        ticks = self._count + np.arange(values.size)
        self._count += values.size
        return SensorBlock(self._clock.stamps(ticks, arrived_ns), values)
