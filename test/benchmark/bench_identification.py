"""
Identification: ours beside pysindy on one set of trajectories, and against the full model.

Run with --quick for 3 realisations and seeds, without publication; --seeds N for another
number. pysindy is the extra `bench`; without it only our columns are printed.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from runpy import run_path

import numpy as np
from scipy.signal import butter, hilbert, sosfiltfilt
from tables import markdown, publish

from hunt_ros.dynamics.normal_form import COEFFICIENTS, PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import SimulationSettings, simulate
from hunt_ros.dynamics.speed_profile import SpeedProfile
from hunt_ros.identification import IdentificationSettings, identify
from hunt_ros.samples import Record

_MAKERS = run_path(str(Path(__file__).parents[1] / 'identification' / 'conftest.py'))
#: Noise and roughness line of the three sets, m.
SETS = ((5e-6, 0.0), (2e-5, 0.0), (5e-6, 5e-5))
#: Speeds at which the unstable amplitude is compared, m/s.
UNSTABLE_AT = (7.0, 7.6)
NAMES = (*COEFFICIENTS, 'v_n', 'A_u 7.0', 'A_u 7.6')
#: The full model without roughness, by harmonic balance and time integration: fold, branches.
FULL_FOLD = 6.433
FULL_UNSTABLE = ((6.6, 379e-6), (7.2, 237e-6), (7.6, 155e-6))
FULL_STABLE = ((7.2, 635e-6), (8.0, 678e-6), (8.8, 703e-6))


def numbers(form: NormalForm | None) -> np.ndarray:
    """Return the compared quantities of a form; NaN for what it has not."""
    if form is None:
        return np.full(len(NAMES), np.nan)
    fold = form.nonlinear_critical_speed
    unstable = form.unstable_amplitude(UNSTABLE_AT)
    values = [getattr(form, name) for name in COEFFICIENTS]
    return np.array([*values, np.nan if fold is None else fold, *unstable])


def radii(records: Sequence[Record]) -> tuple[list[np.ndarray], float]:
    """Envelopes for the peer: band-pass, Hilbert, 1.5 s trimmed at each end, at 50 Hz.

    Band, rate and the windows of the weak form are those that served the peer best of
    half a dozen that were tried.
    """
    band = butter(4, [2.2, 3.5], 'bandpass', fs=100.0, output='sos')
    paths = []
    for record in records:
        lateral = record['lateral'].values
        envelope = np.abs(hilbert(sosfiltfilt(band, lateral - lateral.mean())))
        paths.append(envelope[150:-150:2])
    return paths, float(np.percentile(np.concatenate(paths), 95.0))


def terms() -> list[Callable[[np.ndarray, np.ndarray], np.ndarray]]:
    """Return the five known terms of Eq. (24) as functions of r and eps."""
    return [
        lambda r, e: e * r,
        lambda r, e: r**3 + 0.0 * e,
        lambda r, e: e**2 * r,
        lambda r, e: e * r**3,
        lambda r, e: r**5 + 0.0 * e,
    ]


def sindy(records: Sequence[Record], weak: bool) -> NormalForm | None:
    """Fit the five known terms with pysindy, v_c being told to it."""
    import pysindy as ps

    form = PAPER_NORMAL_FORM
    paths, size = radii(records)
    data = []
    for record, path in zip(records, paths, strict=True):
        eps = float(form.detuning(np.median(record['speed'].values)))
        data.append(np.stack([path / size, np.full(path.size, eps)], axis=1))
    time_s = np.arange(paths[0].size) * 0.02
    library = ps.CustomLibrary(library_functions=terms())
    options: dict[str, object] = {}
    if weak:
        np.random.seed(0)  # noqa: NPY002 - the peer draws its windows from numpy's global state
        library = ps.WeakPDELibrary(library, spatiotemporal_grid=time_s, K=100, H_xt=[4.0])
    else:
        options['differentiation_method'] = ps.SmoothedFiniteDifference()
    model = ps.SINDy(
        optimizer=ps.STLSQ(threshold=0.0, alpha=1e-10, normalize_columns=True),
        feature_library=library,
        **options,
    )
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        model.fit(data, t=time_s)
        found = np.asarray(model.coefficients())[0][:5]
    unit = (size / (2.0 * form.length_scale)) ** 2
    d1, d4, d7, d10, d15 = found * form.time_scale / np.array([1, unit, 1, unit, unit**2])
    return NormalForm(8.0, float(d1), float(d4), float(d7), float(d10), float(d15))


def ours(records: Sequence[Record]) -> NormalForm | None:
    """Identify, v_c being known to us as it is to the peer."""
    result = identify(records, IdentificationSettings(prior_v_c=(8.0, 1e-3)))
    return None if result.normal_form is None else result.normal_form.form


def trial(task: tuple[int, float, float, bool]) -> dict[str, tuple[np.ndarray, float]]:
    """Run all methods on one realisation."""
    seed, noise, roughness, peers = task
    records = _MAKERS['trajectories'](seed, noise, roughness)
    methods: dict[str, Callable[[], NormalForm | None]] = {'ours': lambda: ours(records)}
    if peers:
        methods['pysindy, weak'] = lambda: sindy(records, True)
        methods['pysindy'] = lambda: sindy(records, False)
    results = {}
    identify(records[:4])  # compile before the clock starts
    for name, method in methods.items():
        begin = time.perf_counter()
        form = method()
        results[name] = (numbers(form), time.perf_counter() - begin)
    return results


def covered(seed: int) -> np.ndarray:
    """Whether each 95 % interval of one realisation at 20 um holds the truth."""
    form = PAPER_NORMAL_FORM
    result = identify(_MAKERS['trajectories'](seed, 2e-5))
    wanted = [(result.coefficients[name], getattr(form, name)) for name in COEFFICIENTS]
    wanted += [(result.v_n, form.nonlinear_critical_speed), (result.v_c, 8.0)]
    speeds = [point.speed for point in result.branches if point.unstable is not None]
    bands = [point.unstable for point in result.branches if point.unstable is not None]
    inside = [x is not None and x.low <= truth <= x.high for x, truth in wanted]
    for speed in UNSTABLE_AT:
        low = np.interp(speed, speeds, [band.low for band in bands])
        high = np.interp(speed, speeds, [band.high for band in bands])
        inside.append(bool(low <= float(form.unstable_amplitude(speed)) <= high))
    return np.array(inside)


def staircase(seed: int) -> list[float]:
    """Errors from one staircase of the full model."""
    result = identify([_MAKERS['staircase'](seed)], IdentificationSettings(seed=seed))
    form = None if result.normal_form is None else result.normal_form.form
    if form is None or result.v_n is None or result.v_c is None:
        return [np.nan] * 6
    speeds = [point.speed for point in result.branches if point.unstable is not None]
    bands = [point.unstable for point in result.branches if point.unstable is not None]
    inside = []
    for speed, truth in FULL_UNSTABLE:
        low = np.interp(speed, speeds, [band.low for band in bands])
        high = np.interp(speed, speeds, [band.high for band in bands])
        inside.append(low <= truth <= high)
    stable = max(abs(float(form.stable_amplitude(v)) / a - 1.0) for v, a in FULL_STABLE)
    unstable = max(abs(float(form.unstable_amplitude(v)) / a - 1.0) for v, a in FULL_UNSTABLE)
    return [
        result.v_n.value - FULL_FOLD,
        result.v_c.value - 8.0,
        result.v_c.std,
        stable,
        unstable,
        float(np.mean(inside)),
    ]


def comparison(count: int, pool: ProcessPoolExecutor) -> str:
    """Return the tables against pysindy."""
    peers = find_spec('pysindy') is not None
    text = []
    truth = numbers(PAPER_NORMAL_FORM)
    for noise, roughness in SETS:
        trials = list(pool.map(trial, [(s, noise, roughness, peers) for s in range(count)]))
        rows: list[list[object]] = []
        rms: dict[str, np.ndarray] = {}
        for name in trials[0]:
            error = 100.0 * (np.array([one[name][0] for one in trials]) / truth - 1.0)
            known = np.isfinite(error).sum(axis=0)
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')
                rms[name] = np.sqrt(np.nanmean(error**2, axis=0))
                bias = np.nanmean(error, axis=0)
            rows.append([name, 'bias', *bias, float(np.median([o[name][1] for o in trials]))])
            rows.append([name, 'rms', *rms[name], ''])
            if known.min() < count:
                rows.append([name, 'answers', *known, ''])
        if peers:
            best = np.nanmin([rms[name] for name in rms if name != 'ours'], axis=0)
            rows.append(['best peer / ours', 'rms', *(best / rms['ours']), ''])
        text.append(
            f'Noise {1e6 * noise:.0f} um, roughness line {1e6 * roughness:.0f} um; error in %'
            f' of the true value over {count} realisations:\n\n'
            + markdown(['method', 'error', *NAMES, 'time (s)'], rows)
        )
    return '\n\n'.join(text)


def coverage(count: int, pool: ProcessPoolExecutor) -> str:
    """Return the table of how often the intervals hold the truth."""
    inside = np.sum(list(pool.map(covered, range(1000, 1000 + count))), axis=0)
    header = [*COEFFICIENTS, 'v_n', 'v_c', 'A_u 7.0', 'A_u 7.6']
    goal = f'{round(0.91 * count)} to {round(0.985 * count)}'
    return (
        f'95 % intervals that hold the truth, of {count} realisations at 20 um'
        f' (goal {goal}; v_c not told):\n\n' + markdown(header, [list(inside)])
    )


def full_model(count: int, pool: ProcessPoolExecutor) -> str:
    """Return the table of staircases of the full model."""
    found = np.array(list(pool.map(staircase, range(count))))
    known = found[np.isfinite(found[:, 0])]
    v_n, v_c, std, stable, unstable, inside = known.T
    rows = [
        ['answers', f'{len(known)} of {count}', 'all'],
        ['v_n within 0.05 m/s', f'{np.mean(np.abs(v_n) <= 0.05):.0%}', '90 %'],
        ['stable branch within 2 %', f'{np.mean(stable <= 0.02):.0%}', '90 %'],
        [
            'v_c within 0.1 m/s or two deviations',
            f'{np.mean(np.abs(v_c) <= np.maximum(0.1, 2.0 * std)):.0%}',
            '90 %',
        ],
        ['bias and rms of v_n (m/s)', f'{v_n.mean():+.3f}, {np.sqrt(np.mean(v_n**2)):.3f}', ''],
        ['bias and rms of v_c (m/s)', f'{v_c.mean():+.3f}, {np.sqrt(np.mean(v_c**2)):.3f}', ''],
        ['median reported deviation of v_c (m/s)', f'{np.median(std):.3f}', ''],
        ['median largest error of the unstable branch', f'{np.median(unstable):.1%}', ''],
        ['true unstable branch inside its band', f'{inside.mean():.0%}', '95 %'],
    ]
    return (
        'One staircase of the full model (2), (3): 0.2 m/s steps, 25 s holds, roughness 30 um,'
        ' broadband 8e-6, noise 5 um. Truth: the branches of the model without roughness.\n\n'
        + markdown(['', 'found', 'goal'], rows)
    )


def hour() -> str:
    """Return how long an hour of three channels at 1 kHz takes."""
    up = np.arange(6.0, 8.9, 0.1)
    profile = SpeedProfile.staircase(*up, *up[-2::-1], hold_s=62.0)
    settings = SimulationSettings(sample_rate_hz=1000.0, broadband=8e-6, drive_rate_hz=1000.0)
    record = simulate(paper_rig(), settings, profile, seed=1)
    begin = time.perf_counter()
    result = identify([record])
    point = time.perf_counter() - begin
    begin = time.perf_counter()
    identify([record], IdentificationSettings(bootstrap=100))
    drawn = time.perf_counter() - begin - point
    fold = 'none' if result.v_n is None else f'{result.v_n.value:.3f} m/s'
    return (
        f'{record.duration_s / 60.0:.0f} minutes of three channels at 1 kHz: {point:.1f} s with'
        f' linearised intervals (goal 10 s), {drawn:.1f} s more for 100 bootstrap'
        f' replications (goal 60 s); v_n {fold}.'
    )


def main() -> None:
    """Measure, print and publish."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='3 realisations, no publication')
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--coverage', type=int, default=200)
    parser.add_argument('--jobs', type=int, default=None)
    arguments = parser.parse_args()
    count = 3 if arguments.quick else arguments.seeds
    cover = 6 if arguments.quick else arguments.coverage
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context('spawn')) as pool:
        parts = [comparison(count, pool), coverage(cover, pool), full_model(count, pool)]
    parts.append(hour())
    text = '\n\n'.join(parts)
    if arguments.quick:
        print(text)
        return
    publish('bench-identification', 'Identification', f'{text}\n\n{FALLS_SHORT}')


FALLS_SHORT = (
    'Both methods are told v_c and the five terms; the peer gets r(t) from band-pass and Hilbert'
    ' transform, with the settings that served it best of those tried, and gives no interval, no'
    ' fold and no v_c of its own. Times are those of processes that share the machine. What falls'
    ' short: single realisations in which the weak form does well on v_n and the unstable'
    ' amplitude leave it two to four times our error there, not five; intervals at 20 um are'
    ' slightly narrow for D1 and v_n. On the full model v_c comes'
    ' out about 0.05 m/s low, by the roughness and the misfit of the quintic form, and v_n of the'
    ' hour 0.03 m/s high, with an interval that does not know of it.'
)


if __name__ == '__main__':
    main()
