"""The verb `plan`: recordings in, the profile out that teaches the most a minute."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.errors import HuntError

if TYPE_CHECKING:
    from hunt_ros.identification.plan import Plan

SUMMARY = 'say what to measure next: the profile that teaches the most a minute'
EXAMPLE = 'hunt plan bags/hysteresis_loop --budget 2min --out next.yaml'

_UNITS = {'': 1.0, 's': 1.0, 'min': 60.0, 'h': 3600.0}
#: Actions that are shown.
_SHOWN = 6


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    from hunt_ros.cli.support.identification import add_keep, add_settings

    parser.add_argument(
        '--budget', type=_time, default=600.0, metavar='TIME', help='600, 600s, 10min (10min)'
    )
    parser.add_argument(
        '--max-escape',
        type=options.number(0.0, 1.0),
        default=0.05,
        metavar='P',
        help='largest chance that hunting begins where it is not meant to (%(default)s)',
    )
    speed = options.number(0.0, 1e3, 'm/s', above=True)
    parser.add_argument(
        '--speed-ceiling',
        type=speed,
        metavar='MPS',
        help='default: that of --rig, or the fastest recorded',
    )
    parser.add_argument(
        '--at',
        type=_speeds,
        default=(),
        metavar='V,...',
        help='speeds at which the unstable amplitude is wanted, m/s',
    )
    parser.add_argument(
        '--start', type=speed, metavar='MPS', help='speed of the rig now (the slowest recorded)'
    )
    parser.add_argument(
        '--kicks', action='store_true', help='somebody stands by to kick the wheelset'
    )
    parser.add_argument(
        '--rearm',
        type=options.number(0.0, 1e4, 's'),
        default=10.0,
        metavar='S',
        help='time that a kick costs (%(default)s)',
    )
    parser.add_argument('--out', type=Path, metavar='FILE', help='write the profile here')
    add_settings(parser, 'recordings, or the parameter file of hunt identify --out')
    add_keep(parser)
    options.add_json(parser, 'the plan')


def run(arguments: argparse.Namespace) -> int:
    """Identify, plan, write the profile, say why."""
    from hunt_ros.cli.support.identification import identification_of
    from hunt_ros.cli.support.output import progress, write_json
    from hunt_ros.identification.plan import PlanSettings, plan

    settings = PlanSettings(
        budget_s=arguments.budget,
        max_escape=arguments.max_escape,
        speed_ceiling_mps=arguments.speed_ceiling or options.rig_of(arguments).speed_ceiling_mps,
        speeds_mps=arguments.at,
        kicks=arguments.kicks,
        rearm_s=arguments.rearm,
        start_speed_mps=arguments.start or 0.0,
        seed=arguments.seed or 0,
    )
    known = identification_of(arguments)
    with progress('planning') as advance:
        found = plan(known, settings)
        advance(1.0)
    if arguments.out:
        _write(arguments.out, found.profile.to_yaml())
    if arguments.json:
        write_json(found.to_json(), arguments.json)
    if arguments.json != '-':
        print(describe(found))
    return 0


def describe(found: Plan) -> str:
    """Return the plan as a few lines for a person."""
    lines = [found.reason]
    for one in found.quantities:
        scale, unit = (1e6, 'um') if one.unit == 'm' else (1.0, one.unit)
        lines.append(
            f'{one.name:16s}{scale * one.value:.5g} {unit}, deviation {scale * one.std:.2g}'
            f' -> {scale * one.std_after:.2g} {unit}'
        )
    lines.append(
        f'lasts about {found.duration_s:.0f} s, at most {found.longest_s:.0f} s'
        + (
            ''
            if found.escape is None
            else f'; chance of unwanted hunting {100.0 * found.escape:.2g} %'
        )
    )
    lines += [f'  {one.duration_s:5.0f} s  {one.action.words}' for one in found.steps]
    if found.actions:
        lines.append('from here, the best actions (drop of the log deviations a minute):')
    lines += [
        f'  {one.gain_per_minute:7.2f}  {one.action.words}' for one in found.actions[:_SHOWN]
    ]
    return '\n'.join(lines)


def _time(text: str) -> float:
    found = re.fullmatch(r'([0-9.]+)\s*(s|min|h|)', text.strip())
    try:
        value = float(found.group(1)) * _UNITS[found.group(2)] if found else -1.0
    except ValueError:
        value = -1.0
    if not 10.0 <= value <= 86_400.0:
        raise argparse.ArgumentTypeError(
            f'expected a time from 10 s to 24 h, such as 600s or 10min, got {text}'
        )
    return value


def _speeds(text: str) -> tuple[float, ...]:
    speed = options.number(0.0, 1e3, 'm/s', above=True)
    return tuple(speed(word) for word in text.split(','))


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise HuntError(f'{path}: cannot write the profile ({error.strerror})') from error
