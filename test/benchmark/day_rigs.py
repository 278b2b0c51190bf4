"""
Random rigs and days: any rig by its normal form under noise, and what it really does.

A second simulator, of another make than `hunt_ros.dynamics`: the phasor of the hunting obeys
z' = (s(v, |z|) + i omega) z + lines + noise, with s of a fold or without one. A day is a rig, a
speed over time, blows, sensors and what happens to them; all follow from one seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import DetectorConfig
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.samples import Record, Series

_F = NDArray[np.float64]

KINDS = (
    'run-up below v_n',
    'run-up and coast-down',
    'rest, then at speed',
    'kicks',
    'quiet',
    'starts in the cycle',
    'staircase',
    'just below v_n, kicked',
)
#: More of them, for a day beside that of a seed.
TURNS = ('stops and goes on', 'reverses')
FAULTS = ('lateral dead', 'lateral noise', 'lateral gain', 'yaw dead', 'swapped', 'gaps')


@dataclass(frozen=True)
class RandomRig:
    """
    A rig: s = g (eps + e (2 x - x^2)) with a fold at eps = -e, or g (eps - x / 10), x = (A / a)^2.

    `lines` are displacements at 0.9 v_c in parts of `scale`, and `quiet` the quiet amplitude.
    """

    hz: float
    v_c: float
    pace: float
    fold: float
    scale: float
    quiet: float
    lines: tuple[float, ...]
    roller_m: float
    ratio: complex

    @property
    def diffusion(self) -> float:
        """Noise intensity, m^2/s: <|z|^2> = 2 D / s where s = g / 10."""
        return 0.05 * self.pace * (self.quiet * self.scale) ** 2

    def form(self) -> NormalForm:
        """The same as a normal form; its unit of length makes r^2 = x."""
        quintic = self.pace * self.fold
        return NormalForm(
            critical_speed=self.v_c,
            D1=self.pace,
            D4=2.0 * quintic if self.fold else -0.1 * self.pace,
            D7=0.0,
            D10=0.0,
            D15=-quintic,
            length_scale=0.5 * self.scale,
            time_scale=1.0,
            frequency_hz=self.hz,
        )

    def branches(self, v: _F) -> tuple[_F, _F]:
        """Unstable and stable amplitude, m, by speed; NaN where there is none."""
        eps = v / self.v_c - 1.0
        with np.errstate(invalid='ignore'):
            if not self.fold:
                return np.full(v.size, math.nan), self.scale * np.sqrt(10.0 * eps)
            root = np.sqrt(1.0 + eps / self.fold)
            unstable = np.where(eps < 0.0, self.scale * np.sqrt(1.0 - root), math.nan)
            return unstable, self.scale * np.sqrt(1.0 + root)


@dataclass(frozen=True)
class Day:
    """A day: what the sensors read, what the detector is told, and what really happened."""

    seed: int
    kind: str
    fault: str
    rig: RandomRig
    record: Record
    config: DetectorConfig
    form: IdentifiedNormalForm | None
    t: _F
    speed: _F
    amplitude: _F
    fault_s: float = math.inf

    @property
    def title(self) -> str:
        """The day in a few words."""
        rig = self.rig
        law = f'fold {rig.fold:.2f}' if rig.fold else 'no fold'
        lines = '+'.join(f'{line:.2f}' for line in rig.lines) or 'no lines'
        told = 'form' if self.form else 'no form'
        return (
            f'{self.seed}: {self.kind}, {self.fault or "sound"}, {told}, {rig.hz:.2f} Hz, {law},'
            f' quiet {rig.quiet:.3f}, {lines}'
        )


def random_rig(rng: np.random.Generator) -> RandomRig:
    """Return a rig: railway wheelsets, models and wings."""
    hz = math.exp(rng.uniform(math.log(0.6), math.log(8.0)))
    v_c = rng.uniform(5.0, 40.0)
    turns = hz * rng.uniform(1.3, 4.0)
    lines = tuple(rng.uniform(0.01, 0.12, rng.integers(0, 3)))
    return RandomRig(
        hz,
        v_c,
        1.8 * hz * rng.uniform(0.5, 2.0),
        rng.uniform(0.04, 0.25) if rng.random() < 0.75 else 0.0,
        math.exp(rng.uniform(math.log(2e-4), math.log(2e-2))),
        math.exp(rng.uniform(math.log(0.005), math.log(0.06))),
        lines,
        min(v_c / (math.pi * turns), 10.0),  # no rig file takes a larger roller
        rng.uniform(2.0, 8.0) * np.exp(1j * rng.uniform(0.8, 2.2)),
    )


def random_day(seed: int, kind: str = '') -> Day:
    """Return the day of a seed; of a kind that is named, of the same rig."""
    rng = np.random.default_rng([25, seed])
    rig = random_rig(rng)
    kind = kind or KINDS[seed % len(KINDS)]
    if not rig.fold and kind in ('kicks', 'starts in the cycle', 'just below v_n, kicked'):
        kind = 'staircase'
    fault = str(rng.choice(FAULTS)) if rng.random() < 0.25 else ''
    period = 1.0 / rig.hz
    rate = rig.hz * rng.uniform(40.0, 160.0)
    corners, kicks, begin = _plan(kind, rig, rng)
    t = np.arange(0.0, corners[-1][0] * period, 1.0 / rate)
    speed = np.interp(t / period, *zip(*corners, strict=True))
    angle = np.cumsum(speed) / rate * 2.0 / rig.roller_m
    z = _path(rig, t, np.abs(speed), kicks, begin, rng)
    amplitude = np.abs(z)
    turning = z * np.exp(2j * np.pi * rig.hz * t)
    third = 0.03 * (amplitude / rig.scale) ** 2 * (turning**3 / np.fmax(amplitude, 1e-12) ** 2)
    noise = rig.quiet * rig.scale * rng.uniform(0.1, 1.0)
    step = noise * rng.uniform(1.0, 5.0) if rng.random() < 0.2 else 0.0
    y = (turning + third).real + noise * rng.normal(size=t.size)
    psi = (rig.ratio * turning).real + abs(rig.ratio) * noise * rng.normal(size=t.size)
    if step:
        y = np.round(y / step) * step
    fault_s = rng.uniform(0.1, 0.6) * t[-1] if fault else math.inf
    y, psi = _broken(fault, y, psi, t >= fault_s, noise, rng)
    stamps = np.round(t * 1e9).astype(np.int64)
    slow = slice(None, None, max(1, int(rate / 50.0)))
    record = Record(
        {
            'lateral': Series(stamps, y),
            'yaw': Series(stamps, psi),
            'roller': Series(stamps[slow], angle[slow]),
            'speed': Series(stamps[slow], speed[slow]),
        }
    )
    config = DetectorConfig(
        hunting_frequency_hz=rig.hz * rng.uniform(0.85, 1.15),
        roller_diameter_m=rig.roller_m,
        sensor_timeout_s=max(0.3, 20.0 / rate),
    )
    form = None
    if rng.random() < 0.5:
        spread = np.array([0.02, 0.02, 0.02, 0.05, 0.05, 0.02])
        true = rig.form()
        size = np.array([0.2 * rig.v_c, true.D1, true.D4, true.D1, true.D4, true.D15])
        form = IdentifiedNormalForm(true, np.diag((spread * size) ** 2))
    keep = slice(None, None, max(1, int(rate / (20.0 * rig.hz))))
    return Day(
        seed, kind, fault, rig, record, config, form,
        t[keep], np.abs(speed[keep]), amplitude[keep], fault_s,
    )  # fmt: skip


def _plan(
    kind: str, rig: RandomRig, rng: np.random.Generator
) -> tuple[list[tuple[float, float]], list[tuple[float, float]], float]:
    """Return corners of the speed (periods, m/s), kicks (periods, m), and the first amplitude."""
    v_c, v_n = rig.v_c, rig.v_c * (1.0 - rig.fold)
    ramp = rng.uniform(40.0, 200.0)
    between = v_n + rng.uniform(0.25, 0.75) * (v_c - v_n)
    begin = rig.quiet * rig.scale
    if kind == 'run-up below v_n':
        low, top = rng.uniform(0.05, 0.2) * v_c, rng.uniform(0.85, 0.97) * v_n
        return [(0.0, low), (20.0, low), (20.0 + ramp, top), (200.0 + ramp, top)], [], begin
    if kind == 'run-up and coast-down':
        top, low = rng.uniform(1.03, 1.12) * v_c, 0.3 * v_c
        corners = [(0.0, low), (40.0, low), (40.0 + ramp, top), (250.0 + ramp, top)]
        return [*corners, (250.0 + 2.0 * ramp, low), (300.0 + 2.0 * ramp, low)], [], begin
    if kind == 'rest, then at speed':
        top = rng.uniform(0.8, 0.96) * v_n
        return [(0.0, 0.0), (90.0, 0.0), (90.0 + ramp, top), (400.0 + ramp, top)], [], 0.1 * begin
    if kind == 'starts in the cycle':
        v = between if rng.random() < 0.6 else rng.uniform(1.02, 1.1) * v_c
        top = float(rig.branches(np.array([v]))[1][0])
        corners = [(0.0, v), (250.0, v), (250.0 + ramp, 0.7 * v_n), (330.0 + ramp, 0.7 * v_n)]
        return corners, [], top
    if kind == 'staircase':
        speeds = np.linspace(0.75 * v_n, rng.uniform(1.04, 1.1) * v_c, 6)
        corners = []
        for number, v in enumerate(speeds):
            corners += [(90.0 * number, float(v)), (90.0 * number + 70.0, float(v))]
        return corners, [], begin
    if kind in TURNS:
        fast = rng.uniform(1.03, 1.1) * v_c
        again = fast if kind == TURNS[0] else -fast
        way = [(0.0, 0.7 * v_n), (40.0, 0.7 * v_n), (40.0 + ramp, fast), (240.0 + ramp, fast)]
        way += [(240.0 + 2.0 * ramp, 0.0), (300.0 + 2.0 * ramp, 0.0)]
        return [*way, (300.0 + 3.0 * ramp, again), (500.0 + 3.0 * ramp, again)], [], begin
    if kind == 'quiet':
        return [(0.0, between), (500.0, between)], [], begin
    if kind == 'kicks':
        edge = float(rig.branches(np.array([between]))[0][0])
        sizes = edge * np.concatenate([rng.uniform(0.2, 0.7, 3), rng.uniform(1.3, 1.8, 1)])
        return [(0.0, between), (480.0, between)], _at(sizes, 60.0, 90.0), begin
    v = rng.uniform(0.975, 0.99) * v_n
    sizes = rig.scale * rng.uniform(0.5, 1.3, 4)
    return [(0.0, v), (500.0, v)], _at(sizes, 60.0, 110.0), begin


def _at(sizes: _F, first: float, apart: float) -> list[tuple[float, float]]:
    return [(first + apart * number, float(size)) for number, size in enumerate(sizes)]


def _path(
    rig: RandomRig,
    t: _F,
    speed: _F,
    kicks: list[tuple[float, float]],
    begin: float,
    rng: np.random.Generator,
) -> NDArray[np.complex128]:
    """Integrate the phasor, in the frame that turns with the hunting frequency."""
    step = t[1] - t[0]
    angle = np.cumsum(speed) * step * 2.0 / rig.roller_m
    # Standing still the wheelset is stuck: what moves it grows with the speed.
    driven = np.sqrt(2.0 * rig.diffusion * step) * np.minimum(speed / (0.5 * rig.v_c), 1.0)
    shocks = driven * (rng.normal(size=(t.size, 2)) @ np.array([1.0, 1j]))
    for order, line in enumerate(rig.lines, start=1):
        at_speed = order * 0.9 * rig.v_c / (math.pi * rig.roller_m)
        away = 2.0 * math.pi * abs(at_speed - rig.hz)
        push = line * rig.scale * math.hypot(away, 0.1 * rig.pace)
        shocks += push * step * np.exp(1j * (order * angle - 2.0 * math.pi * rig.hz * t))
    for periods, size in kicks:
        place = min(int(np.searchsorted(t, periods / rig.hz)), t.size - 1)
        shocks[place] += size * np.exp(2j * np.pi * rng.random())
    z, path = complex(begin), np.empty(t.size, dtype=np.complex128)
    excess = speed / rig.v_c - 1.0
    for k, (eps, shock) in enumerate(zip(excess.tolist(), shocks.tolist(), strict=True)):
        x = (z.real * z.real + z.imag * z.imag) / rig.scale**2
        nonlinear = rig.fold * (2.0 * x - x * x) if rig.fold else -0.1 * x
        z = z * math.exp(rig.pace * (eps + nonlinear) * step) + shock
        path[k] = z
    return path


def _broken(
    fault: str, y: _F, psi: _F, since: NDArray[np.bool_], noise: float, rng: np.random.Generator
) -> tuple[_F, _F]:
    """Return the readings with what happens to the sensors."""
    if fault == 'lateral dead':
        return np.where(since, 0.0, y), psi
    if fault == 'lateral noise':
        return np.where(since, noise * rng.normal(size=y.size), y), psi
    if fault == 'lateral gain':
        return np.where(since, rng.choice([0.3, 0.5, 2.0]) * y, y), psi
    if fault == 'yaw dead':
        return y, np.where(since, math.nan, psi)
    if fault == 'swapped':
        return np.where(since, psi, y), np.where(since, y, psi)
    if fault == 'gaps':
        holes = np.convolve(rng.random(y.size) < 3e-4, np.ones(40), mode='same') > 0
        return np.where(holes & since, math.nan, y), np.where(holes & since, math.nan, psi)
    return y, psi
