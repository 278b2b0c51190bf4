"""`hunt calibrate FILE`: known displacements in, gain and offset of a sensor node out."""

from __future__ import annotations

import argparse
import math
from typing import Any

import yaml

from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found
from hunt_ros.drivers.calibration import Calibration, fit_line
from hunt_ros.errors import ConfigError
from hunt_ros.files import write_whole
from hunt_ros.samples import Uncertain
from hunt_ros.samples import known as finite
from hunt_ros.sensors import MOTION, SENSORS
from hunt_ros.suite import SENSORS as SENSOR_NODES

EXAMPLE = 'hunt calibrate lateral.yaml --unit mm --points 1=-8.01,3=-4,5=0.02,7=3.99,9=8'
#: A reading or a displacement: beyond, its square is no number.
_READING = options.number(-1e12, 1e12)


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    parser.add('file', type=options.new_file(), help='ROS parameter file; none that is there')
    parser.add('--sensor', choices=MOTION, default='lateral', help='what it measures (lateral)')
    parser.add('--unit', help='of the known displacements (default: SI): mm, mrad, deg, g')
    first = 'pairs; where the first reading is negative: --points=-5=-10,0=0'
    parser.add('--points', type=_points, required=True, metavar='READING=KNOWN,...', help=first)
    beyond = 'readings at these ends or outside are saturated'
    pair = options.numbers(_READING, form='LOW,HIGH')
    parser.add('--range', type=pair, default=(), metavar='LOW,HIGH', help=beyond)


def run(arguments: argparse.Namespace) -> Found:
    """Calibrate: 0 done, 1 where a straight line does not describe the points."""
    if arguments.file.exists():
        raise ConfigError(f'{arguments.file}: is there already, expected a new name')
    sensor = next(each for each in SENSORS if each.name == arguments.sensor)
    unit = arguments.unit or next(iter(sensor.units))
    if unit not in sensor.units:
        raise ConfigError(f'--unit {unit}: expected one of {", ".join(sensor.units)}')
    factor = sensor.units[unit]
    pairs = [(reading, known * factor) for reading, known in arguments.points]
    fit = fit_line(pairs)
    calibration = Calibration(fit.gain.value, fit.offset.value, arguments.range)
    points = [
        {'reading': reading, 'known': known, 'residual': residual}
        for (reading, known), residual in zip(pairs, fit.residuals, strict=True)
    ]
    given: dict[str, Any] = {'gain': calibration.gain, 'offset': calibration.offset}
    if calibration.range:
        given['range'] = list(calibration.range)
    section = {f'/**/{SENSOR_NODES[sensor.name]}': {'ros__parameters': given}}
    write_whole(arguments.file, yaml.safe_dump(section, sort_keys=False), 'calibration')
    warnings = ['the points bend: a straight line does not describe them'] if fit.bends else []
    told = [
        f'reading {point["reading"]:g}: {point["known"] / factor:g} {unit},'
        f' residual {point["residual"] / factor:.3g}'
        for point in points
    ]
    told += [
        f'{name} {Uncertain(found.value / factor, found.std / factor).text(" +/- ")} {unit}'
        for name, found in (('gain', fit.gain), ('offset', fit.offset))
    ]
    if not math.isfinite(fit.residual_std):
        told.append('two points do not tell how sure gain and offset are: take a third')
    told += [*(f'warning: {warning}' for warning in warnings)]
    told.append(f'written to {arguments.file}: --rig {arguments.file}, or lines of the rig file')
    document = {'channel': sensor.name, 'unit': sensor.unit, **given}
    document |= {'residual_std': finite(fit.residual_std), 'points': points}
    document |= {'gain': fit.gain.to_json(), 'offset': fit.offset.to_json()}
    document |= {'file': str(arguments.file), 'warnings': warnings}
    return Found(document, told, 1 if warnings else 0)


def _points(text: str) -> list[tuple[float, float]]:
    """Read pairs of a reading and its known displacement."""
    pair = options.numbers(_READING, '=', form='READING=KNOWN')
    return [(reading, known) for reading, known in map(pair, text.split(','))]
