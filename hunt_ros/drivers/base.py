"""
What a sensor driver and a drive driver do, whatever hardware is behind them.

A driver is a module with a class `Sensor`, a class `Drive`, or both, named by an entry point of
the group `hunt_ros.drivers` (docs/drivers.md): its name is that of the driver, the parameter
`driver` of the nodes. Our own stand in `setup.py` like those of anybody else. A node knows
these two base classes and nothing else of the hardware. Stamps are taken where the sample is
taken, in the driver, never where it is published.

One thread makes a driver, opens it, reads it and closes it; when the connection is lost it makes
another one; it also sends a drive its set points. Only `close`, which ends a read under way, is
called from other threads.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import EntryPoint, distributions
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import ConfigError, DriverError, one_line
from hunt_ros.settings import Settings as _Settings

_no_stamps: Callable[[], NDArray[np.int64]] = partial(np.array, [], np.int64)
_no_values: Callable[[], NDArray[np.float64]] = partial(np.array, [], np.float64)


@dataclass(frozen=True, eq=False)
class SensorBlock:
    """
    Samples that arrived since the last read, oldest first.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
        When each was taken, on the clock of the host.
    values : ndarray of float64, shape (n,)
        Readings: in the unit of the device (V, counts) where the node has a calibration, else
        m, rad or m/s2; NaN for a sample the hardware marked as bad.
    lost : int
        Samples known to be missing before this block.
    """

    stamps_ns: NDArray[np.int64] = field(default_factory=_no_stamps)
    values: NDArray[np.float64] = field(default_factory=_no_values)
    lost: int = 0


@dataclass(frozen=True, eq=False)
class DriveBlock:
    """
    Readings of the drive since the last read, oldest first.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
        When each was taken, on the clock of the host.
    angle_rad : ndarray of float64, shape (n,)
        Continuous roller angle; NaN where there is no encoder.
    speed_mps : ndarray of float64, shape (n,)
        Running speed.
    foreign_mps : float
        A set point that the drive holds and was not given by this driver; NaN: none is known.
    """

    stamps_ns: NDArray[np.int64] = field(default_factory=_no_stamps)
    angle_rad: NDArray[np.float64] = field(default_factory=_no_values)
    speed_mps: NDArray[np.float64] = field(default_factory=_no_values)
    foreign_mps: float = math.nan


class Driver(ABC):
    """What sensor and drive drivers have in common; making one touches no hardware."""

    #: Kind of the driver's own settings: the node declares its fields as parameters.
    Settings: ClassVar[type[_Settings]] = _Settings

    #: What is open, as a library gives it; None: nothing is.
    handle: Any = None

    def __init__(self, settings: Any) -> None:
        self.settings = settings

    @abstractmethod
    def open(self) -> None:
        """
        Connect to the hardware.

        Raises
        ------
        RefusedError
            If it is there and will not, or is not what the settings say.
        DriverError
            Naming what cannot be reached (it may be starting yet), and where.
        """

    def close(self) -> None:
        """Let go of the hardware. Closing twice, or what is not open, does nothing."""
        handle, self.handle = self.handle, None
        if handle is not None:
            self._release(handle)

    def _release(self, handle: Any) -> None:
        """Close what is open; a read under way in another thread ends."""
        handle.close()

    def opened(self) -> Any:
        """Return what is open; raises DriverError where nothing is, or not any more."""
        if self.handle is None:
            raise DriverError(f'{self}: not open')
        return self.handle

    def __str__(self) -> str:
        """Return the driver and where its hardware is, for messages."""
        return str(self.settings)


class SensorDriver(Driver):
    """
    A source of samples of one quantity.

    Parameters
    ----------
    settings : Settings
        Of the class's own kind, `Settings`.
    channel : str
        What is measured: 'lateral', 'yaw', ...
    rate_hz : float
        Samples a second that the node expects; a driver that sets the pace samples so fast.

    Attributes
    ----------
    range : tuple of float
        Readings outside are saturated, in the unit of the readings. A driver that knows better
        says so when it is made.

    Raises
    ------
    ConfigError
        For a channel that the driver cannot measure.
    """

    #: Channels that it can measure; empty: any.
    channels: ClassVar[tuple[str, ...]] = ()

    def __init__(self, settings: Any, channel: str, rate_hz: float) -> None:
        if self.channels and channel not in self.channels:
            name, known = type(self).__module__.rpartition('.')[2], ', '.join(self.channels)
            raise ConfigError(f'driver {name}: no channel {channel!r}, it has {known}')
        super().__init__(settings)
        self.channel = channel
        self.rate_hz = rate_hz
        self.range: tuple[float, float] = (-math.inf, math.inf)

    @abstractmethod
    def read(self, timeout_s: float) -> SensorBlock:
        """
        Wait for samples, at most `timeout_s` seconds; an empty block means none came.

        Raises
        ------
        DriverError
            If the connection is lost.
        """


class DriveDriver(Driver):
    """
    The roller's drive: its encoder and its set point.

    Parameters
    ----------
    settings : Settings
        Of the class's own kind, `Settings`.
    roller_diameter_m : float
        For a drive that is commanded in turns: v = rate D / 2.
    """

    def __init__(self, settings: Any, roller_diameter_m: float) -> None:
        super().__init__(settings)
        self.roller_diameter_m = roller_diameter_m

    @abstractmethod
    def read(self, timeout_s: float) -> DriveBlock:
        """
        Wait for readings, at most `timeout_s` seconds; an empty block means none came.

        Raises
        ------
        DriverError
            If the connection is lost.
        """

    @abstractmethod
    def set_speed(self, speed_mps: float) -> None:
        """
        Command a running speed, m/s; within half a second, taken or not.

        Raises
        ------
        DriverError
            If the drive did not take it.
        """


_GROUP = 'hunt_ros.drivers'
_BASES: dict[str, Any] = {'Sensor': SensorDriver, 'Drive': DriveDriver}


def driver_class(name: str, role: str) -> type[Driver]:
    """
    Load the class of a driver.

    Parameters
    ----------
    name : str
        Of its entry point.
    role : str
        'Sensor' or 'Drive'.

    Raises
    ------
    ConfigError
        If there is no driver of this name, it cannot be imported, or it has no such class; with
        the names of those there are.
    """
    # `importlib.metadata.entry_points` looks at the first distribution of a name only: an old
    # `hunt_ros.egg-info` in a source tree, found before what is installed, would hide the drivers.
    points: dict[str, EntryPoint] = {}
    for distribution in distributions():
        for point in distribution.entry_points:
            if point.group == _GROUP:
                points.setdefault(point.name, point)
    if name not in points:
        names = ', '.join(sorted(points)) or 'none (install the package again: make install)'
        raise ConfigError(f'driver {name!r}: unknown, those there are: {names}')
    point = points[name]
    try:
        kind = getattr(point.load(), role, None)
    except Exception as error:  # whatever the module of a third party raises
        reason = one_line(error)
        raise ConfigError(f'driver {name!r}: cannot import {point.value} ({reason})') from error
    if not (isinstance(kind, type) and issubclass(kind, _BASES[role])):
        raise ConfigError(
            f'driver {name!r}: {point.value} has no class {role},'
            f' expected one made from {_BASES[role].__name__}'
        )
    return kind
