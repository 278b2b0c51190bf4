"""`hunt import FILE OUT`: a recording of another program as a bag of this rig."""

from __future__ import annotations

import argparse
from pathlib import Path

SUMMARY = 'turn a CSV, MATLAB, NumPy, TDMS or Parquet file, or a foreign bag, into a bag'
EXAMPLE = (
    "hunt import run.mat run --channel yaw='data[0]' --channel lateral='data[1]*0.47'"
    ' --channel speed=16.3 --rate 250'
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('file', type=Path, help='the file to read')
    parser.add_argument('out', type=Path, help='folder of the bag; must not exist')
    parser.add_argument(
        '--channel',
        action='append',
        default=[],
        metavar='NAME=SOURCE',
        help='lateral, yaw, roller or speed: a column, data[1]*0.47, or a constant; repeatable',
    )
    parser.add_argument(
        '--channels', type=Path, metavar='FILE', help='the same as YAML, a line a channel'
    )
    parser.add_argument('--rate', type=float, metavar='HZ', help='of a file without times')
    parser.add_argument('--time', metavar='COLUMN', help='of the times, in s: t or t_ms*0.001')
    parser.add_argument('--namespace', default='rig', help='of the topics (default: %(default)s)')
    for name in ('rig', 'operator', 'notes'):
        parser.add_argument(f'--{name}', help='kept in the bag')
    parser.add_argument('--json', metavar='PATH', help="what was written, as JSON; '-': stdout")


def run(arguments: argparse.Namespace) -> int:
    """Read the file, write the bag, say what is in it."""
    from hunt_ros.bag.channels import channel_map, read_channel_file
    from hunt_ros.bag.importers import load_record
    from hunt_ros.bag.writer import write_record
    from hunt_ros.cli.output import known, write_json
    from hunt_ros.errors import BagError

    if arguments.out.exists():
        raise BagError(f'{arguments.out}: exists already, expected the name of a new folder')
    mapping = read_channel_file(arguments.channels) if arguments.channels else {}
    mapping |= channel_map(arguments.channel)
    record = load_record(arguments.file, mapping, rate_hz=arguments.rate, time=arguments.time)
    given = {name: getattr(arguments, name) for name in ('rig', 'operator', 'notes')}
    notes = {name: text for name, text in given.items() if text}
    path = write_record(arguments.out, record, namespace=arguments.namespace, notes=notes)
    if arguments.json != '-':
        parts = (f'{name} {len(series)}' for name, series in record.items())
        print(f'{path}: {record.duration_s:.1f} s, samples: {", ".join(parts)}')
    if arguments.json:
        channels = {
            name: {'samples': len(series), 'rate_hz': known(series.rate_hz)}
            for name, series in record.items()
        }
        document = {'bag': str(path), 'duration_s': record.duration_s, 'channels': channels}
        write_json(document, arguments.json)
    return 0
