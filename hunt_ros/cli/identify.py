"""The verb `identify`: recordings in, normal form with intervals out."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found
from hunt_ros.cli.support.recordings import add_recordings, identified, whole_of
from hunt_ros.files import write_whole
from hunt_ros.identification import Identification
from hunt_ros.identification.result import EFFECTIVE, lines_of
from hunt_ros.samples import Uncertain

EXAMPLE = 'hunt identify bags/hysteresis_loop --out normal_form.yaml --json -'
#: Of these a person is told why they are not known; the JSON says it of everything.
_ASKED = ('v_c', 'v_n', 'hysteresis_width', 'coefficients', 'criticality')


def configure(parser: options.Parser) -> None:
    """Add the arguments of the verb."""
    add_recordings(parser)
    what = 'write the ROS parameter file here, and beside it the whole identification, as .npz'
    parser.add('--out', type=options.new_file('.yaml', '.yml'), metavar='FILE', help=what)


def run(arguments: argparse.Namespace) -> Found:
    """Identify, and say what was found; 1 where the data carry no normal form."""
    _, result = identified(arguments)
    if arguments.out and result.normal_form is None:
        print(f'hunt identify: {arguments.out} is not written: no normal form', file=sys.stderr)
    elif arguments.out and result.normal_form is not None:
        form = replace(result.normal_form, rig_name=options.rig_of(arguments).rig_name)
        write_whole(whole_of(arguments.out), result.save, 'identification')
        write_whole(arguments.out, form.to_yaml(), 'parameter file')
    return Found(result.to_json(), describe(result), 0 if result.normal_form is not None else 1)


def describe(result: Identification) -> list[str]:
    """Return the result as a few lines for a person."""
    low, high = result.speeds
    speeds = {'v_c': result.v_c, 'v_n': result.v_n, 'hysteresis width': result.hysteresis_width}
    asked = {key: why for key, why in result.unknown.items() if key.split('.')[0] in _ASKED}
    return [
        *result.bracket.lines(),
        *(_line(name, number, 'm/s') for name, number in speeds.items()),
        *(_line(name, number, '') for name, number in result.coefficients.items()),
        f'effective between {low:.3g} and {high:.3g} m/s: {", ".join(EFFECTIVE)}',
        f'units: d0 = {result.length_scale:.4g} m ({result.scales_from["length"]}),'
        f' 1/omega_psi = {result.time_scale:.4g} s ({result.scales_from["time"]})',
        result.onset,
        f'law: {result.fit.law}; {result.fit.segments} segments',
        *(f'warning: {line}' for line in (*result.notices, *lines_of(asked))),
    ]


def _line(name: str, number: Uncertain | None, unit: str) -> str:
    return f'{name:18s}{number.with_interval(unit) if number else "not known"}'
