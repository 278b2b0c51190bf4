"""The verb `plan`: recordings in, the profile out that teaches the most a minute."""

from __future__ import annotations

import argparse
import math
import re
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.errors import ConfigError
from hunt_ros.files import write_whole

if TYPE_CHECKING:
    from hunt_ros.identification.plan import Plan

SUMMARY = 'say what to measure next: the profile that teaches the most a minute'
EXAMPLE = 'hunt plan bags/hysteresis_loop --budget 2min --out next.yaml'

_UNITS = {'': 1.0, 's': 1.0, 'min': 60.0, 'h': 3600.0}
#: Option -> setting of the plan.
_OPTIONS = {
    '--max-escape': 'max_escape',
    '--speed-ceiling': 'speed_ceiling_mps',
    '--start': 'start_speed_mps',
    '--kicks': 'kicks',
    '--rearm': 'rearm_s',
}
#: Actions that are shown.
_SHOWN = 6


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    from hunt_ros.cli.support.identification import add_settings
    from hunt_ros.identification.plan_settings import PlanSettings

    parser.add_argument(
        '--budget', type=_time, dest='budget_s', metavar='TIME', help='600, 600s, 10min (10min)'
    )
    options.add_settings(parser, PlanSettings, _OPTIONS)
    parser.add_argument(
        '--at',
        type=_speeds,
        dest='speeds_mps',
        metavar='V,...',
        help='speeds at which the unstable amplitude is wanted, m/s',
    )
    parser.add_argument(
        '--out', type=options.new_file(), metavar='FILE', help='write the profile here'
    )
    add_settings(parser, 'recordings, or the parameter file of hunt identify --out')
    options.add_json(parser, 'the plan')


def run(arguments: argparse.Namespace) -> int:
    """Identify, plan, write the profile, say why."""
    from hunt_ros.cli.support.identification import identification_of
    from hunt_ros.cli.support.output import progress, write_json
    from hunt_ros.identification.plan import plan
    from hunt_ros.identification.plan_settings import PlanSettings

    names = (*_OPTIONS.values(), 'budget_s', 'speeds_mps', 'seed')
    given = {name: getattr(arguments, name) for name in names}
    if not given['speed_ceiling_mps']:
        ceiling_mps = options.rig_of(arguments).speed_ceiling_mps
        given['speed_ceiling_mps'] = ceiling_mps if math.isfinite(ceiling_mps) else None
    settings = PlanSettings(**{name: one for name, one in given.items() if one is not None})
    ceiling = settings.speed_ceiling_mps
    if ceiling and settings.start_speed_mps > ceiling:
        raise ConfigError(
            f'--start: {settings.start_speed_mps:g} m/s is above the ceiling, {ceiling:g} m/s'
        )
    known = identification_of(arguments)
    with progress('planning') as advance:
        found = plan(known, settings)
        advance(1.0)
    if arguments.out:
        write_whole(arguments.out, found.profile.to_yaml(), 'profile')
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
    if found.steps:
        lines.append('the profile, and how long each part lasts on average:')
    lines += [f'  {one.duration_s:5.0f} s  {one.action.words}' for one in found.steps]
    if found.actions:
        lines.append(
            'the best actions from here, by what a minute teaches (drop of the logarithms of the'
            ' deviations above, 1/min):'
        )
    lines += [
        f'  {one.gain_per_minute:7.2f} 1/min  {one.action.words}' for one in found.actions[:_SHOWN]
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
