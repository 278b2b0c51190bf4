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
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from bags_made import make_record, write_messages, write_rosbags
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from hunt_ros.bag import Bag, read_record
from hunt_ros.bag.inspection import inspect
from hunt_ros.bag.mcap.layout import Layout
from hunt_ros.bag.mcap.records import records
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
        path = write_messages(folder / name, record, compression=compression, chunk_bytes=2500)
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


def cut_out(rng: np.random.Generator, data: bytearray) -> bytearray:
    begin, end = sorted(rng.integers(len(data), size=2).tolist())
    return data[:begin] + data[end:]


def repeat(rng: np.random.Generator, data: bytearray) -> bytearray:
    begin, end = sorted(rng.integers(len(data), size=2).tolist())
    return data[:end] + data[begin:end] * int(rng.integers(1, 4)) + data[end:]


def insert_noise(rng: np.random.Generator, data: bytearray) -> bytearray:
    at = int(rng.integers(len(data)))
    return data[:at] + bytearray(rng.bytes(int(rng.integers(1, 400)))) + data[at:]


def zero(rng: np.random.Generator, data: bytearray) -> bytearray:
    begin, end = sorted(rng.integers(len(data), size=2).tolist())
    data[begin:end] = bytes(end - begin)
    return data


def extreme_number(rng: np.random.Generator, data: bytearray) -> bytearray:
    width = int(rng.choice([2, 4, 8]))
    at = int(rng.integers(max(1, len(data) - width)))
    value = EXTREMES[int(rng.integers(len(EXTREMES)))] & (256**width - 1)
    data[at : at + width] = value.to_bytes(width, 'little')
    return data


def _record_places(data: bytearray) -> list[tuple[int, int, int]]:
    view = bytes(data)
    found = []
    with suppress(ValueError):
        found.extend(records(view, 8, len(view) - 8))
    return found


def extreme_in_record(rng: np.random.Generator, data: bytearray) -> bytearray:
    """Aim at the lengths, times and offsets of one record."""
    places = _record_places(data)
    if not places:
        return extreme_number(rng, data)
    _, offset, length = places[int(rng.integers(len(places)))]
    width = int(rng.choice([2, 4, 8]))
    at = offset + int(rng.integers(0, min(length + 9 - width, 80)))
    value = EXTREMES[int(rng.integers(len(EXTREMES)))] & (256**width - 1)
    data[at : at + width] = value.to_bytes(width, 'little')
    return data


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


def inside_a_chunk(rng: np.random.Generator, data: bytearray) -> bytearray:
    """Damage the messages of an uncompressed chunk, and put its CRC right."""
    chunks = [
        c for c in Layout(memoryview(bytes(data))).chunks if c.compression == '' and c.stored
    ]
    if not chunks:
        return flip_bytes(rng, data)
    chunk = chunks[int(rng.integers(len(chunks)))]
    inner = bytearray(data[chunk.data : chunk.end])
    damage = (flip_bit, flip_bytes, extreme_number, zero)[int(rng.integers(4))]
    inner = damage(rng, inner)
    data[chunk.data : chunk.end] = inner
    at = chunk.offset + 9 + 24
    data[at : at + 4] = zlib.crc32(inner).to_bytes(4, 'little')
    return data


def summary_with_its_crc(rng: np.random.Generator, data: bytearray) -> bytearray:
    """Damage the summary, and put its CRC right."""
    begin = int.from_bytes(data[-28:-20], 'little')
    end = len(data) - 12
    if not 8 < begin < end:
        return flip_bytes(rng, data)
    part = bytearray(data[begin:end])
    part = (flip_bit, flip_bytes, extreme_number)[int(rng.integers(3))](rng, part)
    data[begin:end] = part
    data[-12:-8] = zlib.crc32(part).to_bytes(4, 'little')
    return data


