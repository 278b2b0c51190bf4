"""Recordings that tests make and compare, by the writers of this package and of others."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from operator import itemgetter
from pathlib import Path
from typing import Any, Literal

import lz4.frame
import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from hunt_ros.bag import Bag, BagWriter
from hunt_ros.bag.cdr.message_types import definition_text
from hunt_ros.bag.mcap.writer import McapWriter as OurWriter
from hunt_ros.bag.record_writer import serialise
from hunt_ros.errors import BagError
from hunt_ros.samples import Record, Series
from hunt_ros.sensors import CHANNEL_FIELDS, JOINT_STATE

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


@contextmanager
def chunks_of(size: int) -> Iterator[None]:
    """Have the writer of this package close its chunks at so many bytes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(OurWriter, 'chunk_bytes', size)
        yield


@contextmanager
def compressed(kind: str) -> Iterator[None]:
    """Have the writer of this package compress as others do: '', lz4, zstd."""
    with pytest.MonkeyPatch.context() as patch:
        if kind != 'zstd':
            packed = lz4.frame.compress if kind else bytes
            patch.setattr(OurWriter, 'compression', kind)
            patch.setattr(OurWriter, 'compress', staticmethod(packed))
        yield


def write_messages(path: Path, record: Record) -> Path:
    """The same record message by message, as the live recorder writes."""
    with BagWriter(path) as writer:
        rows = []
        for name, series in record.items():
            key = writer.topic(f'/rig/{name}', CHANNEL_FIELDS[name][0])
            messages = map(bytes, serialise(name, series))
            rows += zip(series.stamps_ns.tolist(), [key] * len(series), messages, strict=True)
        for at, key, message in sorted(rows, key=itemgetter(0)):
            writer.write(key, at, message)
    return path


def written(path: Path, topic: str) -> int:
    """How many messages of a topic a file holds, also while it is being written."""
    with suppress(BagError, KeyError), Bag(path) as bag:
        return bag.topics[topic].messages
    return 0


class Peer:
    """A file by the writer of the package mcap."""

    def __init__(self, path: Path, **options) -> None:
        self.path = path
        self._file = path.open('wb')
        self.writer = McapWriter(self._file, **options)
        self.writer.start('ros2', 'another recorder')

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *details) -> None:
        self.writer.finish()
        self._file.close()

    def channel(self, topic: str, kind: str = JOINT_STATE, text: str | None = None, **more) -> int:
        text = definition_text(kind)[0] if text is None else text
        schema = self.writer.register_schema(kind, 'ros2msg', text.encode())
        return self.writer.register_channel(topic, 'cdr', schema, more)

    def add(self, channel: int, messages: list[bytes], step_ns: int = 10_000_000) -> None:
        for row, message in enumerate(messages):
            at = BEGIN_NS + row * step_ns
            self.writer.add_message(channel, at, message, at + 17, row)


def write_mcap(path: Path, record: Record, **options: Any) -> Path:
    """The same record by the writer of the package mcap."""
    with Peer(path, **{'chunk_size': 20_000} | options) as peer:
        for name, series in record.items():
            key = peer.channel(f'/rig/{name}', CHANNEL_FIELDS[name][0])
            rows = zip(series.stamps_ns.tolist(), serialise(name, series), strict=True)
            for at, message in rows:
                peer.writer.add_message(key, at, bytes(message), at)
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


def in_bursts(
    series: Series,
    size: int,
    *,
    jitter_s: float = 0.0,
    inside_ns: int = 0,
    vary: int = 0,
    lost: float = 0.0,
    seed: int = 0,
) -> Series:
    """
    The same samples as stamped when a buffer of `size` was read, 1 ms after its last one.

    A reading is late by `jitter_s` on average (exponential), the samples of a block are
    `inside_ns` apart, its size varies by up to `vary`, and a share of the blocks is lost.
    """
    rng = np.random.default_rng(seed)
    stamps, values, begin, last = [], [], 0, 0
    while begin < len(series):
        end = min(begin + size + int(rng.integers(-vary, vary + 1)), len(series))
        if rng.random() >= lost:
            late = 1_000_000 + round(1e9 * jitter_s * rng.exponential())
            last = max(last + 1, int(series.stamps_ns[end - 1]) + late)
            stamps.append(last + inside_ns * np.arange(end - begin))
            values.append(series.values[begin:end])
        begin = end
    return Series(np.concatenate(stamps), np.concatenate(values))
