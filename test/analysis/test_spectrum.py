from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.analysis.spectrum import power_spectrum, roughness_frequency
from hunt_ros.errors import IdentificationError

RATE, HUNTING = 200.0, 2.8
TIME = np.arange(round(60 * RATE)) / RATE


def noise(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 5e-6, TIME.size)


def test_roughness_is_a_frequency_in_hertz():
    assert roughness_frequency(6.4, 0.3) == pytest.approx(6.79, abs=0.01)


@settings(max_examples=30, deadline=None)
@given(
    speed=st.floats(5.0, 9.0),
    hunting=st.floats(2.1, 3.8),
    amplitude=st.floats(0.1e-3, 0.8e-3),
    rough=st.floats(0.05e-3, 0.3e-3),
)
def test_hunting_and_roughness_are_named_and_measured(speed, hunting, amplitude, rough):
    line = roughness_frequency(speed, 0.3)
    signal = amplitude * np.sin(2 * np.pi * hunting * TIME + 1.0)
    signal += rough * np.sin(2 * np.pi * line * TIME) + noise() + 2e-3
    spectrum = power_spectrum(signal, RATE, HUNTING, line)
    assert spectrum.line('hunting').frequency_hz == pytest.approx(hunting, abs=0.01)
    assert spectrum.line('hunting').amplitude == pytest.approx(amplitude, rel=0.03)
    assert spectrum.line('roughness').frequency_hz == pytest.approx(line, abs=0.02)
    assert spectrum.line('roughness').amplitude == pytest.approx(rough, rel=0.03)
    assert [one.frequency_hz for one in spectrum.lines] == sorted(
        one.frequency_hz for one in spectrum.lines
    )


@pytest.mark.parametrize('hunting', [1.2, 9.0])
def test_hunting_is_named_by_its_frequency_beside_a_larger_motion(hunting):
    signal = 5e-4 * np.sin(2 * np.pi * hunting * TIME) + 1e-3 * np.sin(2 * np.pi * 3.1 * TIME)
    spectrum = power_spectrum(signal + noise(), RATE, 1.1 * hunting)
    assert spectrum.line('hunting').frequency_hz == pytest.approx(hunting, abs=0.01)


def test_the_density_holds_the_variance():
    signal = 1e-3 * np.sin(2 * np.pi * 2.8 * TIME) + noise()
    spectrum = power_spectrum(signal, RATE, HUNTING)
    power = spectrum.density.sum() * spectrum.frequency_hz[1]
    assert power == pytest.approx(np.var(signal), rel=0.02)


def test_noise_alone_has_no_lines():
    assert power_spectrum(noise(), RATE, HUNTING, roughness_frequency(7.2, 0.3)).lines == ()


def test_a_roughness_line_inside_the_hunting_band_is_not_called_hunting():
    signal = 1e-4 * np.sin(2 * np.pi * 3.18 * TIME) + noise()
    spectrum = power_spectrum(signal, RATE, HUNTING, 3.18)
    assert [line.name for line in spectrum.lines] == ['roughness']


def test_an_overtone_of_hunting_is_not_called_roughness():
    # 3 x 2.835 = 8.505 Hz lies next to f_r = 8.70 Hz of 8.2 m/s.
    signal = 1e-3 * np.sin(2 * np.pi * 2.835 * TIME) + 5e-6 * np.sin(2 * np.pi * 8.505 * TIME)
    names = [
        line.name for line in power_spectrum(signal + 0.1 * noise(), RATE, HUNTING, 8.7).lines
    ]
    assert names == ['hunting', 'hunting 3']


def test_without_a_roller_nothing_is_called_roughness():
    signal = 1e-3 * np.sin(2 * np.pi * 2.8 * TIME) + 1e-4 * np.sin(2 * np.pi * 7.64 * TIME)
    assert [x.name for x in power_spectrum(signal + noise(), RATE, HUNTING).lines] == ['hunting']


@pytest.mark.parametrize('values', [np.zeros(10), np.full(200, np.nan)])
def test_what_cannot_be_analysed_is_refused(values):
    with pytest.raises(IdentificationError, match='spectrum'):
        power_spectrum(values, RATE, HUNTING)


def test_a_constant_has_no_lines():
    assert power_spectrum(np.full(4000, 1e-3), RATE, HUNTING, 7.4).lines == ()
