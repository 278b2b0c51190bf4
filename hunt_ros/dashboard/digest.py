"""
What the page of the recordings says of one: when, how fast, how large, which alarms.

Run as a program, with the path of a recording or of a normal form, it prints this as JSON. So the
node of the page reads in another process: an hour of samples, or a damaged file, costs the live
page nothing.
"""

from __future__ import annotations

import json
import math
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag import Bag, read_record
from hunt_ros.bag.messages import read_texts
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import BagError, HuntError
from hunt_ros.samples import NANOSECONDS, Record, Series, Uncertain

#: Points of the small picture.
_POINTS = 120
_ALARMS, _STATUS = 'hunting/alarms', 'hunting/status'


def digest(path: str | Path) -> dict[str, Any]:
    """
    Read a recording.

    Parameters
    ----------
    path : str or Path
        Folder or file.

    Returns
    -------
    dict
        For JSON; null where something is not known. `began_s` and `duration_s`; `speed_mps`, the
        lowest and the highest; `alarms`, a list of `reached`, `cause`, `began_s` and
        `acknowledged_by` (null where no detector was recorded); `picture`: `speed_mps` and
        `amplitude`, half the range of the motion in mm (or mrad, as `unit` says), in equal parts
        of the time; `problem`: one line, '' for a sound recording.
    """
    found: dict[str, Any] = {
        'began_s': None, 'duration_s': None, 'speed_mps': None, 'alarms': None, 'picture': None,
        'problem': '',
    }  # fmt: skip
    try:
        with Bag(path) as bag:
            found['problem'] = '; '.join(bag.problems)
            if (span := bag.span_ns) is None:
                raise BagError(f'{bag.path}: no message in it')
            first_ns, last_ns = span
            found |= {
                'began_s': first_ns / NANOSECONDS,
                'duration_s': (last_ns - first_ns) / NANOSECONDS,
                'alarms': _alarms(bag),
            }
            record = read_record(bag)
            found['picture'] = _picture(record)
            if 'speed' in record:
                speed = record['speed'].values
                speed = speed[np.isfinite(speed)]
                found['speed_mps'] = (
                    [float(speed.min()), float(speed.max())] if speed.size else None
                )
    except HuntError as error:
        found['problem'] = ' '.join(str(error).split())
    return found


def _alarms(bag: Bag) -> list[dict[str, Any]] | None:
    """Return the alarms that began in the recording; None where no detector was recorded."""
    texts = read_texts(bag, _ALARMS)
    if not texts:
        watched = any(
            topic.messages and name.endswith(f'/{_STATUS}') for name, topic in bag.topics.items()
        )
        return [] if watched else None
    start_s = bag.span_ns[0] / NANOSECONDS if bag.span_ns else 0.0
    names = ('began_s', 'reached', 'cause', 'acknowledged_by')
    try:
        return [
            {name: alarm[name] for name in names}
            for alarm in json.loads(texts[-1].text)['alarms']
            if alarm['over_s'] is None or alarm['over_s'] >= start_s
        ]
    except (ValueError, KeyError, TypeError) as error:
        raise BagError(f'{bag.path}: topic {_ALARMS} is no history of alarms') from error


def _picture(record: Record) -> dict[str, Any]:
    edges = np.linspace(record.start_ns, record.end_ns + 1, _POINTS + 1).astype(np.int64)
    channel = 'lateral' if 'lateral' in record else 'yaw'
    motion = _ranges(record[channel], edges) if channel in record else None
    speed = _ranges(record['speed'], edges) if 'speed' in record else None
    return {
        'speed_mps': None if speed is None else _known(0.5 * (speed[0] + speed[1])),
        'amplitude': None if motion is None else _known(0.5e3 * (motion[1] - motion[0])),
        'unit': 'mm' if channel == 'lateral' else 'mrad',
    }


def _ranges(
    series: Series, edges: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return least and greatest value in each part of the time, NaN where there is none."""
    good = np.isfinite(series.values)
    part = np.searchsorted(edges, series.stamps_ns[good], side='right') - 1
    least, greatest = np.full(_POINTS, math.inf), np.full(_POINTS, -math.inf)
    inside = (part >= 0) & (part < _POINTS)
    values = series.values[good][inside]
    np.minimum.at(least, part[inside], values)
    np.maximum.at(greatest, part[inside], values)
    none = least > greatest
    least[none] = greatest[none] = math.nan
    return least, greatest


def _known(values: NDArray[np.float64]) -> list[float | None]:
    return [round(x, 4) if math.isfinite(x) else None for x in values.tolist()]


def critical_speeds(path: str | Path) -> dict[str, Any]:
    """
    Return the critical speeds of a parameter file.

    Parameters
    ----------
    path : str or Path
        Of the YAML file. The identification beside it, where there is one, has the intervals;
        without it there is only that of v_c.

    Returns
    -------
    dict
        `v_c` and `v_n`: `value`, `std` and `ci95` (null where they are not known), m/s; null
        where there is none.

    Raises
    ------
    HuntError
        If it is no normal form.
    OSError
        If it is not there.
    """
    path = Path(path)
    form = IdentifiedNormalForm.from_yaml(path.read_text(encoding='utf-8'), str(path))
    v_c, v_n, std = form.form.critical_speed, form.form.nonlinear_critical_speed, form.std('v_c')
    if (whole := path.with_suffix('.npz')).exists():
        from hunt_ros.identification import Identification  # seconds, with its kernels

        with suppress(HuntError):  # of another form
            found = Identification.load(whole, form)
            return {'v_c': _json(found.v_c), 'v_n': _json(found.v_n)}
    return {
        'v_c': _json(Uncertain(v_c, std or math.nan)),
        'v_n': None if v_n is None else _json(Uncertain(v_n, math.nan)),
    }


def _json(speed: Uncertain | None) -> dict[str, Any] | None:
    return None if speed is None else speed.to_json()


def main() -> None:
    """Print what there is to say of the recording, or of the form, that is named."""
    os.nice(10)  # what is live goes first
    path = Path(sys.argv[1])
    print(json.dumps((critical_speeds if path.suffix == '.yaml' else digest)(path)))


if __name__ == '__main__':
    main()
