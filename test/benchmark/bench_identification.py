"""
Identification: everything that it finds beside its truth.

Staircases of the full model, other rigs and ways of recording, rigs of another
make, an hour at 1 kHz, and how often the intervals hold. Progress goes to stderr.
"""

from __future__ import annotations

import time
from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
from detection_rigs import BENCHES
from identification_rigs import others
from made import up_and_down
from records_made import rig_settings, trajectories
from scipy import stats
from tables import mapped, markdown, run

from hunt_ros.cli import demo
from hunt_ros.dynamics.normal_form import COEFFICIENTS, PAPER_NORMAL_FORM
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.dynamics.simulation import Kick, SimulationSettings, simulate
from hunt_ros.identification import IdentificationSettings, identify
from hunt_ros.nodes import rig_simulator
from hunt_ros.samples import Record, Uncertain

#: Speeds at which the unstable amplitude is compared, m/s.
UNSTABLE_AT = (7.0, 7.6)
#: The full model without roughness.
RIG = BENCHES['paper']
#: Speeds at which both branches of the full model are compared, m/s. The envelope measures the
#: fundamental, as they have it: the peak of y is larger by 0.1 to 0.2 % on the stable branch.
FULL_UNSTABLE_AT, FULL_STABLE_AT = (6.6, 7.2, 7.6), (7.2, 8.0, 8.8)
#: Broadband forcing and roughness (m) of the staircases.
STAIRCASES = ((8e-6, 3e-5), (1.2e-5, 0.0), (3e-5, 3e-5))


def covered(task: tuple[int, bool]) -> tuple[np.ndarray, float]:
    """Whether each 95 % interval of one realisation at 20 um holds the truth; and lack of fit."""
    seed, told = task
    form = PAPER_NORMAL_FORM
    settings = IdentificationSettings(prior_v_c=(8.0, 1e-3) if told else ())
    result = identify(trajectories(seed, 2e-5), settings)
    wanted = [(result.coefficients[name], getattr(form, name)) for name in COEFFICIENTS]
    wanted += [(result.v_n, form.nonlinear_critical_speed), (result.v_c, 8.0)]
    inside = [x is not None and x.low <= truth <= x.high for x, truth in wanted]
    _, low, high = result.branch('unstable', UNSTABLE_AT)
    truth = form.unstable_amplitude(UNSTABLE_AT)
    return np.array([*inside, *(low <= truth) & (truth <= high)]), result.fit.lack_of_fit_p


def stepped(seed: int, broadband: float, roughness: float) -> Record:
    """One staircase of the full model up and down, 0.2 m/s steps, 25 s holds."""
    settings = replace(rig_settings(roughness), broadband=broadband)
    profile = up_and_down(np.arange(6.0, 8.9, 0.2), 25.0)
    return simulate(RIG.rig, settings, profile, seed=seed)


def staircase(task: tuple[int, float, float]) -> list[float]:
    """Errors from one staircase of the full model."""
    result = identify([stepped(*task)], IdentificationSettings(seed=task[0]))
    form = None if result.normal_form is None else result.normal_form.form
    if form is None or result.v_n is None or result.v_c is None:
        return [np.nan] * 7
    truth = np.array([RIG.unstable(speed) for speed in FULL_UNSTABLE_AT])
    stable = np.array([RIG.stable(speed) for speed in FULL_STABLE_AT])
    _, low, high = result.branch('unstable', FULL_UNSTABLE_AT)
    return [
        result.v_n.value - RIG.branch.nonlinear_critical_speed,
        result.v_c.value - RIG.v_c,
        result.v_c.std,
        result.fit.v_c_bound,
        float(np.abs(form.stable_amplitude(FULL_STABLE_AT) / stable - 1.0).max()),
        float(np.abs(form.unstable_amplitude(FULL_UNSTABLE_AT) / truth - 1.0).max()),
        float(np.mean((low <= truth) & (truth <= high))),
    ]


