"""`hunt calibrate FILE`: known displacements in, the calibration of a sensor out."""

from __future__ import annotations

import argparse
import math
from typing import Any

from hunt_ros.cli.support import options
from hunt_ros.errors import ConfigError
from hunt_ros.files import write_whole
from hunt_ros.sensors import MOTION, SENSORS

SUMMARY = 'calibrate a sensor: known displacements in, gain and offset out'
EXAMPLE = 'hunt calibrate lateral.yaml --unit mm --points 1=-8.01,3=-4,5=0.02,7=3.99,9=8'
#: Of a reading or a displacement: beyond, its square is no number.
_LARGEST = 1e12


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('file', type=options.new_file(), help='YAML; none that is there')
    parser.add_argument(
        '--sensor', choices=MOTION, default='lateral', help='what it measures (default: lateral)'
    )
    parser.add_argument(
        '--unit', help='of the known displacements (default: SI): mm, mrad, deg, g'
    )
    parser.add_argument(
        '--points',
        required=True,
        metavar='READING=KNOWN,...',
        help='pairs; where the first reading is negative: --points=-5=-10,0=0',
    )
    parser.add_argument(
        '--range',
        type=_range,
        default=(-math.inf, math.inf),
        metavar='LOW,HIGH',
        help='readings at these ends or outside are saturated',
    )
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate: 0 done, 1 where a straight line does not describe the points."""
    import yaml

    from hunt_ros.cli.support.output import write_json
    from hunt_ros.drivers.calibration import Calibration, fit_line
    from hunt_ros.samples import known as finite

    if arguments.file.exists():
        raise ConfigError(f'{arguments.file}: is there already, expected a new name')
    sensor = next(each for each in SENSORS if each.name == arguments.sensor)
    unit = arguments.unit or next(iter(sensor.units))
    if unit not in sensor.units:
        raise ConfigError(f'--unit {unit}: expected one of {", ".join(sensor.units)}')
    factor = sensor.units[unit]
    pairs = [_pair(word) for word in arguments.points.split(',')]
    fit = fit_line([(reading, known * factor) for reading, known in pairs])
    calibration = Calibration(fit.gain.value, fit.offset.value, arguments.range)
    points = [
        {'reading': reading, 'known': known * factor, 'residual': residual}
        for (reading, known), residual in zip(pairs, fit.residuals, strict=True)
    ]
    lines: dict[str, Any] = {'channel': sensor.name, 'unit': sensor.unit}
    lines |= {'gain': calibration.gain, 'offset': calibration.offset}
    if math.isfinite(calibration.range[0]):
        lines['range'] = list(calibration.range)
    lines['fit'] = {'residual_std': finite(fit.residual_std), 'points': points}
    text = yaml.safe_dump({'calibration': lines}, sort_keys=False)
    write_whole(arguments.file, text, 'calibration')
    warnings = ['the points bend: a straight line does not describe them'] if fit.bends else []
    if arguments.json != '-':
        for point in points:
            shown = point['known'] / factor, point['residual'] / factor
            print(f'reading {point["reading"]:g}: {shown[0]:g} {unit}, residual {shown[1]:.3g}')
        for name, found in (('gain', fit.gain), ('offset', fit.offset)):
            print(f'{name} {found.value / factor:.6g} +/- {found.std / factor:.2g} {unit}')
        for warning in warnings:
            print(f'warning: {warning}')
        print(f'written to {arguments.file}')
    if arguments.json:
        document = lines.pop('fit') | lines | {'file': str(arguments.file), 'warnings': warnings}
        document |= {'gain': fit.gain.to_json(), 'offset': fit.offset.to_json()}
        write_json(document, arguments.json)
    return 1 if warnings else 0


def _pair(word: str) -> tuple[float, float]:
    """Return a reading and its known displacement."""
    reading, equals, known = word.partition('=')
    if not equals:
        raise ConfigError(f'--points: {word!r}, expected READING=KNOWN')
    for text in (reading, known):
        if not _is_number(text):
            raise ConfigError(f'--points: {text.strip()!r}, expected a number')
    return float(reading), float(known)


def _range(text: str) -> tuple[float, float]:
    low, comma, high = text.partition(',')
    if not comma or not _is_number(low) or not _is_number(high) or float(low) >= float(high):
        raise argparse.ArgumentTypeError(f'expected a lower and a higher reading, got {text}')
    return float(low), float(high)


def _is_number(text: str) -> bool:
    try:
        return abs(float(text)) < _LARGEST
    except ValueError:
        return False
