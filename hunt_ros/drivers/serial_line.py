"""
Text lines over a serial port, as a microcontroller with an ADC sends them (pyserial).

The first line after opening may have lost its beginning and is left out. A line that has not the
form that the parameters say is counted as lost, and takes its turn in the time of the samples.
Where nothing but such lines comes, the driver gives up and says what one looks like.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from hunt_ros.drivers.base import SensorBlock, SensorDriver
from hunt_ros.drivers.sample_clock import SampleClock
from hunt_ros.errors import ConfigError, DriverError, RefusedError
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import Settings, setting

#: Longer than any line: the baud rate is wrong, or the device sends no text.
_LONGEST_LINE = 1024
#: So many lines one after the other that cannot be read: the format is another.
_MOST_BAD = 100


@dataclass(frozen=True)
class SerialLine(Settings):
    """A serial port and the form of its lines."""

    serial_port: str = setting('/dev/ttyACM0', 'Serial port.')
    baud_rate: int = setting(115200, 'Bits a second.', unit='1/s', low=300, high=12_000_000)
    separator: str = setting('', 'Between the columns of a line; empty: blanks.')
    columns: int = setting(
        0, 'Columns of a line, so that a torn one is known; 0: any.', low=0, high=1000
    )
    column: int = setting(0, 'Column of the reading, from 0.', low=0, high=999)
    clock_column: int = setting(
        -1, 'Column of a clock or counter of the device; -1: none.', low=-1, high=999
    )
    clock_tick_s: float = setting(
        1e-6, 'Length of a tick of that clock.', unit='s', low=1e-9, high=1.0
    )
    clock_bits: int = setting(32, 'Width of that clock, which wraps around.', low=8, high=62)

    def __str__(self) -> str:
        return f'serial line {self.serial_port} at {self.baud_rate} baud'


class Sensor(SensorDriver):
    """One column of the lines of a serial port."""

    Settings = SerialLine
    settings: SerialLine

    def __init__(self, settings: SerialLine, channel: str, rate_hz: float) -> None:
        super().__init__(settings, channel, rate_hz)
        last = max(settings.column, settings.clock_column)
        if settings.columns and last >= settings.columns:
            raise ConfigError(
                f'{settings}: column {last} of {settings.columns}, counted from 0: expected less'
            )

    def open(self) -> None:
        """
        Open the port.

        Raises
        ------
        ImportError
            If pyserial is not installed.
        RefusedError
            If the port is not there or taken.
        """
        import serial

        settings = self.settings
        try:
            self.handle = serial.Serial(settings.serial_port, settings.baud_rate, exclusive=True)
        except (OSError, ValueError) as error:
            reason = getattr(error, 'strerror', None) or ' '.join(str(error).split())
            raise RefusedError(f'{self}: cannot open it ({reason})') from error
        self._pending = b''
        self._begun = False  # the end of a line has been seen
        self._bad = 0  # lines one after the other
        self._tick: int | None = None  # of the last sample
        self._arrived_ns = 0
        by_count = settings.clock_column < 0
        self._tick_s = 1.0 / self.rate_hz if by_count else settings.clock_tick_s
        self._clock = SampleClock(self._tick_s)

    def read(self, timeout_s: float) -> SensorBlock:
        """Wait for lines; raises DriverError where the port is gone or sends something else."""
        port = self.opened()
        try:
            port.timeout = timeout_s
            data = port.read(max(1, port.in_waiting))
        except (OSError, TypeError) as error:  # TypeError: closed by another thread meanwhile
            raise DriverError(f'{self}: lost ({" ".join(str(error).split())})') from error
        now_ns, lost = time.monotonic_ns(), 0
        ticks: list[int] = []
        values: list[float] = []
        for line in self._cut(data):
            try:
                tick, value = self._parse(line, now_ns)
            except (ValueError, IndexError):
                lost += 1
                self._count_bad(line)
                continue
            self._bad = 0
            if tick != self._tick:  # else the device has sampled nothing since
                self._tick, self._arrived_ns = tick, now_ns
                ticks.append(tick)
                values.append(value)
        return SensorBlock(self._clock.stamps(ticks, now_ns), np.array(values), lost)

    def _release(self, handle: Any) -> None:
        handle.cancel_read()
        handle.close()

    def _cut(self, data: bytes) -> list[bytes]:
        """Return the lines that are complete now; the first, which may be a rest, is none."""
        *lines, self._pending = (self._pending + data).split(b'\n')
        if len(self._pending) > _LONGEST_LINE:
            raise DriverError(
                f'{self}: no end of a line in {len(self._pending)} bytes'
                f' ({self._pending[:20]!r}...): another baud rate, or no text'
            )
        if lines and not self._begun:
            self._begun = True
            del lines[0]
        return [line for line in lines if line.strip()]

    def _parse(self, line: bytes, now_ns: int) -> tuple[int, float]:
        """Return tick and reading of a line; raises where it has not the form, or is torn."""
        settings = self.settings
        columns = line.decode('ascii', 'replace').split(settings.separator or None)
        if settings.columns and len(columns) != settings.columns:
            raise ValueError
        value = float(columns[settings.column])
        value = value if math.isfinite(value) else math.nan
        if settings.clock_column < 0:
            return (self._tick or 0) + self._bad + 1, value  # a bad line had its turn
        clock, size = int(columns[settings.clock_column]), 1 << settings.clock_bits
        if not 0 <= clock < size:
            raise ValueError
        if self._tick is None:
            return clock, value
        ahead = (clock - self._tick) % size
        passed_s = (now_ns - self._arrived_ns) / NANOSECONDS
        if ahead * self._tick_s > 2.0 * (passed_s + 1.0):  # far from what is due
            raise ValueError
        return self._tick + ahead, value

    def _count_bad(self, line: bytes) -> None:
        """Count a line that was no sample; raises DriverError where they do not end."""
        self._bad += 1
        if self._bad >= _MOST_BAD:
            settings = self.settings
            clock = settings.clock_column
            raise DriverError(
                f'{self}: {self._bad} lines such as {line[:60]!r}: expected a number in column'
                f' {settings.column}{f" and a clock in column {clock}" if clock >= 0 else ""}'
                f' between {settings.separator or "blanks"!r}'
            )
