"""`hunt export BAG OUT`: channels of a recording as a table for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

SUMMARY = 'write channels of a recording as CSV, Parquet or NumPy arrays'
EXAMPLE = "hunt export recordings/hunt_1 run.csv --channel a='/rig/hunting/amplitude.position[0]'"


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('bag', type=Path, help='the recording')
    parser.add_argument('out', type=Path, help='.csv, .parquet or .npz; must not exist')
    parser.add_argument(
        '--channel',
        action='append',
        default=[],
        metavar='NAME=SOURCE',
        help='column and topic.field; repeatable (default: lateral, yaw, roller, speed)',
    )
    parser.add_argument('--from', dest='start', type=float, metavar='S', help='since the start')
    parser.add_argument('--to', dest='end', type=float, metavar='S', help='since the start')
    parser.add_argument('--json', metavar='PATH', help="what was written, as JSON; '-': stdout")


def run(arguments: argparse.Namespace) -> int:
    """Read the columns, write the table."""
    from hunt_ros.bag.channels import channel_map
    from hunt_ros.bag.exporters import export_file, log_span
    from hunt_ros.cli.output import write_json

    limits: list[int | None] = [None, None]
    if arguments.start is not None or arguments.end is not None:
        origin, _ = log_span(arguments.bag)
        for place, seconds in enumerate((arguments.start, arguments.end)):
            if seconds is not None:
                limits[place] = origin + round(seconds * 1e9)
    channels = channel_map(arguments.channel, allowed=None)
    rows = export_file(
        arguments.bag, arguments.out, channels, start_ns=limits[0], end_ns=limits[1]
    )
    if arguments.json != '-':
        print(f'{arguments.out}: {rows} rows')
    if arguments.json:
        write_json({'file': str(arguments.out), 'rows': rows}, arguments.json)
    return 0
