"""
The settings of the detector: every threshold, with its unit, range and meaning.

The ROS parameters of the detector node are declared from these fields. Here is also where the
hunting motion is looked for: from the settings, the normal form, or neither.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from hunt_ros.errors import ConfigError
from hunt_ros.estimation.tracker_config import REFERENCE_HZ
from hunt_ros.rig import Rig, of_rig
from hunt_ros.sensors import sensors_of
from hunt_ros.settings import Settings, setting

#: A speed is silent after this time at least, s: a tachometer is read seldom, and a roller of
#: hundreds of kilograms does not change its speed in it.
_SPEED_TIMEOUT_S = 0.5
#: What is followed where the nominal frequency is `REFERENCE_HZ`, Hz, and likewise with another;
#: and the lowest frequency that the tracker follows.
_LOWEST_HZ, _HIGHEST_HZ, _LEAST_HZ = 1.0, 6.0, 0.03
#: A form whose frequency is this near to the nominal one in force leaves all as it is: the
#: filter loses nothing by it, and goes on with what it has learnt.
_NEAR = math.log(1.2)
#: Nominal frequencies that can be followed: these, and below this share of the output rate.
_SLOWEST_HZ, _FASTEST_HZ, _FASTEST_OF_RATE = 0.1, 50.0, 0.4


def _limit(level: str, what: str, unit: str) -> float:
    """Return a limit of the lab, off by default."""
    text = f'{level} above this {what} (0: off)'
    limit: float = setting(0.0, text, unit=unit, low=0.0, high=1e4)
    return limit


@dataclass(frozen=True)
class DetectorConfig(Settings):
    """
    Settings of `HuntingDetector`, SI throughout.

    Amplitudes are compared with the noise floor the detector has learnt, and with
    the branches of the normal form where there is one, so that the defaults suit a
    wheelset that moves tenths of a millimetre and a rig that moves decimetres.

    The times and rates by which the motion is judged are those of a rig that hunts at 2.84 Hz,
    where their description says so: with another `hunting_frequency_hz` they count as many
    periods, not as many seconds (`rules` converts them, all in one place). One that is
    not given (0) follows the normal form, see `with_frequency`.

    Raises
    ------
    ConfigError
        For a value out of range, or two in the wrong order.
    """

    channels: tuple[str, ...] = of_rig('channels')
    optional_channels: tuple[str, ...] = of_rig('optional_channels')
    lines: tuple[float, ...] = of_rig('lines')
    constant_speed_mps: float = of_rig('constant_speed_mps')
    output_rate_hz: float = setting(
        100.0, 'rate of the estimates', unit='Hz', low=1.0, high=1000.0, fixed=True
    )
    hunting_frequency_hz: float = of_rig('hunting_frequency_hz')

    critical_speed_mps: float = setting(
        0.0, 'v_c, where no normal form gives it (0: unknown)', unit='m/s', low=0.0
    )
    nonlinear_critical_speed_mps: float = setting(
        0.0,
        'v_n, where no normal form gives it (0: unknown; v_c: there is no hysteresis)',
        unit='m/s',
        low=0.0,
    )

    sensor_timeout_s: float = setting(
        0.3,
        'a channel silent for longer is stale, the speed after 0.5 s at least',
        unit='s',
        low=0.01,
        high=60.0,
        fixed=True,
    )
    lateral_range_m: float = of_rig('lateral_range_m')
    yaw_range_rad: float = of_rig('yaw_range_rad')
    roller_diameter_m: float = of_rig('roller_diameter_m')
    wheel_diameter_m: float = of_rig('wheel_diameter_m')

    escape_probability_in: float = setting(
        0.95, 'escaping above this probability of ending on the limit cycle', low=0.5, high=1.0
    )
    false_alarms_per_week: float = setting(
        1.0,
        'at a speed that is held, hunting that the amplitude alone tells is false no more often',
        unit='1/week',
        low=1e-6,
        high=1e5,
    )
    least_damping_per_s: float = setting(
        0.05,
        'quiet motion is damped by at least this: what is damped by less passes for a limit'
        ' cycle (at 2.84 Hz)',
        unit='1/s',
        low=1e-4,
        high=10.0,
    )

    margin_in: float = setting(
        2.0, 'WARN below this ratio of unstable amplitude to amplitude', low=1.0, high=100.0
    )
    warn_lateral_mm: float = _limit('WARN', 'lateral amplitude', 'mm')
    alarm_lateral_mm: float = _limit('ERROR and alarm', 'lateral amplitude', 'mm')
    warn_yaw_mrad: float = _limit('WARN', 'yaw amplitude', 'mrad')
    alarm_yaw_mrad: float = _limit('ERROR and alarm', 'yaw amplitude', 'mrad')
    warn_acceleration_mps2: float = _limit(
        'WARN', 'amplitude of the lateral acceleration, A (2 pi f)^2', 'm/s2'
    )
    alarm_acceleration_mps2: float = _limit(
        'ERROR and alarm', 'amplitude of the lateral acceleration', 'm/s2'
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        # What belongs to the rig is checked where it is defined.
        object.__setattr__(self, 'lines', Rig.of(self).lines)
        self._check_limits()
        nominal = self.hunting_frequency_hz or REFERENCE_HZ
        if self.output_rate_hz * _FASTEST_OF_RATE < nominal:
            raise ConfigError(
                f'output_rate_hz: {self.output_rate_hz:g} is too low for hunting at {nominal:.3g}'
                f' Hz, expected at least {nominal / _FASTEST_OF_RATE:.3g}'
            )
        v_n, v_c = self.nonlinear_critical_speed_mps, self.critical_speed_mps
        if v_n > v_c:
            raise ConfigError(f'nonlinear_critical_speed_mps: {v_n} is above v_c ({v_c})')

    def _check_limits(self) -> None:
        """Refuse a limit that warns later than it alarms."""
        for name in ('lateral_mm', 'yaw_mrad', 'acceleration_mps2'):
            warn, alarm = getattr(self, f'warn_{name}'), getattr(self, f'alarm_{name}')
            if 0.0 < alarm < warn:
                raise ConfigError(
                    f'warn_{name}: {warn:g} must not be above alarm_{name} ({alarm:g})'
                )

    def measures(self, coordinate: str) -> bool:
        """Return True if one of the channels is a sensor of this coordinate."""
        return bool(set(sensors_of(coordinate)) & set(self.channels))

    @property
    def faster(self) -> float:
        """The nominal hunting frequency in units of `REFERENCE_HZ`."""
        return (self.hunting_frequency_hz or REFERENCE_HZ) / REFERENCE_HZ

    @property
    def followed_hz(self) -> tuple[float, float]:
        """The lowest and the highest hunting frequency that is followed, Hz."""
        return max(self.faster * _LOWEST_HZ, _LEAST_HZ), self.faster * _HIGHEST_HZ

    @property
    def period_ns(self) -> int:
        """Spacing of the estimates, ns."""
        return round(1e9 / self.output_rate_hz)

    def timeout_ns(self, channel: str) -> int:
        """Timeout of a channel, ns."""
        least = _SPEED_TIMEOUT_S if channel == 'speed' else 0.0
        return round(1e9 * max(self.sensor_timeout_s, least))


def with_frequency(
    config: DetectorConfig, form_hz: float | None = None, present_hz: float = REFERENCE_HZ
) -> DetectorConfig:
    """
    Return the settings with a nominal hunting frequency.

    Parameters
    ----------
    config : DetectorConfig
        A frequency it names stays, whatever the form says.
    form_hz : float or None
        Hunting frequency of the normal form, Hz; None: there is none.
    present_hz : float
        Nominal frequency in force, Hz: kept without a form, or with one near to it.
    """
    if config.hunting_frequency_hz > 0.0:
        return config
    nominal = present_hz
    if form_hz is not None and abs(math.log(form_hz / present_hz)) >= _NEAR:
        fastest = min(_FASTEST_HZ, _FASTEST_OF_RATE * config.output_rate_hz)
        nominal = min(max(form_hz, _SLOWEST_HZ), fastest)
    return replace(config, hunting_frequency_hz=nominal)
