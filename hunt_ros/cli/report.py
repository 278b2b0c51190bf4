"""The verb `report`: recordings in, one HTML page and the figures of a paper out."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.errors import ConfigError
from hunt_ros.files import write_whole

if TYPE_CHECKING:
    from hunt_ros.identification import Identification

SUMMARY = 'write the report of recordings: one HTML page, and the figures as SVG and PNG'
EXAMPLE = 'hunt report bags/hysteresis_loop --out report.html --figures figures'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    from hunt_ros.cli.support.identification import add_settings

    add_settings(parser)
    parser.add_argument(
        '--out',
        type=options.new_file(),
        metavar='FILE',
        default=Path('report.html'),
        help='the page (%(default)s)',
    )
    parser.add_argument(
        '--figures', type=Path, metavar='DIR', help='write each figure as SVG and PNG here'
    )
    parser.add_argument('--title', metavar='TEXT', help='of the page')
    parser.add_argument(
        '--compare',
        action='store_true',
        help='identify each recording by itself too, and set them side by side',
    )
    options.add_json(parser, 'the identification')


def run(arguments: argparse.Namespace) -> int:
    """Identify, analyse, draw, write; 1 where the data carry no normal form."""
    from hunt_ros.cli.support.identification import records_of, settings_of
    from hunt_ros.cli.support.output import progress, write_json
    from hunt_ros.identification import identify
    from hunt_ros.report.comparison import MOST
    from hunt_ros.report.compose import Report
    from hunt_ros.report.events import events_of
    from hunt_ros.report.figures.style import save_figures
    from hunt_ros.samples import counted

    if arguments.figures:
        options.refuse_place(arguments.figures, 'the figures')
    given = len(arguments.bags)
    if arguments.compare and not 2 <= given <= MOST:
        raise ConfigError(f'--compare: {counted(given, "recording")}, expected 2 to {MOST}')
    settings = settings_of(arguments)
    diameter = settings.roller_diameter_m or None
    with progress('reading') as advance:
        records = records_of(arguments, advance)
    with progress('identifying') as advance:
        identification = identify(records, settings, advance)
    alone: list[Identification] = []
    if arguments.compare:
        for record in records:
            with progress(f'identifying {record.source}') as advance:
                alone.append(identify([record], settings, advance))
    with progress('detecting') as advance:
        events = {}
        for count, record in enumerate(identification.records):
            events[record.source] = events_of(record, identification.normal_form)
            advance((count + 1) / len(identification.records))
    with progress('drawing') as advance:
        title = {} if arguments.title is None else {'title': arguments.title}
        report = Report(identification, events, roller_diameter=diameter, alone=alone, **title)
        drawings = report.drawings()
        advance(0.6)
        written: list[Path] = []
        if arguments.figures:
            figures = {name: one.figure for name, one in drawings.items()}
            written = save_figures(figures, arguments.figures)
        advance(0.9)
        write_whole(arguments.out, report.html(drawings), 'report')
    if arguments.json:
        write_json(report.document, arguments.json)
    if arguments.json != '-':
        print(arguments.out)
        for path in written:
            print(path)
    return 0 if identification.normal_form is not None else 1
