"""
Kicks and quiet running for the benchmark of the detector, and what really happens.

Near the unstable branch the outcome is random, so each kick is followed without
the detector's knowledge until the wheelset is in the limit cycle or quiet again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from detection_rigs import BENCHES, RATE_HZ, Bench
from scipy.signal import butter, hilbert, sosfiltfilt

from hunt_ros.dynamics.simulation import RollerRig, SimulatedBlock
from hunt_ros.dynamics.simulation.settings import SimulationSettings
from hunt_ros.samples import Record, Series

#: Quiet running before a kick, s (UIC 518 wants 100 m), and what the detector sees after it.
BEFORE_S, AFTER_S = 16.0, 8.0


@dataclass(frozen=True)
class Kick:
    """One kick: `factor` times the critical one, m; `ratio` is A_rms / A_u."""

    bench: str
    speed: float
    ratio: float
    factor: float
    way: str
    roughness: float
    critical: float
    seed: int


def critical_kick(bench: str, speed: float, way: str, roughness: float) -> float:
    """
    Kick, m, that separates return from escape without noise: bisected on the full model.

    The kick comes at the moment, and so at the phase of the roughness, at which the
    benchmark's kicks come.
    """
    rig = BENCHES[bench]
    low, high = 0.3 * rig.unstable(speed), 4.0 * rig.unstable(speed)
    while high / low > 1.002:
        middle = math.sqrt(low * high)
        roller = RollerRig(rig.rig, rig.settings(speed, 0.0, roughness), seed=0)
        roller.advance(int(BEFORE_S * RATE_HZ))
        rig.kick(roller, way, middle)
        if rig.escapes(roller, speed):
            high = middle
        else:
            low = middle
    return math.sqrt(low * high)


@dataclass(frozen=True)
class Outcome:
    """The record around a kick, what came of it, and what its motion at `waits` foretold."""

    record: Record
    kick_ns: int
    escaped: bool
    foretold: tuple[float, ...]


def kicked(kick: Kick, waits: tuple[float, ...] = (), clones: int = 0) -> Outcome:
    """
    Run quiet, kick, go on, and see what comes of it.

    Parameters
    ----------
    kick : Kick
    waits : tuple of float
        Times after the kick, s, at which the motion itself is asked for its chance.
    clones : int
        Wheelsets that go on from there under noise of their own; the share of them that
        escapes is the chance as it really was. 0: not asked.
    """
    rig = BENCHES[kick.bench]
    settings = rig.settings(kick.speed, rig.broadband(kick.speed, kick.ratio), kick.roughness)
    roller = RollerRig(rig.rig, settings, kick.seed)
    blocks = [roller.advance(int(BEFORE_S * RATE_HZ))]
    rig.kick(roller, kick.way, kick.factor * kick.critical)
    foretold, done = [], 0
    for wait in waits if clones else ():
        blocks.append(roller.advance(round(wait * RATE_HZ) - done))
        done += len(blocks[-1])
        risen = [
            rig.escapes(_gone_on(rig, settings, roller.motion, kick.seed + 1 + number), kick.speed)
            for number in range(clones)
        ]
        foretold.append(sum(risen) / clones)
    blocks.append(roller.advance(int(AFTER_S * RATE_HZ) - done))
    escaped = rig.escapes(roller, kick.speed)
    return Outcome(recording(blocks), int(blocks[1].stamps_ns[0]), escaped, tuple(foretold))


def _gone_on(
    rig: Bench, settings: SimulationSettings, motion: tuple[float, ...], seed: int
) -> RollerRig:
    """Return a wheelset in this motion, with noise of its own; without roughness."""
    clone = RollerRig(rig.rig, settings, seed)
    y, y_rate, psi, psi_rate = np.subtract(motion, clone.motion).tolist()
    clone.kick(y, psi, y_rate, psi_rate)
    return clone


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


def true_amplitude(bench: Bench, block: SimulatedBlock) -> np.ndarray:
    """Amplitude, m, of the true motion about the hunting frequency; the ends are not exact."""
    frequency = bench.form.frequency_hz
    band = butter(3, [0.5 * frequency, 1.6 * frequency], 'bandpass', fs=RATE_HZ, output='sos')
    motion = without_lines(block.true_lateral, block.roller_angle)
    return np.abs(hilbert(sosfiltfilt(band, motion - motion.mean())))


def without_lines(values: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Remove the first two harmonics of the roller, fitted over the whole, at steady speed."""
    lines = np.stack([f(k * angle) for k in (1, 2) for f in (np.cos, np.sin)], axis=1)
    return np.asarray(values - lines @ np.linalg.lstsq(lines, values, rcond=None)[0])


@dataclass(frozen=True)
class Quiet:
    """Quiet running at one speed, roughness and noise."""

    bench: str
    speed: float
    ratio: float
    roughness: float
    seed: int
    minutes: int


def quiet_minutes(case: Quiet) -> Iterator[Record]:
    """Yield a minute at a time; the run ends where the noise really throws the wheelset out."""
    rig = BENCHES[case.bench]
    subcritical = bool(rig.kick_speeds)
    top = math.inf
    if subcritical:
        nearest = max(case.speed, rig.kick_speeds[0])  # below v_n the forcing of the lowest speed
        level = rig.broadband(nearest, case.ratio)
        top = 0.9 * rig.stable(nearest) + 1.5 * rig.scale * case.roughness
    else:  # there is no edge: forced as the paper's rig
        level = BENCHES['paper'].broadband(max(case.speed, 6.6), case.ratio)
    roller = RollerRig(rig.rig, rig.settings(case.speed, level, case.roughness), case.seed)
    for _ in range(case.minutes):
        block = roller.advance(int(60.0 * RATE_HZ))
        if float(np.abs(block.true_lateral).max()) > top:
            return
        yield recording([block])
