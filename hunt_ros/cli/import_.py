"""`hunt import FILE OUT`: a recording of another program as a bag of this rig."""

from __future__ import annotations

import argparse
from pathlib import Path

from hunt_ros.bag import check_units
from hunt_ros.bag.interchange.importers import load_record
from hunt_ros.bag.record_writer import write_record
from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found
from hunt_ros.samples import CHANNELS, known
from hunt_ros.sensors import MOTION, lacking

EXAMPLE = (
    'hunt import bags/flutter_rig/17092018_CBC_V250_TowardsHB.mat flutter_250 --rate 250'
    " --channel yaw='data[0]' --channel lateral='data[1]*0.47' --channel speed=25.0"
)
#: What an import says of a file, and the words in front of it.
_TOLD = {
    'units_assumed': 'the file tells no unit, assumed: ',
    'left_out': 'left out: ',
    'clock': '',
    'problems': 'damaged: ',
}


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    parser.add('file', type=Path, help='the file to read')
    parser.add('out', type=options.new_folder, help='folder of the bag; must not exist')
    which = f'{", ".join(MOTION)}, roller or speed'
    parser.add('--channel', help=f'{which}: a column, data[1]*0.47, or a constant; repeatable')
    parser.add('--rig')
    parser.add('--rate', help='samples a second of a file without times')
    parser.add('--time', metavar='COLUMN', help='of the times, in s: t or t_ms*0.001')
    parser.add('--namespace', default='rig')
    kept = 'kept in the bag: rig=..., operator=..., notes=...; repeatable'
    parser.add('--note', type=_note, action='append', default=[], metavar='NAME=TEXT', help=kept)


def run(arguments: argparse.Namespace) -> Found:
    """Read the file, write the bag, say what is in it."""
    mapping = options.channels_of(arguments, CHANNELS)
    record = check_units(
        load_record(arguments.file, mapping, rate_hz=arguments.rate, time=arguments.time)
    )
    path = write_record(
        arguments.out, record, namespace=arguments.namespace, notes=dict(arguments.note)
    )
    channels = {
        name: {'samples': len(series), 'rate_hz': known(series.rate_hz)}
        for name, series in record.items()
    }
    told = {name: record.notes.get(name, '') for name in _TOLD}
    written = {'bag': str(path), 'duration_s': record.duration_s, 'channels': channels, **told}
    parts = ', '.join(f'{name} {len(series)}' for name, series in record.items())
    said = [f'{path}: {record.duration_s:.1f} s, samples: {parts}']
    said += [_TOLD[name] + text for name, text in told.items() if text]
    said += [f'no {" or ".join(either)} is in it' for either in lacking(record)]
    return Found(written, ['; '.join(said)])


def _note(text: str) -> tuple[str, str]:
    name, equals, value = text.partition('=')
    if not equals or not name or not value:
        raise argparse.ArgumentTypeError(f'expected NAME=TEXT, got {text}')
    return name, value
