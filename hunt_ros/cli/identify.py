"""The verb `identify`: recordings in, normal form with intervals out."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.cli.support.identification import (
    add_settings,
    settings_of,
    sources_of,
    whole_of,
)
from hunt_ros.files import write_whole

if TYPE_CHECKING:
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.identification import Identification
    from hunt_ros.samples import Uncertain

SUMMARY = 'identify the normal form, with intervals, from recordings'
EXAMPLE = 'hunt identify bags/hysteresis_loop --out normal_form.yaml --json -'
#: Of these a person is told why they are not known; the JSON says it of everything.
_ASKED = ('v_c', 'v_n', 'hysteresis_width', 'coefficients', 'criticality')


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_settings(parser)
    parser.add_argument(
        '--out',
        type=_parameter_file,
        metavar='FILE',
        help='write the ROS parameter file here, and beside it the whole identification, as .npz',
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
            rig_name = options.rig_of(arguments).rig_name
            form = replace(result.normal_form, rig_name=rig_name)
            write_whole(arguments.out, form.to_yaml(), 'parameter file')
            partial = whole_of(arguments.out).with_suffix('.npz.part')
            result.save(partial)
            partial.replace(whole_of(arguments.out))
    if arguments.json:
        write_json(result.to_json(), arguments.json)
    if arguments.json != '-':
        print(describe(result))
    return 0 if result.normal_form is not None else 1


def _parameter_file(text: str) -> Path:
    path = options.new_file()(text)
    if whole_of(path) == path:
        raise argparse.ArgumentTypeError(f'expected the name of a YAML file, got {text}')
    return path


def describe(result: Identification) -> str:
    """Return the result as a few lines for a person."""
    from hunt_ros.identification.result import EFFECTIVE, lines_of

    lines = result.bracket.lines()

    def line(name: str, number: Uncertain | None, unit: str) -> None:
        lines.append(f'{name:18s}{number.with_interval(unit) if number else "not known"}')

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
    asked = {key: why for key, why in result.unknown.items() if key.split('.')[0] in _ASKED}
    lines += [f'warning: {line}' for line in (*result.notices, *lines_of(asked))]
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
