"""`hunt tune BAG...`: settings of the detector over all recordings of a lab, beside the truth."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found, progress
from hunt_ros.cli.support.recordings import add_recordings, identified
from hunt_ros.detection import DetectorConfig
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.report.figures.style import write_picture
from hunt_ros.report.tuning import Outcome, Truth, picture, tune, usual_grid

EXAMPLE = 'hunt tune bags/kick_escapes bags/kick_decays --grid alarm_lateral_mm=0.1,0.3'


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    add_recordings(parser, hunting_detector=(DetectorConfig,))
    parser.add('--normal-form')
    what = 'values of one setting, e.g. false_alarms_per_week=1,100; repeatable (the usual ones)'
    grid = {'type': _values, 'metavar': 'NAME=X,...'}
    parser.add('--grid', action='append', default=[], **grid, help=what)
    what = 'draw false alarms against delay'
    parser.add('--out', type=options.new_file('.svg', '.png'), metavar='FILE', help=what)


def run(arguments: argparse.Namespace) -> Found:
    """Say what is true, replay, and compare; 1 where no recording says what is true."""
    (config,) = options.settings_of(arguments, 'hunting_detector', DetectorConfig)
    form = IdentifiedNormalForm.read(arguments.normal_form) if arguments.normal_form else None
    _, found = identified(arguments, here=True)
    grid = dict(arguments.grid) or usual_grid(found, form is not None)
    with progress('replaying') as advance:
        truths, outcomes = tune(found, config, form, grid, arguments.cluster or '', advance)
    if arguments.out and outcomes[0].harmless_s:
        write_picture(picture(outcomes), arguments.out)
    document = {
        'truth': _truth(truths),
        'settings': [one.to_json() for one in outcomes],
        'warnings': _warnings(outcomes),
    }
    seen = any(truth.hunting or truth.harmless for truth in truths)
    return Found(document, _lines(truths, outcomes), 0 if seen else 1)


def _values(word: str) -> tuple[str, tuple[float, ...]]:
    name, _, values = word.partition('=')
    if not isinstance(getattr(DetectorConfig(), name, None), float):
        raise argparse.ArgumentTypeError(f'{word}: expected numbers of one setting, NAME=X,X,...')
    return name, options.numbers(options.number(0.0, 1e9))(values)


def _truth(truths: Sequence[Truth]) -> dict[str, float]:
    hunting = [end - begin for truth in truths for begin, end in truth.hunting]
    harmless, whole = (
        sum(getattr(truth, name) for truth in truths) for name in ('harmless_s', 'duration_s')
    )
    return {
        'recordings': len(truths),
        'hunting': len(hunting),
        'hunting_s': sum(hunting),
        'harmless_s': harmless,
        'undecided_s': max(0.0, whole - harmless - sum(hunting)),
    }


def _lines(truths: Sequence[Truth], outcomes: Sequence[Outcome]) -> list[str]:
    lines = [
        'recordings: {recordings}; hunting: {hunting} x, {hunting_s:.0f} s; harmless:'
        ' {harmless_s:.0f} s; undecided: {undecided_s:.0f} s'.format(**_truth(truths)),
        f'{"setting":32}{"false":>6}{"an hour (95 %)":>26}{"delay (s)":>24}{"missed":>8}'
        f'{"undecided":>11}',
    ]
    for one in outcomes:
        name = f'{one.setting}={one.value:g}' if one.setting else 'as they are'
        rate, (median, least, longest) = one.per_hour, one.delay_s
        count, low, high = (float(f'{x:.2g}') for x in (rate.value, rate.low, rate.high))
        told = f'{count:g} ({low:g} to {high:g})' if one.harmless_s else '-'
        delay = f'{median:.2f} ({least:.2f} to {longest:.2f})' if one.delays_s else '-'
        lines.append(
            f'{name:32}{one.false_alarms:>6}{told:>26}{delay:>24}{one.missed:>8}{one.undecided:>11}'
        )
    return lines + _warnings(outcomes)


def _warnings(outcomes: Sequence[Outcome]) -> list[str]:
    """Return why a number is not known, and where it says nothing."""
    found = []
    if not outcomes[0].harmless_s:
        found.append(
            'nothing harmless was seen: no rate of false alarms is known, and no picture drawn'
        )
    elif not any(one.differs(outcomes[0]) for one in outcomes):
        found.append('no rate of false alarms differs from the present one by more than chance')
    if not all(one.delays_s for one in outcomes):
        found.append('no delay is known where nothing hunted, or all that did was missed')
    return found
