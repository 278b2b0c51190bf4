"""Where samples come from and set points go: simulated or real hardware."""

from hunt_ros.drivers.base import DriveBlock, DriveDriver, SensorBlock, SensorDriver
from hunt_ros.drivers.sample_clock import SampleClock

__all__ = ['DriveBlock', 'DriveDriver', 'SampleClock', 'SensorBlock', 'SensorDriver']
