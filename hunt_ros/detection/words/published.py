"""Status and events of the detector as they are published: keys with units in their names."""

from __future__ import annotations

from collections.abc import Mapping

from hunt_ros.detection.output import PUBLIC, Event
from hunt_ros.detection.words.status import DetectorStatus
from hunt_ros.samples import NANOSECONDS, as_text


def event_values(event: Event) -> dict[str, object]:
    """Return the values of a message of `hunting/events`."""
    return {
        'event': event.event,
        'since_s': _seconds(event.since_ns),
        'decided_s': _seconds(event.stamp_ns),
        'test': event.test,
        'cause': event.cause,
        'normal_form': event.normal_form,
        **event.numbers,
    }


def status_values(status: DetectorStatus) -> dict[str, object]:
    """Return the values of a message of `hunting/status`."""
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
    return values


def status_message(status: DetectorStatus) -> str:
    """Return the reasons of a status as its message."""
    return '; '.join(status.reasons)


def texts(level: str, message: str, values: Mapping[str, object]) -> dict[str, str]:
    """Return a status or an event as who hears it reads it: level, message and values as texts."""
    shown = {key: as_text(value) for key, value in values.items()}
    return {'level': level, 'message': message, **shown}


def _seconds(stamp_ns: int) -> str:
    """Return a stamp in seconds, to the millisecond; '' where there is none."""
    return f'{stamp_ns / NANOSECONDS:.3f}' if stamp_ns else ''
