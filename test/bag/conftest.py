"""Recordings that the tests of this room share."""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from hunt_ros.bag import BagWriter
from hunt_ros.bag.cdr.message_types import definition_text
from hunt_ros.bag.record_writer import record_rows, serialise
from hunt_ros.samples import Record, Series
from hunt_ros.sensors import CHANNEL_FIELDS

BEGIN_NS = 1_700_000_000_000_000_000


def make_record(seconds: float = 8.0, rate_hz: float = 1000.0, seed: int = 0) -> Record:
    """Noise on all four channels, at rates of their own, with ns that do not fit a float."""
    rng = np.random.default_rng(seed)
    count = round(seconds * rate_hz)
    fast = BEGIN_NS + np.round(np.arange(count) * 1e9 / rate_hz).astype(np.int64)
    slow = fast[::10] + 123
    return Record(
        {
            'lateral': Series(fast, 1e-3 * rng.normal(size=count)),
            'yaw': Series(fast + 7, rng.normal(size=count)),
            'roller': Series(slow, np.cumsum(rng.uniform(size=slow.size))),
            'speed': Series(slow + 1, rng.uniform(6, 9, size=slow.size)),
        },
        'made',
        {'rig': 'the rig', 'operator': 'the operator'},
    )


def assert_same(left: Record, right: Record) -> None:
    """Every sample of both, bit for bit."""
    assert set(left) == set(right)
    for name in left:
        np.testing.assert_array_equal(left[name].stamps_ns, right[name].stamps_ns, name)
        np.testing.assert_array_equal(left[name].values, right[name].values, name)


@pytest.fixture(scope='session')
def record() -> Record:
    return make_record()


@pytest.fixture(scope='session')
def bag(record: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bag') / 'run'
    with BagWriter(path, notes=record.notes) as writer:
        form = writer.topic('/rig/hunting/normal_form', 'std_msgs/msg/String', latched=True)
        writer.write(form, record.start_ns, b'\0\1\0\0\7\0\0\0v_c: 8\0')
        for rows in record_rows(record, writer.topic, 'rig'):
            writer.write_rows(rows)
    return path


@pytest.fixture(scope='session')
def same() -> Callable[[Record, Record], None]:
    return assert_same


@pytest.fixture(scope='session')
def new_record() -> Callable[..., Record]:
    return make_record


def write_messages(path: Path, record: Record, **options: Any) -> Path:
    """The same record message by message, as the live recorder writes."""
    with BagWriter(path, **options) as writer:
        rows = []
        for name, series in record.items():
            key = writer.topic(f'/rig/{name}', CHANNEL_FIELDS[name][0])
            messages = map(bytes, serialise(name, series))
            rows += zip(series.stamps_ns.tolist(), [key] * len(series), messages, strict=True)
        for at, key, message in sorted(rows, key=itemgetter(0)):
            writer.write(key, at, message)
    return path


def write_mcap(path: Path, record: Record, **options: Any) -> Path:
    """The same record by the writer of the package mcap."""
    with open(path, 'wb') as file:
        writer = McapWriter(file, **{'chunk_size': 20_000} | options)
        writer.start('ros2', 'another recorder')
        for name, series in record.items():
            kind = CHANNEL_FIELDS[name][0]
            schema = writer.register_schema(kind, 'ros2msg', definition_text(kind)[0].encode())
            key = writer.register_channel(f'/rig/{name}', 'cdr', schema)
            rows = zip(series.stamps_ns.tolist(), serialise(name, series), strict=True)
            for at, message in rows:
                writer.add_message(key, at, bytes(message), at)
        writer.finish()
    return path


def write_rosbags(
    path: Path,
    record: Record,
    version: Literal[8, 9] = 8,
    plugin: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode | None = None,
) -> Path:
    """The same record by the writer of the package rosbags; its file."""
    writer = RosbagsWriter(path, version=version, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    store = get_typestore(Stores.ROS2_JAZZY)
    with writer:
        for name, series in record.items():
            kind = CHANNEL_FIELDS[name][0]
            connection = writer.add_connection(f'/rig/{name}', kind, typestore=store)
            rows = zip(series.stamps_ns.tolist(), serialise(name, series), strict=True)
            for at, message in rows:
                writer.write(connection, at, bytes(message))
    (file,) = (name for name in path.iterdir() if name.name != 'metadata.yaml')
    return file


@pytest.fixture(scope='session')
def by_mcap() -> Callable[..., Path]:
    return write_mcap


@pytest.fixture(scope='session')
def by_rosbags() -> Callable[..., Path]:
    return write_rosbags


@pytest.fixture(scope='session')
def by_message() -> Callable[..., Path]:
    return write_messages
