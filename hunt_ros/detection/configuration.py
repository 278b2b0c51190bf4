"""
The settings of the detector: every threshold, with its unit, range and meaning.

The ROS parameters of the detector node are declared from these fields.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from hunt_ros.errors import ConfigError
from hunt_ros.samples import CHANNELS, USUAL_CHANNELS
from hunt_ros.sensors import DISPLACEMENTS, sensors_of
from hunt_ros.settings import Settings, setting

#: The hunting frequencies: lowest, nominal and highest, and the least that each may be, Hz.
HUNTING_HZ = {
    'hunting_frequency_min_hz': 0.03,
    'hunting_frequency_hz': 0.05,
    'hunting_frequency_max_hz': 0.1,
}

#: Highest order of a known line, and how many there may be: each costs a tenth of the filter.
MOST_TURNS, MOST_LINES = 100.0, 8

_EITHER = ' or '.join(DISPLACEMENTS)

#: A speed is silent after this time at least, s: a tachometer is read seldom, and a roller of
#: hundreds of kilograms does not change its speed in it.
_SPEED_TIMEOUT_S = 0.5


@dataclass(frozen=True)
class DetectorConfig(Settings):
    """
    Settings of `HuntingDetector`, SI throughout.

    Amplitudes are compared with the noise floor the detector has learnt, and with
    the branches of the normal form where there is one, so that the defaults suit a
    wheelset that moves tenths of a millimetre and a rig that moves decimetres.

    The times and rates by which the motion is judged are those of a rig that hunts at 2.84 Hz,
    where their description says so: with another `hunting_frequency_hz` they count as many
    periods, not as many seconds (`rules` converts them, all in one place). Frequencies
    that are not given (0) follow the normal form, see `frequencies`.

    Raises
    ------
    ConfigError
        For a value out of range, or two in the wrong order.
    """

    channels: tuple[str, ...] = setting(
        USUAL_CHANNELS,
        f'channels the rig has, of {", ".join(CHANNELS)};'
        ' one that is listed and silent is a fault',
        fixed=True,
    )
    optional_channels: tuple[str, ...] = setting(
        (),
        'of the channels, those whose silence is no fault: it is said, with what it costs',
        fixed=True,
    )
    lines: tuple[float, ...] = setting(
        (1.0, 2.0),
        f'known lines, at most {MOST_LINES}, in turns of the roller from 0 to {MOST_TURNS:g}:'
        ' what is forced at these orders is no hunting (0.0: none)',
        fixed=True,
    )
    constant_speed_mps: float = setting(
        0.0,
        'running speed where there is no speed channel (0: from the channel)',
        unit='m/s',
        low=0.0,
        fixed=True,
    )
    output_rate_hz: float = setting(
        100.0, 'rate of the estimates', unit='Hz', low=1.0, high=1000.0, fixed=True
    )
    hunting_frequency_hz: float = setting(
        0.0,
        'nominal hunting frequency; 30 % off costs nothing'
        ' (0: that of the normal form, else 2.84 Hz)',
        unit='Hz',
        low=0.0,
        high=50.0,
        fixed=True,
    )
    hunting_frequency_min_hz: float = setting(
        0.0,
        'lowest hunting frequency considered (0: 0.35 of the nominal one)',
        unit='Hz',
        low=0.0,
        high=40.0,
        fixed=True,
    )
    hunting_frequency_max_hz: float = setting(
        0.0,
        'highest hunting frequency considered (0: 2.1 of the nominal one)',
        unit='Hz',
        low=0.0,
        high=150.0,
        fixed=True,
    )

    critical_speed_mps: float = setting(
        0.0, 'v_c, where no normal form gives it (0: unknown)', unit='m/s', low=0.0
    )
    nonlinear_critical_speed_mps: float = setting(
        0.0,
        'v_n, where no normal form gives it (0: unknown, or no hysteresis)',
        unit='m/s',
        low=0.0,
    )

    sensor_timeout_s: float = setting(
        0.2,
        'a channel silent for longer is stale, the speed after 0.5 s at least',
        unit='s',
        low=0.01,
        high=60.0,
        fixed=True,
    )
    lateral_range_m: float = setting(
        0.0,
        'lateral readings of this size and more are saturated (0: no limit)',
        unit='m',
        low=0.0,
    )
    yaw_range_rad: float = setting(
        0.0, 'yaw readings of this size and more are saturated (0: no limit)', unit='rad', low=0.0
    )
    roller_diameter_m: float = setting(
        0.0,
        'of the roller: where its lines are without a roller channel (0: as the built-in rig,'
        ' 0.3 m), and the speed checked by its angle with one (0: learnt while both move)',
        unit='m',
        low=0.0,
        high=10.0,
        fixed=True,
    )
    wheel_diameter_m: float = setting(
        0.0,
        'of the wheel, whose own line is known with it (0: none; needs roller_diameter_m)',
        unit='m',
        low=0.0,
        high=10.0,
        fixed=True,
    )

    escape_probability_in: float = setting(
        0.95, 'escaping above this probability of ending on the limit cycle', low=0.5, high=1.0
    )
    false_alarms_per_week: float = setting(
        1.0,
        'what is said of growing, holding or falling is false no more often than this',
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
    warn_lateral_mm: float = setting(
        0.0, 'WARN above this lateral amplitude (0: off)', unit='mm', low=0.0, high=1e4
    )
    alarm_lateral_mm: float = setting(
        0.0, 'ERROR and alarm above this lateral amplitude (0: off)', unit='mm', low=0.0, high=1e4
    )
    warn_yaw_mrad: float = setting(
        0.0, 'WARN above this yaw amplitude (0: off)', unit='mrad', low=0.0, high=1e4
    )
    alarm_yaw_mrad: float = setting(
        0.0, 'ERROR and alarm above this yaw amplitude (0: off)', unit='mrad', low=0.0, high=1e4
    )
    warn_acceleration_mps2: float = setting(
        0.0,
        'WARN above this amplitude of the lateral acceleration, A (2 pi f)^2 (0: off)',
        unit='m/s2',
        low=0.0,
        high=1e4,
    )
    alarm_acceleration_mps2: float = setting(
        0.0,
        'ERROR and alarm above this amplitude of the lateral acceleration (0: off)',
        unit='m/s2',
        low=0.0,
        high=1e4,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = sorted(set(self.channels) - set(CHANNELS))
        if unknown:
            raise ConfigError(f'channels: unknown {unknown[0]!r}, expected some of {CHANNELS}')
        if not set(self.channels) & set(DISPLACEMENTS):
            raise ConfigError(f'channels: need {_EITHER}, got {self.channels}')
        self._check_optional()
        self._check_lines()
        self._check_limits()
        self._check_frequencies()
        v_n, v_c = self.nonlinear_critical_speed_mps, self.critical_speed_mps
        if v_n > 0.0 and not v_n < v_c:
            raise ConfigError(f'nonlinear_critical_speed_mps: {v_n} must lie below v_c ({v_c})')

    def _check_optional(self) -> None:
        """Refuse channels as optional without which nothing can be said."""
        for name in self.optional_channels:
            if name not in self.channels:
                raise ConfigError(
                    f'optional_channels: {name!r} is none of the channels {self.channels}'
                )
        if 'speed' in self.optional_channels and self.constant_speed_mps == 0.0:
            raise ConfigError(
                "optional_channels: 'speed' needs constant_speed_mps: without a speed the region"
                ' is unknown'
            )
        motion = set(DISPLACEMENTS) & set(self.channels)
        if motion <= set(self.optional_channels):
            raise ConfigError(
                f'optional_channels: {self.optional_channels} leaves no displacement,'
                f' expected {_EITHER} to be required'
            )

    def _check_limits(self) -> None:
        """Refuse a limit that warns later than it alarms."""
        for name in ('lateral_mm', 'yaw_mrad', 'acceleration_mps2'):
            warn, alarm = getattr(self, f'warn_{name}'), getattr(self, f'alarm_{name}')
            if 0.0 < alarm < warn:
                raise ConfigError(
                    f'warn_{name}: {warn:g} must not be above alarm_{name} ({alarm:g})'
                )

    def _check_lines(self) -> None:
        """Refuse orders that are none, and a wheel whose order is not known."""
        for order in self.lines:
            number = isinstance(order, int | float) and not isinstance(order, bool)
            if not (number and 0.0 <= order <= MOST_TURNS):
                raise ConfigError(
                    f'lines: {order!r} is no order, expected turns of the roller from 0 to'
                    f' {MOST_TURNS:g}'
                )
        orders = tuple(sorted({float(order) for order in self.lines if order > 0.0}))
        if len(orders) > MOST_LINES:
            raise ConfigError(f'lines: {len(orders)} lines, expected at most {MOST_LINES}')
        object.__setattr__(self, 'lines', tuple(map(float, self.lines)))
        if self.wheel_diameter_m > 0.0 and self.roller_diameter_m == 0.0:
            raise ConfigError('wheel_diameter_m: needs roller_diameter_m, got 0')

    def _check_frequencies(self) -> None:
        """Refuse hunting frequencies out of order; one that is 0 is not given."""
        from hunt_ros.detection.frequencies import FASTEST_OF_RATE, with_frequencies

        given = [(name, getattr(self, name)) for name in HUNTING_HZ if getattr(self, name) > 0.0]
        for name, value in given:
            if value < HUNTING_HZ[name]:
                raise ConfigError(
                    f'{name}: {value} is below {HUNTING_HZ[name]:g} Hz (0: not given)'
                )
        for (low, below), (high, above) in pairwise(given):
            if not below < above:
                raise ConfigError(f'{high}: {above} must be above {low} ({below})')
        if len(given) < len(HUNTING_HZ):
            with_frequencies(self)  # is checked itself
            return
        nominal = self.hunting_frequency_hz
        if self.output_rate_hz * FASTEST_OF_RATE < nominal:
            raise ConfigError(
                f'output_rate_hz: {self.output_rate_hz:g} is too low for hunting at {nominal:.3g}'
                f' Hz, expected at least {nominal / FASTEST_OF_RATE:.3g}'
            )

    def measures(self, coordinate: str) -> bool:
        """Return True if one of the channels is a sensor of this coordinate."""
        return bool(set(sensors_of(coordinate)) & set(self.channels))

    @property
    def period_ns(self) -> int:
        """Spacing of the estimates, ns."""
        return round(1e9 / self.output_rate_hz)

    def timeout_ns(self, channel: str) -> int:
        """Timeout of a channel, ns."""
        least = _SPEED_TIMEOUT_S if channel == 'speed' else 0.0
        return round(1e9 * max(self.sensor_timeout_s, least))
