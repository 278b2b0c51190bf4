"""The verb `report`: recordings in, one HTML page and the figures of a paper out."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from hunt_ros.bag import Bag
from hunt_ros.bag.clips import clips_of
from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found, progress
from hunt_ros.cli.support.recorded_run import recorded_events
from hunt_ros.cli.support.recordings import add_recordings, identified, settings_of
from hunt_ros.errors import ConfigError
from hunt_ros.files import write_whole
from hunt_ros.identification import Identification, identify
from hunt_ros.report.alarms import load_of
from hunt_ros.report.comparison import MOST
from hunt_ros.report.compose import Report
from hunt_ros.report.events import events_of
from hunt_ros.report.figures.style import save_figures
from hunt_ros.samples import counted

EXAMPLE = 'hunt report bags/hysteresis_loop --out report.html --figures figures'


def configure(parser: options.Parser) -> None:
    """Add the arguments of the verb."""
    add_recordings(parser)
    page, out = options.new_file('.html'), 'report.html'  # a text: its folder is looked at too
    parser.add('--out', type=page, metavar='FILE', default=out, help=f'the page ({out})')
    parser.add('--figures', type=Path, metavar='DIR', help='write each figure as SVG and PNG here')
    parser.add('--title', metavar='TEXT', help='of the page')
    what = 'identify each recording by itself too, and set them side by side'
    parser.add('--compare', **options.FLAG, help=what)


def run(arguments: argparse.Namespace) -> Found:
    """Identify, analyse, draw, write; 1 where the data carry no normal form."""
    if arguments.figures:
        options.refuse_place(arguments.figures, 'the figures')
    given = len(arguments.bags)
    if arguments.compare and not 2 <= given <= MOST:
        raise ConfigError(f'--compare: {counted(given, "recording")}, expected 2 to {MOST}')
    settings = settings_of(arguments)
    records, identification = identified(arguments, here=True)
    alone: list[Identification] = []
    for number, record in enumerate(records if arguments.compare else (), start=1):
        with progress(f'identifying recording {number}') as advance:
            alone.append(identify([record], settings, advance))
    with progress('detecting') as advance:
        events, loads, clearances = {}, [], {}
        for count, record in enumerate(identification.records):
            found, held = events_of(record, identification.normal_form)
            events[record.source], clearances[record.source] = found, held
            with Bag(path := Path(record.source)) as bag:
                live = recorded_events(bag)
            for problem in map(str, bag.problems):
                if problem not in record.notes.get('problems', ''):
                    print(f'hunt report: damaged: {problem}', file=sys.stderr)
            told = found if live is None else live
            clips = [clip.name for clip in clips_of(path)]
            loads.append(load_of(told, record, live is not None, clips))
            advance((count + 1) / len(identification.records))
    with progress('drawing') as advance:
        report = Report(
            identification,
            events,
            roller_diameter=settings.roller_diameter_m or None,
            alone=alone,
            loads=loads,
            clearances=clearances,
            title=arguments.title or Report.title,
        )
        drawings = report.drawings()
        advance(0.6)
        figures = {name: one.figure for name, one in drawings.items()}
        written = save_figures(figures, arguments.figures) if arguments.figures else []
        advance(0.9)
        write_whole(arguments.out, report.html(drawings), 'report')
    lines = [str(path) for path in (arguments.out, *written)]
    if identification.normal_form is None:
        lines.append(f'no normal form: {identification.unknown["normal_form"]}')
    return Found(report.document, lines, 0 if identification.normal_form is not None else 1)
