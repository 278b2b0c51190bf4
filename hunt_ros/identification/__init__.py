"""
The normal form from recordings, with intervals.

`identify` is the order of the work: `record` (what the recordings consist of), `fit` and what it
needs (the growth law), `uncertainty` and `posterior`, `verdict` (what may be said), `result`.
"""

from hunt_ros.identification.identify import identify, update
from hunt_ros.identification.result import Identification
from hunt_ros.identification.settings import IdentificationSettings

__all__ = ['Identification', 'IdentificationSettings', 'identify', 'update']
