"""From estimates to region, state and alarm."""

from hunt_ros.detection.companions import CompanionConfig, Companions
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.detector import HuntingDetector
from hunt_ros.detection.journal import JournalEntry
from hunt_ros.detection.offline import detect
from hunt_ros.detection.output import Event, Output
from hunt_ros.detection.regions import Level, Region, State
from hunt_ros.detection.status import DetectorStatus

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
