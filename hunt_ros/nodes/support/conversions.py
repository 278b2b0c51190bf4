"""Between ROS messages and numbers: the only place where a message is taken apart or built."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TwistStamped
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from hunt_ros.samples import NANOSECONDS, as_text
from hunt_ros.sensors import CHANNEL_FIELDS, TWIST_STAMPED

#: Level of the design -> level of diagnostic_msgs.
LEVELS: dict[str, bytes] = {
    'OK': DiagnosticStatus.OK,
    'WARN': DiagnosticStatus.WARN,
    'ERROR': DiagnosticStatus.ERROR,
    'STALE': DiagnosticStatus.STALE,
}
_NAMES = {level: name for name, level in LEVELS.items()}


def to_time(stamp_ns: int) -> Time:
    """Return a stamp in ns as a message."""
    seconds, nanoseconds = divmod(int(stamp_ns), NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)


def to_ns(stamp: Time) -> int:
    """Return a message's stamp in ns."""
    return stamp.sec * NANOSECONDS + stamp.nanosec


class FixedLayout:
    """
    A message type whose bytes on the wire differ in the stamp and a few float64 only.

    While every message of a topic has the same frame and names, as it has from one
    publisher, a message is read by comparing the constant bytes and unpacking the
    rest, which costs a tenth of a deserialisation. What does not compare is
    deserialised.

    Parameters
    ----------
    wire : bytes
        One serialised message (CDR, little-endian, header first).
    offsets : sequence of int
        Where the float64 values stand in it.
    """

    def __init__(self, wire: bytes, offsets: Sequence[int]) -> None:
        self._template = bytearray(wire)
        self._offsets = tuple(offsets)
        constant = bytearray(wire)
        for start, size in ((4, 8), *((offset, 8) for offset in self._offsets)):
            constant[start : start + size] = bytes(size)
        self._constant = bytes(constant)

    def encode(self, stamp_ns: int, *values: float) -> bytes:
        """Return the wire bytes of a message with this stamp and these values."""
        wire = self._template
        struct.pack_into('<iI', wire, 4, *divmod(stamp_ns, NANOSECONDS))
        for offset, value in zip(self._offsets, values, strict=True):
            struct.pack_into('<d', wire, offset, value)
        return bytes(wire)

    def decode(self, wire: bytes) -> tuple[int, list[float]] | None:
        """Return (stamp in ns, values), or None where the layout is another."""
        if len(wire) != len(self._constant):
            return None
        rest = bytearray(wire)
        rest[4:12] = bytes(8)
        values: list[float] = []
        for offset in self._offsets:
            values += struct.unpack_from('<d', wire, offset)
            rest[offset : offset + 8] = bytes(8)
        if rest != self._constant:
            return None
        seconds, nanoseconds = struct.unpack_from('<iI', wire, 4)
        return seconds * NANOSECONDS + nanoseconds, values


def _mark(number: int) -> float:
    """Return a value that stands for one of a layout until its place is known."""
    return -1.2345678901234567e-299 * (number + 1)


def _layout(message: JointState | TwistStamped, count: int) -> FixedLayout:
    """Return the layout of a message in which the first `count` marks stand."""
    wire = serialize_message(message)
    places = [wire.index(struct.pack('<d', _mark(number))) for number in range(count)]
    return FixedLayout(wire, places)


def joint_layout(
    names: Sequence[str], frame: str, velocity: bool = False, effort: bool = False
) -> FixedLayout:
    """
    Layout of a JointState: positions of its joints, then velocities and efforts if wanted.

    Parameters
    ----------
    names : sequence of str
        Joints.
    frame : str
        frame_id.
    velocity, effort : bool
        Whether it carries them.
    """
    count = len(names)
    marks = [_mark(number) for number in range(count * (1 + velocity + effort))]
    message = JointState(name=list(names), position=marks[:count])
    message.velocity = marks[count : count * (1 + velocity)]
    message.effort = marks[count * (1 + velocity) :]
    message.header.frame_id = frame
    return _layout(message, len(marks))


def twist_layout(frame: str) -> FixedLayout:
    """Layout of a TwistStamped (6 values, linear before angular)."""
    message = TwistStamped()
    message.header.frame_id = frame
    for number, axis in enumerate('xyz'):
        setattr(message.twist.linear, axis, _mark(number))
        setattr(message.twist.angular, axis, _mark(number + 3))
    return _layout(message, 6)


class JointReader:
    """
    Reads raw JointState messages of one joint, whatever else they carry.

    Parameters
    ----------
    name : str
        The joint to read; a message without it gives None.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._layout: FixedLayout | None = None

    def read(self, wire: bytes) -> tuple[int, float] | None:
        """Return (stamp in ns, position), or None where the joint is not in the message."""
        if self._layout is not None:
            found = self._layout.decode(wire)
            if found is not None:
                return found[0], found[1][0]
        message = deserialize_message(wire, JointState)
        if self._name not in message.name:
            return None
        index = message.name.index(self._name)
        if index >= len(message.position):
            return None
        if len(message.name) == 1:
            self._learn(message, wire)
        return to_ns(message.header.stamp), message.position[index]

    def _learn(self, message: JointState, wire: bytes) -> None:
        """Take the layout of this message for the next ones, if the bytes confirm it."""
        if len(message.effort) or len(message.velocity) > 1:
            return
        moving = bool(len(message.velocity))
        layout = joint_layout([self._name], message.header.frame_id, moving)
        values = [message.position[0], *message.velocity]
        confirmed = layout.encode(to_ns(message.header.stamp), *values) == wire
        self._layout = layout if confirmed else None


class SpeedReader:
    """Reads raw TwistStamped messages: the running speed in linear.x."""

    def __init__(self) -> None:
        self._layout: FixedLayout | None = None

    def read(self, wire: bytes) -> tuple[int, float]:
        """Return (stamp in ns, speed in m/s)."""
        if self._layout is not None:
            found = self._layout.decode(wire)
            if found is not None:
                return found[0], found[1][0]
        message = deserialize_message(wire, TwistStamped)
        self._layout = twist_layout(message.header.frame_id)
        return to_ns(message.header.stamp), message.twist.linear.x


def channel_reader(channel: str) -> tuple[type, JointReader | SpeedReader]:
    """Return the class of the messages of a channel, and what reads one."""
    if CHANNEL_FIELDS[channel][0] == TWIST_STAMPED:
        return TwistStamped, SpeedReader()
    return JointState, JointReader(channel)


def channel_writer(channel: str, frame: str) -> tuple[type, Callable[[int, float], bytes]]:
    """Return the class of the messages of a channel, and what makes one of stamp and value."""
    if CHANNEL_FIELDS[channel][0] == TWIST_STAMPED:
        layout = twist_layout(frame)
        return TwistStamped, lambda stamp_ns, value: layout.encode(stamp_ns, value, *(5 * [0.0]))
    return JointState, joint_layout([channel], frame).encode


def twist(stamp_ns: int, speed_mps: float, frame: str = '') -> TwistStamped:
    """Return a running speed, m/s, as a TwistStamped."""
    message = TwistStamped()
    message.header.stamp = to_time(stamp_ns)
    message.header.frame_id = frame
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
    if not message.status:
        return {}
    status = message.status[0]
    texts = {'level': _NAMES.get(status.level, 'STALE'), 'name': status.name}
    texts['message'] = status.message
    texts |= {pair.key: pair.value for pair in status.values}
    return texts
