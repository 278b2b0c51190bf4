"""
The events of a run: what the detector says to a recording, with the form identified from it.

That is what the detector would have said live had it known the form: the report puts
the sharper alarm to the run it was learnt from, and says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.samples import Record

if TYPE_CHECKING:
    from hunt_ros.detection import Event


def events_of(
    record: Record,
    normal_form: IdentifiedNormalForm | None,
) -> Sequence[Event]:
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
    sequence of Event
        In the order of time.
    """
    from hunt_ros.detection import DetectorConfig, HuntingDetector
    from hunt_ros.detection.offline import collect, config_for, watch
    from hunt_ros.detection.record_frequency import frequency_for

    # Only the channels it has: one that is promised and silent would be a fault.
    config, _ = config_for(record, DetectorConfig())
    if normal_form is None:
        config, _ = frequency_for(record, config)
    return collect(watch(record, HuntingDetector(config, normal_form))).events
