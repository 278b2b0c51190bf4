from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.errors import ConfigError
from hunt_ros.estimation.growth import EnvelopeGrowth, growth_sign
from hunt_ros.estimation.hilbert import HilbertEnvelope


@given(rate=st.floats(-3.0, 3.0), amplitude=st.floats(1e-9, 1e6))
def test_slope_of_an_exponential_is_its_rate(rate, amplitude):
    growth, std = EnvelopeGrowth(100.0, 2.0).update(
        amplitude * np.exp(rate * np.arange(250) / 100)
    )
    assert np.isnan(growth[:199]).all()
    assert growth[199:] == pytest.approx(rate, abs=1e-6)
    assert (std[199:] < 1e-6).all()


def test_standard_deviation_covers_what_noise_does():
    z = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        t = np.arange(400) / 100.0
        wave = np.exp(0.2 * t) * np.cos(17.8 * t) + 0.1 * rng.normal(size=t.size)
        growth, std = EnvelopeGrowth(100.0, 2.0).update(HilbertEnvelope(100.0).update(wave))
        z.append((growth[-1] - 0.2) / std[-1])
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.6


def test_sign_is_told_only_where_it_is_known():
    rates = np.array([1.0, -1.0, 0.2, np.nan, 1.0])
    stds = np.array([0.1, 0.1, 0.1, 0.1, np.nan])
    assert list(growth_sign(rates, stds)) == [1, -1, 0, 0, 0]


@pytest.mark.parametrize('window', [0.01, 0.5])
def test_a_window_too_short_is_refused(window):
    with pytest.raises(ConfigError):
        EnvelopeGrowth(100.0, window)
