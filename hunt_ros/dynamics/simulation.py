"""
Time-domain simulation of the rig: a whole experiment as a record.

This module is also the way in to the rest: the rig as a stream is in `roller_rig`, what
it is made of in `simulation_settings`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.roller_rig import RollerRig, SimulatedBlock
from hunt_ros.dynamics.simulation_settings import (
    DriveModel,
    Roughness,
    SensorModel,
    SimulationSettings,
)
from hunt_ros.dynamics.speed_profile import SpeedProfile
from hunt_ros.errors import ConfigError
from hunt_ros.samples import Record, Series

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

#: Samples computed at once in `simulate`.
BLOCK = 65_536


@dataclass(frozen=True)
class Kick:
    """
    A blow: what it adds to the state of the wheelset at once.

    Parameters
    ----------
    time_s : float
        When, from the start of a simulation; rounded up to a sample.
    lateral_m, yaw_rad, lateral_velocity, yaw_rate : float
        m, rad, m/s, rad/s.
    """

    time_s: float
    lateral_m: float = 0.0
    yaw_rad: float = 0.0
    lateral_velocity: float = 0.0
    yaw_rate: float = 0.0


def simulate(
    rig: RigParameters,
    settings: SimulationSettings,
    profile: SpeedProfile,
    duration_s: float | None = None,
    kicks: Sequence[Kick] = (),
    seed: int = 0,
) -> Record:
    """
    Run an experiment and record it.

    Parameters
    ----------
    rig : RigParameters
        The rig.
    settings : SimulationSettings
        Its initial speed is replaced by that of the profile.
    profile : SpeedProfile
        Set point of the drive.
    duration_s : float, optional
        s; default: to the end of the profile.
    kicks : sequence of Kick
        Blows, in any order.
    seed : int
        Of everything random.

    Returns
    -------
    Record
        lateral and yaw at the sample rate (NaN in drop-outs, stamps of their own
        clocks), roller and speed at the drive rate.

    Raises
    ------
    ConfigError
        For a duration that is not positive.
    """
    duration_s = profile.duration_s if duration_s is None else duration_s
    if not (math.isfinite(duration_s) and duration_s > 0.0):
        raise ConfigError(f'duration must be positive, got {duration_s} s')
    settings = replace(settings, initial_speed=float(profile(0.0)))
    stream, rate = RollerRig(rig, settings, seed), settings.sample_rate_hz
    total = math.floor(duration_s * rate) + 1
    due = sorted(kicks, key=lambda kick: kick.time_s)
    starts = [min(total, max(0, math.ceil(kick.time_s * rate - 1e-9))) for kick in due]
    edges = sorted({*range(0, total, BLOCK), *starts, total})
    blocks = []
    for begin, end in itertools.pairwise(edges):
        for kick, at in zip(due, starts, strict=True):
            if at == begin:
                stream.kick(kick.lateral_m, kick.yaw_rad, kick.lateral_velocity, kick.yaw_rate)
        blocks.append(stream.advance(end - begin, profile(np.arange(begin, end) / rate)))
    return _record(blocks, settings, f'simulation of {rig.name}, seed {seed}')


def _record(blocks: Sequence[SimulatedBlock], settings: SimulationSettings, source: str) -> Record:
    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(block, name) for block in blocks])

    stamps = joined('stamps_ns')
    tick = np.floor(np.arange(len(stamps)) * settings.drive_rate_hz / settings.sample_rate_hz)
    drive = np.diff(tick, prepend=-1.0) > 0.0
    return Record(
        {
            'lateral': Series(joined('lateral_stamps_ns'), joined('lateral')),
            'yaw': Series(joined('yaw_stamps_ns'), joined('yaw')),
            'roller': Series(stamps[drive], joined('roller_angle')[drive]),
            'speed': Series(stamps[drive], joined('speed')[drive]),
        },
        source,
    )
