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

#: Messages are not nested deeper than this.
DEEPEST = 16

#: The field meant when a mapping names only a topic; of a JointState, first the joint that
#: is named as the channel.
USUAL_FIELDS: dict[str, str] = {
    JOINT_STATE: 'position[0]',
    TWIST_STAMPED: 'twist.linear.x',
    'geometry_msgs/msg/Twist': 'linear.x',
    'geometry_msgs/msg/Vector3Stamped': 'vector.x',
    'geometry_msgs/msg/Vector3': 'x',
    'geometry_msgs/msg/PointStamped': 'point.x',
}
USUAL_FIELDS |= {
    f'std_msgs/msg/{name}': 'data'
    for name in ('Float32', 'Float64', 'Int8', 'Int16', 'Int32', 'Int64', 'UInt8', 'UInt16',
                 'UInt32', 'UInt64', 'Bool')
}  # fmt: skip

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


def check_path(definitions: Definitions, message_type: str, path: FieldPath) -> None:
    """
    Check that a path leads to a number in messages of a type, whatever their lengths.

    Raises
    ------
    ValueError
        Naming the fields there are where the path goes wrong.
    """
    node: Node = (Nodetype.NAME, message_type)
    for number, step in enumerate(path):
        done = _show(path[:number]) or message_type
        kind, detail = node
        if kind == Nodetype.NAME and isinstance(step, str):
            fields = dict(definitions.get(detail, ()))
            if step not in fields:
                raise ValueError(f'no field {step!r} in {done}, expected one of {list(fields)}')
            node = fields[step]
        elif kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) and isinstance(step, int):
            if kind == Nodetype.ARRAY and step >= detail[1]:
                raise ValueError(f'{done} has {detail[1]} elements, there is no [{step}]')
            node = detail[0]
        elif isinstance(step, int):
            raise ValueError(f'{done} is not an array, there is no [{step}]')
        else:
            raise ValueError(f'{done} has no fields, there is no {step!r}')
    kind, detail = node
    where = _show(path) or message_type
    if kind == Nodetype.NAME:
        names = [name for name, _ in definitions.get(detail, ())]
        raise ValueError(f'{where} is not a number, expected one of its fields {names}')
    if kind != Nodetype.BASE:
        raise ValueError(f'{where} is an array, expected an element such as {where}[0]')
    if detail[0] not in KINDS:
        raise ValueError(f'{where} is a {detail[0]}, expected a number')


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
        As `parse_path` gives it, and checked by `check_path`.

    Raises
    ------
    ValueError
        If the message has no such element, or is no message of this type.
    """
    walker = _walker(definitions, message)
    try:
        return walker.find((Nodetype.NAME, message_type), path, 0)
    except struct.error as error:
        raise ValueError('the message is shorter than its type') from error
    except KeyError as error:
        raise ValueError(f'its type has a part {error}, which is described nowhere') from error


def locate_texts(
    definitions: Definitions, message_type: str, message: bytes, field: str
) -> tuple[list[tuple[int, bytes]], list[tuple[int, int]]]:
    """
    Return where the strings of a top-level sequence stand, and what they are.

    Beside them stands every length on the way, as in `FieldPlace`.

    Raises
    ------
    ValueError
        If the message has no such sequence of strings, or is no message of this type.
    """
    walker = _walker(definitions, message)
    try:
        for name, (kind, detail) in definitions[message_type]:
            if name == field and kind == Nodetype.SEQUENCE:
                return walker.texts(detail[0]), walker.lengths
            walker.skip((kind, detail), 1)
    except (struct.error, KeyError) as error:
        raise ValueError('the message is shorter than its type') from error
    raise ValueError(f'there is no sequence {field!r}')


def _walker(definitions: Definitions, message: bytes) -> _Walker:
    if len(message) < 4 or message[0] != 0 or message[1] not in (0, 1):
        raise ValueError('it does not begin as a CDR message does')
    return _Walker(definitions, message, '<' if message[1] else '>')


def _show(path: FieldPath) -> str:
    text = ''.join(f'[{step}]' if isinstance(step, int) else f'.{step}' for step in path)
    return text.lstrip('.')


class _Walker:
    """
    Walks over a message, and remembers the lengths it passed.

    Every method raises `ValueError`, `struct.error` or `KeyError` where the message does
    not hold what its type says.

    Parameters
    ----------
    definitions : mapping
        What the types are made of.
    message : bytes
        With its encapsulation.
    order : str
        '<' or '>'.
    """

    def __init__(self, definitions: Definitions, message: bytes, order: str) -> None:
        self.definitions = definitions
        self.message = message
        self.order = order
        self.position = 4
        self.lengths: list[tuple[int, int]] = []
        self._u32 = struct.Struct(order + 'I')

    def find(self, node: Node, path: FieldPath, depth: int) -> FieldPlace:
        """Return the place of the field that a path leads to from here."""
        if depth > DEEPEST:
            raise ValueError('its type is nested too deeply')
        kind, detail = node
        if not path:
            size = int(KINDS[detail[0]][1])
            self.align(size)
            if self.position + size > len(self.message):
                raise ValueError('the message ends before the field')
            kind_text = self.order + KINDS[detail[0]]
            return FieldPlace(self.position, kind_text, size, tuple(self.lengths))
        step = path[0]
        if kind == Nodetype.NAME:
            for name, inner in self.definitions[str(detail)]:
                if name == step:
                    return self.find(inner, path[1:], depth + 1)
                self.skip(inner, depth + 1)
            raise ValueError(f'there is no field {step!r}')
        inner, count = detail
        if kind == Nodetype.SEQUENCE:
            count = self.length()
        if not isinstance(step, int) or step >= count:
            raise ValueError(f'there are {count} elements, there is no [{step}]')
        self.skip_many(inner, step, depth + 1)
        return self.find(inner, path[1:], depth + 1)

    def texts(self, node: Node) -> list[tuple[int, bytes]]:
        """Return where the strings of the sequence here stand, and what they are."""
        if node[0] != Nodetype.BASE or node[1][0] != 'string':
            raise ValueError('it is no sequence of strings')
        count = self.length()
        if count > len(self.message):
            raise ValueError(f'it claims {count} elements in {len(self.message)} bytes')
        found = []
        for _ in range(count):
            length = self.length()
            end = self.position + length
            if end > len(self.message):
                raise ValueError('the message ends before its names')
            found.append((self.position, self.message[self.position : end]))
            self.position = end
        return found

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

    def skip(self, node: Node, depth: int) -> None:
        """Move behind a field."""
        if depth > DEEPEST:
            raise ValueError('its type is nested too deeply')
        kind, detail = node
        if kind == Nodetype.NAME:
            for _, inner in self.definitions[str(detail)]:
                self.skip(inner, depth + 1)
        elif kind == Nodetype.BASE:
            self.skip_many(node, 1, depth)
        else:
            inner, count = detail
            self.skip_many(inner, self.length() if kind == Nodetype.SEQUENCE else count, depth)

    def skip_many(self, node: Node, count: int, depth: int) -> None:
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
                self.skip(node, depth + 1)
        if self.position > len(self.message):
            raise ValueError('the message ends before the field')
