"""
Between tracker and decisions: what the one is told of the rig, and what the others judge.

The settings that are the tracker's own, the mode shape, the range of frequencies, and
which sensor's amplitude counts.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import doubts
from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.estimation.line_search import LineSearch
from hunt_ros.estimation.tracker_config import ModePoint, Shaft, TrackerConfig
from hunt_ros.estimation.turning import ASSUMED_ABOVE, SPEED_STD, TurningAngle
from hunt_ros.sensors import SENSORS

#: Scale of the yaw sensor against that of the lateral one, then and now: what a mode shape
#: from recordings or from theory cannot know of the sensors at hand.
SCALE_STD = 0.03
#: A wheel turns by its diameter and its creep, whatever is known of the roller.
CREEP_STD = 0.005
#: The turning of the roller is averaged over this time, s: an encoder counts whole steps.
_TURNING_S = 1.0


def tracker_config(config: DetectorConfig) -> TrackerConfig:
    """Return the part of the settings that is the tracker's, its times those of the rig."""
    return TrackerConfig.at(
        config.hunting_frequency_hz,
        config.hunting_frequency_min_hz,
        config.hunting_frequency_max_hz,
        shafts(config),
        tuple(sensor for sensor in SENSORS if sensor.name in config.channels),
    )


def roller_diameter(config: DetectorConfig) -> float:
    """Return the diameter of the roller, m; that of the built-in rig where none is given."""
    return config.roller_diameter_m or RigParameters.roller_diameter_m


def shafts(config: DetectorConfig) -> tuple[Shaft, ...]:
    """Return what turns with the roller's angle, and how well each angle is known by it."""
    known = 'roller' in config.channels
    orders = tuple(order for order in config.lines if order > 0.0)
    found = (Shaft(orders, 0.0 if known else SPEED_STD),)
    if config.wheel_diameter_m == 0.0:
        return found
    order = config.roller_diameter_m / config.wheel_diameter_m
    return (*found, Shaft((order,), CREEP_STD if known else SPEED_STD))


def turning_angle(config: DetectorConfig) -> TurningAngle:
    """Return what tells the angle of the roller from its encoder or the speed."""
    return TurningAngle(roller_diameter(config))


def lines_known(config: DetectorConfig, speed: NDArray[np.float64]) -> NDArray[np.bool_]:
    """
    Return at which speeds, m/s, the lines are known well enough to be taken out.

    They are where encoder or diameter are given; else above `ASSUMED_ABOVE`.
    """
    if 'roller' in config.channels or config.roller_diameter_m > 0.0:
        return np.ones(speed.size, dtype=np.bool_)
    lowest = min((order for order in config.lines if order > 0.0), default=math.inf)
    line = lowest * speed / (math.pi * roller_diameter(config))
    above: NDArray[np.bool_] = line > ASSUMED_ABOVE * config.hunting_frequency_hz
    return above


def mode_points(shape: ModeShape, plain: TrackerConfig) -> tuple[ModePoint, ...]:
    """
    Return the tables of a mode shape as the tracker takes them.

    Parameters
    ----------
    shape : ModeShape
        Of the rig.
    plain : TrackerConfig
        Gives the second mode where the shape does not.
    """
    points = []
    for i, speed in enumerate(shape.speeds):
        second, decay = plain.second_frequency_hz, plain.second_decay
        doubt = plain.second_std
        if shape.second_frequency_hz is not None and shape.second_decay is not None:
            second, decay = float(shape.second_frequency_hz[i]), float(shape.second_decay[i])
            doubt = 0.0 if shape.second_std is None else float(shape.second_std[i])
        ratio = None if shape.second_ratio is None else complex(shape.second_ratio[i])
        points += [
            ModePoint(
                speed=float(speed),
                frequency_hz=float(shape.frequency_hz[i]),
                second_frequency_hz=second,
                second_decay=decay,
                yaw_ratio=complex(shape.ratio[i, j]),
                second_yaw_ratio=ratio,
                amplitude=float(amplitude),
                yaw_ratio_std=float(shape.ratio_std[i, j]),
                second_std=doubt,
            )
            for j, amplitude in enumerate(shape.amplitudes)
        ]
    return tuple(points)


def line_search(config: DetectorConfig) -> LineSearch:
    """Return the search for motion outside the range that is tracked."""
    rate = 1e9 / config.period_ns
    high = min(config.hunting_frequency_max_hz, 0.3 * rate)
    low = min(config.hunting_frequency_min_hz, 0.5 * high)
    orders = [order for shaft in shafts(config) for order in shaft.orders]
    return LineSearch(rate, low, high, orders)


class Turning:
    """How fast the roller turns, row by row."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget every row."""
        self._memory = np.array([math.nan, math.nan])
        self._last_ns = 0

    def update(
        self, rows_ns: NDArray[np.int64], angle: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return turns per second at rows, NaN where unknown; angle in rad or NaN."""
        turning = np.full(rows_ns.size, math.nan)
        if rows_ns.size:
            seconds = np.diff(rows_ns, prepend=self._last_ns) * 1e-9
            self._last_ns = int(rows_ns[-1])
            _count_turns(seconds, angle, self._memory, turning)
        return turning


@compiled
def _count_turns(
    seconds: NDArray[np.float64],
    angle: NDArray[np.float64],
    memory: NDArray[np.float64],
    turning: NDArray[np.float64],
) -> None:
    for i in range(angle.size):
        last, mean = memory[0], memory[1]
        memory[0] = angle[i]
        if not (math.isfinite(angle[i] - last) and seconds[i] > 0.0):
            memory[1] = math.nan
            continue
        turns = abs(angle[i] - last) / (2.0 * math.pi * seconds[i])
        if math.isnan(mean):
            mean = turns
        mean += min(seconds[i] / _TURNING_S, 1.0) * (turns - mean)
        memory[1] = mean
        turning[i] = mean


class JudgedChannel:
    """
    Which coordinate the decisions judge: lateral, or yaw while lateral is not measured.

    What yaw tells of the lateral motion, through a mode shape or the ratio seen before, counts
    as lateral where there is a form to compare it with. Without, yaw itself is known better:
    it is judged once lateral has been missing for a second, until lateral is measured again.

    Parameters
    ----------
    config : DetectorConfig

    Attributes
    ----------
    compared : bool
        There is a normal form, in metres.
    """

    def __init__(self, config: DetectorConfig) -> None:
        self._patience = round(1e9 / config.period_ns) if config.measures('lateral') else 0
        self.compared = False
        self.reset()

    def reset(self) -> None:
        """Forget every row."""
        self._channel = 'lateral'
        self._waited = 0

    def stretches(self, rows: NDArray[np.void]) -> list[tuple[int, int, str]]:
        """Return (begin, end, channel) for the rows of ESTIMATE_DTYPE, in order."""
        lateral = np.isfinite(rows['lateral_amplitude'])
        if not self.compared:
            lateral &= (rows['doubts'] & doubts.FROM_YAW) == 0
        if not rows.size or (lateral.all() and self._channel == 'lateral'):
            self._waited = 0
            return [(0, rows.size, 'lateral')]
        parts: list[tuple[int, int, str]] = []
        yaw = np.isfinite(rows['yaw_amplitude'])
        for k in range(rows.size):
            if lateral[k]:
                self._channel, self._waited = 'lateral', 0
            elif yaw[k]:
                self._waited += 1
                if self._waited > self._patience:
                    self._channel = 'yaw'
            if parts and parts[-1][2] == self._channel:
                parts[-1] = parts[-1][0], k + 1, self._channel
            else:
                parts.append((k, k + 1, self._channel))
        return parts
