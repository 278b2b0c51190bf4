from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from bounds import (
    SignalModel,
    amplitude_std_bound,
    amplitude_window,
)

KICK = SignalModel(2.6e-4, 2.5, 0.0, 2e-5, 1000.0, roughness_hz=7.6)


def test_windows_of_the_literature_values():
    # 5 % on the end amplitude with all nuisances unknown.
    assert amplitude_window(KICK) == pytest.approx(0.30, abs=0.02)
    assert amplitude_window(replace(KICK, amplitude=1e-4)) == pytest.approx(0.41, abs=0.02)


def test_end_amplitude_of_a_long_window_meets_the_closed_form():
    model = replace(KICK, roughness_hz=None, known_background=True)
    closed = math.sqrt(8.0 * 2e-5**2 / 8000)
    assert amplitude_std_bound(model, 8.0) == pytest.approx(closed, rel=0.03)


def test_no_estimator_beats_the_bound():
    # Nonlinear least squares on the same model reaches it, and does not pass it.
    from scipy.optimize import least_squares

    model = SignalModel(1e-3, 2.5, 0.3, 1e-4, 500.0, known_background=True)
    t = (np.arange(300) - 299) / 500.0
    errors = []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        phase = 2 * np.pi * rng.random()
        truth = np.array([1.0, phase, 2 * np.pi * 2.5, 0.3])

        def signal(p):
            return p[0] * np.exp(p[3] * t) * np.cos(p[2] * t + p[1])

        data = signal(truth) + 0.1 * rng.normal(size=t.size)
        fit = least_squares(lambda p, d=data: signal(p) - d, truth)
        errors.append(1e-3 * (fit.x[0] - 1.0))
    assert np.std(errors) == pytest.approx(amplitude_std_bound(model, 0.6), rel=0.2)
