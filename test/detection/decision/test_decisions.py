"""The decisions over whole paths of the amplitude equation, with the form that made them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from decided import ROWS, decided, noise

from hunt_ros.detection import doubts
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import decisions, states
from hunt_ros.detection.decision.form import form_numbers
from hunt_ros.detection.decision.outlook import OutlookTable
from hunt_ros.detection.decision.rules import rules_of
from hunt_ros.detection.regions import State
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm

SUBCRITICAL = PAPER_NORMAL_FORM
#: Its cubic term turned round: limit cycles that begin at zero at v_c.
SUPERCRITICAL = NormalForm(
    critical_speed=SUBCRITICAL.critical_speed,
    D1=SUBCRITICAL.D1,
    D4=-10.0 * abs(SUBCRITICAL.D4),
    D7=SUBCRITICAL.D7,
    D10=0.0,
    D15=SUBCRITICAL.D15,
    length_scale=SUBCRITICAL.length_scale,
    time_scale=SUBCRITICAL.time_scale,
)
PERIOD, PATHS = 0.01, 24
HUNTING = (State.ESCAPING, State.LIMIT_CYCLE)


def _paths(
    form: NormalForm, quiet: float, plateau: float, seconds: float, rms: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return speed (m,) and phasors (m, PATHS): 40 s quiet (r.m.s. in m), then a plateau."""
    rng = np.random.default_rng(7)
    diffusion = -0.5 * float(form.growth_rate(quiet)) * rms**2
    speed = np.full(round((40.0 + seconds) / PERIOD), plateau)
    speed[: round(40.0 / PERIOD)] = quiet
    z = np.zeros(PATHS, dtype=np.complex128)
    found = np.empty((speed.size, PATHS), dtype=np.complex128)
    for k, v in enumerate(speed):
        shock = rng.standard_normal((PATHS, 2)) @ np.array([1.0, 1j])
        z = z * (1.0 + np.asarray(form.growth_rate(v, np.abs(z))) * PERIOD)
        z += math.sqrt(2.0 * diffusion * PERIOD) * shock
        found[k] = z
    return speed, found


def _states(form: NormalForm, speed: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the states of one path, shape (m,)."""
    known = IdentifiedNormalForm(form)
    rules = rules_of(DetectorConfig(), 6.4, form.critical_speed)
    found, memory = [], decisions.fresh_memory()
    table, numbers, second = OutlookTable(known), form_numbers(known), round(1.0 / PERIOD)
    for begin in range(0, z.size, second):
        noise = memory['floor'][0]
        memory['outlook'] = table.at(
            float(speed[begin]),
            float(noise['intensity']),
            float(noise['spread']),
            states.CALM * math.sqrt(noise['square']),
            0.0,
        )
        part = slice(begin, begin + second)
        found.append(decided(np.abs(z[part]), rules, numbers, memory, speed[part])['state'])
    return np.concatenate(found)


@pytest.mark.parametrize('excess', [0.0, 0.002])
def test_an_alarm_on_a_plateau_at_the_critical_speed_does_not_fall_back(excess: float) -> None:
    form, plateau = SUBCRITICAL, (1.0 + excess) * SUBCRITICAL.critical_speed
    speed, z = _paths(form, 0.9 * form.critical_speed, plateau, 150.0, 12e-6)
    half = 0.5 * float(form.stable_amplitude(plateau))
    hunted, back, late = 0, 0, 0
    for path in z.T:
        hunting = np.isin(_states(form, speed, path), HUNTING)
        arrived = np.abs(path) > half
        if not arrived.any():
            continue
        hunted += 1
        first = int(np.argmax(arrived))
        back += int((hunting[: first - 1] & ~hunting[1:first]).any())
        late += not hunting[first]
    assert hunted > 0.6 * PATHS
    assert late == 0
    assert back <= 0.1 * hunted  # the chance that an alarm asks for leaves 5 %


def test_a_limit_cycle_that_the_noise_hides_is_no_alarm() -> None:
    form = SUPERCRITICAL
    plateau = 1.0005 * form.critical_speed
    speed, z = _paths(form, 0.9 * form.critical_speed, plateau, 100.0, 12e-6)
    said = [np.isin(_states(form, speed, path), HUNTING).any() for path in z.T]
    assert sum(said) <= 0.05 * PATHS


def test_a_limit_cycle_of_a_few_noise_floors_is_found() -> None:
    form = SUPERCRITICAL
    speed, z = _paths(form, 0.9 * form.critical_speed, 1.05 * form.critical_speed, 100.0, 12e-6)
    hunting = np.array([np.isin(_states(form, speed, path), HUNTING) for path in z.T])
    assert hunting[:, hunting.shape[1] // 2 :].mean() > 0.95


def test_a_limit_cycle_that_the_form_has_die_out_refutes_the_form() -> None:
    """The probability of escape was 0 beside LIMIT CYCLE, and the margin 3."""
    late = replace(PAPER_NORMAL_FORM, critical_speed=12.0)
    quiet = noise(60.0, rms=8e-6)
    path = np.abs(quiet + np.where(np.arange(quiet.size) > 20 * ROWS, 4e-4, 0.0))
    form, memory = IdentifiedNormalForm(late), decisions.fresh_memory()
    memory['outlook'] = OutlookTable(form).at(7.2, 1e-12, 0.1, 2e-5, 0.0)
    rules = rules_of(DetectorConfig(), 9.6, 12.0)
    rows = decided(path, rules, form_numbers(form), memory, speed=7.2)
    cycle = rows[rows['state'] == State.LIMIT_CYCLE]
    assert cycle.size > 10 * ROWS
    assert np.isnan(cycle['escape_probability']).all()
    assert np.isnan(cycle['margin']).all()
    assert ((cycle['doubts'] & doubts.REFUTED) != 0).all()
