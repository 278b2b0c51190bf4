"""
What the simulated rig is made of besides the wheelset: roughness, drive, sensors, rates.

All are frozen and know nothing of each other; `simulation` puts them together.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from hunt_ros.settings import Settings, setting


@dataclass(frozen=True)
class Roughness(Settings):
    """
    Run-out of the rolling surfaces, tied to the angle of the roller.

    A surface that wanders sideways by u(x) turns the direction of rolling by
    du/dx, which adds to psi in the lateral creep force of Eq. (2). Its lines lie
    at the multiples of f_r = v / (pi D), Eq. (1).

    Amplitudes are those of the lines in y at `reference_speed`, as the quiet wheelset shows them;
    the surface that makes them is derived from the linear response, and stays the same at all
    speeds. Those of the wheel, which turns D / (2 r0) times as fast, lie at 28 Hz at 6.4 m/s on
    the paper's rig: above its hunting, but they may alias.
    """

    amplitudes: tuple[float, ...] = setting((), 'at orders 1, 2, ... of the roller', low=0.0)
    wheel_amplitudes: tuple[float, ...] = setting((), 'at those of the wheel', low=0.0)
    reference_speed: float = setting(7.2, 'where they are so large', low=1e-3, high=1e3)


@dataclass(frozen=True)
class SensorModel(Settings):
    """A sensor: its noise, then its resolution; both in m or rad."""

    noise: float = setting(0.0, 'deviation of the white noise of a sample', low=0.0, high=1e3)
    resolution: float = setting(0.0, 'step of the converter (0: none)', low=0.0, high=1e3)


@dataclass(frozen=True)
class DriveModel(Settings):
    """The motor: the speed follows its set point with a lag and a limited acceleration."""

    time_constant_s: float = setting(0.3, 'of the lag (0: none)', unit='s', low=0.0, high=1e6)
    acceleration_limit: float = setting(1.0, 'both ways', unit='m/s2', low=1e-6, high=1e6)
    speed_gain: float = setting(1.0, 'measured over true speed', low=1e-3, high=1e3)
    speed_noise: float = setting(0.0, 'of a measured speed', unit='m/s', low=0.0, high=1e3)


@dataclass(frozen=True)
class SimulationSettings(Settings):
    """
    How the rig is run and measured.

    `broadband` is the strength wn of the white yaw forcing in the dimensionless equation (3):
    dpsi' gets wn dW, with W a Wiener process in t*.
    """

    sample_rate_hz: float = setting(500.0, 'of both sensors', unit='Hz', low=1e-3, high=1e9)
    initial_speed: float = setting(6.0, 'where it starts', unit='m/s', low=0.0, high=1e3)
    roughness: Roughness = field(default_factory=Roughness)
    broadband: float = setting(0.0, 'strength wn of the white yaw forcing', low=0.0, high=1e3)
    lateral_sensor: SensorModel = field(default_factory=SensorModel)
    yaw_sensor: SensorModel = field(default_factory=SensorModel)
    drive: DriveModel = field(default_factory=DriveModel)
    drive_rate_hz: float = setting(
        100.0, 'of speed and roller angle in a record', unit='Hz', low=1e-3, high=1e9
    )
