"""Between ROS messages and numbers: the only place where a message is taken apart or built."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TwistStamped
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from hunt_ros.drivers.interlock import Heard
from hunt_ros.dynamics.profile import Motion
from hunt_ros.samples import NANOSECONDS, as_text, number_of
from hunt_ros.sensors import CHANNEL_FIELDS, JOINT_STATE, TWIST_STAMPED

#: frame_id of all messages.
_FRAME = 'roller_rig'
#: Level of the design -> level of diagnostic_msgs.
LEVELS: dict[str, bytes] = {
    'OK': DiagnosticStatus.OK,
    'WARN': DiagnosticStatus.WARN,
    'ERROR': DiagnosticStatus.ERROR,
    'STALE': DiagnosticStatus.STALE,
}
#: Values of the detector's status that are the fields of `Motion`, in their order.
_MOTION = (
    *('amplitude_m', 'v_n_mps', 'v_c_mps', 'fold_amplitude_m', 'held_speed_mps', 'held_s'),
    *('held_margin', 'held_escape_chance', 'forecast_v_c_low_mps'),
)
_NAMES = {level: name for name, level in LEVELS.items()}


def to_time(stamp_ns: int) -> Time:
    """Return a stamp in ns as a message."""
    seconds, nanoseconds = divmod(int(stamp_ns), NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)


def to_ns(stamp: Time) -> int:
    """Return a message's stamp in ns."""
    return stamp.sec * NANOSECONDS + stamp.nanosec


def message_class(kind: str) -> type[Any] | None:
    """Import a message type by its name; None where its package is not installed."""
    package, _, name = kind.partition('/msg/')
    try:
        found: type[Any] = getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None
    return found


def _mark(number: int) -> float:
    """Return a value that stands for one of a message until its place on the wire is known."""
    return -1.2345678901234567e-299 * (number + 1)


def _place(wire: bytes | bytearray, number: int) -> int:
    return wire.index(struct.pack('<d', _mark(number)))


def joint_writer(
    names: Sequence[str], velocity: bool = False, effort: bool = False
) -> Callable[..., bytes]:
    """
    Return what makes the wire bytes of a JointState of stamp (ns) and values.

    Messages of one publisher differ in these only: they are put into a copy of the first one,
    at a tenth of the cost of serialising.

    Parameters
    ----------
    names : sequence of str
        Joints: their positions are the first values, then come velocities and efforts.
    velocity, effort : bool
        Whether the messages carry them.
    """
    count = len(names)
    marks = [_mark(number) for number in range(count * (1 + velocity + effort))]
    message = JointState(name=list(names), position=marks[:count])
    message.velocity = marks[count : count * (1 + velocity)]
    message.effort = marks[count * (1 + velocity) :]
    message.header.frame_id = _FRAME
    wire = bytearray(serialize_message(message))
    places = [_place(wire, number) for number in range(len(marks))]
    # Behind the last number stand the counts of what it does not carry; then what the middleware
    # has left of its estimate, which strict readers take for damage.
    del wire[places[-1] + 8 + (0 if effort else 4 if velocity else 8) :]

    def written(stamp_ns: int, *values: float) -> bytes:
        """Put stamp and values in."""
        struct.pack_into('<iI', wire, 4, *divmod(stamp_ns, NANOSECONDS))
        for place, value in zip(places, values, strict=True):
            struct.pack_into('<d', wire, place, value)
        return bytes(wire)

    return written


class ChannelReader:
    """
    Reads the raw messages of a channel: a joint's position, or the running speed.

    A value stands where it stood before as long as the bytes between it and the stamp are the
    same: frame, names and counts. Such a message is not deserialised.

    Parameters
    ----------
    channel : str
        Its topic; of a JointState also the joint, whatever other joints there are.

    Attributes
    ----------
    kind : type
        Class of the messages.
    """

    def __init__(self, channel: str) -> None:
        kind, _ = CHANNEL_FIELDS.get(channel, (JOINT_STATE, ''))
        self.kind = TwistStamped if kind == TWIST_STAMPED else JointState
        self._joint = channel
        self._same, self._place = b'?', 12  # behind encapsulation and stamp

    def read(self, wire: bytes) -> tuple[int, float] | None:
        """Return (stamp in ns, value); None where it is no message, or the joint is not in it."""
        try:
            if wire[12 : self._place] != self._same:
                return self._learn(wire)
            seconds, nanoseconds = struct.unpack_from('<iI', wire, 4)
            value: float = struct.unpack_from('<d', wire, self._place)[0]
        except (RuntimeError, struct.error):  # bytes of anybody: ROS does not read them either
            return None
        return seconds * NANOSECONDS + nanoseconds, value

    def _learn(self, wire: bytes) -> tuple[int, float] | None:
        message = deserialize_message(wire, self.kind)
        if self.kind is JointState:
            if self._joint not in message.name[: len(message.position)]:
                return None
            index = message.name.index(self._joint)
            value, message.position[index] = message.position[index], _mark(0)
        else:
            value, message.twist.linear.x = message.twist.linear.x, _mark(0)
        self._place = _place(serialize_message(message), 0)
        # As it came: between the fields stand bytes without meaning, other ones of each publisher.
        self._same = wire[12 : self._place]
        return to_ns(message.header.stamp), value


def twist(stamp_ns: int, speed_mps: float) -> TwistStamped:
    """Return a running speed, m/s, as a TwistStamped."""
    message = TwistStamped()
    message.header.stamp = to_time(stamp_ns)
    message.header.frame_id = _FRAME
    message.twist.linear.x = float(speed_mps)
    return message


def diagnostic(
    stamp_ns: int,
    name: str,
    level: str,
    text: str,
    values: Mapping[str, object],
    hardware: str,
) -> DiagnosticArray:
    """
    Return one status as a DiagnosticArray.

    Parameters
    ----------
    stamp_ns : int
        Header stamp, ns.
    name, text : str
        Whose status, and one line on it.
    level : str
        One of `LEVELS`.
    values : mapping
        Shown as text, see `as_text`.
    hardware : str
        hardware_id: what the status is about.
    """
    status = DiagnosticStatus(level=LEVELS[level], name=name, message=text, hardware_id=hardware)
    status.values = [KeyValue(key=key, value=as_text(value)) for key, value in values.items()]
    array = DiagnosticArray(status=[status])
    array.header.stamp = to_time(stamp_ns)
    return array


def read_diagnostic(message: DiagnosticArray) -> dict[str, str]:
    """Return the first status of an array as texts: level, name, message, and its values."""
    status = message.status[0] if message.status else DiagnosticStatus(level=LEVELS['STALE'])
    texts = {'level': _NAMES.get(status.level, 'STALE'), 'name': status.name}
    texts['message'] = status.message
    texts |= {pair.key: pair.value for pair in status.values}
    return texts


def heard_of(message: DiagnosticArray) -> Heard:
    """Return what a message of the detector says; what is no number is not known."""
    said = read_diagnostic(message)
    motion = Motion(*(number_of(said, name) for name in _MOTION))
    sequence = said.get('sequence', '')
    return Heard(
        said.get('level', 'STALE'),
        int(sequence[:18]) if sequence.isdecimal() else 0,
        to_ns(message.header.stamp),
        said.get('message', ''),
        number_of(said, 'envelope_m'),
        motion,
        said.get('alarm') == 'True',
        said.get('state') in ('escaping', 'limit_cycle'),
        number_of(said, 'noise_floor_m'),
        said.get('undecided') == 'True',
        number_of(said, 'frequency_hz'),
    )
