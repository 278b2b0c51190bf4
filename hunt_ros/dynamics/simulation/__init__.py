"""
Time-domain simulation of the rig.

`settings` says what it is made of, `model` packs that for the compiled `kernel`, `roller_rig` is
the rig as a stream, `experiment` a whole experiment as a record.
"""

from hunt_ros.dynamics.profile.speed_profile import SpeedProfile
from hunt_ros.dynamics.simulation.experiment import Kick, simulate
from hunt_ros.dynamics.simulation.roller_rig import RollerRig, SimulatedBlock
from hunt_ros.dynamics.simulation.settings import (
    DriveModel,
    Roughness,
    SensorModel,
    SimulationSettings,
)

__all__ = [
    'DriveModel',
    'Kick',
    'RollerRig',
    'Roughness',
    'SensorModel',
    'SimulatedBlock',
    'SimulationSettings',
    'SpeedProfile',
    'simulate',
]
