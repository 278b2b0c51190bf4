"""Signals whose every component is known: what the estimators are tested on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass
class Signal:
    """Samples of the sensors on shared stamps, and the hunting phasor in them."""

    stamps: np.ndarray
    lateral: np.ndarray
    yaw: np.ndarray
    acceleration: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    phasor: np.ndarray
    ratio: complex

    def track(self, tracker, sensors=(0, 1, 2), until=None, rate_hz=100):
        """Run a tracker over all of it; return the rows and the true phasor at them."""
        n, count = self.stamps.size, len(tracker.config.sensors)
        values = np.stack([self.lateral, self.yaw, self.acceleration][:count], axis=1)
        for k in range(count):
            if k not in sensors:
                values[:, k] = np.nan
        step = 1_000_000_000 // rate_hz
        outputs = np.arange(step, int(self.stamps[-1]) + 1, step)
        rows = tracker.update(
            np.repeat(self.stamps, count),
            np.tile(np.arange(count, dtype=np.int8), n),
            values.ravel(),
            np.repeat(self.angle, count),
            np.repeat(self.speed, count),
            outputs,
        )
        last = np.searchsorted(self.stamps, outputs, side='right') - 1
        return rows, self.phasor[last]


def hunting_signal(
    seed=0,
    duration=10.0,
    rate=1000.0,
    frequency=2.84,
    amplitude=2e-4,
    growth=0.0,
    noise=2e-5,
    roughness=1e-4,
    kick_at=None,
    kick=0.0,
    second=0.0,
    second_pole=-9.4 + 20.7j,
    forcing=0.0,
    speed=7.2,
    ratio=-3.94 + 2.37j,
    stamps=None,
    acceleration_noise=5e-3,
    acceleration_scale=1.0,
) -> Signal:
    """
    y = Re z + Re w + roughness + bias + noise.

    z has `amplitude` from the start and gets `kick` more at `kick_at`, from where on it grows;
    w, the second mode of the eigenvalue `second_pole`, gets `second` then. `forcing` is the
    variance rate of white forcing.
    """
    rng = np.random.default_rng(seed)
    if stamps is None:
        stamps = ((np.arange(int(duration * rate)) + 1) * (1e9 / rate)).round().astype(np.int64)
    t = stamps * 1e-9
    start = 0.0 if kick_at is None else kick_at
    after = t >= start
    turn = np.exp(2j * np.pi * frequency * t)
    age = np.where(after, t - start, 0.0)
    jump = kick * np.exp(2j * np.pi * rng.random())
    first = amplitude * np.exp(2j * np.pi * rng.random())
    phasor = (first + np.where(after, jump, 0.0)) * np.exp(growth * age) * turn
    if forcing:
        steps = np.diff(t, prepend=0.0)
        shocks = (rng.normal(size=t.size) + 1j * rng.normal(size=t.size)) * np.sqrt(
            forcing * steps
        )
        phasor = phasor + np.cumsum(shocks / turn) * turn
    decaying = np.where(after, np.exp(second_pole * age), 0.0)
    other = second * decaying * np.exp(2j * np.pi * rng.random())
    other_yaw = second * decaying * np.exp(2j * np.pi * rng.random())
    theta = speed / 0.15 * t
    yaw_noise = 5.0 * noise
    lateral = phasor.real + other.real + 1e-5 + noise * rng.normal(size=t.size)
    lateral = lateral + roughness * (np.cos(theta + 0.3) + 0.3 * np.cos(2 * theta))
    yaw = (ratio * phasor).real + 5.0 * other_yaw.real + 2e-4 + yaw_noise * rng.normal(size=t.size)
    yaw = yaw + 3.0 * roughness * np.cos(theta + 1.3)
    # The second derivative of both modes in place of the displacement, with lines of its own.
    pole, fast = growth * after + 2j * np.pi * frequency, second_pole
    acceleration = (pole**2 * phasor).real + (fast**2 * other).real + 0.2 * np.sin(theta)
    acceleration = acceleration_scale * acceleration + 0.1
    acceleration += acceleration_noise * np.random.default_rng([seed, 2]).normal(size=t.size)
    speeds = np.full(t.size, speed)
    return Signal(stamps, lateral, yaw, acceleration, theta, speeds, phasor, ratio)
