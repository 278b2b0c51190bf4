"""What the form says about a row: properties, and the exact theory beside the closed formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from hunt_ros.detection.decision import form
from hunt_ros.detection.decision.form import FormNumbers, form_numbers
from hunt_ros.detection.decision.outlook import NO_OUTLOOK, OUTLOOK, QUANTILES, OutlookTable
from hunt_ros.detection.output import blank_rows
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM

FORM = PAPER_NORMAL_FORM
COVARIANCE = np.diag([0.05, 0.005, 3.0, 0.005, 60.0, 1e4]) ** 2
EXACT = form_numbers(IdentifiedNormalForm(FORM))
TABLES = [OutlookTable(IdentifiedNormalForm(FORM, c)) for c in (np.zeros((6, 6)), COVARIANCE)]


def _row(
    numbers: FormNumbers,
    speed: float,
    amplitude: float,
    std: float,
    outlook: np.ndarray = NO_OUTLOOK,
    roughness: float = 0.0,
) -> np.void:
    rows = blank_rows(np.zeros(1, dtype=np.int64))
    rows['speed'], rows['lateral_roughness'] = speed, roughness
    form.fill_branches(numbers, rows)
    form.predict(numbers, outlook[0], speed, amplitude, std, rows[0])
    return rows[0]


speeds = st.floats(5.0, 9.0)
#: What divides by less overflows, and plain Python warns of it.
stds = st.floats(0.0, 1e-4, allow_subnormal=False)


def _outlook(centre: float, width: float, minute: float) -> np.ndarray:
    """Outlook with an evenly distributed deciding amplitude, m; escapes in a minute."""
    outlook = np.zeros(1, dtype=OUTLOOK)
    outlook['decides'] = centre + width * np.linspace(-0.5, 0.5, QUANTILES)
    outlook['latest'] = outlook['decides'] + width
    outlook['earliest'] = outlook['decides'] - width
    outlook['next_minute'] = minute
    return outlook


@settings(deadline=None)
@given(speeds, stds, st.floats(1e-4, 5e-4), st.floats(0.0, 1.0))
def test_the_chance_of_escape_lies_between_0_and_1_and_grows_with_amplitude(
    speed, std, centre, rate
) -> None:
    outlook = _outlook(centre, 1e-4, rate)
    rows = [
        _row(EXACT, speed, amplitude, std, outlook) for amplitude in np.linspace(0.0, 1e-3, 25)
    ]
    for name in ('escape_probability', 'outlook'):
        values = np.array([float(row[name]) for row in rows])
        assert np.all((values >= 0.0) & (values <= 1.0))
        assert np.all(np.diff(values) >= -1e-12)
    assert all(float(row['outlook']) >= float(row['escape_probability']) - 1e-12 for row in rows)
    for row in rows:
        low, high = row['escape_probability_low'], row['escape_probability_high']
        assert 0.0 <= low <= row['escape_probability'] <= high <= 1.0


def test_the_chance_is_that_of_the_amplitude_averaged_over_its_deviation() -> None:
    outlook = _outlook(3e-4, 1e-4, 0.0)
    rng = np.random.default_rng(1)
    for amplitude in (2.2e-4, 3e-4, 3.3e-4):
        about = amplitude + 4e-5 * rng.standard_normal(4000)
        expected = np.mean(about[:, None] > outlook['decides'])
        found = float(_row(EXACT, 7.2, amplitude, 4e-5, outlook)['escape_probability'])
        assert found == pytest.approx(expected, abs=0.02)
    assert math.isnan(_row(EXACT, 7.2, 1e-4, 1e-5)['escape_probability'])


@settings(deadline=None)
@given(
    st.sampled_from(TABLES),
    st.floats(6.5, 7.9),
    st.floats(1e-6, 1e-3),
    stds,
)
def test_the_interval_of_the_margin_holds_the_margin(table, speed, amplitude, std) -> None:
    outlook = table.at(speed, 0.0, 0.0, math.nan, 0.0)
    row = _row(EXACT, speed, amplitude, std, outlook)
    assert row['margin_low'] <= row['margin'] <= row['margin_high']
    assert row['margin'] == pytest.approx(float(FORM.unstable_amplitude(speed)) / amplitude)


@pytest.mark.parametrize('line', [10e-6, 30e-6, 60e-6])
def test_roughness_lowers_the_edge_as_the_line_does(line: float) -> None:
    # To first order, of a line that is incommensurate with the hunting.
    expected = math.sqrt(float(FORM.unstable_amplitude(7.4)) ** 2 - 2.0 * line**2)
    row = _row(EXACT, 7.4, 1e-4, 0.0, roughness=line)
    assert float(row['unstable_amplitude']) == pytest.approx(expected, rel=0.03)


@settings(deadline=None)
@given(st.floats(6.6, 8.6), st.floats(0.05, 0.85))
def test_the_time_to_the_cycle_is_that_of_the_dynamics(speed, share) -> None:
    unstable, stable = (float(x) for x in FORM.steady_amplitudes(speed))
    low = 1.03 * unstable if math.isfinite(unstable) else 1e-5
    amplitude = low + share * (0.9 * stable - low)
    row = _row(EXACT, speed, amplitude, 0.0)
    found = form.time_to_cycle(EXACT, speed, amplitude, row)
    ends = math.log(amplitude), math.log(0.9 * stable)
    expected, _ = quad(lambda x: 1.0 / float(FORM.growth_rate(speed, math.exp(x))), *ends)
    assert found == pytest.approx(expected, rel=0.01)


def test_without_a_limit_cycle_there_is_no_time_to_it_and_on_it_none_is_left() -> None:
    below, beyond = (_row(EXACT, speed, 1e-4, 0.0) for speed in (5.0, 7.2))
    assert math.isnan(form.time_to_cycle(EXACT, 5.0, 1e-4, below))
    stable = float(beyond['stable_amplitude'])
    assert form.time_to_cycle(EXACT, 7.2, 0.95 * stable, beyond) == 0.0
