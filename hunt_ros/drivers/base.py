"""
What a sensor driver and a drive driver do, whatever hardware is behind them.

A node knows these two protocols and nothing else of the hardware. Stamps are
taken where the sample is taken, in the driver, never where it is published.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


def _no_stamps() -> NDArray[np.int64]:
    return np.zeros(0, dtype=np.int64)


def _no_values() -> NDArray[np.float64]:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class SensorBlock:
    """
    Samples that arrived since the last read, oldest first.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
        When each was taken.
    values : ndarray of float64, shape (n,)
        m for the lateral sensor, rad for the yaw sensor; NaN for a sample the
        hardware marked as bad.
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
        When each was taken.
    angle_rad : ndarray of float64, shape (n,)
        Continuous roller angle.
    speed_mps : ndarray of float64, shape (n,)
        Running speed.
    """

    stamps_ns: NDArray[np.int64] = field(default_factory=_no_stamps)
    angle_rad: NDArray[np.float64] = field(default_factory=_no_values)
    speed_mps: NDArray[np.float64] = field(default_factory=_no_values)


class SensorDriver(Protocol):
    """A source of samples of one quantity."""

    def open(self) -> None:
        """
        Connect to the hardware.

        Raises
        ------
        DriverError
            Naming what cannot be reached, and where.
        """

    def read(self, timeout_s: float) -> SensorBlock:
        """
        Wait for samples, at most `timeout_s` seconds; an empty block means none came.

        Raises
        ------
        DriverError
            If the connection is lost.
        """

    def close(self) -> None:
        """Let go of the hardware. Closing twice does nothing."""


class DriveDriver(Protocol):
    """The roller's drive: its encoder and its set point."""

    def open(self) -> None:
        """
        Connect to the drive.

        Raises
        ------
        DriverError
            Naming what cannot be reached, and where.
        """

    def read(self, timeout_s: float) -> DriveBlock:
        """
        Wait for readings, at most `timeout_s` seconds; an empty block means none came.

        Raises
        ------
        DriverError
            If the connection is lost.
        """

    def set_speed(self, speed_mps: float) -> None:
        """
        Command a running speed, m/s; also while another thread waits in `read`.

        Raises
        ------
        DriverError
            If the drive did not take it.
        """

    def close(self) -> None:
        """Let go of the drive. Closing twice does nothing."""
