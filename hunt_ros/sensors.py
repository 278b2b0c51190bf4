"""
The sensors of the motion: what each measures, and by what name and unit it goes everywhere.

The wheelset moves in two coordinates, lateral and yaw; amplitudes are told of these. A sensor
measures one of them, or its first or second derivative in time. `SENSORS` is the one table:
the channels of a rig, the settings, the tracker's measurement rows, the watch over the channels,
the topics and the columns of files follow from it.

To add a sensor, add a line. The detector uses it where its setting `channels` names it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

#: The coordinates of the motion; a sensor's `coordinate` is one of them.
COORDINATES: tuple[str, ...] = ('lateral', 'yaw')

_LENGTHS = {'m': 1.0, 'mm': 1e-3, 'um': 1e-6}
#: Endings of names that tell the unit of an angle: to SI.
ANGLES = {'rad': 1.0, 'mrad': 1e-3, 'deg': math.pi / 180.0}
STANDARD_GRAVITY = 9.80665  # m/s^2
_ACCELERATIONS = {'mps2': 1.0, 'g': STANDARD_GRAVITY, 'mg': 1e-3 * STANDARD_GRAVITY}
#: Readings within this share of the end of a range are at it: converters end a step before.
_AT_END = 1e-3


@dataclass(frozen=True)
class MotionSensor:
    """
    One sensor of the motion.

    Parameters
    ----------
    name : str
        Its channel, its topic (a JointState) and the joint in it.
    coordinate : str
        What it measures, one of `COORDINATES`.
    derivative : int
        0: the coordinate itself; 1: its velocity; 2: its acceleration.
    unit : str
        SI, as it is written.
    units : mapping of str to float
        Endings of names that tell the unit of a column, and what makes SI of it; the first is SI.
    largest : float
        Usual values are smaller, SI: what is larger was recorded in another unit.
    mistaken : str
        The factor that makes SI of the unit it is likely to have been recorded in.
    cost : str
        What it costs to do without it.
    usual : bool
        A rig has it, unless the settings say otherwise.
    """

    name: str
    coordinate: str
    derivative: int
    unit: str
    units: Mapping[str, float]
    largest: float
    mistaken: str
    cost: str
    usual: bool = True


SENSORS: tuple[MotionSensor, ...] = (
    MotionSensor(
        'lateral',
        'lateral',
        0,
        'm',
        _LENGTHS,
        0.1,  # flanges leave a wheelset some mm, and a model or a wing moves by less than this
        '*0.001',
        'the lateral amplitude is that of yaw through the mode shape, or unknown',
    ),
    MotionSensor(
        'yaw',
        'yaw',
        0,
        'rad',
        ANGLES,
        1.6,
        '*0.0174533',
        'nothing stands in for the lateral sensor when it fails',
    ),
    MotionSensor(
        'axle_box',
        'lateral',
        2,
        'm/s2',
        _ACCELERATIONS,
        500.0,
        f'*{STANDARD_GRAVITY}',
        'the lateral amplitude is told by the other sensors alone',
        usual=False,
    ),
)


#: Channel -> endings of column names that tell its unit: to SI; the first is SI.
UNITS: dict[str, Mapping[str, float]] = {
    **{sensor.name: sensor.units for sensor in SENSORS},
    'roller': ANGLES,
    'speed': {'mps': 1.0, 'kmh': 1.0 / 3.6},
}


def si_of(channel: str) -> str:
    """Return the SI unit of a channel as names of columns and settings end in it: `mps`."""
    return next(iter(UNITS[channel]))


def sensors_of(coordinate: str) -> tuple[str, ...]:
    """Return the names of the sensors that measure a coordinate."""
    return tuple(sensor.name for sensor in SENSORS if sensor.coordinate == coordinate)


def saturated_from(settings: object, channel: str) -> float:
    """
    Return the size from which on the readings of a channel are saturated, SI; 0: not known.

    Parameters
    ----------
    settings : object
        Whose attribute `lateral_range_m`, `yaw_range_rad`, ..., gives the end of the range, both
        ways; 0 or absent: not known.
    channel : str
        Any of a rig.
    """
    full = float(getattr(settings, f'{channel}_range_{si_of(channel)}', 0.0))
    return (1.0 - _AT_END) * full


#: Their names, in the order of the table.
MOTION: tuple[str, ...] = tuple(sensor.name for sensor in SENSORS)
JOINT_STATE, TWIST_STAMPED = 'sensor_msgs/msg/JointState', 'geometry_msgs/msg/TwistStamped'
#: Type and field of the messages of each channel of a rig.
CHANNEL_FIELDS: dict[str, tuple[str, str]] = {
    **dict.fromkeys((*MOTION, 'roller'), (JOINT_STATE, 'position[0]')),
    'speed': (TWIST_STAMPED, 'twist.linear.x'),
}
#: Those that measure a coordinate itself. One of them at least is needed: the second opinion, the
#: criteria and the forecast work on a displacement, and an acceleration shows what is fast many
#: times larger.
DISPLACEMENTS: tuple[str, ...] = tuple(s.name for s in SENSORS if s.derivative == 0)

#: What the motion of a rig cannot be judged without: one of each.
NEEDED: tuple[tuple[str, ...], ...] = (('speed',), DISPLACEMENTS)


def lacking(channels: Collection[str]) -> list[tuple[str, ...]]:
    """Return what is needed and is not among these channels: of each tuple one would do."""
    return [either for either in NEEDED if not set(either) & set(channels)]
