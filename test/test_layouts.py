"""
The layouts for other programs in `config/`: what they name is what the suite publishes.

The programs are not at hand here. So each file is read as its program reads it, and every topic,
field, joint and key in it is looked up: in the tables of the nodes, in the message definitions,
and in a recording.
"""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml
from made import declared
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / 'config'
STORE = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE = 'sensor_msgs/msg/JointState'
FIELDS = ('position', 'velocity', 'effort')


class Published(NamedTuple):
    """What a topic carries: its type, its joints, and of these the fields that are filled."""

    type: str
    joints: tuple[str, ...] = ()
    filled: tuple[str, ...] = ()


@pytest.fixture(scope='module')
def measured() -> dict[str, Published]:
    """Topics of a recording, with their joints as they were published."""
    topics = {}
    with AnyReader([ROOT / 'bags' / 'kick_escapes'], default_typestore=STORE) as reader:
        for connection in reader.connections:
            joints, filled = (), ()
            if connection.msgtype == JOINT_STATE:
                _, _, raw = next(reader.messages([connection]))
                message = reader.deserialize(raw, connection.msgtype)
                joints = tuple(message.name)
                filled = tuple(f for f in FIELDS if len(getattr(message, f)) == len(joints))
            topics[connection.topic] = Published(connection.msgtype, joints, filled)
    return topics


@pytest.fixture(scope='module')
def published(measured: dict[str, Published]) -> dict[str, Published]:
    """Topics of the running suite below the namespace `rig`, from the tables of its nodes."""
    pytest.importorskip('rclpy', reason='the tables of topics stand in the nodes')
    from hunt_ros.nodes.support.estimate_publishers import ESTIMATES
    from hunt_ros.nodes.support.qos import TOPICS

    topics = dict(measured)
    for name, (kind, _) in TOPICS.items():
        topics.setdefault(name if name.startswith('/') else f'/rig/{name}', Published(kind))
    for each in ESTIMATES:
        filled = ('position', *['velocity'] * each.rate, *['effort'] * each.std)
        topics[f'/rig/{each.name}'] = Published(JOINT_STATE, each.joints, filled)
    return topics


@pytest.fixture(scope='module')
def status_keys() -> set[str]:
    """Keys of the values in `hunting/status`."""
    from hunt_ros.detection import HuntingDetector

    return set(HuntingDetector().status.values)


def check_field(path: str, topic: Published, keys: set[str]) -> None:
    """Check a path below a topic: names, `[i]`, `[:]`, and `{key=="..."}` of a status."""
    node: Any = (Nodetype.NAME, topic.type)
    steps = re.findall(r'\.?(\w+)|\[(\d+|:)\]|\{key=="([^"]+)"\}', path)
    assert ''.join(re.findall(r'\.?\w+|\[(?:\d+|:)\]|\{key=="[^"]+"\}', path)) == path, path
    for name, index, key in steps:
        kind, detail = node
        if name:
            assert kind == Nodetype.NAME, path
            fields = dict(STORE.fielddefs[detail][1])
            assert name in fields, f'{path}: {detail} has no {name}'
            node = fields[name]
        elif index:
            assert kind in (Nodetype.ARRAY, Nodetype.SEQUENCE), path
            node = detail[0]
        else:
            assert key in keys, f'{path}: hunting/status has no {key}'
    assert node[0] == Nodetype.BASE, f'{path} is no value'
    if topic.type == JOINT_STATE:
        (field, _, _), (_, index, _) = steps
        assert field in topic.filled, path
        assert int(index) < len(topic.joints), path


def foxglove() -> dict[str, Any]:
    return json.loads((CONFIG / 'foxglove.json').read_text())


def strings(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict | list):
        for child in node.values() if isinstance(node, dict) else node:
            yield from strings(child)


def test_what_the_foxglove_layout_names_is_published(
    published: dict[str, Published], status_keys: set[str]
) -> None:
    paths = [text for text in strings(foxglove()['configById']) if text.startswith('/')]
    assert len(paths) > 15
    for path in paths:
        topic, dot, field = path.partition('.')
        if dot:
            check_field(dot + field, published[topic], status_keys)
        else:
            assert topic in published, path


def test_the_foxglove_layout_is_that_of_the_default_rig() -> None:
    shared = yaml.safe_load((CONFIG / 'rig.yaml').read_text())['/**']['ros__parameters']
    panels = foxglove()['configById']
    assert panels['Gauge!speed']['maxValue'] == shared['speed_ceiling_mps']
    assert panels['DiagnosticStatusPanel!detector']['selectedHardwareId'] == shared['rig_name']
    rules = panels['Indicator!level']['rules']
    assert [(rule['rawValue'], rule['label']) for rule in rules] == [
        ('0', 'OK'), ('1', 'WARN'), ('2', 'ERROR'), ('3', 'STALE'),
    ]  # fmt: skip


def test_what_the_plotjuggler_layout_names_is_published(published: dict[str, Published]) -> None:
    """A series of a JointState is TOPIC/JOINT/FIELD, of another type TOPIC/FIELD/FIELD."""
    root = ElementTree.parse(CONFIG / 'plotjuggler.xml').getroot()
    chosen = root.find('.//selected_topics').get('value', '').split(';')  # type: ignore[union-attr]
    assert set(chosen) <= set(published)
    curves = [curve.get('name', '') for curve in root.iter('curve')]
    assert len(curves) > 15
    for curve in curves:
        topic = max((name for name in chosen if curve.startswith(name + '/')), key=len)
        parts = curve[len(topic) + 1 :].split('/')
        known = published[topic]
        if known.type == JOINT_STATE:
            joint, field = parts
            parts = [field, f'[{known.joints.index(joint)}]']
        check_field('.' + '.'.join(parts).replace('.[', '['), known, set())


def test_the_layouts_are_installed_and_documented(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    installed = dict(declared()['data_files'])['share/hunt_ros/config']
    told = (ROOT / 'docs' / 'tools.md').read_text()
    for name in ('foxglove.json', 'plotjuggler.xml'):
        assert f'config/{name}' in installed
        assert name in told
    # Another namespace is one replacement in each.
    texts = [(CONFIG / name).read_text() for name in ('foxglove.json', 'plotjuggler.xml')]
    assert not [text for text in texts if re.search(r'(?<![\w])/(?!rig/|diagnostics)\w+/', text)]
