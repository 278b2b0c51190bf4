"""Identification of other rigs and records than the paper's staircase: each beside its truth."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
from detection_rigs import BENCHES
from foreign_made import RECORDINGS, RIGS
from made import up_and_down, without
from records_made import rig_settings
from tables import mapped, markdown

from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Hold, Profile
from hunt_ros.dynamics.simulation import simulate
from hunt_ros.errors import HuntError
from hunt_ros.identification import Identification, IdentificationSettings, identify
from hunt_ros.samples import Record, Uncertain

#: Where the unstable amplitude is compared, as a share of the hysteresis region above v_n.
_SHARES = (0.3, 0.6)
#: v_c and v_n, m/s, and the unstable amplitude, m, at speeds between them.
Truth = tuple[float, float | None, Mapping[float, float]]


def truth_of(key: str) -> Truth:
    """Return that of the full model of a rig on the bench, without noise."""
    bench = BENCHES[key]
    v_c, v_n = bench.v_c, bench.branch.nonlinear_critical_speed
    between = [] if v_n is None else [v_n + share * (v_c - v_n) for share in _SHARES]
    return v_c, v_n, {speed: bench.unstable(speed) for speed in between}


def steps(key: str, seed: int, low: float, high: float, rise: float) -> Record:
    """Staircase of 25 s a step up and down; roughness and noise grow with the rig."""
    bench = BENCHES[key]
    settings = rig_settings(3e-5 * bench.scale)
    sensor = replace(settings.lateral_sensor, noise=5e-6 * bench.scale)
    profile = up_and_down(np.arange(low, high + 0.5 * rise, rise), 25.0)
    return simulate(bench.rig, replace(settings, lateral_sensor=sensor), profile, seed=seed)


def seldom_hunting(seed: int) -> Record:
    """Twenty minutes of holds below v_c, and half a minute of hunting at the end."""
    holds = [Hold(float(v), 115.0) for v in np.arange(6.0, 7.81, 0.2)]
    hunts = Corners((0.0, 8.0, 22.0, 34.0, 44.0), (7.8, 8.8, 8.8, 6.2, 6.2))
    profile = Profile((*holds, hunts))
    return simulate(paper_rig(), rig_settings(), profile, seed=seed)


_STAIRS = (6.0, 8.8, 0.2)

#: Rigs and ways of recording, tried with several seeds: name, from a seed to the recordings, what
#: is true of the rig, and what the user tells.
CASES: tuple[tuple[str, Callable[[int], object], Callable[[], Truth], dict[str, float]], ...] = (
    (
        'staircase at 200 Hz, lateral and speed only',
        lambda seed: without(steps('paper', seed, *_STAIRS), 'roller', 'yaw'),
        lambda: truth_of('paper'),
        {},
    ),
    (
        'rig of 14 m/s and 2 Hz',
        lambda seed: steps('14 m/s', seed, 10.5, 15.4, 0.35),
        lambda: truth_of('14 m/s'),
        {},
    ),
    ('a rig that hunts 2 % of its time', seldom_hunting, lambda: truth_of('paper'), {}),
    (
        'supercritical rig',
        lambda seed: steps('supercritical', seed, *_STAIRS),
        lambda: truth_of('supercritical'),
        {},
    ),
    *(
        (
            f'{name}, {how}',
            lambda seed, rig=rig, made=made: made(rig, seed),
            lambda rig=rig: (rig.v_c, rig.v_n, {}),
            rig.told,
        )
        for name, rig in RIGS.items()
        for how, made in RECORDINGS.items()
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
    return replace(found, records=(), envelopes=())


def inside(found: Identification, unstable: Mapping[float, float]) -> list[bool]:
    """Return whether each true unstable amplitude of which a band is given lies in it."""
    if not unstable:
        return []
    _, low, high = found.branch('unstable', list(unstable))
    bands = zip(unstable.values(), low, high, strict=True)
    return [bool(a <= truth <= b) for truth, a, b in bands if math.isfinite(a)]


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
    for number, (name, _, truth, _) in enumerate(CASES):
        found = mapped(pool, name, one, [(number, seed) for seed in range(count)])
        v_c, v_n, unstable = truth()
        results = [each for each in found if isinstance(each, Identification)]
        held = [each for result in results for each in inside(result, unstable)]
        kinds = Counter(getattr(each, 'criticality', None) or 'not known' for each in found)
        said = [', '.join(f'{kind} {n}' for kind, n in kinds.most_common())]
        if misfit := sum(result.fit.lack_of_fit for result in results):
            said.append(f'lack of fit {misfit}')
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
        ' without noise; of rigs of another make, by brute force. The unstable amplitude is'
        ' compared at 30 and 60 % of the way from v_n to v_c.\n\n' + markdown(header, rows)
    )
