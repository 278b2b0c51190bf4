"""`hunt export BAG OUT`: channels of a recording as a table for other programs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from hunt_ros.bag import Bag
from hunt_ros.bag.interchange.exporters import export_file
from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found

EXAMPLE = "hunt export bags/kick_escapes run.csv --channel y='/rig/lateral.position[0]' --to 20"


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    parser.add('bag', type=Path, help='the recording')
    parser.add('out', type=Path, help='.csv; must not exist')
    parser.add(
        '--channel', help='column and topic.field; repeatable (default: all channels of a rig)'
    )
    parser.add('--rig', '--from', '--to')


def run(arguments: argparse.Namespace) -> Found:
    """Read the columns, write the table."""
    options.check_stretch(arguments)
    channels = options.channels_of(arguments, allowed=None)
    with Bag(arguments.bag) as bag:
        stretch = {'from_s': arguments.start, 'to_s': arguments.end}
        rows = export_file(bag, arguments.out, channels, **stretch)
        problems = list(map(str, bag.problems))
    for problem in problems:
        print(f'hunt export: damaged: {problem}', file=sys.stderr)
    written = {'file': str(arguments.out), 'rows': rows, 'problems': problems}
    return Found(written, [f'{arguments.out}: {rows} rows'])
