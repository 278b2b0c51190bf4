"""`hunt simulate OUT`: a recording of a simulated rig, as fast as the machine computes it."""

from __future__ import annotations

import argparse
import math
import sys

from hunt_ros.bag.record_writer import write_record
from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found
from hunt_ros.dynamics.linear_stability import critical_frequency
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.profile import Profile
from hunt_ros.dynamics.simulation import Kick, Roughness, SensorModel, SimulationSettings, simulate
from hunt_ros.errors import ConfigError

#: Of one sensor: a day at 1 kHz, and what a machine's memory holds.
_MOST_SAMPLES = 1e8
_SWEEP = 'profile: [{sweep: {low_mps: 6.0, high_mps: 8.8}}]'

EXAMPLE = (
    'hunt simulate steps --kick 60:0.0001 --seed 3 --profile'
    ' "profile: [{staircase: {low_mps: 6.4, high_mps: 7.2}}]"'
)


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    parser.add('out', type=options.new_folder, help='folder of the bag; must not exist')
    what = 'speed profile: file or text, as of the speed node, docs/profiles.md (%(default)s)'
    parser.add('--profile', metavar='FILE', default=_SWEEP, help=what)
    longest = options.number(0.0, options.LONGEST_S, 's', above=True)
    parser.add('--duration', type=longest, metavar='S', help='default: to the end of the profile')
    pair = options.numbers(options.number(-1e6, 1e6), ':', form='T:SIZE')
    what = 'blow at T seconds that moves the wheelset sideways by SIZE m; repeatable'
    parser.add('--kick', type=pair, action='append', default=[], metavar='T:SIZE', help=what)
    parser.add(
        '--wheelset', default='', metavar='FILE', help='the rig as YAML (default: built in)'
    )
    parser.add('--rate', default=500.0, help='samples a second of the sensors (%(default)s)')
    size = options.number(0.0, 0.1)
    for name, default, metavar, what in (
        ('--roughness', 20e-6, 'M', 'roughness line (%(default)s m)'),
        ('--broadband', 8e-6, 'WN', 'white yaw forcing wn (%(default)s)'),
        ('--noise', 5e-6, 'M', 'lateral sensor (%(default)s m)'),
        ('--yaw-noise', 2e-5, 'RAD', 'yaw sensor (%(default)s rad)'),
    ):
        parser.add(name, type=size, default=default, metavar=metavar, help=what)
    parser.add('--seed', default=0)


def run(arguments: argparse.Namespace) -> Found:
    """Simulate, write the bag, say where it is."""
    rig, settings = RigParameters.read(arguments.wheelset), _settings(arguments)
    profile = Profile.read(arguments.profile)
    duration_s = profile.duration_s if arguments.duration is None else arguments.duration
    if duration_s * arguments.rate > _MOST_SAMPLES:
        raise ConfigError(
            f'--rate: {duration_s:g} s at {arguments.rate:g} Hz are more than'
            f' {_MOST_SAMPLES:g} samples a sensor'
        )
    hunting_hz = critical_frequency(rig) / (2.0 * math.pi * rig.time_scale)
    if arguments.rate < 2.0 * hunting_hz:  # Shannon (1949)
        raise ConfigError(
            f'--rate: {arguments.rate:g} Hz are too few to show hunting of {hunting_hz:.3g} Hz,'
            f' expected {2.0 * hunting_hz:.3g} or more'
        )
    kicks = []
    for time_s, size in arguments.kick:
        if not 0.0 <= time_s <= duration_s:
            raise ConfigError(f'--kick: {time_s:g} s is not within the {duration_s:g} s simulated')
        if not abs(size) < rig.half_gauge_m:
            raise ConfigError(
                f'--kick: {size:g} m throws the wheelset off the rollers, expected less than'
                f' its half gauge, {rig.half_gauge_m:g} m'
            )
        kicks.append(Kick(time_s, lateral_m=size))
    record = simulate(rig, settings, profile, arguments.duration, kicks=kicks, seed=arguments.seed)
    notes = {'source': 'hunt simulate', 'seed': str(arguments.seed)}
    path = write_record(arguments.out, record, notes=notes)
    samples = sum(len(series) for series in record.values())
    late = ', '.join(f'{t:g} s' for t, _ in arguments.kick if t > record.duration_s)
    if late:  # steps that react to the amplitude may end early
        over = f'hunt simulate: over after {record.duration_s:.1f} s'
        print(f'{over}: no kick at {late}', file=sys.stderr)
    written = {'bag': str(path), 'duration_s': record.duration_s, 'samples': samples}
    return Found(written, [f'{path}: {record.duration_s:.1f} s, {samples} samples'])


def _settings(arguments: argparse.Namespace) -> SimulationSettings:
    return SimulationSettings(
        sample_rate_hz=arguments.rate,
        roughness=Roughness((arguments.roughness,)),
        broadband=arguments.broadband,
        lateral_sensor=SensorModel(noise=arguments.noise),
        yaw_sensor=SensorModel(noise=arguments.yaw_noise),
    )
