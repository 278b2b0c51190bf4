"""The verb `identify`: recordings in, normal form with intervals out."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.errors import HuntError

if TYPE_CHECKING:
    from hunt_ros.cli.support.output import Advance
    from hunt_ros.identification import Identification, IdentificationSettings
    from hunt_ros.identification.days import Days
    from hunt_ros.samples import Record, Uncertain

SUMMARY = 'identify the normal form, with intervals, from recordings'
EXAMPLE = 'hunt identify bags/hysteresis_loop --out normal_form.yaml --json -'


#: Whose section of a parameter file is read as well: it does the same in a running suite.
NODE = 'normal_form_identifier'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_settings(parser)
    parser.add_argument(
        '--out',
        type=_parameter_file,
        metavar='FILE',
        help='write the ROS parameter file here, and beside it the whole identification, as .npz',
    )
    parser.add_argument(
        '--branches',
        type=Path,
        metavar='FILE.csv',
        help='write both branches with their 95 %% bands here',
    )
    options.add_json(parser, 'the whole result')


def add_settings(parser: argparse.ArgumentParser, what: str = 'recordings: runs, days') -> None:
    """Add what to read and how to identify: what `report` and `plan` share with `identify`."""
    parser.add_argument('bags', nargs='+', metavar='BAG', help=what)
    options.add_channels(parser)
    parser.add_argument(
        '--day',
        metavar='PATTERN',
        help="regular expression: its first group in a bag's path is its day (else the date)",
    )
    options.add_rig(parser)
    for name, metavar, share, said in (
        ('v-c', 'V[:STD]', 0.01, 'known v_c, m/s (STD: 1 %%)'),
        ('D1', 'D[:STD]', 0.1, 'known D1 (STD: 10 %%)'),
    ):
        parser.add_argument(f'--prior-{name}', type=_prior(share), metavar=metavar, help=said)
    positive = options.number(0.0, 1e6, above=True)
    parser.add_argument('--length-scale', type=positive, metavar='M', help='d0, m (0.0485)')
    parser.add_argument(
        '--time-scale', type=positive, metavar='S', help='1/omega_psi, s (1/25.91)'
    )
    parser.add_argument(
        '--lines',
        type=_orders,
        metavar='N,...',
        help='orders of the known lines, in turns of the roller (1,2); "": none',
    )
    parser.add_argument(
        '--ignore',
        type=_interval,
        action='append',
        default=[],
        metavar='[N:]FROM:TO',
        help='leave out these s since the start of each recording, or of the Nth; repeatable',
    )
    parser.add_argument(
        '--minimum-hold', type=positive, metavar='S', help='shortest hold of the speed (8)'
    )
    parser.add_argument(
        '--frequency-range', type=_range, metavar='LOW:HIGH', help='of the hunting, Hz (0.5:20)'
    )
    length = options.number(0.0, 10.0, 'm', above=True)
    parser.add_argument(
        '--sensor-range', type=length, metavar='M', help='the lateral sensor reads no more'
    )
    parser.add_argument(
        '--clearance', type=length, metavar='M', help='amplitude at which a flange touches'
    )
    parser.add_argument(
        '--roller-diameter',
        type=length,
        metavar='M',
        help='where the roller angle was not recorded, it follows from this and the speed',
    )
    parser.add_argument(
        '--wheel-diameter', type=length, metavar='M', help="to remove the wheel's own line too"
    )
    parser.add_argument('--frequency', type=positive, metavar='HZ', help='hunting frequency')
    parser.add_argument(
        '--speed-resolution',
        type=options.number(0.0, 1e3),
        metavar='MPS',
        help='smallest step of the speed reading',
    )
    parser.add_argument(
        '--speed-scale-std',
        type=options.number(0.0, 1.0),
        metavar='SHARE',
        help='scale error of the speed reading',
    )
    parser.add_argument(
        '--bootstrap',
        type=options.whole(0, 1_000_000),
        metavar='N',
        help='intervals from N replications (0: linearised)',
    )
    options.add_seed(parser, None)
    parser.add_argument(
        '--jobs', type=options.whole(0, 4096), metavar='N', help='processes (0: one a core)'
    )
    parser.add_argument('--cluster', metavar='ADDRESS', help='Dask scheduler, tcp://host:8786')


def run(arguments: argparse.Namespace) -> int:
    """Identify, and say what was found; 1 where the data carry no normal form."""
    from hunt_ros.cli.support.output import progress, write_json
    from hunt_ros.identification import identify

    settings = settings_of(arguments)
    with progress('reading') as advance:
        records = records_of(arguments, advance)
    with progress('identifying') as advance:
        result = identify(records, settings, advance)
    if arguments.out:
        if result.normal_form is None:
            print(
                f'hunt identify: {arguments.out} is not written: no normal form', file=sys.stderr
            )
        else:
            _write(arguments.out, result.normal_form.to_yaml())
            result.save(whole_of(arguments.out))
    if arguments.branches and not result.branches:
        print(f'hunt identify: {arguments.branches} is not written: no branches', file=sys.stderr)
    elif arguments.branches:
        _write(arguments.branches, branches_csv(result), 'branches')
    if arguments.json:
        write_json(result.to_json(), arguments.json)
    if arguments.json != '-':
        print(describe(result))
    return 0 if result.normal_form is not None else 1


def identification_of(arguments: argparse.Namespace) -> Identification:
    """
    Identify the recordings of `add_settings`, or read what was identified before.

    A single parameter file stands for the identification beside it.

    Raises
    ------
    HuntError
        If they cannot be read, or what stands beside the file belongs to another form.
    """
    from hunt_ros.cli.support.output import progress
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.identification import Identification, identify

    if len(arguments.bags) == 1 and Path(arguments.bags[0]).suffix == '.yaml':
        path = Path(arguments.bags[0])
        text = options.read_text(path, 'parameter file')
        return Identification.load(whole_of(path), IdentifiedNormalForm.from_yaml(text, str(path)))
    settings = settings_of(arguments)
    with progress('reading') as advance:
        records = records_of(arguments, advance)
    with progress('identifying') as advance:
        return identify(records, settings, advance)


def whole_of(parameter_file: Path) -> Path:
    """Return where the whole identification stands beside a parameter file."""
    return parameter_file.with_suffix('.npz')


def _parameter_file(text: str) -> Path:
    path = Path(text)
    if not path.name or whole_of(path) == path:
        raise argparse.ArgumentTypeError(f'expected the name of a YAML file, got {text}')
    return path


def records_of(arguments: argparse.Namespace, advance: Advance) -> list[Record]:
    """Read the recordings, each with its day where the user says how to find it."""
    from dataclasses import replace

    from hunt_ros.bag import check_units, read_record
    from hunt_ros.samples import CHANNELS

    channels, rig = options.channels_of(arguments, CHANNELS), options.rig_of(arguments, NODE)
    pattern = _pattern(arguments.day)
    records = []
    for count, path in enumerate(arguments.bags):
        record = check_units(read_record(path, channels, require=('lateral', 'speed')))
        rig.refuse_other(record.notes.get('rig', ''), str(path))
        if pattern is not None:
            found = pattern.search(str(path))
            if found is None:
                raise HuntError(f'--day: {pattern.pattern!r} is not found in {path}')
            record = replace(record, notes={**record.notes, 'day': found.group(1)})
        records.append(record)
        advance((count + 1) / len(arguments.bags))
    return records


def _pattern(text: str | None) -> re.Pattern[str] | None:
    if text is None:
        return None
    try:
        pattern = re.compile(text)
    except re.error as error:
        raise HuntError(f'--day: {text!r} is no regular expression ({error})') from error
    if pattern.groups < 1:
        raise HuntError(f'--day: expected a group in parentheses, got {text!r}')
    return pattern


def settings_of(arguments: argparse.Namespace) -> IdentificationSettings:
    """Return the settings that the options of `add_settings` ask for."""
    from hunt_ros.identification import IdentificationSettings

    given = {
        'length_scale': arguments.length_scale,
        'time_scale': arguments.time_scale,
        'frequency_hz': arguments.frequency,
        'speed_resolution': arguments.speed_resolution,
        'speed_scale_std': arguments.speed_scale_std,
        'bootstrap': arguments.bootstrap,
        'seed': arguments.seed,
        'jobs': arguments.jobs,
        'cluster': arguments.cluster,
        'lines': arguments.lines,
        'roller_diameter_m': arguments.roller_diameter,
        'wheel_diameter_m': arguments.wheel_diameter,
        'ignore': tuple(arguments.ignore) or None,
        'minimum_hold_s': arguments.minimum_hold,
        'frequency_range_hz': arguments.frequency_range,
        'lateral_range_m': arguments.sensor_range,
        'flange_clearance_m': arguments.clearance,
        'prior_v_c': arguments.prior_v_c,
        'prior_D1': arguments.prior_D1,
    }
    if arguments.cluster is not None:
        if not arguments.bootstrap:
            raise HuntError('--cluster: only with --bootstrap N, whose replications it runs')
        _reach(arguments.cluster)
    return IdentificationSettings.of_rig(options.rig_of(arguments, NODE), **given)


def _prior(share: float) -> Callable[[str], tuple[float, float]]:
    """Return the type of VALUE or VALUE:STD; without STD it is this share of the value."""
    positive = options.number(0.0, 1e6, above=True)

    def parse(text: str) -> tuple[float, float]:
        value, colon, std = text.partition(':')
        return positive(value), positive(std) if colon else share * positive(value)

    return parse


def _interval(text: str) -> tuple[float, float, int]:
    """Read FROM:TO or N:FROM:TO."""
    words = text.split(':')
    if len(words) not in (2, 3):
        raise argparse.ArgumentTypeError(f'expected FROM:TO or N:FROM:TO, got {text}')
    number = options.whole(1)(words[0]) if len(words) == 3 else 0
    second = options.number(0.0, options.LONGEST_S, 's')
    start, end = second(words[-2]), second(words[-1])
    if not start < end:
        raise argparse.ArgumentTypeError(f'expected FROM before TO, got {text}')
    return start, end, number


def _range(text: str) -> tuple[float, float]:
    """Read LOW:HIGH."""
    low, _, high = text.partition(':')
    frequency = options.number(0.0, 1e4, 'Hz', above=True)
    found = frequency(low), frequency(high)
    if not found[0] < found[1]:
        raise argparse.ArgumentTypeError(f'expected LOW below HIGH, got {text}')
    return found


def _orders(text: str) -> tuple[float, ...]:
    """Read N,N,...; an empty text is no line."""
    order = options.number(0.0, 100.0, above=True)
    return tuple(order(word) for word in text.split(',') if word.strip())


def _reach(address: str) -> None:
    """Fail before the work begins where no Dask scheduler can be."""
    import socket

    host, _, port = address.rpartition('://')[2].rpartition(':')
    if not host or not port.isdecimal():
        raise HuntError(f'--cluster: expected tcp://HOST:PORT, got {address}')
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except (OSError, OverflowError) as error:
        reason = getattr(error, 'strerror', None) or str(error)
        raise HuntError(f'--cluster: nobody answers at {address} ({reason})') from error


def branches_csv(result: Identification) -> str:
    """Return both branches as a table, SI units; empty where there is none."""
    names = [
        f'{name}{part}_m' for name in ('stable', 'unstable') for part in ('', '_low', '_high')
    ]
    lines = [','.join(['speed_mps', *names])]
    for point in result.branches:
        cells = [repr(point.speed)]
        for one in (point.stable, point.unstable):
            known = () if one is None else (one.value, one.low, one.high)
            cells += [repr(float(x)) for x in known] or [''] * 3
        lines.append(','.join(cells))
    return '\n'.join(lines) + '\n'


def _write(path: Path, text: str, what: str = 'parameter file') -> None:
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise HuntError(f'{path}: cannot write the {what} ({error.strerror})') from error


def describe(result: Identification) -> str:
    """Return the result as a few lines for a person."""
    from hunt_ros.identification.result import EFFECTIVE
    from hunt_ros.identification.silence import worth_saying

    lines = []

    def line(name: str, number: Uncertain | None, unit: str) -> None:
        if number is None:
            lines.append(f'{name:18s}not known')
        else:
            lines.append(
                f'{name:18s}{number.value:.5g} {unit}'
                f'  (95 %: {number.low:.5g} .. {number.high:.5g})'
            )

    line('v_c', result.v_c, 'm/s')
    line('v_n', result.v_n, 'm/s')
    line('hysteresis width', result.hysteresis_width, 'm/s')
    for name, number in result.coefficients.items():
        line(name, number, '')
    low, high = result.speeds
    lines.append(f'effective between {low:.3g} and {high:.3g} m/s: {", ".join(EFFECTIVE)}')
    lines.append(
        f'units: d0 = {result.length_scale:.4g} m ({result.scales_from["length"]}),'
        f' 1/omega_psi = {result.time_scale:.4g} s ({result.scales_from["time"]})'
    )
    lines.append(
        f'{result.criticality or "criticality not known"}; law: {result.fit.law};'
        f' {result.fit.segments} of {len(result.segments)} segments used'
    )
    observed = result.observed
    lines += _observed('v_c', observed.v_c, observed.v_c_between)
    lines += _observed('v_n', observed.v_n, observed.v_n_between)
    lines += _days(result.days)
    lines += [f'warning: {line}' for line in (*result.notices, *worth_saying(result.unknown))]
    return '\n'.join(lines)


def _observed(
    name: str, speed: float | None, between: tuple[float | None, float | None]
) -> list[str]:
    """Say what the jumps, or free motion, show of a critical speed by themselves."""
    low, high = between
    if low is None and high is None:
        return []
    if low is None or high is None:
        side = f'above {low:.4g}' if low is not None else f'below {high:.4g}'
    else:
        side = f'between {low:.4g} and {high:.4g}'
    jump = '' if speed is None else f'jump at {speed:.4g}, '
    return [f'observed {name}: {jump}{side} m/s']


def _days(days: Days | None) -> list[str]:
    """Say how far the days are apart; nothing of a single day."""
    if days is None or len(days.summaries) < 2:
        return []
    lines = []
    for one in days.summaries:
        shift = f', {1e3 * one.shift:+.3g} mm' if math.isfinite(one.shift) else ''
        lines.append(f'day {one.day}: {one.recordings} recordings{shift}')
    if math.isfinite(days.day_std):
        lines.append(f'limit cycle, day to day: {1e3 * days.day_std:.3g} mm (standard deviation)')
    return lines
