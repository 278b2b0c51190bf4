"""From a channel's source to the topic and the field that it means in a recording."""

from __future__ import annotations

from hunt_ros.bag.blocks import Topic
from hunt_ros.bag.cdr.gather import Wanted
from hunt_ros.bag.cdr.layout import (
    USUAL_FIELDS,
    check_path,
    joint_of,
    parse_path,
    stamp_path,
)
from hunt_ros.bag.cdr.message_types import definitions_of
from hunt_ros.bag.channels import ChannelSource
from hunt_ros.bag.reader import Bag
from hunt_ros.errors import BagError
from hunt_ros.sensors import JOINT_STATE


def find_topic(bag: Bag, source: ChannelSource, namespace: str | None = None) -> str:
    """
    Find the topic that a source means: by its full name, or by its last one.

    Raises
    ------
    BagError
        If there is none, or several.
    """
    if source.topic in bag.topics:
        return source.topic
    wanted = source.topic.strip('/')
    found = [
        name
        for name in bag.topics
        if name.endswith('/' + wanted)
        and not source.topic.startswith('/')
        and (namespace is None or name.strip('/') == f'{namespace.strip("/")}/{wanted}'.strip('/'))
    ]
    if len(found) == 1:
        return found[0]
    if found:
        raise BagError(
            f'{bag.path}: channel {source.channel}: several topics end in {wanted!r}'
            f' ({", ".join(sorted(found))}), name the one'
        )
    raise BagError(
        f'{bag.path}: channel {source.channel}: no topic {source.topic!r}, it has {listed(bag)}'
    )


def wanted_field(topic: Topic, source: ChannelSource, bag: Bag, alone: bool = True) -> Wanted:
    """
    Find the field that a source means in messages of a topic.

    `alone`: where no field is named, the only joint of a message is taken, whatever its name.

    Raises
    ------
    BagError
        If there is no such field, or it is no number.
    """
    definitions = definitions_of(topic, str(bag.path))
    text = source.field or USUAL_FIELDS.get(topic.type, '')
    stamp = stamp_path(definitions, topic.type)
    joint = joint_of(text)
    if not source.field and topic.type == JOINT_STATE:
        joint = ('position', source.channel)
    try:
        if joint is not None and topic.type == JOINT_STATE:
            path = parse_path(joint[0])
            alone = alone and not source.field
            return Wanted(definitions, topic.type, path, stamp, joint[1], alone)
        path = parse_path(text)
        check_path(definitions, topic.type, path)
    except ValueError as error:
        raise BagError(f'{bag.path}: topic {topic.name} ({topic.type}): {error}') from error
    return Wanted(definitions, topic.type, path, stamp)


def listed(bag: Bag) -> str:
    """Return the topics of a recording for a message, the first dozen, or why there are none."""
    names = sorted(bag.topics)
    shown = ', '.join(names[:12]) or ': '.join(['no topics', *bag.problems[-1:]])
    return f'{shown} and {len(names) - 12} more' if len(names) > 12 else shown
