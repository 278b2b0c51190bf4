from __future__ import annotations

import math

import numpy as np
import pytest

from hunt_ros.analysis.frequency_amplitude import amplitude_and_frequency, frequency_law
from hunt_ros.errors import IdentificationError

D0, SCALE = 0.0485, 1.0 / 25.91
TRUTH = {'omega': 0.6875, 'D4I': -900.0, 'D1I': 0.072}


def hertz(amplitude, speed):
    """Frequency by Eq. (25) with the coefficients of `TRUTH`."""
    square = (np.asarray(amplitude) / (2 * D0)) ** 2
    eps = np.asarray(speed) / 8.0 - 1.0
    rate = TRUTH['omega'] + TRUTH['D4I'] * square + TRUTH['D1I'] * eps
    return rate / (2 * math.pi * SCALE)


def test_the_coefficients_come_back_with_their_intervals():
    generator = np.random.default_rng(0)
    inside = dict.fromkeys(TRUTH, 0)
    for _ in range(60):
        amplitude = generator.uniform(0.1e-3, 0.7e-3, 60)
        speed = generator.uniform(6.4, 9.0, 60)
        measured = hertz(amplitude, speed) + generator.normal(0.0, 0.003, 60)
        law = frequency_law(amplitude, measured, speed, 8.0)
        assert set(law.coefficients) >= set(TRUTH)
        for name, value in TRUTH.items():
            inside[name] += law.coefficients[name].low < value < law.coefficients[name].high
    assert all(50 <= count <= 60 for count in inside.values())
    assert law.frequency_hz(0.5e-3, 7.0) == pytest.approx(float(hertz(0.5e-3, 7.0)), abs=0.005)
    assert law.residual_rms_hz == pytest.approx(0.003, rel=0.4)


def test_one_speed_gives_no_term_in_the_speed():
    amplitude = np.linspace(0.1e-3, 0.6e-3, 30)
    law = frequency_law(amplitude, hertz(amplitude, 7.2), 7.2, 8.0)
    assert not {'D1I', 'D10I', 'D7I'} & set(law.coefficients)
    assert law.coefficients['D4I'].value == pytest.approx(TRUTH['D4I'], rel=1e-6)


def test_a_decay_shows_amplitude_and_frequency_together():
    rate = 200.0
    time = np.arange(round(40 * rate)) / rate
    amplitude = 0.7e-3 * np.exp(-0.05 * time)
    phase = 2 * np.pi * np.cumsum(hertz(amplitude, 8.0)) / rate
    signal = amplitude * np.cos(phase) + np.random.default_rng(1).normal(0, 5e-6, time.size)
    when, found, frequency = amplitude_and_frequency(signal, rate, (1.8, 4.2))
    assert found == pytest.approx(np.interp(when, time, amplitude), rel=0.03)
    law = frequency_law(found, frequency, 8.0, 8.0)
    d4 = law.coefficients['D4I']
    assert d4.value == pytest.approx(TRUTH['D4I'], rel=0.05)
    assert abs(d4.value - TRUTH['D4I']) < 4.0 * d4.std


def test_weights_are_heard():
    amplitude = np.linspace(0.1e-3, 0.6e-3, 20)
    measured = hertz(amplitude, 8.0)
    measured[-1] += 0.5
    std = np.full(20, 0.001)
    std[-1] = 10.0
    law = frequency_law(amplitude, measured, 8.0, 8.0, std)
    assert law.coefficients['D4I'].value == pytest.approx(TRUTH['D4I'], rel=1e-3)


def test_equal_amplitudes_tell_nothing():
    with pytest.raises(IdentificationError, match='amplitudes'):
        frequency_law(np.full(10, 1e-3), np.full(10, 2.8), 8.0, 8.0)
    with pytest.raises(IdentificationError, match='expected at least'):
        amplitude_and_frequency(np.zeros(300), 200.0, (2.0, 4.0))
