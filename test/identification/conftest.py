"""Records that several tests share, and what is known of the paper's form without a fit."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import made
import numpy as np
import pytest
from records_made import amplitude_record, staircase, sweep, trajectories

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.dynamics.growth_law import QUINTIC, TERMS, lawful
from hunt_ros.identification import Identification, identify
from hunt_ros.identification.posterior import Posterior
from hunt_ros.identification.result import FitSummary
from hunt_ros.samples import Record


def identification_of_the_paper(seed: int = 1) -> Identification:
    """What is known of the paper's form: v_n to 0.03 m/s and v_c to 0.1 m/s, without a fit."""
    law, scales = made.LAW, made.SCALES
    rng = np.random.default_rng(seed)
    vague = lawful([0.03, 0.03, 0.1, 0.02, 0.05, 0.02], felt=0.0)
    p = law.p + np.abs(law.p) * vague * rng.standard_normal((400, TERMS))
    intensity = 5e-12 * np.exp(0.2 * rng.standard_normal(400))
    posterior = Posterior(law, p, intensity, (6.0, 8.8))
    numbers = posterior.numbers(0.0)
    return Identification(
        normal_form=posterior.identified(0.0),
        v_c=numbers['v_c'],
        v_n=numbers['v_n'],
        hysteresis_width=numbers['hysteresis_width'],
        coefficients={},
        criticality='subcritical',
        length_scale=scales.length_scale,
        time_scale=scales.time_scale,
        scales_from={'length': 'given', 'time': 'given'},
        speeds=(6.0, 8.8),
        branches=posterior.branch_points(),
        steady_states=(),
        observed=ObservedCriticalSpeeds(),
        disturbance=None,
        four_point=None,
        fit=FitSummary(QUINTIC, 0, 0.0, False, (), 1.0, 1.0, True),
        posterior=posterior,
    )


@pytest.fixture(scope='session')
def records() -> dict[str, list[Record]]:
    """Records that several tests share, made once."""
    return {'trajectories': trajectories(1), 'staircase': [staircase(0)], 'sweep': [sweep(1)]}


@pytest.fixture(scope='session')
def identified(records) -> Callable[[str], Identification]:
    """Return a function that identifies some of these records, each once."""
    return cache(lambda name: identify(records[name]))


@pytest.fixture(scope='session')
def make() -> Callable[..., Record]:
    """Make a record of the amplitude equation."""
    return amplitude_record


@pytest.fixture(scope='session')
def known() -> Identification:
    """What is known of the paper's form."""
    return identification_of_the_paper()
