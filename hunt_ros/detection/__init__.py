"""From estimates to region, state and alarm."""

from hunt_ros.detection.companions import CompanionConfig, Companions
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.detector import HuntingDetector, detect
from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.output import DetectorStatus, Event, Output
from hunt_ros.detection.regions import Level, Region, State

__all__ = [
    'CompanionConfig',
    'Companions',
    'DetectorConfig',
    'DetectorStatus',
    'Event',
    'HuntingDetector',
    'JournalEntry',
    'Level',
    'Output',
    'Region',
    'State',
    'detect',
]
