"""Records whose truth is known: of the amplitude equation itself, and of the full model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import made
import numpy as np

from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.dynamics.simulation import DriveModel, Kick, SimulationSettings, simulate
from hunt_ros.samples import Record, Series

ORIGIN_NS = 1_700_000_000_000_000_000


def amplitude_record(
    speed: Callable[[np.ndarray], np.ndarray] | float,
    duration_s: float,
    seed: int,
    form: NormalForm = PAPER_NORMAL_FORM,
    start: float = 1e-6,
    forcing: float = 0.0,
    noise: float = 5e-6,
    roughness: float = 0.0,
    kicks: Sequence[tuple[float, float]] = (),
    rate_hz: float = 100.0,
) -> Record:
    """Record of Eq. (24) with random forcing: y = Re z exp(i 2 pi f t) and what sensors add."""
    rng = np.random.default_rng(seed)
    n, dt = int(duration_s * rate_hz), 1.0 / rate_hz
    time = np.arange(n) * dt
    v = np.broadcast_to(speed(time) if callable(speed) else speed, time.shape).astype(float)
    z = start * np.exp(1j * rng.uniform(0.0, 2.0 * np.pi))
    pushes = rng.standard_normal((n, 2)) @ np.array([1.0, 1.0j]) * forcing * math.sqrt(dt)
    blows = {round(at * rate_hz): size for at, size in kicks}
    path = np.empty(n, dtype=complex)
    eps = v / form.critical_speed - 1.0
    linear = (form.D1 * eps + form.D7 * eps**2) / form.time_scale
    cubic = (form.D4 + form.D10 * eps) / form.time_scale
    quintic = form.D15 / form.time_scale
    unit = (2.0 * form.length_scale) ** -2

    def rate(k: int, amplitude: float) -> float:
        r2 = amplitude * amplitude * unit
        return linear[k] + (cubic[k] + quintic * r2) * r2

    for k in range(n):
        z += blows.get(k, 0.0)
        path[k] = z
        a = abs(z)
        half = a * math.exp(0.5 * dt * rate(k, a))
        z = z * math.exp(dt * rate(k, half)) + pushes[k]
    roller = np.cumsum(v) * dt / 0.15
    lateral = (path * np.exp(2j * np.pi * form.frequency_hz * time)).real
    lateral += roughness * np.cos(roller + 1.0) + 3e-5 + noise * rng.standard_normal(n)
    stamps = ORIGIN_NS + np.round(time * 1e9).astype(np.int64)
    channels = {
        'lateral': Series(stamps, lateral),
        'speed': Series(stamps[::5], v[::5]),
        'roller': Series(stamps[::5], roller[::5]),
    }
    return Record(channels, f'seed {seed}')


def held_speeds(
    speeds: Sequence[float], hold_s: float, way_s: float, seed: int, **more: float
) -> Record:
    """Record of the amplitude equation over holds, with ways of `way_s` between them."""
    edges = hold_s * np.arange(1, len(speeds))
    ends = np.sort([0.0, *(edges - 0.5 * way_s), *(edges + 0.5 * way_s), hold_s * len(speeds)])
    at = np.repeat(speeds, 2)
    return amplitude_record(lambda t: np.interp(t, ends, at), ends[-1], seed, **more)


def trajectories(seed: int, noise: float = 2e-5, roughness: float = 0.0) -> list[Record]:
    """Thirty free trajectories of 30 s at eight speeds, from 50 to 800 um."""
    rng = np.random.default_rng(seed)
    speeds = np.linspace(6.2, 9.0, 8)
    return [
        amplitude_record(
            speeds[i % 8],
            30.0,
            1000 * seed + i,
            start=float(np.exp(rng.uniform(math.log(5e-5), math.log(8e-4)))),
            noise=noise,
            roughness=roughness,
        )
        for i in range(30)
    ]


def rig_settings(roughness: float = 3e-5) -> SimulationSettings:
    """The default rig with roughness, random forcing and sensor noise."""
    lines = (roughness,) if roughness else ()
    return made.rig_settings(200.0, roughness=lines, drive=DriveModel(speed_noise=0.01))


def staircase(seed: int) -> Record:
    """One staircase of the full model up and down, 0.2 m/s steps, 25 s holds."""
    profile = made.up_and_down(np.arange(6.0, 8.9, 0.2), 25.0)
    return simulate(paper_rig(), rig_settings(), profile, seed=seed)


def sweep(seed: int) -> Record:
    """A continuous sweep of the full model with bumps inside the basin on the way up."""
    profile = Profile(
        (Corners((0.0, 10.0, 250.0, 275.0, 515.0, 530.0), (6.0, 6.0, 8.8, 8.8, 6.0, 6.0)),)
    )
    kicks = [Kick(60.0, lateral_m=1e-4), Kick(120.0, lateral_m=1e-4), Kick(160.0, lateral_m=8e-5)]
    return simulate(paper_rig(), rig_settings(2e-5), profile, kicks=kicks, seed=seed)
