"""The detector's status and events as DiagnosticArray: keys with units in their names."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray

from hunt_ros.detection.output import PUBLIC, Event
from hunt_ros.detection.words.status import DetectorStatus
from hunt_ros.nodes.conversions import diagnostic
from hunt_ros.samples import NANOSECONDS


def event_message(event: Event, rig: str) -> DiagnosticArray:
    """Return a transition: its word is the name of the status, its cause the message."""
    values: dict[str, object] = {
        'event': event.event,
        'since_s': _seconds(event.since_ns),
        'decided_s': _seconds(event.stamp_ns),
        'test': event.test,
        'cause': event.cause,
        'normal_form': event.normal_form,
        **event.numbers,
    }
    return diagnostic(event.stamp_ns, event.event, event.level.label, event.cause, values, rig)


def status_message(status: DetectorStatus, rig: str) -> DiagnosticArray:
    """Return the present status: the reasons in its message, every number as a value."""
    values: dict[str, object] = {
        'state': status.state.label,
        'region': status.region.label,
        'alarm': status.alarm,
        'sequence': status.sequence,
        'inputs_until_ns': status.inputs_until_ns,
        'since_s': _seconds(status.since_ns),
        'test': status.test,
        'state_since_s': _seconds(status.state_since_ns),
        'state_decided_s': _seconds(status.state_decided_ns),
        'normal_form': status.normal_form,
        'v_n_mps': status.v_n,
        'v_c_mps': status.v_c,
        'fold_amplitude_m': status.fold_amplitude,
        'absent': '; '.join(status.absent),
    }
    values |= {name: '' if x is None else x for name, x in status.totals.items()}
    values |= {PUBLIC.get(name, name): value for name, value in status.numbers.items()}
    values |= {f'dropped {what}': count for what, count in status.dropped.items()}
    values |= {f'clock_offset_s {name}': x for name, x in status.clock_offsets_s.items()}
    text = '; '.join(status.reasons)
    return diagnostic(status.stamp_ns, 'hunting', status.level.label, text, values, rig)


def _seconds(stamp_ns: int) -> str:
    """Return a stamp in seconds, to the millisecond; '' where there is none."""
    return f'{stamp_ns / NANOSECONDS:.3f}' if stamp_ns else ''
