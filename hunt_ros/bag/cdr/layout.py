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

from rosbags.interfaces import Nodetype

from hunt_ros.bag.cdr.message_types import Definitions
from hunt_ros.bag.cdr.walker import KINDS, CdrWalker, FieldPath, FieldPlace, Node
from hunt_ros.sensors import JOINT_STATE, TWIST_STAMPED

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


def _walker(definitions: Definitions, message: bytes) -> CdrWalker:
    if len(message) < 4 or message[0] != 0 or message[1] not in (0, 1):
        raise ValueError('it does not begin as a CDR message does')
    return CdrWalker(definitions, message, '<' if message[1] else '>')


def _show(path: FieldPath) -> str:
    text = ''.join(f'[{step}]' if isinstance(step, int) else f'.{step}' for step in path)
    return text.lstrip('.')
