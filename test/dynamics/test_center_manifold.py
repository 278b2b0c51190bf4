"""The normal form against the reference, the eigenvalue, and the limit cycles themselves."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.linear_stability import critical_frequency, critical_speed
from hunt_ros.dynamics.parameters import CUBIC_KEYS, QUINTIC_KEYS, RigParameters
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError

CASES: list[dict[str, Any]] = json.loads(
    (Path(__file__).parent / 'data' / 'normal_forms.json').read_text(encoding='utf-8')
)['cases']


def rig_of(case: dict[str, Any]) -> RigParameters:
    rig = RigParameters(alpha=case['alpha'], beta=case['beta'])
    return rig.with_linear(case['d11'], case['d22'])


def linear_rigs(count: int, seed: int) -> list[RigParameters]:
    """Return rigs with a Hopf point and random creep, conicity, mass and springs."""
    rng = np.random.default_rng(seed)
    rigs: list[RigParameters] = []
    while len(rigs) < count:
        rig = RigParameters(
            tread_angle=rng.uniform(0.02, 0.3),
            wheel_radius_m=rng.uniform(0.02, 0.06),
            lateral_frequency_rad_per_s=rng.uniform(4.0, 20.0),
        ).with_linear(*rng.uniform(0.5, 5.0, 2))
        try:
            critical_speed(rig)
        except ConfigError:
            continue
        rigs.append(rig)
    return rigs


@pytest.mark.parametrize('case', CASES, ids=range(len(CASES)))
def test_every_reference_case_agrees_to_1e_8(case: dict[str, Any]) -> None:
    form = normal_form_of(rig_of(case))
    assert form.critical_speed / rig_of(case).speed_scale == pytest.approx(case['v_c_star'], 1e-12)
    assert form.omega == pytest.approx(case['omega'], rel=1e-12)
    names = {'w210': 'w210_y', 'w101': 'w101_y'} | {n: n for n in ('D1', 'D4', 'D7', 'D10', 'D15')}
    for own, theirs in names.items():
        wanted = complex(*case[theirs])
        assert abs(getattr(form, own) - wanted) < 1e-8 * abs(wanted), own


@pytest.mark.parametrize('case', CASES, ids=range(len(CASES)))
def test_the_amplitude_coordinate_gives_the_speed_of_harmonic_balance(
    case: dict[str, Any],
) -> None:
    """The error left is of the next order, a^4 relative to eps: 16 times at twice a."""
    form = normal_form_of(rig_of(case))
    real = form.amplitude_coordinate
    errors = []
    for cycle in case['limit_cycles_by_harmonic_balance']:
        amplitude = cycle['fundamental_amplitude_of_y_star']
        r2 = (amplitude / 2) ** 2
        roots = np.roots([real.D7, real.D1 + real.D10 * r2, real.D4 * r2 + real.D15 * r2**2])
        eps = roots[np.argmin(np.abs(roots))]
        errors.append(abs(eps / cycle['epsilon'] - 1))
    assert errors[0] < 1e-5
    assert errors[1] / errors[0] == pytest.approx(16, rel=0.1)


def test_d1_and_d7_of_a_hundred_rigs_are_the_derivatives_of_the_eigenvalue() -> None:
    h = 2e-3
    rigs = linear_rigs(100, seed=1)
    for rig in rigs:
        form, v_c, near = normal_form_of(rig), critical_speed(rig), 1j * critical_frequency(rig)
        tracked = []
        for step in (-2, -1, 0, 1, 2):
            values = np.linalg.eigvals(Wheelset(rig).linear_matrix(v_c * (1.0 + h * step)))
            tracked.append(values[np.argmin(np.abs(values - near))])
        d1 = np.dot(tracked, [1, -8, 0, 8, -1]) / (12.0 * h)
        d7 = np.dot(tracked, [-1, 16, -30, 16, -1]) / (24.0 * h**2)
        assert abs(form.D1 - d1) < 1e-8 * max(abs(d7), abs(d1))
        assert abs(form.D7 - d7) < 1e-7 * max(abs(d7), abs(d1))
        assert form.D4 == form.D10 == form.D15 == 0
        assert form.omega == critical_frequency(rig)


@given(seed=st.integers(0, 10**6), factor=st.floats(0.2, 5.0))
@settings(max_examples=25, deadline=None)
def test_coefficients_scale_with_the_unit_of_length_of_the_nonlinearity(
    seed: int, factor: float
) -> None:
    """With x -> x / s the cubic terms gain s^2 and the quintic ones s^4, and so do D4, D15."""
    rng = np.random.default_rng(seed)
    alpha, beta = (
        {key: float(rng.normal(0, 50)) for key in CUBIC_KEYS + QUINTIC_KEYS} for _ in range(2)
    )

    def scaled(terms: dict[str, float]) -> dict[str, float]:
        return {k: t * factor ** (int(k[0]) + int(k[1]) - 1) for k, t in terms.items()}

    one = normal_form_of(RigParameters(alpha=alpha, beta=beta))
    other = normal_form_of(RigParameters(alpha=scaled(alpha), beta=scaled(beta)))
    for name, power in (('D4', 2), ('D10', 2), ('D15', 4), ('w210', 2)):
        wanted = getattr(one, name) * factor**power
        assert abs(getattr(other, name) - wanted) < 1e-9 * abs(wanted) + 1e-12


def test_a_degenerate_pair_is_refused_by_name() -> None:
    """Where the Hopf point goes to infinite speed, both pairs meet on the imaginary axis."""
    table = RigParameters(name='double')
    coupling = table.k21 / table.d22
    d = (1.0 - table.k11) / 2.0 / np.sqrt(coupling)  # no Hopf point below it
    assert normal_form_of(table.with_linear(1.01 * d, 1.01 * d)).D1.real > 0.0
    with pytest.raises(ConfigError, match=r'double: degenerate critical eigenvalues \(.*j'):
        normal_form_of(table.with_linear(d * (1 + 1e-12), d * (1 + 1e-12)))
    with pytest.raises(ConfigError, match='double: no Hopf point'):
        normal_form_of(table.with_linear(0.99 * d, 0.99 * d))
