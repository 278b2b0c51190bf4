"""
The normal form from recordings, with intervals.

`identify` is the order of the work: `recordings` (what they say together) and `preparation` (what
each says alone, wherever `workers` do it), `record` (what a recording consists of), `fit` and what
it needs (the growth law), `uncertainty` and `posterior`, `verdict` (what may be said), `result`.
"""

from hunt_ros.identification.identify import identify, update
from hunt_ros.identification.preparation import Source
from hunt_ros.identification.result import Identification
from hunt_ros.identification.settings import IdentificationSettings

__all__ = ['Identification', 'IdentificationSettings', 'Source', 'identify', 'update']
