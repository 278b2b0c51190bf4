"""Between ROS messages and numbers: the only place where a message is taken apart or built."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TwistStamped, Vector3Stamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from hunt_ros.samples import NANOSECONDS

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
        values = []
        for offset in self._offsets:
            values += struct.unpack_from('<d', wire, offset)
            rest[offset : offset + 8] = bytes(8)
        if rest != self._constant:
            return None
        seconds, nanoseconds = struct.unpack_from('<iI', wire, 4)
        return seconds * NANOSECONDS + nanoseconds, values


def _aligned(offset: int, size: int) -> int:
    """Next offset of CDR for a number of `size` bytes; the 4-byte prefix does not count."""
    return 4 + -(-(offset - 4) // size) * size


def joint_layout(name: str, frame: str, velocity: bool = False) -> FixedLayout:
    """
    Layout of a JointState of one joint: position, and velocity if wanted.

    Parameters
    ----------
    name, frame : str
        Joint name and frame_id.
    velocity : bool
        Whether it carries a velocity.
    """
    wire = bytearray(b'\x00\x01\x00\x00' + bytes(8))

    def number(value: int) -> None:
        wire.extend(bytes(_aligned(len(wire), 4) - len(wire)) + struct.pack('<I', value))

    def text(value: str) -> None:
        raw = value.encode() + b'\x00'
        number(len(raw))
        wire.extend(raw)

    def values(count: int) -> None:
        number(count)
        if count:
            wire.extend(bytes(_aligned(len(wire), 8) - len(wire)))
            offsets.append(len(wire))
            wire.extend(bytes(8))

    offsets: list[int] = []
    text(frame)
    number(1)
    text(name)
    values(1)
    values(int(velocity))
    values(0)
    return FixedLayout(bytes(wire), offsets)


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
        layout = joint_layout(self._name, message.header.frame_id, bool(len(message.velocity)))
        stamp = to_ns(message.header.stamp)
        values = [message.position[0], *list(message.velocity)[:1]]
        self._layout = layout if layout.encode(stamp, *values) == wire else None


def joint_state(
    stamp_ns: int,
    names: Sequence[str],
    positions: Sequence[float],
    velocities: Sequence[float] = (),
    frame: str = '',
) -> JointState:
    """Return a JointState message."""
    message = JointState(name=list(names), position=list(positions), velocity=list(velocities))
    message.header.stamp = to_time(stamp_ns)
    message.header.frame_id = frame
    return message


def twist(stamp_ns: int, speed_mps: float, frame: str = '') -> TwistStamped:
    """Return a running speed, m/s, as a TwistStamped."""
    message = TwistStamped()
    message.header.stamp = to_time(stamp_ns)
    message.header.frame_id = frame
    message.twist.linear.x = float(speed_mps)
    return message


def number(stamp_ns: int, value: float) -> Vector3Stamped:
    """Return a single number as a Vector3Stamped, in x."""
    message = Vector3Stamped()
    message.header.stamp = to_time(stamp_ns)
    message.vector.x = float(value)
    return message


def diagnostic(
    stamp_ns: int, name: str, level: str, text: str, values: Mapping[str, object]
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
        Shown as text; floats with the digits that make them exact.
    """
    status = DiagnosticStatus(level=LEVELS[level], name=name, message=text)
    status.values = [KeyValue(key=key, value=_shown(value)) for key, value in values.items()]
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


def _shown(value: object) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)
