"""What no estimator can do better: the bounds that the benchmark compares with."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bounds import SignalModel, std_bound
from scipy.optimize import least_squares


def test_end_amplitude_of_a_long_window_meets_the_closed_form():
    model = SignalModel(2.6e-4, 2.5, 0.0, 2e-5, 1000.0)
    closed = math.sqrt(8.0 * 2e-5**2 / 8000)
    assert std_bound(model, 8.0) == pytest.approx(closed, rel=0.03)


@pytest.mark.parametrize('second', [(), (3.3, 9.4)])
def test_no_estimator_beats_the_bound(second):
    # Nonlinear least squares on the same model reaches it, and does not pass it.
    model = SignalModel(1e-3, 2.5, 0.3, 1e-4, 500.0, second_mode=second or None)
    t = (np.arange(300) - 299) / 500.0
    decays = np.exp(complex(-9.4, 2 * np.pi * 3.3) * (t - t[0])) if second else 0j * t
    errors = []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        truth = np.array([1.0, 2 * np.pi * rng.random(), 2 * np.pi * 2.5, 0.3, 0.0, 0.0])

        def signal(p):
            hunting = p[0] * np.exp(p[3] * t) * np.cos(p[2] * t + p[1])
            return hunting + p[4] * decays.real + p[5] * decays.imag

        data = signal(truth) + 0.1 * rng.normal(size=t.size)
        fit = least_squares(lambda p, d=data: signal(p) - d, truth)
        errors.append(1e-3 * (fit.x[0] - 1.0))
    assert np.std(errors) == pytest.approx(std_bound(model, 0.6), rel=0.2)
