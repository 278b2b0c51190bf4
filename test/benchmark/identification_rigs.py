"""Identification of other rigs and records than the paper's staircase: each beside its truth."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import cache

import numpy as np
from bench_forecast import other_rig
from made import FLUTTER, flutter_runs, up_and_down, without
from records_made import amplitude_record, rig_settings
from tables import mapped, markdown

from hunt_ros.dynamics.limit_cycle import limit_cycles
from hunt_ros.dynamics.linear_stability import critical_speed
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.parameters import RigParameters, paper_rig
from hunt_ros.dynamics.profile import Corners, Hold, Profile
from hunt_ros.dynamics.simulation import simulate
from hunt_ros.errors import HuntError
from hunt_ros.identification import Identification, IdentificationSettings, identify
from hunt_ros.samples import Record, Uncertain

#: Where the unstable amplitude is compared, as a share of the hysteresis region above v_n.
_SHARES = (0.3, 0.6)


#: v_c and v_n, m/s, and the unstable amplitude, m, at speeds between them.
Truth = tuple[float, float | None, Mapping[float, float]]


def between(v_n: float, v_c: float) -> list[float]:
    """Return speeds inside the hysteresis region, m/s."""
    return [v_n + share * (v_c - v_n) for share in _SHARES]


def truth_of_rig(rig: RigParameters) -> Truth:
    """Return that of the full model without noise."""
    v_c, branch = critical_speed(rig), limit_cycles(rig)
    v_n = branch.nonlinear_critical_speed
    if v_n is None:
        return v_c, None, {}
    unstable = {}
    for speed in between(v_n, v_c):
        at = branch.at_speed(speed)
        unstable[speed] = float(at.amplitude[~at.stable][0])
    return v_c, v_n, unstable


def truth_of_form(form: NormalForm) -> Truth:
    """Return that of the amplitude equation."""
    v_n = form.nonlinear_critical_speed
    assert v_n is not None
    speeds = between(v_n, form.critical_speed)
    amplitudes = form.unstable_amplitude(speeds)
    return form.critical_speed, v_n, dict(zip(speeds, map(float, amplitudes), strict=True))


def steps(rig: RigParameters, seed: int, low: float, high: float, rise: float) -> Record:
    """Staircase of 25 s a step up and down; roughness and noise grow with the rig."""
    size = rig.half_gauge_m / paper_rig().half_gauge_m
    settings = rig_settings(3e-5 * size)
    sensor = replace(settings.lateral_sensor, noise=5e-6 * size)
    profile = up_and_down(np.arange(low, high + 0.5 * rise, rise), 25.0)
    return simulate(rig, replace(settings, lateral_sensor=sensor), profile, seed=seed)


def seldom_hunting(seed: int) -> Record:
    """Twenty minutes of holds below v_c, and half a minute of hunting at the end."""
    holds = [Hold(float(v), 115.0) for v in np.arange(6.0, 7.81, 0.2)]
    hunts = Corners((0.0, 8.0, 22.0, 34.0, 44.0), (7.8, 8.8, 8.8, 6.2, 6.2))
    profile = Profile((*holds, hunts))
    return simulate(paper_rig(), rig_settings(), profile, seed=seed)


def strongly_subcritical(seed: int, by: float) -> list[Record]:
    """Return free trajectories of the paper's form with D4 and D15 `by` times as large."""
    form = stronger(by)
    rng = np.random.default_rng(seed)
    v_n = form.nonlinear_critical_speed
    assert v_n is not None
    speeds = np.linspace(0.97 * v_n, 9.0, 8)
    starts = np.exp(rng.uniform(math.log(5e-5), math.log(8e-4), 30))
    return [
        amplitude_record(speeds[i % 8], 30.0, 1000 * seed + i, form=form, start=float(start))
        for i, start in enumerate(starts)
    ]


def stronger(by: float) -> NormalForm:
    """Return the paper's form with D4 and D15 `by` times as large."""
    return replace(PAPER_NORMAL_FORM, D4=by * PAPER_NORMAL_FORM.D4, D15=by * PAPER_NORMAL_FORM.D15)


#: The limit cycle of the full model is 0.6 to 0.7 mm large.
NARROW = replace(paper_rig(), flange_clearance_m=0.6e-3)
SOFT = replace(paper_rig(), name='supercritical', beta={'30': -446.87, '50': -2.74748e6})
_PAPER = cache(lambda: truth_of_rig(paper_rig()))
_STAIRS = (6.0, 8.8, 0.2)

#: Rigs and ways of recording, tried with several seeds: name, from a seed to the recordings, what
#: is true of the rig, and what the user tells.
CASES: tuple[tuple[str, Callable[[int], object], Callable[[], Truth], dict[str, float]], ...] = (
    (
        'staircase at 200 Hz, lateral and speed only',
        lambda seed: without(steps(paper_rig(), seed, *_STAIRS), 'roller', 'yaw'),
        _PAPER,
        {},
    ),
    (
        'rig of 14 m/s and 2 Hz',
        lambda seed: steps(other_rig(), seed, 10.5, 15.4, 0.35),
        cache(lambda: truth_of_rig(other_rig())),
        {},
    ),
    *(
        (
            f'trajectories, D4 and D15 {by:.0f} times as large',
            lambda seed, by=by: strongly_subcritical(seed, by),
            lambda by=by: truth_of_form(stronger(by)),
            {},
        )
        for by in (3.0, 4.0)
    ),
    ('a rig that hunts 2 % of its time', seldom_hunting, _PAPER, {}),
    *(
        (
            f'flange at 0.6 mm, {"told" if told else "not told"}',
            lambda seed: steps(NARROW, seed, *_STAIRS),
            _PAPER,
            told,
        )
        for told in ({}, {'flange_clearance_m': 0.6e-3})
    ),
    (
        'supercritical rig',
        lambda seed: steps(SOFT, seed, *_STAIRS),
        cache(lambda: truth_of_rig(SOFT)),
        {},
    ),
)


