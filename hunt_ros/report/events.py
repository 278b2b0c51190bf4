"""
The events of a run: what the detector says to a recording, with the form identified from it.

That is what the detector would have said live had it known the form: the report puts
the sharper alarm to the run it was learnt from, and says so.
"""

from __future__ import annotations

from collections.abc import Callable

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.report.figures.overview import RunEvent
from hunt_ros.samples import NANOSECONDS, Record, known


def events_of(
    record: Record,
    normal_form: IdentifiedNormalForm | None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[RunEvent]:
    """
    Run the detector over a record.

    Parameters
    ----------
    record : Record
        With `speed`, and `lateral` or `yaw`.
    normal_form : IdentifiedNormalForm or None
        The form in force; None: the detector knows nothing of the rig.
    progress : callable
        Told which fraction is done.

    Returns
    -------
    list of RunEvent
        In the order of time, from the first stamp of the record.
    """
    from hunt_ros.detection import DetectorConfig, HuntingDetector
    from hunt_ros.detection.offline import collect, config_for, watch
    from hunt_ros.detection.record_frequency import frequency_for

    # Only the channels it has: one that is promised and silent would be a fault.
    config, _ = config_for(record, DetectorConfig())
    if normal_form is None:
        config, _ = frequency_for(record, config)
    events = collect(watch(record, HuntingDetector(config, normal_form), progress)).events
    return [
        RunEvent(
            seconds=(event.stamp_ns - record.start_ns) / NANOSECONDS,
            event=event.event,
            level=event.level.label,
            speed=known(event.speed_mps),
            amplitude=known(event.amplitude_m),
            growth_rate=known(event.growth_rate_per_s),
            source=record.source,
            cause=event.cause,
        )
        for event in events
    ]
