"""The test of a law against the limit cycle it was fitted to is one: its p is a probability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made import LAW, SCALES, changed
from records_made import held_speeds
from scipy import stats

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.dynamics.growth_law import TERMS, lawful
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.dynamics.paper_form import from_normal_form
from hunt_ros.identification import identify
from hunt_ros.identification.verdict.lack_of_fit import lack_of_fit
from hunt_ros.samples import Record

SPEEDS = np.linspace(6.7, 9.0, 24)
SCATTER = 2e-3
#: What transients and the quiet state tell of each coefficient, 1/s.
KNOWN = np.array([0.02, 0.1, 0.3, 0.1, 0.3, 0.1])


def logs(p: np.ndarray) -> np.ndarray:
    """Logarithms of the stable branch of a law."""
    return np.log(replace(LAW, p=lawful(p)).steady_amplitudes(SPEEDS)[1])


@pytest.fixture(scope='module')
def probabilities() -> np.ndarray:
    """Of 200 sets of states made by the law itself, each with the law that was fitted to it."""
    rng = np.random.default_rng(0)
    paper = LAW.p[:6]
    slopes = [(logs(paper + h) - logs(paper - h)) / 2e-4 for h in 1e-4 * np.eye(6)]
    sensitivity = np.stack(slopes, axis=1)
    other = np.diag(KNOWN**-2)
    covariance = np.linalg.inv(sensitivity.T @ sensitivity / SCATTER**2 + other)
    found = []
    for _ in range(200):
        error = SCATTER * rng.standard_normal(SPEEDS.size)
        told = KNOWN * rng.standard_normal(6)
        p = paper + covariance @ (sensitivity.T @ error / SCATTER**2 + other @ told)
        amplitude = np.exp(logs(paper) + error)
        states = [
            SteadyState(v, a, 1e-6, 'up', 70) for v, a in zip(SPEEDS, amplitude, strict=True)
        ]
        held = np.pad(covariance, (0, TERMS - 6))
        found.append(lack_of_fit(replace(LAW, p=lawful(p)), states, None, held).p)
    return np.array(found)


@pytest.mark.parametrize('level', [0.05, 0.2, 0.5, 0.8])
def test_the_degrees_of_freedom_that_the_fit_took_are_charged(probabilities, level):
    below = int(np.sum(probabilities < level))
    # Three deviations of a binomial; and an approximation that is allowed a fifth of the level.
    low = stats.binom.ppf(0.0013, probabilities.size, 0.8 * level)
    high = stats.binom.ppf(0.9987, probabilities.size, min(1.2 * level, 0.95))
    assert low <= below <= high


SOFT = NormalForm(7.0, 0.12, -450.0, -0.06, 0.0, -3.4e6)
#: Up through v_c to 7.84 m/s, and down again.
_THERE, _BACK = (0.0, 10.0, 250.0, 260.0, 500.0, 510.0), (5.95, 5.95, 7.84, 7.84, 5.95, 5.95)


def swept(made_by: NormalForm, scatter: float, seed: int) -> list[SteadyState]:
    """States of a law along a slow sweep down to v_c, which the amplitude follows late."""
    law = replace(LAW, p=lawful(from_normal_form(made_by, SCALES)))
    rng = np.random.default_rng(seed)
    step, seconds = 0.02, 100.0
    log = float(np.log(law.steady_amplitudes(7.84)[1][0]))
    states = []
    for k, time in enumerate(np.arange(0.0, seconds, step)):
        speed = 7.84 - 0.8 * time / seconds
        rate = float(law.growth_rate(speed, np.exp(log)))
        log += step * rate
        if k % 150 == 0:
            seen = float(np.exp(log + scatter * rng.standard_normal()))
            states.append(SteadyState(speed, seen, 1e-6, 'down', 8, growth_rate=rate))
    return states


def test_an_amplitude_that_lags_behind_a_ramp_is_no_lack_of_fit() -> None:
    law = replace(LAW, p=lawful(from_normal_form(SOFT, SCALES)))
    flagged = 0
    for seed in range(5):
        states = swept(SOFT, 5e-3, seed)
        flagged += lack_of_fit(law, states).flagged
        # As if it stood still, it is where no limit cycle of the law is.
        assert lack_of_fit(law, [replace(one, growth_rate=0.0) for one in states]).flagged
        # Another law is found out also in motion.
        other = replace(law, p=law.p * np.array([1, 1, 1, 1.2, 1, 1, 1, 1, 1, 1]))
        assert lack_of_fit(other, states).flagged
    assert flagged <= 1


def test_a_slow_sweep_through_a_soft_onset_is_no_lack_of_fit(make) -> None:
    found = [
        identify(
            [make(lambda t: np.interp(t, _THERE, _BACK), 510.0, seed, form=SOFT, forcing=4e-6)]
        )
        for seed in range(4)
    ]
    assert sum(one.fit.lack_of_fit for one in found) == 0
    assert sum(one.criticality == 'supercritical' for one in found) >= 3
    assert all(abs(one.v_c.value - 7.0) < 0.1 for one in found)


_STEPS = (*np.arange(6.2, 9.01, 0.2), *np.arange(8.8, 6.19, -0.2))


def _stairs(seed: int, wave: float) -> Record:
    """Steps of the law itself up and down; `wave`: what no law has, a gain that waves with v."""
    record = held_speeds(_STEPS, 14.0, 2.0, seed, forcing=1e-5)
    lateral, speed = record['lateral'], record['speed']
    v = np.interp(lateral.stamps_ns, speed.stamps_ns, speed.values)
    bent = lateral.values * (1.0 + wave * np.sin(2.0 * np.pi * (v - 7.0) / 1.6))
    return changed(record, lateral=bent)


@pytest.mark.slow
def test_a_limit_cycle_that_no_form_follows_does_not_bend_the_critical_speed() -> None:
    for wave, seeds in ((0.0, range(2)), (0.012, range(2))):
        for seed in seeds:
            result = identify([_stairs(seed, wave)])
            assert abs(result.v_c.value - 8.0) < 3.0 * result.v_c.std
