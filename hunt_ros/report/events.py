"""
The events of a run: what the detector says to a recording, with the form identified from it.

That is what the detector would have said live had it known the form: the report uses
the sharper alarm on the run it was learnt from, and says so.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.report.overview import RunEvent
from hunt_ros.samples import NANOSECONDS, Record, Series

#: Time that is fed at once, ns: the channels must run side by side, or one would fill
#: the detector's buffers while it waits for the other.
_BLOCK_NS = 2 * NANOSECONDS


def events_of(record: Record, normal_form: IdentifiedNormalForm | None) -> list[RunEvent]:
    """
    Run the detector over a record.

    Parameters
    ----------
    record : Record
        With `speed`, and `lateral` or `yaw`.
    normal_form : IdentifiedNormalForm or None
        The form in force; None: the detector knows nothing of the rig.

    Returns
    -------
    list of RunEvent
        In the order of time, from the first stamp of the record.
    """
    from hunt_ros.detection import DetectorConfig, HuntingDetector

    detector = HuntingDetector(DetectorConfig(), normal_form)
    outputs = [detector.update(*block) for block in side_by_side(record)]
    outputs.append(detector.finish())
    return [
        RunEvent(
            seconds=(event.stamp_ns - record.start_ns) / NANOSECONDS,
            event=event.event,
            level=event.level.name,
            speed=_known(event.speed_mps),
            amplitude=_known(event.amplitude_m),
            growth_rate=_known(event.growth_rate_per_s),
            source=record.source,
        )
        for output in outputs
        for event in output.events
    ]


def side_by_side(record: Record) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """
    Cut the channels into blocks of time, in turn, each channel in its recorded order.

    Yields
    ------
    channel, stamps_ns, values
        Together every sample of the record, once.
    """
    start = record.start_ns
    blocks = {name: _blocks(series, start) for name, series in record.items()}
    last = max((int(index[-1]) for index in blocks.values() if index.size), default=-1)
    for number in range(last + 1):
        for name, index in blocks.items():
            first, end = np.searchsorted(index, [number, number + 1])
            if end > first:
                series = record[name]
                yield name, series.stamps_ns[first:end], series.values[first:end]


def _blocks(series: Series, start_ns: int) -> np.ndarray:
    """Number of the block of each sample; a stamp that jumps back stays where it was recorded."""
    numbers: np.ndarray = np.maximum.accumulate((series.stamps_ns - start_ns) // _BLOCK_NS)
    return numbers


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
