"""The normal form from recordings, with intervals."""

from hunt_ros.identification.identify import identify, update
from hunt_ros.identification.result import Identification
from hunt_ros.identification.settings import IdentificationSettings

__all__ = ['Identification', 'IdentificationSettings', 'identify', 'update']
