"""A whole experiment on the simulated rig, as a record."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.limit_cycle import cycles_of
from hunt_ros.dynamics.linear_stability import critical_frequency
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.profile import Motion, Profile
from hunt_ros.dynamics.profile.run import SET_POINT_S, ProfileRun
from hunt_ros.dynamics.simulation.roller_rig import RollerRig, SimulatedBlock
from hunt_ros.dynamics.simulation.settings import SimulationSettings
from hunt_ros.errors import ConfigError
from hunt_ros.samples import Record, Series

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
    profile: Profile,
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
    profile : Profile
        Set point of the drive. Steps that react to the amplitude see that of the true
        motion, and critical speeds from the equations of the rig.
    duration_s : float, optional
        s; default: to the end of the profile.
    kicks : sequence of Kick
        Blows, in any order.
    seed : int
        Of everything random.

    Returns
    -------
    Record
        lateral and yaw at the sample rate, roller and speed at the drive rate.

    Raises
    ------
    ConfigError
        For a duration that is not positive, or a profile that needs critical speeds that
        this rig does not have.
    """
    rate = settings.sample_rate_hz
    points = _Reacting(profile, rig, rate) if profile.reacts else _Fixed(profile, rate)
    wanted_s = points.duration_s if duration_s is None else duration_s
    if not wanted_s > 0.0 or (duration_s is not None and math.isinf(duration_s)):
        raise ConfigError(f'duration must be positive, got {wanted_s} s')
    stream = RollerRig(rig, replace(settings, initial_speed=float(points.begin_mps)), seed)
    total = sys.maxsize if math.isinf(wanted_s) else math.floor(wanted_s * rate) + 1
    due = sorted(
        ((max(0, math.ceil(kick.time_s * rate - 1e-9)), kick) for kick in kicks),
        key=lambda one: one[0],
    )
    blocks: list[SimulatedBlock] = []
    at = 0
    while at < total and not (duration_s is None and points.finished):
        while due and due[0][0] == at:
            _, kick = due.pop(0)
            stream.kick(kick.lateral_m, kick.yaw_rad, kick.lateral_velocity, kick.yaw_rate)
        end = min(at + points.block, total, *(start for start, _ in due[:1]))
        blocks.append(stream.advance(end - at, points.targets(at, end)))
        points.see(blocks[-1])
        at = end
    return record_of(blocks, settings, f'simulation of {rig.name}, seed {seed}')


class _Fixed:
    """
    Set points that are known before.

    Attributes
    ----------
    begin_mps : float
        The first one.
    duration_s : float
        Of the profile, s.
    block : int
        The most samples at once.
    finished : bool
        False: the duration tells.
    """

    finished = False
    block = BLOCK

    def __init__(self, profile: Profile, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._times_s, self._speeds_mps = profile.corners()
        self.begin_mps, self.duration_s = self._speeds_mps[0], self._times_s[-1]

    def targets(self, begin: int, end: int) -> NDArray[np.float64]:
        """Return the set points of the next samples, m/s, shape (end - begin,)."""
        times_s = np.arange(begin, end) / self._rate_hz
        return np.asarray(np.interp(times_s, self._times_s, self._speeds_mps), dtype=np.float64)

    def see(self, block: SimulatedBlock) -> None:
        """Nothing depends on the motion."""


class _Reacting:
    """
    Set points that the motion decides, with the same attributes; how long is not known before.

    The amplitude is that of the last period of the hunting.

    Raises
    ------
    ConfigError
        Where a step needs critical speeds that this rig does not have.
    """

    duration_s = math.inf

    def __init__(self, profile: Profile, rig: RigParameters, rate_hz: float) -> None:
        self._motion = _theory(rig)
        if lacking := profile.missing(self._motion):
            raise ConfigError(lacking)
        self._rate_hz = rate_hz
        self.block = max(1, round(SET_POINT_S * rate_hz))
        self.begin_mps = profile.steps[0].begin_mps(self._motion)
        self._run = ProfileRun(profile, self.begin_mps)
        period_s = 2.0 * math.pi * rig.time_scale / critical_frequency(rig)
        turn = np.arange(max(2, round(period_s * rate_hz)))
        self._wave = np.exp(2j * np.pi * turn / turn.size) * 2.0 / turn.size
        self._last = np.full(turn.size, math.nan)

    @property
    def finished(self) -> bool:
        """True when the last step is over."""
        return self._run.finished

    def targets(self, begin: int, end: int) -> NDArray[np.float64]:
        """Return the set points of the next samples, m/s, shape (end - begin,)."""
        before = self._run.speed_mps
        after = self._run.advance((end - begin) / self._rate_hz, self._motion)
        return np.linspace(before, after, end - begin, endpoint=False)

    def see(self, block: SimulatedBlock) -> None:
        """Take the amplitude of the lateral motion, NaN in the first period."""
        self._last = np.append(self._last, block.true_lateral)[-self._wave.size :]
        self._motion = replace(self._motion, amplitude_m=float(abs(self._wave @ self._last)))


def _theory(rig: RigParameters) -> Motion:
    """Return the critical speeds and the fold of the equations of a rig; NaN where none is."""
    branch = cycles_of(rig)
    if branch is None:
        return Motion()
    v_n, amplitude = branch.saddle_node() or (math.nan, math.nan)
    return Motion(v_n=v_n, v_c=branch.critical_speed, fold_amplitude_m=amplitude)


def record_of(
    blocks: Sequence[SimulatedBlock], settings: SimulationSettings, source: str
) -> Record:
    """Return blocks of a stream as one record, in the rates of the sensors and of the drive."""

    def joined(name: str) -> NDArray[Any]:
        """Return a field of all blocks."""
        return np.concatenate([getattr(block, name) for block in blocks])

    stamps = joined('stamps_ns')
    tick = np.floor(np.arange(len(stamps)) * settings.drive_rate_hz / settings.sample_rate_hz)
    drive = np.diff(tick, prepend=-1.0) > 0.0
    return Record(
        {
            'lateral': Series(stamps, joined('lateral')),
            'yaw': Series(stamps, joined('yaw')),
            'roller': Series(stamps[drive], joined('roller_angle')[drive]),
            'speed': Series(stamps[drive], joined('speed')[drive]),
        },
        source,
    )
