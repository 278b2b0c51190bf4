"""`hunt export BAG OUT`: channels of a recording as a table for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from hunt_ros.cli.support import options
from hunt_ros.errors import ConfigError

SUMMARY = 'write channels of a recording as CSV, Parquet or NumPy arrays'
EXAMPLE = "hunt export bags/kick_escapes run.csv --channel y='/rig/lateral.position[0]' --to 20"


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('bag', type=Path, help='the recording')
    parser.add_argument('out', type=Path, help='.csv, .parquet or .npz; must not exist')
    options.add_channels(
        parser, 'column and topic.field; repeatable (default: all channels of a rig)'
    )
    options.add_rig(parser)
    options.add_stretch(parser)
    options.add_json(parser, 'what was written')


def run(arguments: argparse.Namespace) -> int:
    """Read the columns, write the table."""
    from hunt_ros.bag.interchange.exporters import export_file, log_span
    from hunt_ros.cli.support.output import write_json

    options.check_stretch(arguments)
    limits: list[int | None] = [None, None]
    if arguments.start is not None or arguments.end is not None:
        origin, last = log_span(arguments.bag)
        if arguments.start is not None and arguments.start * 1e9 > last - origin:
            raise ConfigError(
                f'--from: {arguments.start:g} s is behind the end of {arguments.bag}, which'
                f' lasts {(last - origin) / 1e9:.3f} s'
            )
        for place, seconds in enumerate((arguments.start, arguments.end)):
            if seconds is not None:
                limits[place] = origin + round(seconds * 1e9)
    channels = options.channels_of(arguments, allowed=None)
    rows = export_file(
        arguments.bag, arguments.out, channels, start_ns=limits[0], end_ns=limits[1]
    )
    if arguments.json != '-':
        print(f'{arguments.out}: {rows} rows')
    if arguments.json:
        write_json({'file': str(arguments.out), 'rows': rows}, arguments.json)
    return 0