def coverage(count: int, pool: Executor) -> str:
    """Return the table of how often the intervals hold the truth, and of the lack of fit."""
    rows: list[list[object]] = []
    probabilities: list[float] = []
    for told in (False, True):
        inside = np.zeros(len(COEFFICIENTS) + 4, dtype=int)
        tasks = [(seed, told) for seed in range(1000, 1000 + count)]
        for held, p in mapped(pool, 'coverage', covered, tasks):
            inside += held
            if not told and np.isfinite(p):
                probabilities.append(p)
        rows.append(['told' if told else 'not told', *inside])
    header = ['v_c', *COEFFICIENTS, 'v_n', 'v_c', 'A_u 7.0', 'A_u 7.6']
    goal = f'{round(0.91 * count)} to {round(0.985 * count)}'
    return (
        f'95 % intervals that hold the truth, of {count} realisations at 20 um (goal {goal}):\n\n'
        f'{markdown(header, rows)}\n\n{uniform(probabilities)}'
    )


def uniform(probabilities: Sequence[float]) -> str:
    """Return whether the p of the lack of fit is a probability where the law is true."""
    if len(probabilities) < 5:
        return 'p of the lack of fit: too few realisations have one.'
    test = stats.kstest(probabilities, 'uniform')
    below = ', '.join(
        f'{np.mean(np.array(probabilities) < level):.3f} below {level}'
        for level in (0.01, 0.05, 0.5)
    )
    return (
        f'p of the lack of fit of the {len(probabilities)} realisations that have one, their law'
        f' being true: {below}; against the uniform distribution KS p = {test.pvalue:.2g}.'
    )


def full_model(count: int, pool: Executor) -> str:
    """Return the table of staircases of the full model, a column for each forcing."""
    columns = []
    for broadband, roughness in STAIRCASES:
        tasks = [(seed, broadband, roughness) for seed in range(count)]
        found = np.array(mapped(pool, f'broadband {broadband:g}', staircase, tasks))
        known = found[np.isfinite(found[:, 0])]
        v_n, v_c, std, bound, stable, unstable, inside = known.T
        columns.append(
            [
                f'{len(known)} of {count}',
                f'{np.mean(np.abs(v_n) <= 0.05):.0%}',
                f'{np.mean(stable <= 0.02):.0%}',
                f'{np.mean(np.abs(v_c) <= np.maximum(0.1, 2.0 * std)):.0%}',
                f'{np.median(std / bound):.2f}',
                f'{inside.mean():.0%}',
                f'{v_n.mean():+.3f}, {np.sqrt(np.mean(v_n**2)):.3f}',
                f'{v_c.mean():+.3f}, {np.sqrt(np.mean(v_c**2)):.3f}',
                f'{np.median(std):.3f}, {np.median(bound):.3f}',
                f'{np.median(stable):.1%}, {np.median(unstable):.1%}',
            ]
        )
    labels = [
        ('answers', 'all'),
        ('v_n within 0.05 m/s', '90 %'),
        ('stable branch within 2 %', '90 %'),
        ('v_c within 0.1 m/s or two deviations', '90 %'),
        ('reported deviation of v_c over its bound, median', '1.5'),
        ('true unstable branch inside its band', '95 %'),
        ('bias and rms of v_n (m/s)', ''),
        ('bias and rms of v_c (m/s)', ''),
        ('reported deviation of v_c and its bound, medians (m/s)', ''),
        ('median largest error, stable and unstable branch', ''),
    ]
    rows = [
        [label, *(column[k] for column in columns), goal] for k, (label, goal) in enumerate(labels)
    ]
    header = [f'{wn:g}, {1e6 * line:.0f} um' for wn, line in STAIRCASES]
    return (
        f'One staircase of the full model (2), (3): 0.2 m/s steps, 25 s holds, noise 5 um, {count}'
        ' seeds; a column for each broadband forcing and roughness. Truth: the branches of the'
        ' model without roughness. The bound is that of Cramer and Rao under the law that was'
        ' chosen.\n\n' + markdown(['', *header, 'goal'], rows)
    )


