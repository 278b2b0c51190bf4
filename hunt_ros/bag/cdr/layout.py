"""
Where a field lies in a serialised message (CDR, little or big endian).

The place of a field depends on the lengths of the strings and sequences before it.
`locate` walks one message and notes every such length on the way; another message
has the field at the same place if and only if it has the same lengths there, which
can be checked for a million messages at once.

Source: OMG CDR (formal/02-06-51, 15.3) as Fast CDR applies it to ROS 2: alignment
counts from behind the four bytes of encapsulation, and an empty sequence is not
padded to its elements.
"""

from __future__ import annotations

import re
import struct
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype

from hunt_ros.bag.cdr.message_types import Definitions
from hunt_ros.sensors import JOINT_STATE, TWIST_STAMPED

FieldPath = tuple[str | int, ...]

#: A type as rosbags describes it: (node type, detail); the detail's form follows the node type.
Node = tuple[Any, Any]

#: numpy kinds of the primitive types, without byte order.
KINDS: dict[str, str] = {
    'bool': 'u1', 'byte': 'u1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1',
    'int16': 'i2', 'uint16': 'u2', 'int32': 'i4', 'uint32': 'u4',
    'int64': 'i8', 'uint64': 'u8', 'float32': 'f4', 'float64': 'f8',
}  # fmt: skip


#: The field meant when a mapping names only a topic, where there are several; of a JointState,
#: first the joint that is named as the channel.
USUAL_FIELDS: dict[str, str] = {
    JOINT_STATE: 'position[0]',
    TWIST_STAMPED: 'twist.linear.x',
    'geometry_msgs/msg/Twist': 'linear.x',
    'geometry_msgs/msg/Vector3Stamped': 'vector.x',
    'geometry_msgs/msg/Vector3': 'x',
    'geometry_msgs/msg/PointStamped': 'point.x',
}

_STEP = re.compile(r'\.?([A-Za-z_]\w*)|\[(\d+)\]')
_JOINT = re.compile(r'^(position|velocity|effort)\[([^\W\d][^\[\]]*)\]$')


class FieldPlace(NamedTuple):
    """
    Where a field lies in messages of one layout.

    `offset` counts from the start of the message, encapsulation included, and `size` is that
    of the field, bytes; `kind` is its numpy type with byte order, such as '<f8'; `lengths` are
    (offset, value) of every 32-bit length on the way to it.
    """

    offset: int
    kind: str
    size: int
    lengths: tuple[tuple[int, int], ...]


def parse_path(text: str) -> FieldPath:
    """
    Split `linear_acceleration.y` or `data[3]` into its steps.

    Raises
    ------
    ValueError
        If it is not such a path.
    """
    steps: list[str | int] = []
    position = 0
    while position < len(text):
        match = _STEP.match(text, position)
        if match is None or (position == 0 and text[0] in '.['):
            raise ValueError(f'{text!r} is no field path, expected for example data[3]')
        steps.append(match[1] if match[1] is not None else int(match[2]))
        position = match.end()
    return tuple(steps)


def joint_of(text: str) -> tuple[str, str] | None:
    """Return (field, joint) of a path such as `position[lateral]`, or None for another path."""
    match = _JOINT.match(text)
    return (match[1], match[2]) if match else None


def stamp_path(definitions: Definitions, message_type: str) -> FieldPath | None:
    """Return the path of the message's own stamp (of its header), or None without one."""
    for name, (node, detail) in definitions.get(message_type, ()):
        if node == Nodetype.NAME and detail == 'std_msgs/msg/Header' and name == 'header':
            return ('header', 'stamp')
        if node == Nodetype.NAME and detail == 'builtin_interfaces/msg/Time' and name == 'stamp':
            return ('stamp',)
    return None


def usual_field(definitions: Definitions, message_type: str) -> str:
    """Return the path of the field that is meant where none is named: the only number; '' else."""
    if message_type in USUAL_FIELDS:
        return USUAL_FIELDS[message_type]
    numbers = [
        name
        for name, (node, detail) in definitions.get(message_type, ())
        if node == Nodetype.BASE and detail[0] in KINDS
    ]
    return numbers[0] if len(numbers) == 1 else ''


class PathError(ValueError):
    """A path that leads to no number, whatever the message."""


def locate(
    definitions: Definitions, message_type: str, message: bytes, path: FieldPath
) -> FieldPlace:
    """
    Walk one message to a field.

    Parameters
    ----------
    definitions, message_type
        What the message is made of.
    message : bytes
        With its encapsulation.
    path : tuple
        As `parse_path` gives it.

    Raises
    ------
    ValueError
        If the message has no such element, or is no message of this type; `PathError` naming
        the fields there are, where the path leads to no number.
    """
    walker = _Walker(definitions, message)
    try:
        return walker.find((Nodetype.NAME, message_type), path)
    except (struct.error, RecursionError, KeyError) as error:
        reason = f'{type(error).__name__}: {error}'
        raise ValueError(f'the message is not as its type says ({reason})') from error


