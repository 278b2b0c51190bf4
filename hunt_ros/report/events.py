"""
The events of a run: their words, and those of a recording with the form identified from it.

The latter are what the detector would have said live had it known the form: the report puts
the sharper alarm to the run it was learnt from, and says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.samples import Record

if TYPE_CHECKING:
    from hunt_ros.detection import DetectorConfig, Event
    from hunt_ros.detection.words.clearance import Clearance

#: Where the words of its name are not enough.
SENTENCES: dict[str, str] = {
    'hysteresis_entered': 'entered the hysteresis region: a bump can now start hunting',
    'hysteresis_left': 'left the hysteresis region',
    'unstable_entered': 'above the critical speed: the quiet state is unstable',
    'unstable_left': 'below the critical speed again',
    'escaping': 'ESCAPING: the motion is growing towards the limit cycle',
    'limit_cycle': 'LIMIT CYCLE: full hunting',
    'decaying': 'hunting is dying out',
    'disturbed': 'disturbed, inside the basin of the quiet state',
    'margin_low': 'margin is low',
    'margin_restored': 'margin is restored',
    'limit_exceeded': 'AMPLITUDE LIMIT EXCEEDED',
    'limit_cleared': 'amplitude limit kept again',
    'motion_outside_range': 'MOTION OUTSIDE THE RANGE THAT IS FOLLOWED',
    'motion_outside_range_over': 'no more motion outside the range that is followed',
    'sensor_fault': 'SENSOR FAULT',
    'input_stale': 'INPUT STALE: the estimates cannot be trusted',
    'interlock_tripped': 'INTERLOCK TRIPPED',
    'interlock_disarmed': 'INTERLOCK DISARMED',
    'acknowledged': 'alarm acknowledged',
    'criterion_exceeded': 'CRITERION EXCEEDED',
    'criterion_cleared': 'criterion no longer exceeded',
}


def sentence(event: str) -> str:
    """Return what an event is, for a person: on the page, on the terminal and in the report."""
    return SENTENCES.get(event, event.replace('_', ' '))


def events_of(
    record: Record,
    normal_form: IdentifiedNormalForm | None,
    settings: DetectorConfig | None = None,
) -> tuple[Sequence[Event], Sequence[Clearance]]:
    """
    Run the detector over a record.

    Parameters
    ----------
    record : Record
        With `speed`, and `lateral` or `yaw`.
    normal_form : IdentifiedNormalForm or None
        The form in force; None: the detector knows nothing of the rig.
    settings : DetectorConfig, optional
        The usual ones by default.

    Returns
    -------
    events : sequence of Event
        In the order of time.
    clearances : sequence of Clearance
        Of each speed that was held, the verdict at the end.
    """
    from hunt_ros.detection import DetectorConfig, HuntingDetector
    from hunt_ros.detection.offline import collect, config_for, frequency_for
    from hunt_ros.detection.replay import watch

    # Only the channels it has: one that is promised and silent would be a fault.
    config, _ = config_for(record, settings or DetectorConfig())
    if normal_form is None:
        config, _ = frequency_for(record, config)
    detector = HuntingDetector(config, normal_form)
    return collect(watch(record, detector), detector).events, detector.clearances.all()
