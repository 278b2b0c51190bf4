"""An identification of a known rig, as a document: what the tests of the report draw."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hunt_ros.dynamics.identified import PARAMETERS, IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.samples import Uncertain

#: Standard deviations of (v_c, D1, D4, D7, D10, D15) as a staircase gives them.
_STD = np.array([0.04, 0.0016, 24.0, 0.011, 75.0, 5.2e5])


def identified_form(form: NormalForm = PAPER_NORMAL_FORM) -> IdentifiedNormalForm:
    """Return a form with a covariance in which D4 and D15 hang together."""
    correlation = np.eye(6)
    correlation[2, 5] = correlation[5, 2] = -0.95
    covariance = correlation * np.outer(_STD, _STD)
    return IdentifiedNormalForm(form, covariance, {'recordings': 'run_a.mcap'})


def identification_document(
    one: IdentifiedNormalForm | None = None, seed: int = 1
) -> dict[str, Any]:
    """Return the JSON document of an identification of that form, with measured points."""
    one = identified_form() if one is None else one
    form = one.form
    random = np.random.default_rng(seed)
    v_n, v_c = form.nonlinear_critical_speed, form.critical_speed
    low = v_c - 2.0
    speeds = low + 0.2 * np.arange(15)
    states = []
    for direction in ('up', 'down'):
        hunts_from = v_c - 0.3 if direction == 'up' or v_n is None else v_n
        for speed in speeds:
            amplitude = float(form.stable_amplitude(speed))
            hunting = speed >= hunts_from and np.isfinite(amplitude)
            true = amplitude if hunting else 2.2e-5 + 1e-5 * (speed - low)
            states.append(
                {
                    'speed_mps': float(speed),
                    'amplitude_m': float(true * (1.0 + 0.01 * random.standard_normal())),
                    'amplitude_std_m': 0.012 * true,
                    'direction': direction,
                    'cycles': 62,
                }
            )
    grid = np.linspace(low, v_c + 0.8, 29)
    unstable, stable = form.steady_amplitudes(grid)
    draws = one.draws(200, seed=4)
    folds = [x for x in (draw.nonlinear_critical_speed for draw in draws) if x is not None]
    fold = None if v_n is None else Uncertain(v_n, float(np.std(folds))).to_json()
    width = (
        None
        if v_n is None
        else Uncertain(v_c - v_n, float(np.hypot(np.std(folds), one.std('v_c')))).to_json()
    )
    return {
        'v_c': Uncertain(v_c, one.std('v_c')).to_json(),
        'v_n': fold,
        'hysteresis_width': width,
        'coefficients': {
            name: Uncertain(getattr(form, name), one.std(name)).to_json()
            for name in PARAMETERS[1:]
        },
        'criticality': form.criticality,
        'length_scale_m': form.length_scale,
        'time_scale_s': form.time_scale,
        'coordinate': 'amplitude',
        'branches': [
            {
                'speed_mps': float(v),
                'stable_amplitude_m': float(s) if np.isfinite(s) else None,
                'unstable_amplitude_m': float(u) if np.isfinite(u) else None,
            }
            for v, s, u in zip(grid, stable, unstable, strict=True)
        ],
        'steady_states': states,
        'observed': {
            'v_c': v_c - 0.3,
            'v_n': None if v_n is None else v_n + 0.1,
            'hysteresis_width': None if v_n is None else v_c - v_n - 0.4,
            'step_mps': 0.2,
        },
        'disturbance_m': Uncertain(1.48e-4, 0.9e-5).to_json(),
        'four_point': {
            'D4': 1988.2,
            'D7': -0.051,
            'D10': -410.4,
            'D15': -4.13e7,
            'condition_number': 3.1e4,
        },
        'fit': {
            'method': 'trajectory least squares',
            'segments': 31,
            'residual_rms_m': 4.6e-6,
            'lack_of_fit': False,
            'condition_number': 212.0,
        },
        'warnings': ['v_n: the last hunting plateau and the first quiet one are 0.2 m/s apart'],
    }


@pytest.fixture
def identified() -> Callable[..., IdentifiedNormalForm]:
    """Make an identified form with a covariance; of the paper's by default."""
    return identified_form


@pytest.fixture
def document() -> Callable[..., dict[str, Any]]:
    """Make the JSON document of an identification; of the paper's form by default."""
    return identification_document
