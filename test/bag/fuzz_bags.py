"""
Damage recordings in every way we can think of; each must end in a result or a BagError.

Runs as a program of its own, so that its limits on memory and time are those of the
process: a case that takes more fails.

    python test/bag/fuzz_bags.py --cases 10000 --seed 1
"""

from __future__ import annotations

import argparse
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from bags_made import chunks_of, compressed, make_record, write_messages, write_rosbags
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from hunt_ros.bag import Bag, read_record
from hunt_ros.bag.inspection import inspect
from hunt_ros.bag.mcap.records import CHUNK, records, unpack_chunk
from hunt_ros.bag.messages import read_raw, read_texts
from hunt_ros.bag.repair import repair
from hunt_ros.errors import BagError
from hunt_ros.samples import Record

#: Memory that a case may take beyond what the program holds, and its time.
MEMORY_BYTES = 3 << 30
SECONDS = 10

EXTREMES = (0, 1, 2, 255, 2**16, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1)

Damage = Callable[[np.random.Generator, bytearray], bytearray]


class TooSlowError(Exception):
    """A case took longer than it may."""


def originals(folder: Path) -> dict[str, Path]:
    """Small recordings of every kind."""
    whole = make_record(0.06)
    record, found = Record({name: whole[name] for name in ('lateral', 'speed')}), {}
    for compression in ('', 'lz4', 'zstd'):
        name = f'mcap_{compression or "none"}'
        with compressed(compression), chunks_of(2500):
            path = write_messages(folder / name, record)
        (found[name],) = path.glob('*.mcap')
    for name, plugin, mode in (
        ('sqlite', StoragePlugin.SQLITE3, None),
        ('file_zstd', StoragePlugin.MCAP, CompressionMode.FILE),
        ('message_zstd', StoragePlugin.MCAP, CompressionMode.MESSAGE),
    ):
        found[name] = write_rosbags(folder / name, record, 8, plugin, mode)
    return found


def flip_bit(rng: np.random.Generator, data: bytearray) -> bytearray:
    data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    return data


def flip_bytes(rng: np.random.Generator, data: bytearray) -> bytearray:
    for _ in range(int(rng.integers(2, 30))):
        data[int(rng.integers(len(data)))] = int(rng.integers(256))
    return data


def cut(rng: np.random.Generator, data: bytearray) -> bytearray:
    return data[: int(rng.integers(len(data)))]


def replace_a_part(rng: np.random.Generator, data: bytearray) -> bytearray:
    """Leave a part out, zero it, repeat it, or put noise in its place."""
    begin, end = sorted(rng.integers(len(data), size=2).tolist())
    noise = rng.bytes(int(rng.integers(1, 400)))
    parts = (b'', bytes(end - begin), data[begin:end] * int(rng.integers(2, 5)), noise)
    return data[:begin] + parts[int(rng.integers(4))] + data[end:]


def extreme_number(rng: np.random.Generator, data: bytearray) -> bytearray:
    """Write one anywhere, or among the lengths, times and offsets of one record."""
    width = int(rng.choice([2, 4, 8]))
    at = int(rng.integers(max(1, len(data) - width)))
    if rng.integers(2) and (places := _record_places(data)):
        _, offset, length = places[int(rng.integers(len(places)))]
        at = offset + int(rng.integers(0, min(length + 9 - width, 80)))
    value = EXTREMES[int(rng.integers(len(EXTREMES)))] & (256**width - 1)
    data[at : at + width] = value.to_bytes(width, 'little')
    return data


def _record_places(data: bytearray) -> list[tuple[int, int, int]]:
    view = bytes(data)
    found = []
    with suppress(ValueError):
        found.extend(records(view, 8, len(view) - 8))
    return found


def shuffle_records(rng: np.random.Generator, data: bytearray) -> bytearray:
    places = _record_places(data)
    if len(places) < 3:
        return flip_bytes(rng, data)
    parts = [data[offset : offset + 9 + length] for _, offset, length in places]
    if rng.integers(2):
        rng.shuffle(parts)
    else:
        del parts[int(rng.integers(len(parts)))]
    return data[:8] + b''.join(parts) + data[-8:]