def one(task: tuple[int, int]) -> Identification | str:
    """Identify the recordings of a seed; return what is found, or the refusal."""
    number, seed = task
    _, records, _, told = CASES[number]
    try:
        found = identify(records(seed), IdentificationSettings(seed=seed, **told))
    except HuntError as refused:
        return str(refused)
    return replace(found, records=(), envelopes=(), segments=())


def inside(found: Identification, unstable: Mapping[float, float]) -> list[bool]:
    """Return whether each true unstable amplitude of which a band is given lies in it."""
    if not unstable:
        return []
    _, low, high = found.branch('unstable', list(unstable))
    bands = zip(unstable.values(), low, high, strict=True)
    return [bool(a <= truth <= b) for truth, a, b in bands if math.isfinite(a)]


def why_no_fold(found: Identification) -> str:
    """Return why v_n is not known, or ''."""
    return '' if found.v_n else found.unknown.get('v_n', '')


def accuracy(numbers: Sequence[Uncertain | None], truth: float | None) -> list[str]:
    """Return how many were given, their bias and rms, and how many intervals hold."""
    known = [number for number in numbers if number is not None]
    if truth is None or not known:
        return [f'{len(known)}', '', '']
    error = np.array([number.value for number in known]) - truth
    held = sum(number.low <= truth <= number.high for number in known)
    return [
        f'{len(known)}',
        f'{error.mean():+.3f}, {np.sqrt(np.mean(error**2)):.3f}',
        f'{held} of {len(known)}',
    ]


def others(count: int, pool: Executor) -> str:
    """Return the table of the cases, `count` seeds each."""
    rows = []
    for number, (name, _, truth_of, _) in enumerate(CASES):
        found = mapped(pool, name, one, [(number, seed) for seed in range(count)])
        v_c, v_n, unstable = truth_of()
        results = [each for each in found if isinstance(each, Identification)]
        held = [each for result in results for each in inside(result, unstable)]
        kinds = Counter(getattr(each, 'criticality', None) or 'not known' for each in found)
        said = [', '.join(f'{kind} {n}' for kind, n in kinds.most_common())]
        if flange := sum(
            'flange' in (each if isinstance(each, str) else ' '.join(each.warnings))
            for each in found
        ):
            said.append(f'flange named {flange}')
        if misfit := sum(result.fit.lack_of_fit for result in results):
            said.append(f'lack of fit {misfit}')
        whys = [each if isinstance(each, str) else why_no_fold(each) for each in found]
        reasons = Counter(why for why in whys if why)
        most = reasons.most_common(2)
        said += [f'"{why}" {n}' for why, n in most]
        if other := sum(reasons.values()) - sum(n for _, n in most):
            said.append(f'other reasons {other}')
        rows.append(
            [
                name,
                f'{v_c:.3f}',
                *accuracy([getattr(each, 'v_c', None) for each in found], v_c),
                '-' if v_n is None else f'{v_n:.3f}',
                *accuracy([getattr(each, 'v_n', None) for each in found], v_n),
                f'{sum(held)} of {len(held)}' if held else '',
                '; '.join(said),
            ]
        )
    header = ['', 'v_c', 'given', 'bias, rms', 'holds']
    header += ['v_n', 'given', 'bias, rms', 'holds', 'A_u in its band', 'said']
    return (
        f'Other rigs and records, {count} seeds each (m/s); truth: the branches of the model'
        ' without noise and flange. The unstable amplitude is compared at 30 and 60 % of the'
        ' way from v_n to v_c.\n\n' + markdown(header, rows)
    )


def flutter() -> str:
    """Return what the real recordings of a flutter rig give, each day and all."""
    if not FLUTTER.is_dir():
        return 'The recordings of the flutter rig are not on this machine.'
    runs = flutter_runs('*.mat')
    settings = IdentificationSettings(length_scale_m=0.1)
    rows = []
    days = sorted({run.notes['day'] for run in runs})
    for name, some in [
        *((day, [run for run in runs if run.notes['day'] == day]) for day in days),
        ('all', runs),
    ]:
        rows.append([name, len(some), *_of_flutter(identify(some, settings))])
    header = ['day', 'recordings', 'v_c (m/s)', 'v_n (m/s)', 'criticality', 'lack of fit, p']
    header += ['v_c seen above (m/s)']
    return (
        'Flutter rig (real recordings; no truth is known: free motion decayed up to 23.7 m/s and'
        ' grew from 25.9 m/s on, between them with the day):\n\n' + markdown(header, rows)
    )


def _of_flutter(found: Identification) -> list[str]:
    """Return the cells of a day."""
    p = found.fit.lack_of_fit_p
    above = found.bracket.v_c
    return [
        *('not known' if x is None else str(x) for x in (found.v_c, found.v_n)),
        found.criticality or 'not known',
        f'{"yes" if found.fit.lack_of_fit else "no"}, {p:.2g}' if math.isfinite(p) else '-',
        '-' if above is None else f'{above:.1f}',
    ]
