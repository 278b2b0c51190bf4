"""`hunt calibrate FILE`: known displacements in, the calibration of a sensor out."""

from __future__ import annotations

import argparse
import csv
import math
import sys
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hunt_ros.cli.support import options
from hunt_ros.errors import ConfigError, HuntError
from hunt_ros.sensors import MOTION, SENSORS

if TYPE_CHECKING:
    from hunt_ros.drivers.base import SensorDriver
    from hunt_ros.drivers.calibration import Calibration, LineFit
    from hunt_ros.samples import Uncertain

SUMMARY = 'calibrate a sensor: known displacements in, gain and offset or a table out'
EXAMPLE = (
    'hunt calibrate lateral.yaml --unit mm --points 1=-8.01,3=-4,5=0.02,7=3.99,9=8'
    ' --picture lateral.svg'
)
_UNITS = {sensor.name: sensor.units for sensor in SENSORS}


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('file', type=Path, help='YAML; one that is there is kept as FILE.DATE.bak')
    parser.add_argument(
        '--sensor', choices=MOTION, default='lateral', help='what it measures (default: lateral)'
    )
    parser.add_argument(
        '--unit', help='of the known displacements (default: SI): mm, mrad, deg, g'
    )
    known = parser.add_mutually_exclusive_group(required=True)
    known.add_argument(
        '--points',
        metavar='READING=KNOWN,...',
        help='pairs; where the first reading is negative: --points=-5=-10,0=0',
    )
    known.add_argument(
        '--csv', type=Path, metavar='FILE', help='two columns: reading, known displacement'
    )
    known.add_argument(
        '--driver', metavar='NAME', help='read the sensor now: asks for each displacement'
    )
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='setting of the driver (docs/drivers.md), repeatable: source=/daq/ch0.data[3]',
    )
    options.add_rate(parser, None, 'of the driver (default: 500)')
    parser.add_argument(
        '--seconds',
        type=options.number(0.0, 3600.0, 's', above=True),
        metavar='S',
        help='mean of so long a reading at each displacement (default: 1)',
    )
    parser.add_argument(
        '--table', action='store_true', help='a table of the points, not a straight line'
    )
    parser.add_argument(
        '--range', metavar='LOW,HIGH', help='readings at these ends or outside are saturated'
    )
    parser.add_argument('--picture', type=Path, metavar='FILE', help='.svg or .png')
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate: 0 done, 1 where a straight line does not describe the points."""
    from hunt_ros.cli.support.output import write_json
    from hunt_ros.drivers.calibration import Calibration, fit_line

    for option in ('set', 'rate', 'seconds'):
        if getattr(arguments, option) and not arguments.driver:
            raise ConfigError(f'--{option}: has an effect with --driver only')
    if arguments.picture and arguments.picture.suffix not in ('.svg', '.png'):
        raise ConfigError(
            f'--picture {arguments.picture}: expected a name that ends in .svg or .png'
        )
    units = _UNITS[arguments.sensor]
    unit = arguments.unit or next(iter(units))
    if unit not in units:
        raise ConfigError(f'--unit {unit}: expected one of {", ".join(units)}')
    pairs = list(_pairs(arguments, unit))
    points = [(reading, known * units[unit]) for reading, known in pairs]
    if len(points) < 2:
        raise ConfigError(f'calibration: {len(points)} points, expected two at least')
    fit = fit_line(points)
    table = tuple(sorted(points)) if arguments.table else ()
    calibration = Calibration(
        channel=arguments.sensor,
        gain=1.0 if table else fit.gain.value,
        offset=0.0 if table else fit.offset.value,
        table=table,
        range=_range(arguments.range),
        source='--points' if arguments.points else str(arguments.csv or '--driver'),
    )
    residuals = _residuals(points, calibration, fit)
    warnings = [] if table else _warnings(points, fit)
    document = _document(arguments.sensor, points, calibration, fit, residuals, warnings)
    kept = _write(arguments.file, calibration, document)
    if arguments.picture:
        _draw(arguments.picture, points, calibration, residuals)
    if arguments.json != '-':
        _print(arguments.file, kept, unit, units[unit], pairs, document)
    if arguments.json:
        write_json(document | {'file': str(arguments.file), 'kept': kept or None}, arguments.json)
    return 1 if warnings else 0


def _pairs(arguments: argparse.Namespace, unit: str) -> Iterator[tuple[float, float]]:
    """Iterate over (reading, known displacement in `unit`)."""
    if arguments.points:
        for word in arguments.points.split(','):
            reading, equals, known = word.partition('=')
            if not equals:
                raise ConfigError(f'--points: {word!r}, expected READING=KNOWN')
            yield _number(reading, '--points'), _number(known, '--points')
    elif arguments.csv:
        text = options.read_text(arguments.csv, 'table of points')
        rows = [row for row in csv.reader(text.splitlines()) if row and row[0][:1] != '#']
        for number, row in enumerate(rows):
            where = f'{arguments.csv}: row {number + 1}'
            if len(row) != 2:
                raise ConfigError(f'{where}: {len(row)} columns, expected reading, displacement')
            if number == 0 and not _is_number(row[0]):
                continue  # the names of the columns
            yield _number(row[0], where), _number(row[1], where)
    else:
        yield from _measured(arguments, unit)


def _measured(arguments: argparse.Namespace, unit: str) -> Iterator[tuple[float, float]]:
    """Ask for known displacements, and read the sensor at each."""
    from hunt_ros.cli.support.settings_file import read_settings
    from hunt_ros.drivers.registry import driver_class

    kind = driver_class(arguments.driver, 'Sensor')
    settings = read_settings(kind.Settings, '', (), arguments.set)
    seconds = arguments.seconds or 1.0
    driver = kind(settings, arguments.sensor, arguments.rate or 500.0)
    try:
        driver.open()
        while True:
            print(
                f'known displacement, {unit} (empty: done): ', end='', file=sys.stderr, flush=True
            )
            answer = sys.stdin.readline().strip()
            if not answer:
                return
            if not _is_number(answer):
                print(f'{answer!r} is no number', file=sys.stderr)
                continue
            mean, std, count = _mean_reading(driver, seconds)
            print(f'reading {mean:.6g} +/- {std:.2g} ({count} samples)', file=sys.stderr)
            yield mean, float(answer)
    finally:
        driver.close()


def _mean_reading(driver: SensorDriver, seconds: float) -> tuple[float, float, int]:
    """Return mean, standard deviation and number of the readings from now on."""
    import time

    import numpy as np

    while driver.read(0.0).stamps_ns.size:
        pass  # of the time before
    values: list[float] = []
    until_s = time.monotonic() + seconds
    while (left_s := until_s - time.monotonic()) > 0.0:
        values += driver.read(min(left_s, 0.2)).values.tolist()
    readings = np.array(values)
    good = readings[np.isfinite(readings)]
    if not good.size:
        raise HuntError(f'{driver}: no valid sample within {seconds:g} s')
    return float(good.mean()), float(good.std()), int(good.size)


def _residuals(
    points: list[tuple[float, float]], calibration: Calibration, fit: LineFit
) -> list[Uncertain]:
    """Return the residuals with their deviations: those of the points that made the line."""
    import numpy as np

    from hunt_ros.samples import Uncertain

    raw = np.array([reading for reading, _ in points])
    if calibration.table:
        return [Uncertain(0.0, math.nan) for _ in points]
    leverage = 1.0 / raw.size + (raw - raw.mean()) ** 2 / ((raw - raw.mean()) ** 2).sum()
    stds = fit.residual_std * np.sqrt(np.maximum(1.0 - leverage, 0.0))
    return [Uncertain(*pair) for pair in zip(fit.residuals, stds.tolist(), strict=True)]


def _warnings(points: list[tuple[float, float]], fit: LineFit) -> list[str]:
    """Say where a straight line is not enough: where a parabola is better for sure."""
    import numpy as np
    from scipy.stats import f as fisher

    raw, known = (np.array(column) for column in zip(*points, strict=True))
    if len(set(raw.tolist())) < 3 or raw.size < 4:
        return []
    scaled = (raw - raw.mean()) / np.ptp(raw)
    rest = known - np.polyval(np.polyfit(scaled, known, 2), scaled)
    line, parabola = float((np.array(fit.residuals) ** 2).sum()), float((rest**2).sum())
    least = (1e-9 * float(np.ptp(known))) ** 2  # rounding
    ratio = (line - parabola) / max(parabola / (raw.size - 3), least)
    if ratio <= fisher.ppf(0.99, 1, raw.size - 3):
        return []
    return ['the points bend: a straight line does not describe them, try --table']


def _document(
    sensor: str,
    points: list[tuple[float, float]],
    calibration: Calibration,
    fit: LineFit,
    residuals: list[Uncertain],
    warnings: list[str],
) -> dict[str, Any]:
    """Return what was found, as JSON."""
    from hunt_ros.samples import known as finite

    line = not calibration.table
    return {
        'channel': sensor,
        'gain': _uncertain(fit.gain) if line else None,
        'offset': _uncertain(fit.offset) if line else None,
        'table': [list(row) for row in calibration.table] or None,
        'range': [finite(end) for end in calibration.range],
        'residual_std': finite(fit.residual_std) if line else None,
        'points': [
            {
                'reading': reading,
                'known': known,
                'residual': residual.value,
                'residual_std': finite(residual.std),
            }
            for (reading, known), residual in zip(points, residuals, strict=True)
        ],
        'warnings': warnings,
    }


def _uncertain(number: Uncertain) -> dict[str, Any]:
    found = number.to_json() or {}
    return {name: found.get(name) for name in ('value', 'std', 'ci95')}


def _write(path: Path, calibration: Calibration, document: dict[str, Any]) -> str:
    """Write the file; return the name under which the old one is kept, or ''."""
    import yaml

    made = datetime.now(timezone.utc).strftime('%Y-%m-%dT%H%M%SZ')
    lines: dict[str, Any] = {
        'channel': calibration.channel,
        'unit': next(each.unit for each in SENSORS if each.name == calibration.channel),
        'polarity': 1,
    }
    if calibration.table:
        lines['table'] = [list(row) for row in calibration.table]
    else:
        lines |= {'gain': calibration.gain, 'offset': calibration.offset}
    if math.isfinite(calibration.range[0]):
        lines['range'] = list(calibration.range)
    lines |= {'made': made, 'fit': {key: document[key] for key in ('residual_std', 'points')}}
    text = yaml.safe_dump({'calibration': lines}, sort_keys=False)
    kept = ''
    try:
        if path.exists():
            kept = f'{path}.{made}.bak'
            path.replace(kept)
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise HuntError(f'{path}: cannot write the calibration ({error.strerror})') from error
    return kept


def _draw(
    path: Path,
    points: list[tuple[float, float]],
    calibration: Calibration,
    residuals: list[Uncertain],
) -> None:
    """Draw points, line and residuals into a picture."""
    from hunt_ros.report.figures.calibration import calibration_figure
    from hunt_ros.report.figures.style import journal_style, svg

    figure = calibration_figure(points, calibration, residuals)
    try:
        if path.suffix == '.svg':
            path.write_text(svg(figure, salt='calibration'), encoding='utf-8')
        else:
            with journal_style():
                figure.savefig(path, dpi=300, facecolor='white')
    except OSError as error:
        raise HuntError(f'{path}: cannot write the picture ({error.strerror})') from error


def _print(
    path: Path,
    kept: str,
    unit: str,
    factor: float,
    pairs: list[tuple[float, float]],
    document: dict[str, Any],
) -> None:
    """Print the points with their residuals, and what was made of them."""
    print(f'{"reading":>12} {f"known, {unit}":>14} {f"residual, {unit}":>16} {"deviation":>11}')
    for (reading, known), point in zip(pairs, document['points'], strict=True):
        std = point['residual_std']
        shown = '-' if std is None else f'{std / factor:.3g}'
        print(f'{reading:>12.6g} {known:>14.6g} {point["residual"] / factor:>16.3g} {shown:>11}')
    for name in ('gain', 'offset'):
        found = document[name]
        if found is not None:
            std = 'unknown' if found['std'] is None else f'{found["std"] / factor:.2g}'
            print(f'{name} {found["value"] / factor:.6g} +/- {std} {unit}')
    if document['table']:
        print(f'table of {len(document["table"])} rows')
    for warning in document['warnings']:
        print(f'warning: {warning}')
    print(f'written to {path}' + (f'; the old one is {kept}' if kept else ''))


def _range(text: str | None) -> tuple[float, float]:
    """Read the option --range; without it there is no limit."""
    if text is None:
        return (-math.inf, math.inf)
    words = text.split(',')
    if len(words) != 2:
        raise ConfigError(f'--range {text}: expected LOW,HIGH')
    low, high = (_number(word, '--range') for word in words)
    if low >= high:
        raise ConfigError(f'--range {text}: expected a lower and a higher reading')
    return low, high


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _number(text: str, where: str) -> float:
    if not _is_number(text):
        raise ConfigError(f'{where}: {text.strip()!r}, expected a number')
    return float(text)
