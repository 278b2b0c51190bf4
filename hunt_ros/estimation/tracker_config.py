"""
Settings of the hunting tracker, and how they reach the compiled kernel.

Nothing here has a length in it: the tracker finds the scale of the signals and
of their noise by itself, so metres, millimetres and volts are treated alike.
"""

from __future__ import annotations

from dataclasses import dataclass

from hunt_ros.sensors import SENSORS, MotionSensor

#: The hunting frequency the times inside the tracker are meant for, Hz: it counts time in units
#: that make the nominal frequency this one, so that a rig of another frequency gets the same
#: filter, slower or faster.
REFERENCE_HZ = 2.84

#: The sensors of a usual rig.
USUAL: tuple[MotionSensor, ...] = tuple(sensor for sensor in SENSORS if sensor.usual)


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
    bin_s: float = 0.005

    @property
    def time_scale(self) -> float:
        """Units of the tracker's time in a second."""
        return self.frequency_hz / REFERENCE_HZ
