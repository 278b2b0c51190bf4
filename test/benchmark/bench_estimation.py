"""
`make bench-estimation`: the tracker's speed, its accuracy against the bounds.

Everything is seeded; times are of one run on one core, the accuracy figures do not
depend on the machine.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from runpy import run_path

import numpy as np
from bounds import (
    SignalModel,
    amplitude_window,
    growth_window,
    sign_time_bound,
)
from tables import markdown, publish

from hunt_ros.compiled import HAVE_COMPILER
from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.estimation.kalman import HuntingTracker, TrackerConfig

hunting_signal = run_path(str(Path(__file__).parents[1] / 'estimation' / 'conftest.py'))['_signal']

BOTH, LATERAL = (0, 1), (0,)
RATIO = -3.94 + 2.37j
SECOND = (3.3, 9.4)
SEEDS = 40


def speed() -> str:
    """Time of the kernel for a sample, and for an hour of data."""
    rows = []
    signal = hunting_signal(0, duration=120.0)
    for label, bin_s in (('every sample an update', 0.0), ('means over 5 ms (default)', 0.005)):
        tracker = HuntingTracker(TrackerConfig(bin_s=bin_s))
        start = time.thread_time()  # of CPU: the machine may be busy
        signal.track(tracker)
        each = (time.thread_time() - start) / (2 * signal.stamps.size)
        rows.append((label, each * 1e6, each * 7.2e6))
    text = markdown(['', 'us a sample', 'hour of 2 x 1 kHz, s'], rows)
    return (
        f'Compiler: {"numba" if HAVE_COMPILER else "none"}; 20 states.\n\n{text}\n\nA live call'
        f' with 4 to 40 samples and one output takes {latency() * 1e6:.0f} us in the median.'
    )


def latency() -> float:
    """Median time of one call, live blocks."""
    signal = hunting_signal(0, duration=8.0)
    tracker, times = HuntingTracker(), []
    sensor = np.tile(np.array([0, 1], dtype=np.int8), 10)
    for at in range(0, signal.stamps.size, 10):
        part = slice(at, at + 10)
        stamps = np.repeat(signal.stamps[part], 2)
        values = np.stack([signal.lateral[part], signal.yaw[part]], axis=1).ravel()
        angle, running = np.repeat(signal.angle[part], 2), np.repeat(signal.speed[part], 2)
        start = time.perf_counter()
        tracker.update(stamps, sensor, values, angle, running, stamps[-1:])
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def windows() -> str:
    """Time after a kick until the amplitude is known to 5 % rms, against the bounds."""
    rows = []
    for noise in (5e-6, 2e-5):
        for sensors in (LATERAL, BOTH):
            errors, scores = [], []
            for seed in range(SEEDS):
                signal = hunting_signal(
                    seed,
                    duration=9.0,
                    amplitude=2e-5,
                    kick_at=7.0037,
                    kick=2e-4,
                    second=2e-4,
                    noise=noise,
                    rate=500,
                )
                out, phasor = signal.track(HuntingTracker(), sensors)
                error = (out['lateral_amplitude'] - np.abs(phasor))[700:860]
                errors.append(error / np.abs(phasor)[700:860])
                scores.append((error / out['lateral_amplitude_std'][700:860])[12:])
            rms = np.sqrt(np.mean(np.square(errors), axis=0))
            time_s = (np.flatnonzero(rms > 0.05).max() + 702) * 0.01 - 7.0037
            score = float(np.sqrt(np.mean(np.square(scores))))
            both = sensors == BOTH
            notes = SignalModel(
                2e-4,
                2.84,
                0.0,
                noise,
                500.0,
                5 * noise if both else None,
                RATIO,
                roughness_hz=7.6,
            )
            known = replace(notes, known_background=True, second_mode=SECOND)
            label = 'y and psi' if both else 'y'
            bounds = amplitude_window(notes), amplitude_window(known)
            rows.append((label, noise * 1e6, time_s, *bounds, score))
    return markdown(
        [
            'sensors',
            'noise, um',
            '5 % window, s',
            'bound of the notes, s',
            'bound with the second mode, s',
            'rms of error/std from 0.12 s on (honest: 1)',
        ],
        rows,
    )


def growth_signs() -> str:
    """Time after a kick until the sign of the growth rate is known, against the bounds."""
    one, none = np.ones(1), np.zeros((1, 1))
    tied = ModeShape(7.2 * one, none[0], 2.84 * one, none + RATIO, none)
    trackers = (
        ('y', LATERAL, None),
        ('y and psi', BOTH, None),
        ('y and psi, ratio known', BOTH, tied),
    )
    rows = []
    for rate in (0.5, 0.2, 0.1):
        for label, sensors, shape in trackers:
            times = []
            for seed in range(SEEDS // 2):
                signal = hunting_signal(
                    seed,
                    duration=10.0,
                    amplitude=0.0,
                    kick_at=7.0,
                    kick=2e-4,
                    second=2e-4,
                    growth=rate,
                )
                tracker = HuntingTracker()
                tracker.set_modes(shape, 0.03)
                out, _ = signal.track(tracker, sensors)
                sure = np.abs(out['growth_rate']) > 3.0 * out['growth_rate_std']
                first = np.flatnonzero(sure & (out['stamp_ns'] > 7_000_000_000))
                times.append(out['stamp_ns'][first[0]] * 1e-9 - 7.0 if first.size else np.inf)
            model = SignalModel(
                2e-4, 2.84, rate, 2e-5, 1000.0, known_background=True, second_mode=SECOND
            )
            gain = 1.0
            if sensors == BOTH:
                model = replace(model, yaw_noise=1e-4, yaw_ratio=RATIO)
                gain = 1.0 + abs(RATIO) ** 2 / 25.0
            notes = sign_time_bound(rate, 2e-4, 2e-5, 1e-3) / gain ** (1.0 / 3.0)
            full = growth_window(model, rate / 3.0)
            median = float(np.median(times))
            rows.append((label, rate, median, median / notes, full / notes, median / full))
    return markdown(
        [
            'after a kick',
            'growth, 1/s',
            'median time to 3 sigma, s',
            'ratio to the bound of the notes',
            'the same of the bound with the second mode',
            'ratio to that bound',
        ],
        rows,
    )


def main() -> None:
    sections = [
        '### Speed',
        speed(),
        '### Amplitude after a kick\nA kick of 0.2 mm at an unknown phase, that excites the second'
        f' mode as strongly; 500 Hz, roughness of 0.1 mm, {SEEDS} kicks. The bound of the notes'
        ' takes frequency, phase, growth rate, roughness and bias as unknown and no second mode;'
        ' the other takes roughness and bias as known from before the kick and a second mode'
        ' of unknown phasor.',
        windows(),
        '### Sign of the growth rate after a kick\n0.2 mm, 20 um of noise at 1 kHz. No estimator'
        ' can tell growth from the decay of the second mode before that is gone: there the bound'
        ' of the notes, which knows no second mode, is out of reach.',
        'Frequency and decay of the second mode are guessed, with a deviation of half their size;'
        ' the bound that takes only its phasor as unknown is by itself 1.4 to 2 times the one of'
        ' the notes.',
        growth_signs(),
    ]
    publish('bench-estimation', 'Estimation', '\n\n'.join(sections))


if __name__ == '__main__':
    main()
