"""
Reading recordings: columns against rosbags and mcap, in one run on the same files.

    python test/benchmark/bench_bags.py [--messages 2000000] [--seconds 3600]
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from tables import asked, markdown, publish  # isort: skip
from bags_made import compressed, make_record, write_rosbags  # isort: skip
from made import PAPER, record_of, without  # isort: skip

from hunt_ros.bag import read_columns, read_record, write_record
from hunt_ros.samples import Record

STORE = get_typestore(Stores.ROS2_JAZZY)
COLUMNS = ['a=/rig/lateral', 'b=/rig/yaw']


def timed(work: Callable[[], object], repeats: int = 1) -> float:
    """Return the best of some runs, s of CPU: all of it runs in one thread."""
    best = float('inf')
    for _ in range(repeats):
        begin = time.process_time()
        work()
        best = min(best, time.process_time() - begin)
    return best


def three_channels(seconds: float) -> Record:
    """An hour, say, of lateral, yaw and speed at 1 kHz, as a quiet rig."""
    rng = np.random.default_rng(2)
    time_s = 1.0 + np.arange(round(seconds * 1000)) / 1000.0
    wave = 1e-4 * np.sin(2 * np.pi * 2.8 * time_s)
    lateral = wave + 5e-6 * rng.standard_normal(time_s.size)
    yaw = 5.0 * wave + 2e-5 * rng.standard_normal(time_s.size)
    return record_of(time_s, lateral=lateral, yaw=yaw, speed=6.0 + 2.8 * time_s / seconds)


def rosbags_raw(path: Path) -> int:
    with Reader(path) as reader:
        return sum(1 for _ in reader.messages())


def rosbags_deserialised(path: Path) -> tuple[np.ndarray, ...]:
    """What a user of rosbags writes to get the same two columns."""
    columns: dict[str, tuple[list[int], list[float]]] = {}
    with Reader(path) as reader:
        for connection, _, raw in reader.messages():
            message = STORE.deserialize_cdr(raw, connection.msgtype)
            stamps, values = columns.setdefault(connection.topic, ([], []))
            stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            values.append(message.position[0])
    return tuple(np.array(part) for pair in columns.values() for part in pair)


def mcap_raw(path: Path) -> int:
    with open(next(path.glob('*.mcap')), 'rb') as file:
        return sum(1 for _ in make_reader(file).iter_messages())


def compare(folder: Path, count: int) -> tuple[list[list[object]], dict[str, float]]:
    """Columns, raw iteration and deserialisation for each compression, and for SQLite."""
    record = without(make_record(count / 1000.0), 'roller', 'speed')
    rows: list[list[object]] = []
    ratios: dict[str, float] = {}
    for compression in ('', 'lz4', 'zstd', 'SQLite'):
        path = folder / f'two_{compression}'
        if compression == 'SQLite':
            write_rosbags(path, record)
        else:
            with compressed(compression):
                write_record(path, record)
        read_columns(path, COLUMNS)  # the file is in the page cache for all
        ours = timed(lambda path=path: read_columns(path, COLUMNS), 3)
        raw = timed(lambda path=path: rosbags_raw(path))
        full = timed(lambda path=path: rosbags_deserialised(path))
        peer = timed(lambda path=path: mcap_raw(path)) if compression == '' else float('nan')
        name = compression or 'none'
        rate = 2 * count / 1e6
        rows += [
            [name, 'hunt_ros read_columns', ours, rate / ours, 1.0],
            [name, 'rosbags Reader, raw bytes', raw, rate / raw, raw / ours],
            [name, 'rosbags Reader + deserialize_cdr', full, rate / full, full / ours],
        ]
        if compression == '':
            rows.append([name, 'mcap, raw bytes', peer, rate / peer, peer / ours])
        ratios |= {f'{name} raw': raw / ours, f'{name} deserialised': full / ours}
        shutil.rmtree(path)
    return rows, ratios


def hour(folder: Path, seconds: float) -> list[list[object]]:
    """Write, read and replay three channels at 1 kHz."""
    from hunt_ros.detection import DetectorConfig, HuntingDetector
    from hunt_ros.detection.offline import collect, config_for
    from hunt_ros.detection.replay import watch

    def replay(record: Record) -> None:
        config, _ = config_for(record, DetectorConfig())
        detector = HuntingDetector(config, PAPER)
        collect(watch(record, detector), detector)

    record = three_channels(seconds)
    rows: list[list[object]] = []
    for compression in ('', 'zstd'):
        name = compression or 'none'
        path = folder / f'hour_{name}'
        with compressed(compression):
            written = timed(lambda path=path: write_record(path, record))
        read_record(path)
        reading = timed(lambda path=path: read_record(path), 3)
        rows.append([f'write_record, {name}', written, seconds / written])
        rows.append([f'read_record, {name}', reading, seconds / reading])
        if compression:
            replay(record.between(0, 6 * 10**9))  # compiled, or loaded
            replayed = timed(lambda path=path: replay(read_record(path)))
            rows.append([f'replay with the detector, {name}', replayed, seconds / replayed])
        shutil.rmtree(path)
    return rows


def main() -> None:
    arguments = asked(__doc__, messages=(2_000_000, 20_000), seconds=(3600.0, 20.0))
    folder = Path(tempfile.mkdtemp(prefix='bench_bags_'))
    try:
        rows, ratios = compare(folder, arguments.messages // 2)
        long_rows = hour(folder, arguments.seconds)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    goals = [
        ['uncompressed, against rosbags deserialised', '50', ratios['none deserialised']],
        ['uncompressed, against rosbags raw bytes', '10', ratios['none raw']],
        ['zstd, against rosbags deserialised', '20', ratios['zstd deserialised']],
    ]
    text = '\n\n'.join(
        [
            f'Two channels of {arguments.messages // 2} JointState messages (84 bytes), stamps and'
            ' values as arrays; every chunk CRC and every message layout is checked. CPU seconds'
            ' of one thread, best of 3 for hunt_ros, one run for the others, files cached.',
            markdown(['chunks', 'way', 'CPU s', '10^6 messages/s', 'times hunt_ros'], rows),
            markdown(['times as fast as', 'goal', 'measured'], goals),
            f'{arguments.seconds:.0f} s of lateral, yaw and speed at 1 kHz'
            f' ({arguments.seconds * 3000 / 1e6:.1f} million messages; goals for an hour: read'
            ' in 2 s, replay in 6 s, which is 600 times real time):',
            markdown(['work', 'CPU s', 'times real time'], long_rows),
        ]
    )
    publish('bench-bags', 'Reading recordings', text, arguments.publish)


if __name__ == '__main__':
    main()
