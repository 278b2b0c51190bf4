"""
Settings of the hunting tracker, and how they reach the compiled kernel.

Nothing here has a length in it: the tracker finds the scale of the signals and
of their noise by itself, so metres, millimetres and volts are treated alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.sensors import SENSORS, MotionSensor

#: The hunting frequency the times inside the tracker are meant for, Hz: it counts time in units
#: that make the nominal frequency this one, so that a rig of another frequency gets the same
#: filter, slower or faster.
REFERENCE_HZ = 2.84

#: The sensors of a usual rig.
USUAL: tuple[MotionSensor, ...] = tuple(sensor for sensor in SENSORS if sensor.usual)


@dataclass(frozen=True)
class ModePoint:
    """
    What is known of the rig's hunting mode at one speed and amplitude.

    Parameters
    ----------
    speed : float
        Running speed, m/s.
    frequency_hz : float
        Frequency of the hunting mode, Hz.
    yaw_ratio : complex, optional
        Yaw phasor over lateral phasor of the hunting mode, in the units of the two
        sensors (rad/m in SI). None: unknown, learnt from the data.
    amplitude : float
        Lateral amplitude it holds for, m.
    yaw_ratio_std : float
        Relative standard deviation of `yaw_ratio` here, beside that of the scale of the
        sensors, which is `TrackerConfig.yaw_ratio_std` and common to all points.
    """

    speed: float
    frequency_hz: float
    yaw_ratio: complex | None = None
    amplitude: float = 0.0
    yaw_ratio_std: float = 0.0


@dataclass(frozen=True)
class Shaft:
    """
    Something that turns, and the lines that it forces on the signals.

    Parameters
    ----------
    orders : tuple of float
        Frequencies of its lines, in turns of the angle that the tracker is given.
    slip_std : float
        Relative standard deviation of its turning rate against that of the angle: 0 where it
        turns with it (an encoder's own shaft), 0.01 where the angle is an integrated speed.
    """

    orders: tuple[float, ...]
    slip_std: float = 0.0


@dataclass(frozen=True)
class TrackerConfig:
    """
    What `HuntingTracker` is told of the rig; the defaults suit one that hunts at 1 to 6 Hz.

    Parameters
    ----------
    frequency_hz : float
        Nominal hunting frequency, Hz: all times of the filter are numbers of its periods. 30 %
        off costs nothing once there is a signal.
    frequency_min_hz, frequency_max_hz : float
        Range the frequency state is kept in, Hz.
    shafts : tuple of Shaft
        What turns, and its lines.
    sensors : tuple of MotionSensor
        What measures the motion. The first one of a coordinate says how large its motion is; the
        scale of a further one is learnt against it.
    modes : tuple of ModePoint
        The mode by speed, interpolated, held at its ends; empty: `frequency_hz`, no ratio.
        Where the ratio depends on the amplitude there is a point for every speed and
        amplitude of a grid, sorted by speed, then amplitude.
    yaw_ratio_std : float
        Prior relative standard deviation of a `yaw_ratio` that is given.
    bin_s : float
        Samples of one sensor are averaged over bins of this length, s at `REFERENCE_HZ`, before
        they enter the filter (0: every sample by itself). See
        `hunt_ros.estimation.tracker.block`.
    """

    frequency_hz: float = REFERENCE_HZ
    frequency_min_hz: float = 1.0
    frequency_max_hz: float = 6.0
    shafts: tuple[Shaft, ...] = (Shaft((1.0, 2.0)),)
    sensors: tuple[MotionSensor, ...] = USUAL
    modes: tuple[ModePoint, ...] = ()
    yaw_ratio_std: float = 0.1
    bin_s: float = 0.005

    @property
    def time_scale(self) -> float:
        """Units of the tracker's time in a second."""
        return self.frequency_hz / REFERENCE_HZ

    def mode_table(self) -> NDArray[np.float64]:
        """
        Return the modes as the kernel reads them.

        Returns
        -------
        ndarray of float64, shape (speeds, amplitudes, 6)
            Speed; hunting frequency, in rad per unit of the tracker's time, see `time_scale`;
            ratio, real and imaginary (NaN: unknown); amplitude; relative standard deviation of
            the ratio.
        """
        turn = 2.0 * math.pi / self.time_scale
        unknown = complex(math.nan, math.nan)
        rows = []
        for point in self.modes or (ModePoint(0.0, self.frequency_hz),):
            ratio = unknown if point.yaw_ratio is None else point.yaw_ratio
            frequency = turn * point.frequency_hz
            doubt = point.yaw_ratio_std
            rows.append([point.speed, frequency, ratio.real, ratio.imag, point.amplitude, doubt])
        speeds = len({row[0] for row in rows})
        return np.array(rows, dtype=np.float64).reshape(speeds, -1, 6)
