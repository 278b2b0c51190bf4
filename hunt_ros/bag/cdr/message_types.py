"""
What a message type is made of.

The definition in the bag comes first, then the types of ROS 2 itself.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from hunt_ros.bag.blocks import Topic
from hunt_ros.errors import BagError, one_line

#: Type name -> list of (field name, description), as rosbags describes fields.
Definitions = dict[str, list[tuple[str, Any]]]

#: Definition texts that are read. The parts of one in IDL stand under headings.
ENCODINGS: tuple[str, ...] = ('ros2msg', 'ros2idl', 'omgidl')
_IDL_HEAD = re.compile(r'^={10,}\nIDL: \S+\n', re.MULTILINE)

#: A definition longer than this is not one (bytes).
LONGEST_DEFINITION = 1 << 20


@lru_cache(maxsize=1)
def standard_types() -> Typestore:
    """Return the message types of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


@lru_cache(maxsize=256)
def _parsed(name: str, encoding: str, text: str) -> Definitions:
    types: dict[str, Any] = {}
    if encoding == 'ros2msg':
        types = get_types_from_msg(text, name)
    else:
        for part in _IDL_HEAD.split(text):
            if part.strip():
                types |= get_types_from_idl(part)
    return {key: list(fields) for key, (_, fields) in types.items()}


@lru_cache(maxsize=1)
def standard_definitions() -> Definitions:
    """Return what the message types of ROS 2 Jazzy are made of."""
    return {key: list(fields) for key, (_, fields) in standard_types().fielddefs.items()}


def definitions_of(topic: Topic, source: str = 'bag') -> Definitions:
    """
    Return the definitions that a topic's messages are read by.

    The text that the bag carries comes first; a bag without it (SQLite bags before
    Iron) is read by the types of ROS 2 Jazzy.

    Raises
    ------
    BagError
        If the topic is not CDR, its definition cannot be read, or its type is unknown.
    """
    where = f'{source}: topic {topic.name} ({topic.type or "no type"})'
    if topic.encoding != 'cdr':
        raise BagError(f'{where}: encoding {topic.encoding!r}, expected cdr')
    if topic.definition and topic.definition_encoding in ENCODINGS:
        if len(topic.definition) > LONGEST_DEFINITION:
            raise BagError(f'{where}: its definition has {len(topic.definition)} characters')
        try:
            found = _parsed(topic.type, topic.definition_encoding, topic.definition)
        except Exception as error:  # the parser raises what its grammar meets
            if topic.type in standard_definitions():
                return standard_definitions()
            reason = one_line(error)
            raise BagError(f'{where}: its definition cannot be read ({reason:.80})') from error
        if topic.type in found:
            return {**standard_definitions(), **found}
    if topic.type not in standard_definitions():
        raise BagError(f'{where}: the bag holds no definition of this type')
    return standard_definitions()


def definition_text(message_type: str) -> tuple[str, str]:
    """
    Return (text, type hash) of a standard message type, as bags carry it.

    Returns
    -------
    tuple of str
        Two empty strings for a type that is not a standard one.
    """
    store = standard_types()
    if message_type not in store.fielddefs:
        return '', ''
    text, _ = store.generate_msgdef(message_type, ros_version=2)
    return text, store.hash_rihs01(message_type)
