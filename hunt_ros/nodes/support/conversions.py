"""Between ROS messages and numbers: the only place where a message is taken apart or built."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TwistStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from hunt_ros.samples import NANOSECONDS, as_text

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


class _Wire:
    """Builds the CDR bytes of a message with a header, field by field."""

    def __init__(self, frame: str) -> None:
        self.data = bytearray(b'\x00\x01\x00\x00' + bytes(8))
        self.offsets: list[int] = []
        self.text(frame)

    def number(self, value: int) -> None:
        self._align(4)
        self.data += struct.pack('<I', value)

    def text(self, value: str) -> None:
        raw = value.encode() + b'\x00'
        self.number(len(raw))
        self.data += raw

    def floats(self, count: int) -> None:
        for _ in range(count):
            self._align(8)
            self.offsets.append(len(self.data))
            self.data += bytes(8)

    def layout(self) -> FixedLayout:
        return FixedLayout(bytes(self.data), self.offsets)

    def _align(self, size: int) -> None:
        """Pad to a multiple of `size`; the 4-byte prefix does not count."""
        self.data += bytes(-(len(self.data) - 4) % size)


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
    wire = _Wire(frame)
    wire.number(len(names))
    for name in names:
        wire.text(name)
    for count in (len(names), len(names) * velocity, len(names) * effort):
        wire.number(count)
        wire.floats(count)
    return wire.layout()


def twist_layout(frame: str) -> FixedLayout:
    """Layout of a TwistStamped (6 values, linear before angular)."""
    wire = _Wire(frame)
    wire.floats(6)
    return wire.layout()


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
