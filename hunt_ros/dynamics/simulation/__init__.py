"""
Time-domain simulation of the rig.

`settings` says what it is made of, `roller_rig` is the rig as a stream (by the compiled `kernel`),
`experiment` a whole experiment as a record.
"""

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
    'simulate',
]