def with_its_crc(rng: np.random.Generator, data: bytearray) -> bytearray:
    """Damage the messages of an uncompressed chunk, or the summary, and put its CRC right."""
    chunks = []
    with suppress(ValueError):  # damaged before, or a database
        for opcode, at, length in records(data, 8, len(data) - 8):
            if opcode == CHUNK:
                chunks.append(unpack_chunk(data, at, length))
    places = [(c.data, c.end, c.offset + 33) for c in chunks if c.compression == '' and c.stored]
    begin, end = int.from_bytes(data[-28:-20], 'little'), len(data) - 12
    if 8 < begin < end and (not places or rng.integers(2)):
        places = [(begin, end, end)]
    if not places:
        return flip_bytes(rng, data)
    begin, end, crc = places[int(rng.integers(len(places)))]
    damage = (flip_bit, flip_bytes, extreme_number)[int(rng.integers(3))]
    data[begin:end] = part = damage(rng, data[begin:end])
    data[crc : crc + 4] = zlib.crc32(part).to_bytes(4, 'little')
    return data


DAMAGES: tuple[Damage, ...] = (
    flip_bit, flip_bytes, cut, replace_a_part, extreme_number, shuffle_records, with_its_crc,
)  # fmt: skip


def try_everything(path: Path, target: Path, with_repair: bool) -> None:
    """Read, inspect and repair."""
    attempts: list[Callable[[], object]] = [
        lambda: read_record(path),
        lambda: read_texts(path, 'hunting/normal_form'),
        lambda: inspect(path).to_json(),
        lambda: repair(path, target) and inspect(target),
    ]
    for attempt in attempts if with_repair else attempts[:-1]:
        try:
            attempt()
        except BagError as error:
            if '\n' in str(error) or target.exists():
                raise AssertionError(
                    'more than one line, or a failed repair left its folder'
                ) from error


def messages(path: Path) -> set[bytes]:
    with Bag(path) as bag:
        return {raw.data for raw in read_raw(bag, list(bag.topics))}


def run_case(seed: int, name: str, source: Path, whole: set[bytes], scratch: Path) -> None:
    rng = np.random.default_rng(seed)
    damage = DAMAGES[int(rng.integers(len(DAMAGES)))]
    folder = scratch / 'case'
    folder.mkdir()
    as_folder = name == 'message_zstd' or rng.integers(8) == 0
    files = [source, source.parent / 'metadata.yaml'] if as_folder else [source]
    copies = [Path(shutil.copy(file, folder)) for file in files]
    victim = copies[-1 if rng.integers(3) == 0 else 0]
    victim.write_bytes(damage(rng, bytearray(victim.read_bytes())))
    path = folder if as_folder else copies[0]
    try_everything(path, scratch / 'saved', with_repair=bool(rng.integers(3) == 0))
    if damage in (flip_bit, cut) and name.startswith('mcap'):
        # One wrong bit never gets past a CRC: what is read was there.
        with suppress(BagError):
            assert messages(path) <= whole, 'something was read that was not there'


def on_alarm(number: int, frame: object) -> None:
    raise TooSlowError(f'more than {SECONDS} s')


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--cases', type=int, default=10_000)
    parser.add_argument('--seed', type=int, default=1, help='of the first case')
    arguments = parser.parse_args()
    signal.signal(signal.SIGALRM, on_alarm)
    failures = 0
    base = '/dev/shm' if Path('/dev/shm').is_dir() else None
    with tempfile.TemporaryDirectory(prefix='fuzz_bags_', dir=base) as scratch:
        sources = originals(Path(scratch))
        wholes = {name: messages(path.parent) for name, path in sources.items()}
        names = list(sources)
        used = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, resource.RLIM_INFINITY))
        for seed in range(arguments.seed, arguments.seed + arguments.cases):
            name = names[seed % len(names)]
            with tempfile.TemporaryDirectory(dir=scratch) as folder:
                signal.alarm(SECONDS)
                try:
                    run_case(seed, name, sources[name], wholes[name], Path(folder))
                except Exception:
                    failures += 1
                    print(f'seed {seed} ({name}): {traceback.format_exc()}')
                finally:
                    signal.alarm(0)
    print(f'{arguments.cases - failures} cases ended as they should, {failures} did not')
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
