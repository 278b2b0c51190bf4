"""The noise intensity: right on average, and as uncertain as it says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import decisions, noise
from hunt_ros.detection.decision.outlook import form_numbers
from hunt_ros.detection.decision.rules import rules_of
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

FORM = PAPER_NORMAL_FORM
NUMBERS = form_numbers(IdentifiedNormalForm(FORM))
PERIOD = 0.01
DIFFUSION = 1e-11


def _phasor(speed: float, seconds: float, seed: int, lag_s: float = 0.0) -> np.ndarray:
    """Complex Ornstein-Uhlenbeck motion of the quiet state, turning at 2.84 Hz."""
    rng = np.random.default_rng(seed)
    rate, count = float(FORM.growth_rate(speed)), round((seconds + 3.0) / PERIOD)
    keep = math.exp(rate * PERIOD)
    size = math.sqrt(DIFFUSION * (1.0 - keep**2) / -rate)
    steps = size * (rng.standard_normal(count) + 1j * rng.standard_normal(count))
    steps[0] *= 1.0 / math.sqrt(1.0 - keep**2)
    motion = lfilter([1.0], [1.0, -keep], steps)
    if lag_s:
        part = 1.0 - math.exp(-PERIOD / lag_s)
        motion = lfilter([part], [1.0, part - 1.0], motion)
    turned = motion * np.exp(2j * math.pi * 2.84 * PERIOD * np.arange(count))
    return np.asarray(turned[round(3.0 / PERIOD) :])  # the lag has settled


def _learnt(motion: np.ndarray, speed: float, stops: tuple[int, ...] = ()) -> tuple[float, float]:
    rules = rules_of(DetectorConfig(), FORM.nonlinear_critical_speed or math.nan, 8.0)
    memory = decisions.fresh_memory()['noise']
    for k, z in enumerate(motion):
        if k in stops:
            noise.interrupt(memory[0])
        noise.learn_intensity(rules, NUMBERS, memory[0], speed, abs(z), math.atan2(z.imag, z.real))
    return float(memory['intensity'][0]), float(memory['spread'][0])


@pytest.mark.parametrize('speed', [6.6, 7.2, 7.9])
@pytest.mark.parametrize('lag_s', [0.0, 0.15])
def test_it_is_right_on_average_and_its_spread_is_honest(speed: float, lag_s: float) -> None:
    found = np.array([_learnt(_phasor(speed, 12.0, k, lag_s), speed) for k in range(60)])
    assert found[:, 0].mean() == pytest.approx(DIFFUSION, rel=0.15)
    off = np.log(found[:, 0] / DIFFUSION) / found[:, 1]
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.4


def test_a_jump_across_an_interruption_is_not_seen() -> None:
    motion = _phasor(7.2, 40.0, 3)
    jumped = motion.copy()
    jumped[2000:] *= -1.0
    apart = _learnt(jumped, 7.2, stops=(2000,))[0]
    assert apart == pytest.approx(_learnt(motion, 7.2)[0], rel=0.3)
