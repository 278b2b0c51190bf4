"""The verb `report`: recordings in, one HTML page and the figures of a paper out."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.errors import HuntError

if TYPE_CHECKING:
    from hunt_ros.cli.support.output import Advance
    from hunt_ros.identification import Identification
    from hunt_ros.report.figures.overview import RunEvent

SUMMARY = 'write the report of recordings: one HTML page, and the figures as SVG and PNG'
EXAMPLE = 'hunt report bags/hysteresis_loop --out report.html --figures figures'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    from hunt_ros.cli.support.identification import add_settings

    add_settings(parser)
    parser.add_argument(
        '--out', metavar='FILE', default='report.html', help='the page (%(default)s)'
    )
    parser.add_argument('--figures', metavar='DIR', help='write each figure as SVG and PNG here')
    parser.add_argument('--title', metavar='TEXT', help='of the page')
    parser.add_argument(
        '--model',
        type=Path,
        metavar='FILE',
        help='show a model beside it: CSV with v (m/s), A (m), stability, or a rig as YAML',
    )
    options.add_json(parser, 'the identification')


def run(arguments: argparse.Namespace) -> int:
    """Identify, analyse, draw, write; 1 where the data carry no normal form."""
    from hunt_ros.cli.support.identification import records_of, settings_of
    from hunt_ros.cli.support.output import progress, write_json
    from hunt_ros.identification import identify
    from hunt_ros.report.compose import Report
    from hunt_ros.report.figures.style import save_figures

    page = _places(arguments)
    model = None
    if arguments.model is not None:
        from hunt_ros.report.figures.own_model import model_of

        model = model_of(options.read_text(arguments.model, 'model'), str(arguments.model))
    settings = settings_of(arguments)
    diameter = settings.roller_diameter_m or None
    with progress('reading') as advance:
        records = records_of(arguments, advance)
    with progress('identifying') as advance:
        identification = identify(records, settings, advance)
    with progress('detecting') as advance:
        events = _events(identification, advance)
    with progress('drawing') as advance:
        title = {} if arguments.title is None else {'title': arguments.title}
        report = Report(identification, events, roller_diameter=diameter, model=model, **title)
        drawings = report.drawings()
        advance(0.6)
        written: list[Path] = []
        if arguments.figures:
            written = save_figures(
                {name: one.figure for name, one in drawings.items()}, Path(arguments.figures)
            )
        advance(0.9)
        _write(page, report.html(drawings))
    if arguments.json:
        write_json(report.document, arguments.json)
    if arguments.json != '-':
        print(page)
        for path in written:
            print(path)
    return 0 if identification.normal_form is not None else 1


def _places(arguments: argparse.Namespace) -> Path:
    """Return where the page goes, once it is sure that page and figures can be written."""
    page = Path(arguments.out)
    if not page.absolute().parent.is_dir() or page.is_dir():
        raise HuntError(f'{page}: cannot write the report there, expected a file in a folder')
    if arguments.figures:
        try:
            Path(arguments.figures).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise HuntError(
                f'{arguments.figures}: cannot make the folder of the figures ({error.strerror})'
            ) from error
    return page


def _events(identification: Identification, advance: Advance) -> Sequence[RunEvent]:
    """Run the detector over every record, with the form just identified."""
    from hunt_ros.report.events import events_of

    events: list[RunEvent] = []
    total = len(identification.records)
    for count, record in enumerate(identification.records):
        start = count / total

        def part(fraction: float, start: float = start) -> None:
            advance(start + fraction / total)

        events += events_of(record, identification.normal_form, part)
    return events


def _write(path: Path, text: str) -> None:
    """Write the page under a temporary name first: a report is there whole, or not at all."""
    partial = path.with_name(path.name + '.part')
    try:
        partial.write_text(text, encoding='utf-8')
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise HuntError(f'{path}: cannot write the report ({error.strerror})') from error
