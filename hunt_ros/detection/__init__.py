"""
From samples to region, state and alarm.

A sample goes through the `door` (which samples count, and when), `health` (are they sound),
`estimates` (the tracker and its second opinion), `rows` and `decision` (what they mean), and
`words` (what is told of it). `detector` is the whole of it, `offline` and `replay` run it.
"""

from typing import TYPE_CHECKING

from hunt_ros.lazy import lazily

if TYPE_CHECKING:
    from hunt_ros.detection.companions import CompanionConfig, Companions
    from hunt_ros.detection.configuration import DetectorConfig
    from hunt_ros.detection.detector import HuntingDetector
    from hunt_ros.detection.journal import JournalEntry
    from hunt_ros.detection.output import Event
    from hunt_ros.detection.regions import Level, State
    from hunt_ros.detection.replay import detect

__all__ = [
    'CompanionConfig',
    'Companions',
    'DetectorConfig',
    'Event',
    'HuntingDetector',
    'JournalEntry',
    'Level',
    'State',
    'detect',
]

__getattr__ = lazily(
    __name__,
    {
        'CompanionConfig': 'companions',
        'Companions': 'companions',
        'DetectorConfig': 'configuration',
        'HuntingDetector': 'detector',
        'JournalEntry': 'journal',
        'detect': 'replay',
        'Event': 'output',
        'Level': 'regions',
        'State': 'regions',
    },
)
