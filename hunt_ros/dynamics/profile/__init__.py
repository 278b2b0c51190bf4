"""
Speed profiles: what a drive is asked for, as an experimenter writes it.

A `Profile` is a sequence of `steps`, and `step` is what all of them are; `run` is one under way.
"""

from hunt_ros.dynamics.profile.profile import Profile
from hunt_ros.dynamics.profile.step import Leg, Motion, Scene, Step
from hunt_ros.dynamics.profile.steps import (
    STEPS,
    Climb,
    Corners,
    Hold,
    Ramp,
    Seesaw,
    Staircase,
    Sweep,
)

__all__ = [
    'STEPS',
    'Climb',
    'Corners',
    'Hold',
    'Leg',
    'Motion',
    'Profile',
    'Ramp',
    'Scene',
    'Seesaw',
    'Staircase',
    'Step',
    'Sweep',
]