DAMAGES: tuple[Damage, ...] = (
    flip_bit, flip_bytes, cut, cut_out, repeat, insert_noise, zero, extreme_number,
    extreme_in_record, shuffle_records, inside_a_chunk, summary_with_its_crc,
)  # fmt: skip


def try_everything(path: Path, scratch: Path, with_repair: bool) -> str:
    """Read, inspect and repair; returns what came of it."""
    outcomes = []
    for attempt in (
        lambda: read_record(path),
        lambda: read_texts(path, 'hunting/normal_form'),
        lambda: inspect(path).to_json(),
    ):
        try:
            attempt()
            outcomes.append('read')
        except BagError as error:
            if '\n' in str(error):
                raise AssertionError(f'more than one line: {error}') from error
            outcomes.append('refused')
    if with_repair:
        target = scratch / 'saved'
        try:
            repair(path, target)
            inspect(target)
            outcomes.append('saved')
        except BagError:
            outcomes.append('lost')
            if target.exists():
                raise AssertionError('a failed repair left its folder') from None
        shutil.rmtree(target, ignore_errors=True)
    return ' '.join(outcomes)


def messages(path: Path) -> set[bytes]:
    with Bag(path) as bag:
        return {raw.data for raw in read_raw(bag, list(bag.topics))}


def run_case(
    seed: int, name: str, source: Path, whole: set[bytes], scratch: Path
) -> tuple[str, str]:
    rng = np.random.default_rng(seed)
    damage = DAMAGES[int(rng.integers(len(DAMAGES)))]
    folder = scratch / 'case'
    folder.mkdir()
    try:
        target = folder / source.name
        as_folder = name == 'message_zstd' or rng.integers(8) == 0
        description = source.parent / 'metadata.yaml'
        if as_folder and rng.integers(3) == 0:
            shutil.copy(source, target)
            raw = damage(rng, bytearray(description.read_bytes()))
            (folder / 'metadata.yaml').write_bytes(raw)
        else:
            target.write_bytes(damage(rng, bytearray(source.read_bytes())))
            if as_folder:
                shutil.copy(description, folder)
        path = folder if as_folder else target
        outcome = try_everything(path, scratch, with_repair=bool(rng.integers(3) == 0))
        if damage in (flip_bit, cut) and name.startswith('mcap') and outcome.startswith('read'):
            # One wrong bit never gets past a CRC: what is read was there.
            try:
                found = messages(path)
            except BagError:
                found = set()
            if not found <= whole:
                raise AssertionError('something was read that was not there')
        return damage.__name__, outcome
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def on_alarm(number: int, frame: object) -> None:
    raise TooSlowError(f'more than {SECONDS} s')


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--cases', type=int, default=10_000)
    parser.add_argument('--seed', type=int, default=1, help='of the first case')
    arguments = parser.parse_args()
    base = '/dev/shm' if Path('/dev/shm').is_dir() else None
    scratch = Path(tempfile.mkdtemp(prefix='fuzz_bags_', dir=base))
    signal.signal(signal.SIGALRM, on_alarm)
    counts: Counter[tuple[str, str]] = Counter()
    failures = 0
    try:
        sources = originals(scratch)
        wholes = {name: messages(path.parent) for name, path in sources.items()}
        names = list(sources)
        used = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, resource.RLIM_INFINITY))
        for seed in range(arguments.seed, arguments.seed + arguments.cases):
            name = names[seed % len(names)]
            signal.alarm(SECONDS)
            try:
                counts[run_case(seed, name, sources[name], wholes[name], scratch)] += 1
            except Exception as error:
                failures += 1
                print(f'seed {seed} ({name}): {type(error).__name__}: {error}')
                if failures == 1:
                    import traceback

                    traceback.print_exc(file=sys.stdout)
            finally:
                signal.alarm(0)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    for (damage, outcome), count in sorted(counts.items()):
        print(f'{count:7d}  {damage:20s} {outcome}')
    print(f'{sum(counts.values())} cases ended as they should, {failures} did not')
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
