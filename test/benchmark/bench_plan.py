"""
What to measure next: `hunt plan` with the identification in the loop, against the staircase.

The simulated rig is the full model. A first sweep, then again and again: identify all that was
recorded, plan the next stretch, run it with its triggers. Beside it the paper's staircase, 0.2 m/s
and 25 s a step, identified after the same times and at its end, and the profiles that react to the
motion, at their ends.
"""

from __future__ import annotations

import math
import sys
import warnings
from argparse import Namespace
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
from detection_rigs import BENCHES
from records_made import rig_settings
from tables import mapped, markdown, run

from hunt_ros.dynamics.parameters import RigParameters, paper_rig
from hunt_ros.dynamics.profile import Motion, Profile
from hunt_ros.dynamics.profile.run import ProfileRun
from hunt_ros.dynamics.simulation import RollerRig, SimulatedBlock, simulate
from hunt_ros.dynamics.simulation.experiment import record_of
from hunt_ros.errors import HuntError
from hunt_ros.identification import Identification, identify
from hunt_ros.identification.plan import PlanSettings, plan
from hunt_ros.samples import Record

#: Where the unstable amplitude is compared, m/s.
AT = (7.0, 7.6)
NAMES = ('v_n (m/s)', 'v_c (m/s)', *(f'A_u({v:g}) (um)' for v in AT))
#: Times at which both ways are compared, s; the staircase ends at 725 s + ramps.
TIMES = (150.0, 250.0, 370.0)
FIRST = 'profile:\n- sweep: {low_mps: 6.0, high_mps: 8.8, rate_mps2: 0.1}\n'
STAIRCASE = 'profile:\n- staircase: {low_mps: 6.0, high_mps: 8.8}\n'
SEESAW = 'profile: [{seesaw: {duration_s: 240}}]'
#: Length of a stretch that is planned at once, s, and of the blocks in which the rig is run.
STRETCH_S, BLOCK_S = 80.0, 0.1


@dataclass
class Bench:
    """The simulated rig with a drive that runs profiles, and what it has recorded."""

    rig: RigParameters
    seed: int
    blocks: list[SimulatedBlock] = field(default_factory=list)
    speed: float = 6.0
    time: float = 0.0
    amplitude: float = 0.0

    def __post_init__(self) -> None:
        self.settings = rig_settings()
        self.stream = RollerRig(self.rig, self.settings, self.seed)
        self.count = round(BLOCK_S * self.settings.sample_rate_hz)
        period = round(self.settings.sample_rate_hz / 2.835)
        turn = 2.0 * np.pi * np.arange(period) / period
        self.basis = np.stack([np.cos(turn), np.sin(turn)]) * 2.0 / period

    def run(self, profile: Profile, until_s: float = math.inf) -> Iterator[float]:
        """Run a profile to its end or a time, s; yield the time after each block."""
        run = ProfileRun(profile, self.speed)
        while not run.finished and self.time < until_s:
            before = self.speed
            self.speed = run.advance(BLOCK_S, Motion(amplitude_m=self.amplitude))
            targets = np.linspace(before, self.speed, self.count + 1)[1:]
            self.blocks.append(self.stream.advance(self.count, targets))
            self.time += BLOCK_S
            self._look()
            yield self.time

    def _look(self) -> None:
        """Take the amplitude of the last period of the hunting."""
        samples = np.concatenate([block.lateral for block in self.blocks[-5:]])
        period = self.basis.shape[1]
        if samples.size < period:
            return
        last = samples[-period:]
        self.amplitude = float(np.hypot(*(self.basis @ (last - last.mean()))))

    def record(self) -> Record:
        """Return all that was recorded."""
        return record_of(self.blocks, self.settings, f'seed {self.seed}')


def numbers(known: Identification | None) -> np.ndarray:
    """Value and deviation of each quantity, shape (4, 2); NaN for what is not known."""
    found = np.full((len(NAMES), 2), np.nan)
    if known is None:
        return found
    for row, one in zip(found, (known.v_n, known.v_c), strict=False):
        if one is not None:
            row[:] = one.value, one.std
    value, low, high = known.branch('unstable', AT)
    found[2:, 0], found[2:, 1] = 1e6 * value, 1e6 * (high - low) / (2.0 * 1.96)
    return found


def identified(record: Record) -> Identification | None:
    """Identify a recording; None where it is refused."""
    try:
        return identify(record)
    except HuntError:
        return None


