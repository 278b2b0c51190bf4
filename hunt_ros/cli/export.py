"""`hunt export BAG OUT`: channels of a recording as a table for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from hunt_ros.cli.support import options

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
    from hunt_ros.bag.interchange.exporters import export_file
    from hunt_ros.cli.support.output import write_json

    options.check_stretch(arguments)
    channels = options.channels_of(arguments, allowed=None)
    rows = export_file(
        arguments.bag, arguments.out, channels, from_s=arguments.start, to_s=arguments.end
    )
    if arguments.json != '-':
        print(f'{arguments.out}: {rows} rows')
    if arguments.json:
        write_json({'file': str(arguments.out), 'rows': rows}, arguments.json)
    return 0
