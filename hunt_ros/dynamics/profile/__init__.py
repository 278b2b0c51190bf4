"""
Speed profiles: what a drive is asked for, as an experimenter writes it.

A `Profile` is a sequence of `steps`; `run` is one under way; `speed_profile` is the set point
against time that is left where no detector decides how it goes.
"""

from hunt_ros.dynamics.profile.profile import Profile
from hunt_ros.dynamics.profile.steps import (
    STEPS,
    Climb,
    Corners,
    Hold,
    Leg,
    Motion,
    Ramp,
    Scene,
    Seesaw,
    Staircase,
    Step,
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
