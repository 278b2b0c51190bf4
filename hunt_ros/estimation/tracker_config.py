"""
Settings of the hunting tracker, and how they reach the compiled kernel.

Nothing here has a length in it: the tracker finds the scale of the signals and
of their noise by itself, so metres, millimetres and volts are treated alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import ConfigError
from hunt_ros.estimation.tracker.layout import MOST_LINES, MOST_SLIPS
from hunt_ros.sensors import SENSORS, MotionSensor


@dataclass(frozen=True)
class ModePoint:
    """
    What is known of the rig's two modes at one speed and amplitude.

    Parameters
    ----------
    speed : float
        Running speed, m/s.
    frequency_hz : float
        Frequency of the hunting mode, Hz.
    second_frequency_hz, second_decay : float
        Frequency (Hz) and decay rate (1/s, positive) of the second mode.
    yaw_ratio : complex, optional
        Yaw phasor over lateral phasor of the hunting mode, in the units of the two
        sensors (rad/m in SI). None: unknown, learnt from the data.
    second_yaw_ratio : complex, optional
        The same for the second mode. None: the two sensors see it independently.
    amplitude : float
        Lateral amplitude it holds for, m.
    yaw_ratio_std : float
        Relative standard deviation of `yaw_ratio` here, beside that of the scale of the
        sensors, which is `TrackerConfig.yaw_ratio_std` and common to all points.
    second_std : float
        Relative standard deviation of the second mode's frequency and decay, below 1; 0: known.

    Raises
    ------
    ConfigError
        For a value that is not finite, or a frequency or decay that is not positive.
    """

    speed: float
    frequency_hz: float
    second_frequency_hz: float
    second_decay: float
    yaw_ratio: complex | None = None
    second_yaw_ratio: complex | None = None
    amplitude: float = 0.0
    yaw_ratio_std: float = 0.0
    second_std: float = 0.0

    def __post_init__(self) -> None:
        for name in ('frequency_hz', 'second_frequency_hz', 'second_decay'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f'mode point: {name} must be positive, got {value}')
        if not math.isfinite(self.speed):
            raise ConfigError(f'mode point: speed must be finite, got {self.speed}')
        for name in ('amplitude', 'yaw_ratio_std'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f'mode point: {name} must not be negative, got {value}')
        _share('mode point: second_std', self.second_std)


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

    Raises
    ------
    ConfigError
        For an order that is not positive, or a slip outside 0..0.1.
    """

    orders: tuple[float, ...]
    slip_std: float = 0.0

    def __post_init__(self) -> None:
        for order in self.orders:
            if not (math.isfinite(order) and order > 0.0):
                raise ConfigError(f'shaft: an order must be positive, got {order}')
        if not 0.0 <= self.slip_std <= 0.1:
            raise ConfigError(f'shaft: slip_std must be within 0..0.1, got {self.slip_std}')


#: The sensors of a usual rig.
USUAL: tuple[MotionSensor, ...] = tuple(sensor for sensor in SENSORS if sensor.usual)

#: The hunting frequency the times inside the tracker are meant for, Hz: it counts time in units
#: that make the nominal frequency this one, so that a rig of another frequency gets the same
#: filter, slower or faster.
REFERENCE_HZ = 2.84


def _share(name: str, value: float) -> None:
    if not 0.0 <= value < 1.0:
        raise ConfigError(f'{name} must be within 0..1, below 1, got {value}')


def _positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ConfigError(f'tracker: {name} must be positive, got {value}')


