"""The detector's status and events as DiagnosticArray: keys with units in their names."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray

from hunt_ros.detection.output import Event
from hunt_ros.detection.status import DetectorStatus
from hunt_ros.nodes.conversions import diagnostic
from hunt_ros.samples import NANOSECONDS

#: Number of the detector -> key in `hunting/status`; all others keep their name.
_KEYS = {
    'speed': 'speed_mps',
    'lateral_amplitude': 'amplitude_m',
    'lateral_amplitude_std': 'amplitude_std_m',
    'lateral_amplitude_rate': 'amplitude_rate_mps',
    'yaw_amplitude': 'yaw_amplitude_rad',
    'yaw_amplitude_std': 'yaw_amplitude_std_rad',
    'lateral_envelope': 'envelope_m',
    'yaw_envelope': 'yaw_envelope_rad',
    'growth_rate': 'growth_rate_per_s',
    'growth_rate_std': 'growth_rate_std_per_s',
    'unstable_amplitude': 'unstable_amplitude_m',
    'unstable_amplitude_std': 'unstable_amplitude_std_m',
    'stable_amplitude': 'stable_amplitude_m',
    'lateral_roughness': 'roughness_m',
    'noise_floor': 'noise_floor_m',
    'outlook': 'escape_chance_next_minute',
    'time_to_limit_cycle': 'time_to_limit_cycle_s',
}


def event_message(event: Event, rig: str) -> DiagnosticArray:
    """Return a transition: its word is the name of the status."""
    values = {
        'event': event.event,
        'since_s': f'{event.since_ns / NANOSECONDS:.3f}',
        'cause': event.cause,
        'speed_mps': event.speed_mps,
        'amplitude_m': event.amplitude_m,
        'growth_rate_per_s': event.growth_rate_per_s,
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
    }
    values |= {_KEYS.get(name, name): value for name, value in status.numbers.items()}
    values |= {f'dropped {what}': count for what, count in status.dropped.items()}
    values |= {f'clock_offset_s {name}': x for name, x in status.clock_offsets_s.items()}
    text = '; '.join(status.reasons)
    return diagnostic(status.stamp_ns, 'hunting', status.level.label, text, values, rig)
