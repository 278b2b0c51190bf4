"""
A recording as if it were hardware: at real time, around and around, its stamps shifted to now.

Which place of the recording is due follows from the clock of the host alone: the recording is as
long as from its first sample to its last, of any channel, and is played again and again since
`begin_s`. So the nodes of a rig that read one recording are in step, whenever each was started.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag import Bag, ChannelSource, read_columns
from hunt_ros.drivers.base import DriveBlock, DriveDriver, SensorBlock, SensorDriver
from hunt_ros.drivers.sample_clock import host_less_steady_ns
from hunt_ros.errors import BagError, ConfigError, DriverError
from hunt_ros.samples import NANOSECONDS, Series
from hunt_ros.settings import Settings, setting

#: Samples are handed out so often, s: as a device with a small buffer does.
_HAND_OUT_S = 0.01
#: Pause between the end of the recording and its beginning: the motion jumps there, ns.
_PAUSE_NS = NANOSECONDS


@dataclass(frozen=True)
class Replay(Settings):
    """A recording that stands for hardware."""

    bag: str = setting('', 'The recording: folder, .mcap or .db3.', fixed=True)
    source: str = setting(
        '',
        'Where the channel stands in it, as /daq/ch0.data[3]*0.001; empty: by its name.',
        fixed=True,
    )
    begin_s: float = setting(
        0.0,
        'When the recording begins for the first time, UNIX time; the same for all nodes.',
        unit='s',
        low=0.0,
        high=9e9,
        fixed=True,
    )

    def __str__(self) -> str:
        return f'replay of {self.bag or "no bag"}'


class _Player:
    """
    Says which samples are due, and shifts their stamps.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
        Recorded, not decreasing.
    span_ns : tuple of int
        First and last time of the whole recording.
    begin_s : float
        When it begins for the first time.
    """

    def __init__(
        self, stamps_ns: NDArray[np.int64], span_ns: tuple[int, int], begin_s: float
    ) -> None:
        self._stamps = stamps_ns
        self._start_ns = span_ns[0]
        self._round_ns = span_ns[1] - span_ns[0] + _PAUSE_NS
        self._begin_ns = round(begin_s * NANOSECONDS)
        self._host_less_steady_ns = host_less_steady_ns()
        self._done = self._due_by_now()
        self._ended = threading.Event()

    def due(self, timeout_s: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Wait; return the numbers of the samples that came due, and their stamps, now."""
        deadline_s = time.monotonic() + timeout_s
        while (due := self._due_by_now()) <= self._done:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0 or self._ended.wait(min(_HAND_OUT_S, left_s)):
                return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        turns, numbers = np.divmod(np.arange(self._done, due), self._stamps.size)
        self._done = due
        shift_ns = self._begin_ns - self._start_ns + turns * self._round_ns
        return numbers, self._stamps[numbers] + shift_ns

    def end(self) -> None:
        """End a wait under way in another thread."""
        self._ended.set()

    def _due_by_now(self) -> int:
        """Return how many samples have been due, over all rounds."""
        now_ns = time.monotonic_ns() + self._host_less_steady_ns
        turn, within_ns = divmod(now_ns - self._begin_ns, self._round_ns)
        if turn < 0:
            return 0
        in_turn = np.searchsorted(self._stamps, self._start_ns + within_ns, 'right')
        return int(turn) * self._stamps.size + int(in_turn)


def _read(settings: Replay, sources: list[ChannelSource]) -> tuple[list[Series], tuple[int, int]]:
    """Return series in the order of their stamps, and the time that the recording takes."""
    try:
        with Bag(settings.bag) as bag:
            columns = read_columns(bag, sources)
            span_ns = bag.span_ns
    except BagError as error:
        raise DriverError(f'replay: {error}') from error
    series = []
    for source in sources:
        column = columns[source.channel]
        if not len(column) or span_ns is None:
            raise DriverError(f'{settings}: channel {source.channel} holds no samples')
        order = np.argsort(column.stamps_ns, kind='stable')
        stamps = column.stamps_ns[order]
        away_ns = max(span_ns[0] - int(stamps[0]), int(stamps[-1]) - span_ns[1])
        if away_ns > _PAUSE_NS:
            raise DriverError(
                f'{settings}: channel {source.channel}: stamps are {away_ns / NANOSECONDS:.1f} s'
                ' away from the times of the recording, expected one clock'
            )
        series.append(Series(stamps, column.values[order]))
    assert span_ns is not None
    return series, span_ns


class Sensor(SensorDriver):
    """A channel of a recording."""

    Settings = Replay
    settings: Replay

    def __init__(self, settings: Replay, channel: str, rate_hz: float) -> None:
        super().__init__(settings, channel, rate_hz)
        try:
            self._source = ChannelSource.of(channel, settings.source or channel)
        except BagError as error:
            raise ConfigError(f'source: {error}') from error
        self._player: _Player | None = None

    def open(self) -> None:
        """Read the channel; raises DriverError where it is not in the recording."""
        (series,), span_ns = _read(self.settings, [self._source])
        self._values = series.values
        self._player = _Player(series.stamps_ns, span_ns, self.settings.begin_s)

    def read(self, timeout_s: float) -> SensorBlock:
        """Wait for the samples that are due."""
        if self._player is None:
            raise DriverError(f'{self}: not open')
        numbers, stamps_ns = self._player.due(timeout_s)
        return SensorBlock(stamps_ns, self._values[numbers])

    def close(self) -> None:
        """End."""
        if self._player is not None:
            self._player.end()

    def __str__(self) -> str:
        return str(self.settings)


class Drive(DriveDriver):
    """The readings of a drive in a recording; it takes no set point."""

    Settings = Replay
    settings: Replay

    def __init__(self, settings: Replay, roller_diameter_m: float) -> None:
        super().__init__(settings, roller_diameter_m)
        try:
            self._source = ChannelSource.of('speed', settings.source or 'speed')
        except BagError as error:
            raise ConfigError(f'source: {error}') from error
        self._player: _Player | None = None

    def open(self) -> None:
        """Read speed and angle; raises DriverError where there is no speed in the recording."""
        (speed,), span_ns = _read(self.settings, [self._source])
        self._speed_mps = speed.values
        self._angle_rad = np.full(len(speed), math.nan)
        with contextlib.suppress(DriverError):  # a rig may have no encoder
            (angle,), _ = _read(self.settings, [ChannelSource('roller', 'roller')])
            origin = int(speed.stamps_ns[0])
            at = speed.seconds(origin)
            self._angle_rad = np.interp(at, angle.seconds(origin), angle.values)
        self._player = _Player(speed.stamps_ns, span_ns, self.settings.begin_s)

    def read(self, timeout_s: float) -> DriveBlock:
        """Wait for the readings that are due."""
        if self._player is None:
            raise DriverError(f'{self}: not open')
        numbers, stamps_ns = self._player.due(timeout_s)
        return DriveBlock(stamps_ns, self._angle_rad[numbers], self._speed_mps[numbers])

    def set_speed(self, speed_mps: float) -> None:
        """Refuse: raises DriverError."""
        raise DriverError(f'{self}: a recording takes no set point ({speed_mps:g} m/s)')

    def close(self) -> None:
        """End."""
        if self._player is not None:
            self._player.end()

    def __str__(self) -> str:
        return str(self.settings)