def swept(seed: int) -> tuple[list[bool], float]:
    """Of the sweep of `hunt demo`: form, v_c and v_n hold, fits; error of v_c, m/s."""
    profile = Profile((Corners(demo._TIMES_S, demo._SPEEDS_MPS),))
    kicks = [Kick(time_s, lateral_m=size_m) for time_s, size_m in demo._KICKS]
    settings = SimulationSettings(sample_rate_hz=200.0, **rig_simulator._ORDINARY)
    result = identify(simulate(RIG.rig, settings, profile, kicks=kicks, seed=seed))
    wanted = ((result.v_c, RIG.v_c), (result.v_n, RIG.branch.nonlinear_critical_speed))
    held = [number is not None and number.low <= truth <= number.high for number, truth in wanted]
    error = np.nan if result.v_c is None else result.v_c.value - RIG.v_c
    return [result.normal_form is not None, *held, not result.fit.lack_of_fit], error


def sweeps(count: int, pool: Executor) -> str:
    """Return how often the sweep of `hunt demo` gives a form, and how often its intervals hold."""
    found, errors = zip(*mapped(pool, 'demo', swept, range(1, count + 1)), strict=True)
    form, v_c, v_n, fits = np.sum(found, axis=0)
    return (
        f'Of {count} sweeps of `hunt demo`, simulated without the nodes, {form} give a form (goal'
        f' all); 95 % intervals hold v_c in {v_c} and v_n in {v_n}; v_c is off by'
        f' {np.sqrt(np.nanmean(np.square(errors))):.3f} m/s (rms);'
        f' {count - fits} are said not to fit.'
    )


def an_hour(seed: int) -> Record:
    """Three channels at 1 kHz, an hour: 0.1 m/s steps, 62 s holds."""
    profile = up_and_down(np.arange(6.0, 8.9, 0.1), 62.0)
    settings = SimulationSettings(sample_rate_hz=1000.0, broadband=8e-6, drive_rate_hz=1000.0)
    return simulate(RIG.rig, settings, profile, seed=seed)


def of_hour(seed: int) -> tuple[float, dict[str, bool]]:
    """Return CPU seconds of an hour, and which of its intervals hold the truth."""
    record = an_hour(seed)
    begin = time.process_time()
    result = identify([record])
    seconds = time.process_time() - begin
    fold = RIG.branch.nonlinear_critical_speed
    wanted: list[tuple[str, Uncertain | None, float]] = [
        ('v_c', result.v_c, RIG.v_c),
        ('v_n', result.v_n, fold),
        ('v_c - v_n', result.hysteresis_width, RIG.v_c - fold),
    ]
    for side, speeds in (('unstable', FULL_UNSTABLE_AT), ('stable', FULL_STABLE_AT)):
        for speed in speeds:
            point = result.posterior.branches(speed)[side][0] if result.posterior else None
            wanted.append((f'{side} at {speed}', point, getattr(RIG, side)(speed)))
    return seconds, {
        name: number is not None and number.low <= truth <= number.high
        for name, number, truth in wanted
    }


def hours(count: int, pool: Executor) -> str:
    """Return how long an hour of three channels at 1 kHz takes, and how often intervals hold."""
    list(pool.map(warm, range(4)))
    done = mapped(pool, 'hours', of_hour, range(1, count + 1))
    held = Counter(name for _, holds in done for name, one in holds.items() if one)
    median = float(np.median([cpu for cpu, _ in done]))
    return (
        f'An hour of three channels at 1 kHz: {median:.1f} s of CPU in the median (goal 6 s).'
        f' Intervals that hold the truth, of {count} seeds (goal all): '
        + ', '.join(f'{name} {held[name]}' for name in done[0][1])
    )


def warm(seed: int) -> None:
    """Compile before the clock starts."""
    identify([stepped(seed, 8e-6, 0.0)])


def measured(arguments: Namespace, pool: Executor) -> str:
    """Return all tables."""
    count = arguments.seeds
    parts = [full_model(count, pool), others(count, pool), hours(count, pool)]
    parts += [sweeps(5 * count, pool)]
    return '\n\n'.join([*parts, coverage(arguments.coverage, pool)])


if __name__ == '__main__':
    numbers = {'seeds': (20, 1), 'coverage': (200, 2)}
    run(__doc__, 'bench-identification', 'Identification', measured, **numbers)
