"""Values that no rig can have: a channel in millimetres or degrees that is taken for SI."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hunt_ros.errors import BagError
from hunt_ros.samples import NANOSECONDS, Record, Series, plain
from hunt_ros.sensors import SENSORS

#: A motion is looked at so long, s, and over so many values at least.
_WINDOW_S, _FEWEST = 1.0, 50
#: No sensor measures less, whatever its unit: where all is less, its bytes are of another type.
_LEAST = 1e-20
#: Readings of so many times the largest usual one, or of so much in any unit, or more are none.
_IMPOSSIBLE, NO_READING = 1e4, 1e30
#: A step of the roller that is so near to a turn is a wrap, rad.
_NEAR_TURN = 0.1
#: Largest usual value of a channel, its unit, and a factor that makes SI of the unit it may have
#: been recorded in.
LARGEST: dict[str, tuple[float, str, str]] = {
    **{s.name: (s.largest, s.unit, s.mistaken) for s in SENSORS},
    'speed': (200.0, 'm/s', '/3.6'),
    'roller': (1000.0, 'rad/s', '*0.0174533'),  # as it turns
}


def wrong_unit(channel: str, series: Series, usual_most: float = math.inf) -> str:
    """
    Say what is wrong with the size of a channel's values; '' where nothing is.

    Half of the values must be too large, of a motion half of those of `_WINDOW_S`: a few are
    error codes of a sensor, and most of a recording may be quiet.

    Parameters
    ----------
    channel : str
        Its name.
    series : Series
        In SI, as it is thought.
    usual_most : float
        A smaller limit than that of `LARGEST`.
    """
    finite = np.isfinite(series.values)
    values = series.values[finite]
    if channel not in LARGEST or not values.size:
        return ''
    most, unit, factor = LARGEST[channel]
    if 0.0 < (peak := float(np.abs(values).max())) < _LEAST:
        return f'channel {channel} is {peak:.2g} {unit} at most: of another type than it says?'
    most = min(most, usual_most)
    span_s = float(np.ptp(series.stamps_ns[finite])) / NANOSECONDS
    count = min(max(1, round(span_s / _WINDOW_S)), max(1, values.size // _FEWEST))
    if channel == 'speed':
        usual = float(np.median(np.abs(values)))
    elif channel == 'roller':
        steps = np.abs(np.diff(values))
        steps[np.abs(steps - 2.0 * np.pi) < _NEAR_TURN] = 0.0  # it may wrap, also where it stands
        ways = [part.sum() for part in np.array_split(steps, count)]
        usual = float(np.median(ways)) * count / max(span_s, _WINDOW_S)
    else:  # it may have any offset
        parts = np.array_split(values, count)
        usual = max(float(np.median(np.abs(part - np.median(part)))) for part in parts)
    if usual <= most:
        return ''
    return (
        f'channel {channel} is beyond {plain(usual)} {unit} half of the time, expected less than'
        f' {most:g} {unit}: recorded in another unit? (--channel {channel}=SOURCE{factor})'
    )


def possible_readings(record: Record) -> tuple[Record, list[str]]:
    """
    Return a record with NaN for readings that no sensor gives, and a line for each such channel.

    They are few, or so large that they are numbers of nothing.
    """
    channels, told = dict(record), []
    for name, series in record.items():
        sizes = np.where(np.isfinite(series.values), np.abs(series.values), 0.0)
        most = _IMPOSSIBLE * LARGEST[name][0] if name != 'roller' else NO_READING
        many = 100 * np.count_nonzero(sizes >= most) > max(100, sizes.size)
        if many or wrong_unit(name, series):
            most = NO_READING
        if (far := sizes >= most).any():
            channels[name] = Series(series.stamps_ns, np.where(far, math.nan, series.values))
            told.append(
                f'channel {name}: {np.count_nonzero(far)} readings of up to {sizes.max():.3g} (SI)'
                ' are none of a sensor, and are passed over'
            )
    return replace(record, channels=channels), told


def check_units(record: Record) -> Record:
    """
    Return the record with its possible readings, if its values can be those of a rig in SI.

    Raises
    ------
    BagError
        Naming the recording, the channel and its values.
    """
    found, told = possible_readings(record)
    for channel, series in found.items():
        if problem := wrong_unit(channel, series):
            raise BagError(f'{record.source}: {problem}')
    if not told:
        return found
    problems = '; '.join([*filter(None, [record.notes.get('problems')]), *told])
    return replace(found, notes={**record.notes, 'problems': problems})
