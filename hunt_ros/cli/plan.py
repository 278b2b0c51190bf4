"""The verb `plan`: recordings in, the profile out that teaches the most a minute."""

from __future__ import annotations

import argparse
import math
from itertools import groupby

from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found, progress
from hunt_ros.cli.support.recordings import add_recordings, known_of
from hunt_ros.errors import ConfigError
from hunt_ros.files import write_whole
from hunt_ros.identification.plan import Plan, PlanSettings, plan
from hunt_ros.samples import Uncertain

EXAMPLE = 'hunt plan bags/hysteresis_loop --budget 120 --out next.yaml'

#: Option -> setting of the plan.
_OPTIONS = {
    '--budget': 'budget_s',
    '--max-escape': 'max_escape',
    '--start': 'start_speed_mps',
    '--at': 'speeds_mps',
}


def configure(parser: options.Parser) -> None:
    """Add the arguments of the verb."""
    options.add_settings(parser, PlanSettings, _OPTIONS)
    parser.add('--out', type=options.new_file(), metavar='FILE', help='write the profile here')
    add_recordings(parser, 'recordings, or the parameter file of hunt identify --out')


def run(arguments: argparse.Namespace) -> Found:
    """Identify, plan, write the profile, say why."""
    given = options.given_settings(arguments, (*_OPTIONS.values(), 'seed'))
    ceiling = options.rig_of(arguments).speed_ceiling_mps
    if math.isfinite(ceiling):
        given['speed_ceiling_mps'] = ceiling
    settings = PlanSettings(**given)
    if settings.start_speed_mps > ceiling:
        raise ConfigError(
            f'--start: {settings.start_speed_mps:g} m/s is above the ceiling, {ceiling:g} m/s'
        )
    known = known_of(arguments)
    with progress('planning') as advance:
        found = plan(known, settings)
        advance(1.0)
    if arguments.out:
        write_whole(arguments.out, found.profile.to_yaml(), 'profile')
    return Found(found.to_json(), describe(found))


def describe(found: Plan) -> list[str]:
    """Return the plan as a few lines for a person."""
    lines = [found.reason]
    for one in found.quantities:
        scale, unit = (1e6, 'um') if one.unit == 'm' else (1.0, one.unit)
        now = Uncertain(scale * one.value, scale * one.std)
        lines.append(f'{one.name:16s}{now} {unit}, at best ± {one.told(one.std_after)} after it')
    low, high = found.duration_ci95_s
    lasts = f'lasts about {found.duration_s:.0f} s (95 %: {low:.0f} to {high:.0f})'
    lasts += f', at most {found.longest_s:.0f} s'
    if found.escape is not None:
        lasts += f'; chance of unwanted hunting {100.0 * found.escape:.2g} %'
    lines.append(lasts)
    if found.steps:
        lines.append('the profile, and how long each part lasts on average:')
    for words, alike in groupby(found.steps, key=lambda one: one.words):
        lasting = [one.duration_s for one in alike]
        times = f', {len(lasting)} times' if len(lasting) > 1 else ''
        lines.append(f'  {sum(lasting):5.0f} s  {words}{times}')
    return lines
