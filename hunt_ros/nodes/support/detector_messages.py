"""The detector's status and events as DiagnosticArray."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray

from hunt_ros.detection.output import Event
from hunt_ros.detection.words import published
from hunt_ros.detection.words.status import DetectorStatus
from hunt_ros.nodes.support.conversions import diagnostic


def event_message(event: Event, rig: str) -> DiagnosticArray:
    """Return a transition: its word is the name of the status, its cause the message."""
    values = published.event_values(event)
    return diagnostic(event.stamp_ns, event.event, event.level.label, event.cause, values, rig)


def status_message(status: DetectorStatus, rig: str) -> DiagnosticArray:
    """Return the present status: the reasons in its message, every number as a value."""
    text, values = published.status_message(status), published.status_values(status)
    return diagnostic(status.stamp_ns, 'hunting', status.level.label, text, values, rig)
