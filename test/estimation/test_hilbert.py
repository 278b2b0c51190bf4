from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.errors import ConfigError
from hunt_ros.estimation.hilbert import HilbertEnvelope


@settings(max_examples=25, deadline=None)
@given(
    frequency=st.floats(1.6, 4.9),
    amplitude=st.floats(1e-6, 1e3),
    bias=st.floats(-10.0, 10.0),
    phase=st.floats(0.0, 6.3),
)
def test_envelope_of_a_sine_is_its_amplitude_whatever_the_bias(frequency, amplitude, bias, phase):
    t = np.arange(300) / 100.0
    filtering = HilbertEnvelope(100.0)
    envelope = filtering.update(amplitude * (np.cos(2 * np.pi * frequency * t + phase) + bias))
    gain = filtering.gain(frequency)
    assert envelope[100:] == pytest.approx(amplitude * gain, rel=0.03)


def test_gain_is_one_in_the_band_and_nothing_at_zero_and_at_the_roller():
    filtering = HilbertEnvelope(100.0)
    assert filtering.gain([1.7, 2.84, 4.0, 4.9]) == pytest.approx(1.0, abs=0.06)
    assert filtering.gain(0.0) < 1e-6
    assert filtering.gain(9.0) < 0.03


def test_envelope_is_late_by_its_delay():
    t = np.arange(1000) / 100.0
    growing = np.exp(0.5 * t) * np.cos(17.8 * t)
    filtering = HilbertEnvelope(100.0)
    envelope = filtering.update(growing)
    truth = np.exp(0.5 * (t - filtering.delay_s))
    gain = filtering.gain(17.8 / 2 / np.pi)
    np.testing.assert_allclose(envelope[100:], truth[100:] * gain, rtol=0.02)


def test_noise_gain_is_the_spread_of_a_strong_envelope():
    rng = np.random.default_rng(0)
    t = np.arange(20000) / 100.0
    filtering = HilbertEnvelope(100.0)
    envelope = filtering.update(np.cos(17.8 * t) + 0.05 * rng.normal(size=t.size))
    assert envelope[100:].std() == pytest.approx(0.05 * filtering.noise_gain, rel=0.1)


def test_a_short_gap_is_bridged():
    wave = np.cos(17.8 * np.arange(500) / 100.0)
    whole = HilbertEnvelope(100.0).update(wave)
    wave[300:303] = np.nan
    bridged = HilbertEnvelope(100.0).update(wave)
    np.testing.assert_allclose(bridged[100:], whole[100:], rtol=0.05)


@pytest.mark.parametrize(
    'settings_', [{'low_hz': 0.0}, {'high_hz': 60.0}, {'low_hz': 7.0}, {'length_s': 0.1}]
)
def test_an_impossible_band_is_refused(settings_):
    with pytest.raises(ConfigError):
        HilbertEnvelope(100.0, **settings_)
