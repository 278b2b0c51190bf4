"""
Walking over one serialised message (CDR), field by field, without building an object.

Source: OMG CDR (formal/02-06-51, 15.3) as Fast CDR applies it to ROS 2: alignment
counts from behind the four bytes of encapsulation, and an empty sequence is not
padded to its elements.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from rosbags.interfaces import Nodetype

from hunt_ros.bag.cdr.message_types import Definitions

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


@dataclass(frozen=True)
class FieldPlace:
    """
    Where a field lies in messages of one layout.

    Parameters
    ----------
    offset : int
        From the start of the message, encapsulation included, bytes.
    kind : str
        numpy type with byte order, such as '<f8'.
    size : int
        Of the field, bytes.
    lengths : tuple of (int, int)
        (offset, value) of every 32-bit length on the way to the field.
    """

    offset: int
    kind: str
    size: int
    lengths: tuple[tuple[int, int], ...]


class CdrWalker:
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
