"""
What the simulated rig is made of besides the wheelset: roughness, drive, sensors, rates.

All are frozen and know nothing of each other; `simulation` puts them together.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from hunt_ros.settings import checked


@dataclass(frozen=True)
class Roughness:
    """
    Run-out of the rolling surfaces, tied to the angle of the roller.

    A surface that wanders sideways by u(x) turns the direction of rolling by
    du/dx, which adds to psi in the lateral creep force of Eq. (2). Its lines lie
    at the multiples of f_r = v / (pi D), Eq. (1).

    Parameters
    ----------
    amplitudes : tuple of float
        Amplitude, m, of the line in y at roller orders 1, 2, ... at
        `reference_speed`, as the quiet wheelset shows it. The surface that makes
        it is derived from the linear response, and stays the same at all speeds.
    wheel_amplitudes : tuple of float
        The same for orders of the wheel, which turns D / (2 r0) times as fast
        (28 Hz at 6.4 m/s on the paper's rig: above its hunting, but it may alias).
    reference_speed : float
        m/s.

    Raises
    ------
    ConfigError
        For a negative or non-finite amplitude.
    """

    amplitudes: tuple[float, ...] = ()
    wheel_amplitudes: tuple[float, ...] = ()
    reference_speed: float = 7.2

    def __post_init__(self) -> None:
        for value in (*self.amplitudes, *self.wheel_amplitudes):
            checked('roughness amplitude', value, 'not be negative')
        checked('roughness reference_speed', self.reference_speed, 'be positive')


@dataclass(frozen=True)
class SensorModel:
    """
    A sensor: its noise, then its resolution.

    Parameters
    ----------
    noise : float
        Standard deviation of the white noise of a sample, m or rad.
    resolution : float
        Step of the converter, m or rad; 0: none.

    Raises
    ------
    ConfigError
        Naming the value that is impossible.
    """

    noise: float = 0.0
    resolution: float = 0.0

    def __post_init__(self) -> None:
        checked('sensor: noise', self.noise, 'not be negative')
        checked('sensor: resolution', self.resolution, 'not be negative')


@dataclass(frozen=True)
class DriveModel:
    """
    The motor: the speed follows its set point with a lag and a limited acceleration.

    Parameters
    ----------
    time_constant_s : float
        Of the first-order lag; 0: none.
    acceleration_limit : float
        m/s^2, both ways.
    speed_gain : float
        Measured over true speed (an encoder diameter taken wrong).
    speed_noise : float
        Standard deviation of a measured speed, m/s.
    """

    time_constant_s: float = 0.3
    acceleration_limit: float = 1.0
    speed_gain: float = 1.0
    speed_noise: float = 0.0

    def __post_init__(self) -> None:
        checked('drive: time_constant_s', self.time_constant_s, 'not be negative')
        checked('drive: acceleration_limit', self.acceleration_limit, 'be positive')
        checked('drive: speed_gain', self.speed_gain, 'be positive')
        checked('drive: speed_noise', self.speed_noise, 'not be negative')


@dataclass(frozen=True)
class SimulationSettings:
    """
    How the rig is run and measured.

    Parameters
    ----------
    sample_rate_hz : float
        Of both sensors.
    initial_speed : float
        m/s; 0: the roller stands still.
    roughness : Roughness
    broadband : float
        Strength wn of the white yaw forcing in the dimensionless equation (3):
        dpsi' gets wn dW, with W a Wiener process in t*.
    lateral_sensor, yaw_sensor : SensorModel
    drive : DriveModel
    drive_rate_hz : float
        Rate of speed and roller angle in a `Record`.

    Raises
    ------
    ConfigError
        Naming the value that is impossible.
    """

    sample_rate_hz: float = 500.0
    initial_speed: float = 6.0
    roughness: Roughness = field(default_factory=Roughness)
    broadband: float = 0.0
    lateral_sensor: SensorModel = field(default_factory=SensorModel)
    yaw_sensor: SensorModel = field(default_factory=SensorModel)
    drive: DriveModel = field(default_factory=DriveModel)
    drive_rate_hz: float = 100.0

    def __post_init__(self) -> None:
        for name in ('sample_rate_hz', 'drive_rate_hz'):
            checked(f'simulation: {name}', getattr(self, name), 'be positive')
        for name in ('initial_speed', 'broadband'):
            checked(f'simulation: {name}', getattr(self, name), 'not be negative')
