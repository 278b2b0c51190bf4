"""`hunt simulate OUT`: a recording of a simulated rig, as fast as the machine computes it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli import options
from hunt_ros.errors import ConfigError

if TYPE_CHECKING:
    from hunt_ros.dynamics.parameters import RigParameters
    from hunt_ros.dynamics.simulation import SimulationSettings, SpeedProfile

#: Of one sensor: a day at 1 kHz, and what a machine's memory holds.
_MOST_SAMPLES = 1e8
_POSITIVE = options.number(0.0, 1e6, above=True)

SUMMARY = 'simulate the rig over a speed profile and write the recording as a bag'
EXAMPLE = 'hunt simulate sweep --sweep 6 8.8 0.02 --kick 60:0.0001 --seed 3'


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('out', type=Path, help='folder of the bag; must not exist')
    speed = parser.add_mutually_exclusive_group()
    speed.add_argument(
        '--sweep',
        nargs=3,
        type=_POSITIVE,
        metavar=('LOW', 'HIGH', 'RATE'),
        help='up and back, m/s, m/s and m/s^2 (default: 6 8.8 0.02)',
    )
    speed.add_argument(
        '--staircase',
        nargs=4,
        type=_POSITIVE,
        metavar=('LOW', 'HIGH', 'STEP', 'HOLD'),
        help='up and back in steps, m/s, each held HOLD seconds',
    )
    speed.add_argument(
        '--profile', type=_corners, metavar='T:V,...', help='corners: seconds and m/s'
    )
    parser.add_argument(
        '--duration',
        type=options.number(0.0, options.LONGEST_S, 's', above=True),
        metavar='S',
        help='default: the whole profile',
    )
    parser.add_argument(
        '--kick',
        type=_pair,
        action='append',
        default=[],
        metavar='T:SIZE',
        help='blow at T seconds that moves the wheelset sideways by SIZE m; repeatable',
    )
    parser.add_argument(
        '--wheelset', type=Path, metavar='FILE', help='the rig as YAML (default: built in)'
    )
    options.add_rate(parser, 500.0, 'of the sensors (%(default)s)')
    for name, default, metavar, what in (
        ('roughness', 20e-6, 'M', 'roughness line (%(default)s m)'),
        ('broadband', 8e-6, 'WN', 'white yaw forcing wn (%(default)s)'),
        ('noise', 5e-6, 'M', 'lateral sensor (%(default)s m)'),
        ('yaw-noise', 2e-5, 'RAD', 'yaw sensor (%(default)s rad)'),
    ):
        kind = options.number(0.0, 0.1)
        parser.add_argument(f'--{name}', type=kind, default=default, metavar=metavar, help=what)
    options.add_seed(parser)
    options.add_json(parser, 'what was written')


def run(arguments: argparse.Namespace) -> int:
    """Simulate, write the bag, say where it is."""
    from hunt_ros.bag.writer import write_record
    from hunt_ros.cli.output import write_json
    from hunt_ros.dynamics.simulation import Kick, simulate

    if arguments.out.exists():
        raise ConfigError(f'{arguments.out}: exists already, expected the name of a new folder')
    rig, settings, profile = _rig(arguments.wheelset), _settings(arguments), _profile(arguments)
    duration_s = profile.duration_s if arguments.duration is None else arguments.duration
    if duration_s > options.LONGEST_S:
        raise ConfigError(f'the profile lasts {duration_s:g} s, more than {options.LONGEST_S:g} s')
    if duration_s * arguments.rate > _MOST_SAMPLES:
        raise ConfigError(
            f'--rate: {duration_s:g} s at {arguments.rate:g} Hz are more than'
            f' {_MOST_SAMPLES:g} samples a sensor'
        )
    for time_s, size in arguments.kick:
        if not 0.0 <= time_s <= duration_s:
            raise ConfigError(f'--kick: {time_s:g} s is not within the {duration_s:g} s simulated')
        if not abs(size) < rig.half_gauge_m:
            raise ConfigError(
                f'--kick: {size:g} m throws the wheelset off the rollers, expected less than'
                f' its half gauge, {rig.half_gauge_m:g} m'
            )
    kicks = [Kick(time_s, lateral_m=size) for time_s, size in arguments.kick]
    record = simulate(rig, settings, profile, duration_s, kicks=kicks, seed=arguments.seed)
    notes = {'source': 'hunt simulate', 'seed': str(arguments.seed)}
    path = write_record(arguments.out, record, notes=notes)
    samples = sum(len(series) for series in record.values())
    if arguments.json != '-':
        print(f'{path}: {record.duration_s:.1f} s, {samples} samples')
    if arguments.json:
        document = {'bag': str(path), 'duration_s': record.duration_s, 'samples': samples}
        write_json(document, arguments.json)
    return 0


def _rig(path: Path | None) -> RigParameters:
    from hunt_ros.dynamics.parameters import RigParameters, paper_rig

    if path is None:
        return paper_rig()
    return RigParameters.from_yaml(options.read_text(path, 'rig'), str(path))


def _profile(arguments: argparse.Namespace) -> SpeedProfile:
    import numpy as np

    from hunt_ros.dynamics.simulation import SpeedProfile

    if arguments.profile:
        times, speeds = zip(*arguments.profile, strict=True)
        return SpeedProfile(tuple(times), tuple(speeds))
    if arguments.staircase:
        low, high, step, hold_s = arguments.staircase
        if step <= 0.0 or high < low:
            raise ConfigError(f'--staircase: no steps of {step:g} from {low:g} to {high:g} m/s')
        up = np.append(np.arange(low, high - 0.5 * step, step), high).tolist()
        return SpeedProfile.staircase(*up, *up[-2::-1], hold_s=hold_s)
    low, high, rate = arguments.sweep or (6.0, 8.8, 0.02)
    if high < low:
        raise ConfigError(f'--sweep: no way up from {low:g} to {high:g} m/s')
    return SpeedProfile.sweep(low, high, rate)


def _settings(arguments: argparse.Namespace) -> SimulationSettings:
    from hunt_ros.dynamics.simulation import Roughness, SensorModel, SimulationSettings

    return SimulationSettings(
        sample_rate_hz=arguments.rate,
        initial_speed=float(_profile(arguments)(0.0)),
        roughness=Roughness((arguments.roughness,)) if arguments.roughness else Roughness(),
        broadband=arguments.broadband,
        lateral_sensor=SensorModel(noise=arguments.noise),
        yaw_sensor=SensorModel(noise=arguments.yaw_noise),
    )


def _pair(text: str) -> tuple[float, float]:
    first, colon, second = text.partition(':')
    if not colon:
        raise argparse.ArgumentTypeError(f'expected two numbers T:VALUE, got {text}')
    finite = options.number(-1e6, 1e6)
    return finite(first), finite(second)


def _corners(text: str) -> list[tuple[float, float]]:
    return [_pair(part) for part in text.split(',')]
