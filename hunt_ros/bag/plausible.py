"""Values that no rig can have: a channel in millimetres or degrees that is taken for SI."""

from __future__ import annotations

import numpy as np

from hunt_ros.errors import BagError
from hunt_ros.samples import Record, Series
from hunt_ros.sensors import SENSORS

#: Largest usual value of a channel, its unit, and a factor that makes SI of the unit it may have
#: been recorded in.
LARGEST: dict[str, tuple[float, str, str]] = {
    **{s.name: (s.largest, s.unit, s.mistaken) for s in SENSORS},
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