def extent(
    definitions: Definitions, message_type: str, message: bytes
) -> tuple[int, list[tuple[int, int]]]:
    """
    Return where a message ends, and (offset, value) of every length in it.

    A publisher may have sent more, as hunt_ros 0.2 did.
    """
    walker = _Walker(definitions, message)
    walker.skip((Nodetype.NAME, message_type))
    return walker.position, walker.lengths


def _show(path: FieldPath) -> str:
    text = ''.join(f'[{step}]' if isinstance(step, int) else f'.{step}' for step in path)
    return text.lstrip('.')


class _Walker:
    """
    Walks over a message, and remembers the lengths it passed.

    Every method raises `ValueError`, `struct.error`, `KeyError` or `RecursionError` where the
    message does not hold what its type says, or does not begin as CDR does.
    """

    def __init__(self, definitions: Definitions, message: bytes) -> None:
        if len(message) < 4 or message[0] != 0 or message[1] not in (0, 1):
            raise ValueError('it does not begin as a CDR message does')
        self.definitions = definitions
        self.message = message
        self.order = '<' if message[1] else '>'
        self.position = 4
        self.lengths: list[tuple[int, int]] = []
        self._u32 = struct.Struct(self.order + 'I')

    def find(self, node: Node, path: FieldPath) -> FieldPlace:
        """Return the place of the field that a path leads to."""
        for number, step in enumerate(path):
            done = _show(path[:number]) or 'the message'
            kind, detail = node
            if kind == Nodetype.BASE:
                raise PathError(f'{done} is a {detail[0]}, there is no {step!r} in it')
            if kind == Nodetype.NAME:
                fields = dict(self.definitions[str(detail)])
                if step not in fields:
                    raise PathError(f'no field {step!r} in {done}, expected one of {list(fields)}')
                for name, node in fields.items():
                    if name == step:
                        break
                    self.skip(node)
                continue
            node, count = detail
            if not isinstance(step, int):
                raise PathError(f'{done} is an array, expected an element such as {done}[0]')
            if kind == Nodetype.SEQUENCE:
                count = self.length()
            if step >= count:
                raise ValueError(f'{done} has {count} elements, there is no [{step}]')
            self.skip_many(node, step)
        kind, detail = node
        where = _show(path) or 'the message'
        if kind == Nodetype.NAME:
            names = [name for name, _ in self.definitions[str(detail)]]
            raise PathError(f'{where} is not a number, expected one of its fields {names}')
        if kind != Nodetype.BASE:
            raise PathError(f'{where} is an array, expected an element such as {where}[0]')
        if detail[0] not in KINDS:
            raise PathError(f'{where} is a {detail[0]}, expected a number')
        size = int(KINDS[detail[0]][1])
        self.align(size)
        if self.position + size > len(self.message):
            raise ValueError('the message ends before the field')
        return FieldPlace(self.position, self.order + KINDS[detail[0]], size, tuple(self.lengths))

    def align(self, size: int) -> None:
        """Move on to a multiple of `size`."""
        self.position += -(self.position - 4) % size

    def length(self) -> int:
        """Read a length, and remember it."""
        self.align(4)
        (value,) = self._u32.unpack_from(self.message, self.position)
        self.lengths.append((self.position, value))
        self.position += 4
        return int(value)

    def skip(self, node: Node) -> None:
        """Move behind a field."""
        kind, detail = node
        if kind == Nodetype.NAME:
            for _, inner in self.definitions[str(detail)]:
                self.skip(inner)
        elif kind == Nodetype.BASE:
            self.skip_many(node, 1)
        else:
            inner, count = detail
            self.skip_many(inner, self.length() if kind == Nodetype.SEQUENCE else count)

    def skip_many(self, node: Node, count: int) -> None:
        """Move behind `count` elements."""
        # Every element takes a byte at least: a longer claim is damage, not a message.
        if count > len(self.message):
            raise ValueError(f'it claims {count} elements in {len(self.message)} bytes')
        kind, detail = node
        if kind == Nodetype.BASE and detail[0] in KINDS:
            if count:
                size = int(KINDS[detail[0]][1])
                self.align(size)
                self.position += count * size
        elif kind == Nodetype.BASE:
            if detail[0] != 'string':
                raise ValueError(f'a field of type {detail[0]} cannot be passed')
            for _ in range(count):
                length = self.length()  # moves the position itself
                self.position += length
        else:
            for _ in range(count):
                self.skip(node)
        if self.position > len(self.message):
            raise ValueError('the message ends before the field')
