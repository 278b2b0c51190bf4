"""Limit cycles against time integration, harmonic balance, and the normal form."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cycles_made import at_speed, exponent
from fitted_form import fitted_form
from scipy.integrate import solve_ivp

from hunt_ros.dynamics import limit_cycle
from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.limit_cycle import Branch, limit_cycles
from hunt_ros.dynamics.parameters import RigParameters, paper_rig
from hunt_ros.dynamics.wheelset import Wheelset

CASES: list[dict[str, Any]] = json.loads(
    (Path(__file__).parent / 'data' / 'normal_forms.json').read_text(encoding='utf-8')
)['cases']


@pytest.fixture(scope='module')
def branch() -> Branch:
    return limit_cycles(paper_rig())


def integrated(
    rig: RigParameters, speed: float, start: list[float], seconds: float
) -> tuple[float, float]:
    """Fundamental amplitude of y (m) and period (s) at the end of a long integration."""
    wheelset = Wheelset(rig)
    end = seconds / rig.time_scale

    def crossing(t: float, x: np.ndarray) -> float:
        return float(x[0])

    crossing.direction = 1.0  # type: ignore[attr-defined]
    run = solve_ivp(
        lambda t, x: wheelset.derivative(x, speed),
        (0.0, end),
        start,
        method='DOP853',
        rtol=1e-9,
        atol=1e-13,
        events=crossing,
        dense_output=True,
    )
    first, last = run.t_events[0][-4], run.t_events[0][-1]
    t = np.linspace(first, last, 3 * 256 + 1)[:-1]
    y = run.sol(t)[0]
    wave = np.exp(-2j * np.pi * 3 * np.arange(t.size) / t.size)
    return 2 * abs(np.mean(y * wave)) * rig.length_scale, (last - first) / 3 * rig.time_scale


@pytest.mark.parametrize('speed', [6.6, 7.2, 8.8])
def test_a_stable_cycle_is_where_a_long_integration_ends(branch: Branch, speed: float) -> None:
    cycles = at_speed(branch, speed)
    stable = cycles.amplitude[cycles.stable][0]
    amplitude, period = integrated(paper_rig(), speed, [0.013, 0, 0, 0], 30.0)
    assert stable == pytest.approx(amplitude, rel=1e-4)
    assert cycles.frequency_hz[cycles.stable][0] == pytest.approx(1 / period, rel=1e-6)


def test_the_unstable_cycle_divides_what_dies_from_what_grows(branch: Branch) -> None:
    cycle = at_speed(branch, 7.2)
    n = cycle.system.points
    x, omega = cycle.unknowns[0], cycle.unknowns[0][-2]
    y, psi = (x[k * n : (k + 1) * n] * cycle.system.largest for k in (0, 1))
    on_cycle = np.array(
        [y[0], omega * (cycle.system.first @ y)[0], psi[0], omega * (cycle.system.first @ psi)[0]]
    )
    unstable = float(cycle.amplitude[0])
    amplitudes = [
        integrated(paper_rig(), 7.2, list(on_cycle * factor), 5.0)[0] for factor in (0.99, 1.01)
    ]
    grown = np.log(np.abs(np.array(amplitudes) / unstable - 1) / 0.01)
    assert amplitudes[0] < unstable < amplitudes[1]
    # the disturbance of 1 % grows by exp(exponent * time) to its first order
    rate = float(exponent(cycle)[0])
    assert grown.mean() == pytest.approx(rate * (5.0 - 1.5 / 2.835), rel=0.15)


def test_the_numbers_known_of_the_default_rig(branch: Branch) -> None:
    folds = branch.folds()
    assert len(folds) == 1
    assert folds[0][0] == pytest.approx(6.433, abs=1e-3)
    assert folds[0][1] == pytest.approx(0.480e-3, abs=2e-6)
    unstable = [1e6 * float(at_speed(branch, v).amplitude[0]) for v in (6.6, 7.2, 7.6)]
    assert unstable == pytest.approx([379, 237, 155], abs=1)
    stable = [1e3 * float(at_speed(branch, v).amplitude[-1]) for v in (6.45, 7.2, 8.8)]
    assert stable == pytest.approx([0.507, 0.635, 0.703], abs=2e-3)


def test_the_fold_is_where_the_exponent_changes_sign(
    branch: Branch, monkeypatch: pytest.MonkeyPatch
) -> None:
    speed, amplitude = branch.folds()[0]
    change = np.flatnonzero(np.diff(branch.stable))
    assert len(change) == 1
    near = slice(change[0], change[0] + 2)
    assert branch.amplitude[near].min() <= amplitude <= branch.amplitude[near].max()
    assert speed <= branch.speed.min() + 1e-9
    monkeypatch.setattr(limit_cycle, 'STEP', 0.01)
    monkeypatch.setattr(limit_cycle, 'POINTS', 24)
    finer = limit_cycles(paper_rig()).folds()[0]
    assert (speed, amplitude) == pytest.approx(finer, rel=2e-5)


def test_each_speed_has_two_cycles_below_v_c_and_one_above(branch: Branch) -> None:
    fold = branch.folds()[0][0]
    for speed in np.random.default_rng(0).uniform(fold + 2e-3, 9.9, 60):
        cycles = at_speed(branch, float(speed))
        assert cycles.amplitude.size == (2 if speed < branch.critical_speed else 1), speed
        np.testing.assert_allclose(cycles.speed, speed, rtol=1e-12)


@pytest.mark.parametrize('case', CASES, ids=range(len(CASES)))
def test_cycles_of_the_reference_rigs_are_those_of_harmonic_balance(case: dict[str, Any]) -> None:
    """Rigs with all twenty nonlinear coefficients; three odd harmonics there, eight here."""
    rig = RigParameters(alpha=case['alpha'], beta=case['beta'])
    rig = rig.with_linear(case['d11'], case['d22'])
    v_c = case['v_c_star'] * rig.speed_scale
    branch = limit_cycles(replace(rig, flange_clearance_m=0.0075 * rig.length_scale))
    for cycle in case['limit_cycles_by_harmonic_balance']:
        there = at_speed(branch, v_c * (1 + cycle['epsilon']))
        wanted = cycle['fundamental_amplitude_of_y_star'] * rig.length_scale
        place = int(np.argmin(np.abs(there.amplitude - wanted)))
        assert there.amplitude[place] == pytest.approx(wanted, rel=1e-5)
        omega = 2 * np.pi * there.frequency_hz[place] * rig.time_scale
        assert omega == pytest.approx(cycle['omega'], rel=1e-7)


def test_near_the_hopf_point_the_normal_form_gives_amplitude_and_exponent(branch: Branch) -> None:
    form = normal_form_of(paper_rig()).amplitude_coordinate
    speed = 7.99
    cycle = at_speed(branch, speed)
    unstable = float(form.unstable_amplitude(speed))
    assert cycle.amplitude[0] == pytest.approx(unstable, rel=1e-4)
    rates = form.growth_rate(speed, unstable * np.array([1.0 - 1e-5, 1.0 + 1e-5]))
    assert exponent(cycle)[0] == pytest.approx(np.diff(rates)[0] / 2e-5, rel=1e-2)


def test_the_quintic_form_nearest_to_the_branch_follows_it_through_the_fold(
    branch: Branch,
) -> None:
    theory = normal_form_of(paper_rig())

    taylor, fitted = theory.amplitude_coordinate, fitted_form(theory, branch, (6.4, 9.0))
    v_n = branch.nonlinear_critical_speed
    assert taylor.nonlinear_critical_speed > v_n + 0.5  # the expansion does not reach the fold
    assert fitted.nonlinear_critical_speed == pytest.approx(v_n, abs=0.02)
    inside = (branch.speed >= 6.6) & (branch.speed <= 9.0)
    unstable, stable = fitted.steady_amplitudes(branch.speed)
    for found, wanted, error in ((unstable, ~branch.stable, 0.01), (stable, branch.stable, 0.005)):
        use = inside & wanted
        np.testing.assert_allclose(found[use], branch.amplitude[use], rtol=error)


def test_a_supercritical_rig_has_one_stable_branch_without_fold() -> None:
    rig = RigParameters(beta={'30': -400.0})
    branch = limit_cycles(rig)
    assert branch.stable.all()
    assert branch.folds() == []
    assert branch.nonlinear_critical_speed is None
    assert branch.speed.min() >= branch.critical_speed
