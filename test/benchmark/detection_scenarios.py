"""
Scenarios for the detector on the simulated rig, and what really happened in each.

Near the unstable branch the outcome is random, so each kick is followed without
the detector's knowledge until the wheelset is in the limit cycle or quiet again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from hunt_ros.dynamics.amplitude_noise import quiet_diffusion
from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.limit_cycle import Branch, limit_cycles
from hunt_ros.dynamics.linear_stability import hunting_mode
from hunt_ros.dynamics.model_misfit import fitted_form
from hunt_ros.dynamics.parameters import RigParameters, paper_rig
from hunt_ros.dynamics.simulation import RollerRig, SimulatedBlock
from hunt_ros.dynamics.simulation_settings import Roughness, SensorModel, SimulationSettings
from hunt_ros.samples import Record, Series

RATE_HZ = 500.0
RIG = paper_rig()


@cache
def branch() -> Branch:
    """Limit cycles of the full model."""
    return limit_cycles(RIG)


@cache
def true_form() -> IdentifiedNormalForm:
    """The quintic form that fits the full model's limit cycles, with 1 % on the branch."""
    form = fitted_form(normal_form_of(RIG), branch(), (6.6, 8.4))
    relative = np.array([0.001, 0.01, 0.01, 0.01, 0.01, 0.01])
    values = np.array([form.critical_speed, form.D1, form.D4, form.D7, form.D10, form.D15])
    return IdentifiedNormalForm(form, np.diag((relative * values) ** 2))


@cache
def unstable_amplitude(speed: float) -> float:
    """A_u of the full model, m."""
    at = branch().at_speed(speed)
    return float(at.amplitude[~at.stable][0])


def broadband_for(speed: float, ratio: float) -> float:
    """Strength of the forcing that gives A_rms = ratio A_u in the quiet state."""
    damping = -hunting_mode(RIG, speed).growth_rate
    unit = math.sqrt(2.0 * quiet_diffusion(RIG, speed, 1.0) / damping)
    return ratio * unstable_amplitude(speed) / unit


def settings(
    speed: float, broadband: float, roughness: float = 0.0, noise: float = 5e-6
) -> SimulationSettings:
    """The rig as measured: two sensors, their noise in y and psi."""
    return SimulationSettings(
        sample_rate_hz=RATE_HZ,
        initial_speed=speed,
        broadband=broadband,
        roughness=Roughness((roughness, 0.4 * roughness)) if roughness else Roughness(),
        lateral_sensor=SensorModel(noise=noise),
        yaw_sensor=SensorModel(noise=4.0 * noise),
    )


@cache
def critical_kick(speed: float) -> float:
    """Kick in y, m, that separates return from escape without noise: bisected."""
    low, high = 0.3 * unstable_amplitude(speed), 3.0 * unstable_amplitude(speed)
    while high / low > 1.002:
        middle = math.sqrt(low * high)
        rig = RollerRig(RIG, settings(speed, 0.0), seed=0)
        rig.kick(lateral_m=middle)
        if outcome(rig, speed):
            high = middle
        else:
            low = middle
    return math.sqrt(low * high)


def outcome(rig: RollerRig, speed: float, patience_s: float = 120.0) -> bool:
    """Follow the rig until it hunts (True) or is quiet; the motion itself, no estimate."""
    edge = unstable_amplitude(speed)
    cycles = branch().at_speed(speed)
    top = 0.5 * (edge + float(cycles.amplitude[cycles.stable][0]))
    for _ in range(int(patience_s)):
        block = rig.advance(int(RATE_HZ))
        size = 0.5 * float(np.ptp(block.true_lateral))
        if size > top:
            return True
        if size < 0.45 * edge:
            return False
    return size > edge


@dataclass
class Kicked:
    """One kick: the record around it, and what came of it."""

    speed: float
    ratio: float
    factor: float
    record: Record
    kick_ns: int
    escaped: bool


def kicked(
    speed: float,
    ratio: float,
    factor: float,
    seed: int,
    before_s: float = 12.0,
    after_s: float = 4.0,
) -> Kicked:
    """Run quiet, kick to `factor` of the critical kick, go on, and see what comes of it."""
    rig = RollerRig(RIG, settings(speed, broadband_for(speed, ratio)), seed)
    first = rig.advance(int(before_s * RATE_HZ))
    rig.kick(lateral_m=factor * critical_kick(speed))
    second = rig.advance(int(after_s * RATE_HZ))
    record = recording([first, second])
    return Kicked(speed, ratio, factor, record, int(second.stamps_ns[0]), outcome(rig, speed))


def recording(blocks: list[SimulatedBlock]) -> Record:
    """Put blocks together as a Record; speed and roller at a fifth of the rate."""

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(block, name) for block in blocks])

    stamps = joined('stamps_ns')
    slow = slice(None, None, 5)
    return Record(
        {
            'lateral': Series(joined('lateral_stamps_ns'), joined('lateral')),
            'yaw': Series(joined('yaw_stamps_ns'), joined('yaw')),
            'roller': Series(stamps[slow], joined('roller_angle')[slow]),
            'speed': Series(stamps[slow], joined('speed')[slow]),
        }
    )


@dataclass
class QuietRun:
    """Hours of quiet running at one speed, roughness and noise."""

    speed: float
    ratio: float
    roughness: float
    seed: int
    hours: float
    escaped: bool = field(default=False, init=False)

    def blocks(self, length_s: float = 60.0) -> Iterator[Record]:
        """Yield records; the run ends where the noise really throws it out."""
        level = broadband_for(max(self.speed, 6.6), self.ratio)
        rig = RollerRig(RIG, settings(self.speed, level, self.roughness), self.seed)
        cycles = branch().at_speed(max(self.speed, 6.6))
        top = 0.9 * float(cycles.amplitude[cycles.stable][0])
        for _ in range(max(1, round(self.hours * 3600.0 / length_s))):
            block = rig.advance(int(length_s * RATE_HZ))
            if float(np.abs(block.true_lateral).max()) > top + 1.5 * self.roughness:
                self.escaped = True
                return
            yield recording([block])


@cache
def other_rig(kind: str) -> RigParameters:
    """'supercritical': the same rig with a softening nonlinearity."""
    if kind != 'supercritical':
        raise KeyError(kind)
    from dataclasses import replace

    return replace(RIG, name=kind, beta={'30': -446.87, '50': -2.74748e6})