def staircase(task: tuple[int, RigParameters]) -> list[np.ndarray]:
    """Run the staircase; numbers at the times and at its end."""
    seed, rig = task
    bench, found = Bench(rig, seed), []
    due = list(TIMES)
    for time in bench.run(Profile.from_yaml(STAIRCASE)):
        if due and time >= due[0] - 1e-6:
            found.append(numbers(identified(bench.record())))
            due.pop(0)
    return [*found, numbers(identified(bench.record()))]


def reacting(task: tuple[int, RigParameters]) -> tuple[float, np.ndarray]:
    """Run the profile that reacts; how long it took, s, and the numbers at its end."""
    seed, rig = task
    record = simulate(rig, rig_settings(), Profile.from_yaml(SEESAW), seed=seed)
    return record.duration_s, numbers(identified(record))


def planned(task: tuple[int, RigParameters]) -> list[np.ndarray]:
    """Run the loop of planning and measuring; numbers at the times."""
    seed, rig = task
    bench, found = Bench(rig, seed), []
    for _ in bench.run(Profile.from_yaml(FIRST)):
        pass
    for due in TIMES:
        while bench.time < due - 5.0:
            known = identified(bench.record())
            profile = Profile.from_yaml(FIRST)
            if known is not None:
                settings = PlanSettings(
                    budget_s=STRETCH_S,
                    speed_ceiling_mps=8.8,
                    speeds_mps=AT,
                    start_speed_mps=bench.speed,
                    start_amplitude_m=bench.amplitude,
                    seed=seed,
                )
                try:
                    profile = plan(known, settings).profile
                except HuntError as error:
                    print(f'seed {seed} at {bench.time:.0f} s: {error}', file=sys.stderr)
            # The way home is for the end only.
            steps = profile.steps[:-1] if len(profile.steps) > 1 else profile.steps
            for _ in bench.run(Profile(steps), due):
                pass
        found.append(numbers(identified(bench.record())))
    return found


def row(label: str, found: list[np.ndarray], true: np.ndarray) -> list[object]:
    """Rms error / rms of the stated deviation, and how many are within two deviations."""
    rows = np.array(found)
    cells: list[object] = [label, f'{int(np.isfinite(rows[:, 0, 0]).sum())} of {len(rows)}']
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        for k, value in enumerate(true):
            error, std = rows[:, k, 0] - value, rows[:, k, 1]
            known = np.isfinite(error)
            within = int((np.abs(error[known]) <= 2.0 * std[known]).sum())
            cells.append(
                f'{np.sqrt(np.nanmean(error**2)):.2g} / {np.sqrt(np.nanmean(std**2)):.2g}'
                f' ({within}/{int(known.sum())})'
            )
    return cells


def measured(arguments: Namespace, pool: Executor) -> str:
    """Return the table."""
    count = arguments.seeds
    tasks = [(seed, paper_rig()) for seed in range(count)]
    ways = {
        name: mapped(pool, name, work, tasks)
        for name, work in (('planned', planned), ('staircase', staircase))
    }
    reacted = mapped(pool, 'see-saw', reacting, tasks)
    bench = BENCHES['paper']
    unstable = [1e6 * bench.unstable(speed) for speed in AT]
    true = np.array([bench.branch.nonlinear_critical_speed, bench.v_c, *unstable])
    rows = [
        row(f'{name}, {time:.0f} s', [one[k] for one in ways[name]], true)
        for k, time in enumerate(TIMES)
        for name in ('planned', 'staircase')
    ]
    rows.append(row('staircase, whole', [one[-1] for one in ways['staircase']], true))
    lasted_s = np.mean([seconds for seconds, _ in reacted])
    rows.append(row(f'see-saw, {lasted_s:.0f} s', [one for _, one in reacted], true))
    rows.append(['truth', '', *(f'{value:.4g}' for value in true)])
    return (
        'Full model with roughness 30 um, forcing 8e-6, noise 5 um; rms error / rms of the stated'
        f' deviation (within two deviations), {count} seeds. Goal: the accuracy of the whole'
        ' staircase (about 740 s) in a third of its time, A_u better than it ever is, deviations'
        ' honest (19 of 20 within two).\n\n' + markdown(['', 'answers', *NAMES], rows)
    )


if __name__ == '__main__':
    run(__doc__, 'bench-plan', 'What to measure next', measured, seeds=(20, 2))
