"""The verb `identify`: recordings in, normal form with intervals out."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.cli.support.identification import (
    add_keep,
    add_settings,
    settings_of,
    sources_of,
    whole_of,
)
from hunt_ros.errors import HuntError

if TYPE_CHECKING:
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.identification import Identification
    from hunt_ros.identification.days import Days
    from hunt_ros.samples import Uncertain

SUMMARY = 'identify the normal form, with intervals, from recordings'
EXAMPLE = 'hunt identify bags/hysteresis_loop --out normal_form.yaml --json -'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_settings(parser)
    add_keep(parser)
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


def run(arguments: argparse.Namespace) -> int:
    """Identify, and say what was found; 1 where the data carry no normal form."""
    from hunt_ros.cli.support.output import progress, write_json
    from hunt_ros.identification import identify

    settings = settings_of(arguments)
    with progress('reading') as advance:
        sources = sources_of(arguments, advance)
    with progress('identifying') as advance:
        result = identify(sources, settings, advance)
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


def _parameter_file(text: str) -> Path:
    path = Path(text)
    if not path.name or whole_of(path) == path:
        raise argparse.ArgumentTypeError(f'expected the name of a YAML file, got {text}')
    return path


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
    lines += _second_mode(result.normal_form)
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


def _second_mode(found: IdentifiedNormalForm | None) -> list[str]:
    """Return the line on the second mode, where it is known best; none where it is not known."""
    shape = found.mode_shape if found else None
    if shape is None or shape.second_frequency_hz is None or shape.second_decay is None:
        return []
    if shape.second_std is None:
        return []
    doubt = shape.second_std.tolist()
    place = doubt.index(min(doubt))
    return [
        f'second mode: {shape.second_frequency_hz[place]:.3g} Hz, decay'
        f' {shape.second_decay[place]:.3g} 1/s at {shape.speeds[place]:.3g} m/s,'
        f' +/- {100.0 * doubt[place]:.2g} %'
    ]


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