@dataclass(frozen=True)
class TrackerConfig:
    """
    Settings of `HuntingTracker`; the defaults suit any rig that hunts at 1 to 6 Hz.

    For another rig `TrackerConfig.at` gives the same filter, slower or faster.

    Parameters
    ----------
    frequency_hz : float
        Nominal hunting frequency, Hz. 30 % off costs nothing once there is a signal.
    frequency_min_hz, frequency_max_hz : float
        Range the frequency state is kept in, Hz.
    frequency_std : float
        Prior standard deviation of the frequency, as a fraction of the nominal one.
    frequency_drift : float
        Random walk of the frequency, fraction of nominal per square root of a second.
    growth_rate_std : float
        Prior standard deviation of the growth rate, 1/s.
    growth_rate_drift : float
        Random walk of a growth rate near zero, (1/s) per square root of a second.
    second_frequency_hz, second_decay : float
        Frequency (Hz) and decay rate (1/s) of the second, fast-decaying mode.
    second_std : float
        How far both may be off, as a fraction, below 1; 0: they are known.
    yaw_ratio, second_yaw_ratio : complex, optional
        Yaw over lateral phasor of the two modes; None: learnt, or left free.
    yaw_ratio_std : float
        Prior relative standard deviation of a `yaw_ratio` that is given.
    yaw_ratio_floor : float
        Relative accuracy with which one ratio describes all amplitudes and speeds.
    modes : tuple of ModePoint
        The same by speed, replacing the constants above; interpolated, held at its ends.
        Where the ratio depends on the amplitude there is a point for every speed and
        amplitude of a grid, sorted by speed, then amplitude.
    bin_s : float
        Samples of one sensor are averaged over bins of this length, s, before they
        enter the filter (0: every sample by itself). See `hunt_ros.estimation.tracker.block`.
    surprise : float
        Innovation, in its standard deviations, beyond which a sample may be wrong, or the
        beginning of a kick or of a step of the level.
    noise_time, bandwidth_time : float
        Time constants, s, of the self-tuned sensor noise and process noise.
    stuck_s : float
        A sensor whose value does not change for this long, s, is not measuring.
    shafts : tuple of Shaft
        What turns, and its lines.
    sensors : tuple of MotionSensor
        What measures the motion. The first one of a coordinate says how large its motion is; the
        scale of a further one is learnt against it.
    gap_s : float
        After silence longer than this, s, the hunting phasor is known no more.

    Raises
    ------
    ConfigError
        For a value outside its range.
    """

    frequency_hz: float = 2.84
    frequency_min_hz: float = 1.0
    frequency_max_hz: float = 6.0
    frequency_std: float = 0.2
    frequency_drift: float = 0.015
    growth_rate_std: float = 1.0
    growth_rate_drift: float = 0.03
    second_frequency_hz: float = 3.3
    second_decay: float = 9.4
    second_std: float = 0.5
    yaw_ratio: complex | None = None
    second_yaw_ratio: complex | None = None
    yaw_ratio_std: float = 0.1
    yaw_ratio_floor: float = 0.03
    modes: tuple[ModePoint, ...] = ()
    bin_s: float = 0.005
    surprise: float = 4.0
    noise_time: float = 2.0
    bandwidth_time: float = 1.0
    stuck_s: float = 0.05
    gap_s: float = 2.0
    shafts: tuple[Shaft, ...] = (Shaft((1.0, 2.0)),)
    sensors: tuple[MotionSensor, ...] = USUAL

    def __post_init__(self) -> None:
        names = [sensor.name for sensor in self.sensors]
        if not names or len(set(names)) < len(names):
            raise ConfigError(f'tracker: sensors must be one or more, each once, got {names}')
        ratios = ('yaw_ratio', 'second_yaw_ratio')
        free = (*ratios, 'second_std', 'modes', 'bin_s', 'shafts', 'sensors')
        for setting in fields(self):
            if setting.name not in free:
                _positive(setting.name, getattr(self, setting.name))
        _share('tracker: second_std', self.second_std)
        longest = 0.02 * REFERENCE_HZ / self.frequency_hz
        if not 0.0 <= self.bin_s <= longest:
            raise ConfigError(
                f'tracker: bin_s must be within 0..{longest:.3g} s, got {self.bin_s}'
            )
        if not self.frequency_min_hz < self.frequency_hz < self.frequency_max_hz:
            raise ConfigError(
                f'tracker: frequency_hz {self.frequency_hz} must lie between frequency_min_hz'
                f' {self.frequency_min_hz} and frequency_max_hz {self.frequency_max_hz}'
            )
        places = [(point.speed, point.amplitude) for point in self.modes]
        if any(b <= a for a, b in pairwise(places)):
            raise ConfigError(f'tracker: speeds of modes must increase, got {places}')
        by_speed: dict[float, list[float]] = {}
        for speed, amplitude in places:
            by_speed.setdefault(speed, []).append(amplitude)
        if any(found != by_speed[places[0][0]] for found in by_speed.values()):
            raise ConfigError('tracker: modes must have the same amplitudes at every speed')
        known = {point.yaw_ratio is None for point in self.modes}
        if len(known) > 1:
            raise ConfigError('tracker: yaw_ratio must be given at every speed or at none')
        lines, slips = self.line_table()
        if len(lines) > MOST_LINES or len(slips) > MOST_SLIPS:
            raise ConfigError(
                f'tracker: {len(lines)} lines on {len(slips)} shafts with a slip, expected at most'
                f' {MOST_LINES} and {MOST_SLIPS}'
            )

    @property
    def time_scale(self) -> float:
        """Units of the tracker's time in a second."""
        return self.frequency_hz / REFERENCE_HZ

    @classmethod
    def at(
        cls,
        frequency_hz: float,
        lowest_hz: float,
        highest_hz: float,
        shafts: tuple[Shaft, ...] = (Shaft((1.0, 2.0)),),
        sensors: tuple[MotionSensor, ...] = USUAL,
    ) -> TrackerConfig:
        """
        Return the settings for a rig that hunts at another frequency: all times with it.

        Parameters
        ----------
        frequency_hz, lowest_hz, highest_hz : float
            Nominal hunting frequency, and the range it may lie in, Hz.
        shafts : tuple of Shaft
            What turns.
        sensors : tuple of MotionSensor
            What measures the motion.

        Raises
        ------
        ConfigError
            If they are not positive and in this order.
        """
        _positive('frequency_hz', frequency_hz)
        faster = frequency_hz / REFERENCE_HZ
        plain = cls()
        return cls(
            frequency_hz=frequency_hz,
            frequency_min_hz=lowest_hz,
            frequency_max_hz=highest_hz,
            frequency_drift=plain.frequency_drift * math.sqrt(faster),
            growth_rate_std=plain.growth_rate_std * faster,
            growth_rate_drift=plain.growth_rate_drift * faster * math.sqrt(faster),
            second_frequency_hz=plain.second_frequency_hz * faster,
            second_decay=plain.second_decay * faster,
            bin_s=plain.bin_s / faster,
            noise_time=plain.noise_time / faster,
            bandwidth_time=plain.bandwidth_time / faster,
            # What repeats a value is a sensor, whose rate does not rise with the frequency.
            stuck_s=plain.stuck_s / min(faster, 1.0),
            gap_s=plain.gap_s / faster,
            shafts=shafts,
            sensors=sensors,
        )

    def line_table(self) -> tuple[list[tuple[float, int]], list[float]]:
        """
        Return the known lines as the filter keeps them.

        Returns
        -------
        lines : list of (float, int)
            Order, and which slip it turns with (-1: none).
        slips : list of float
            Prior standard deviation of each.
        """
        lines: list[tuple[float, int]] = []
        slips: list[float] = []
        for shaft in self.shafts:
            place = -1
            if shaft.slip_std > 0.0 and shaft.orders:
                place = len(slips)
                slips.append(shaft.slip_std)
            lines += [(order, place) for order in shaft.orders]
        return lines, slips

    def mode_table(self) -> NDArray[np.float64]:
        """
        Return the modes as the kernel reads them.

        Returns
        -------
        ndarray of float64, shape (speeds, amplitudes, 11)
            Speed; hunting frequency; ratio, real and imaginary (NaN: unknown); second
            frequency, decay, its ratio, real and imaginary; amplitude; relative
            standard deviation of the ratio, and of the second mode's eigenvalue.
            Frequencies and the decay are in rad and 1 per unit of the tracker's time, see
            `time_scale`.
        """
        scale = self.time_scale
        points = self.modes or (
            ModePoint(
                0.0,
                self.frequency_hz,
                self.second_frequency_hz,
                self.second_decay,
                self.yaw_ratio,
                self.second_yaw_ratio,
                second_std=self.second_std,
            ),
        )
        unknown = complex(math.nan, math.nan)
        rows = []
        for point in points:
            ratio = unknown if point.yaw_ratio is None else complex(point.yaw_ratio)
            second = unknown if point.second_yaw_ratio is None else complex(point.second_yaw_ratio)
            rows.append(
                (
                    point.speed,
                    2.0 * math.pi * point.frequency_hz / scale,
                    ratio.real,
                    ratio.imag,
                    2.0 * math.pi * point.second_frequency_hz / scale,
                    point.second_decay / scale,
                    second.real,
                    second.imag,
                    point.amplitude,
                    point.yaw_ratio_std,
                    point.second_std,
                )
            )
        speeds = len({row[0] for row in rows})
        return np.array(rows, dtype=np.float64).reshape(speeds, -1, 11)
