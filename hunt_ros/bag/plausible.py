"""Values that no rig can have: a channel in millimetres or degrees that is taken for SI."""

from __future__ import annotations

import numpy as np

from hunt_ros.errors import BagError
from hunt_ros.samples import Record, Series

#: Largest usual value of a channel (lateral motion, m; yaw motion, rad; speed, m/s), its unit,
#: and a factor that makes SI of the unit it may have been recorded in.
LARGEST: dict[str, tuple[float, str, str]] = {
    'lateral': (1.0, 'm', '*0.001'),
    'yaw': (1.6, 'rad', '*0.0174533'),
    'speed': (200.0, 'm/s', '/3.6'),
}


def wrong_unit(channel: str, series: Series) -> str:
    """
    Say what is wrong with the size of a channel's values; '' where nothing is.

    Half of the values must be too large: a few are error codes of a sensor.

    Parameters
    ----------
    channel : str
        Its name.
    series : Series
        In SI, as it is thought.
    """
    values = series.values[np.isfinite(series.values)]
    if channel not in LARGEST or not values.size:
        return ''
    most, unit, factor = LARGEST[channel]
    # A sensor of motion may have any offset; a speed has none.
    middle = 0.0 if channel == 'speed' else float(np.median(values))
    usual = float(np.median(np.abs(values - middle)))
    if usual <= most:
        return ''
    return (
        f'channel {channel} is beyond {usual:.3g} {unit} half of the time, expected less than'
        f' {most:g} {unit}: recorded in another unit? (--channel {channel}=SOURCE{factor})'
    )


def check_units(record: Record) -> Record:
    """
    Return the record, if its values can be those of a rig in SI.

    Raises
    ------
    BagError
        Naming the recording, the channel and its values.
    """
    for channel, series in record.items():
        problem = wrong_unit(channel, series)
        if problem:
            raise BagError(f'{record.source}: {problem}')
    return record
