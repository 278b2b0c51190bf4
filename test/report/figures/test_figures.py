"""What the figures draw: the right curves, points and words, for any kind of rig."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from report_made import identification_of, identified_form

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds, SteadyState
from hunt_ros.detection import Event
from hunt_ros.detection.regions import Level
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.limit_cycle import limit_cycles
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.report.choice import either_side, four_states
from hunt_ros.report.figures.bifurcation import hysteresis_loop, identified_diagram
from hunt_ros.report.figures.diagram import (
    Curve,
    bands_of_draws,
    bifurcation_diagram,
    branch_curve,
    branch_points,
    draw_branches,
    form_curve,
)
from hunt_ros.report.figures.overview import run_overview
from hunt_ros.report.figures.response_panels import response_panels
from hunt_ros.report.figures.style import journal_style, new_figure, svg
from hunt_ros.report.response import response_of
from hunt_ros.samples import Record, Series

SUPERCRITICAL = replace(PAPER_NORMAL_FORM, D4=-2030.0)


def words(figure: Figure) -> str:
    """All text of a figure."""
    from matplotlib.text import Text

    return ' | '.join(text.get_text() for text in figure.findobj(Text) if isinstance(text, Text))


def line(figure: Figure, label: str) -> tuple[np.ndarray, np.ndarray]:
    for axes in figure.axes:
        for one in axes.lines:
            if one.get_label() == label:
                return np.asarray(one.get_xdata()), np.asarray(one.get_ydata())
    raise AssertionError(f'no line {label!r}')


# --- the branches ---------------------------------------------------------------------


@given(
    st.floats(0.01, 1.0), st.floats(100.0, 1e4), st.floats(-0.5, 0.5), st.floats(-500.0, 500.0),
    st.floats(-1e8, -1e6),
)  # fmt: skip
def test_both_branches_start_at_the_fold_and_the_unstable_one_ends_at_v_c(
    d1: float, d4: float, d7: float, d10: float, d15: float
) -> None:
    form = NormalForm(8.0, D1=d1, D4=d4, D7=d7, D10=d10, D15=d15)
    fold = form.saddle_node()
    # Outside: no fold in the figure, or a second Hopf point in it (D7).
    assume(fold is not None and 4.5 < fold[0] < 7.9 and d1 + 0.125 * d7 > 0.0)
    assert fold is not None
    speed, unstable, stable = branch_points(form, 4.0, 9.0)
    assert np.all(np.diff(speed) > 0.0)
    at = int(np.flatnonzero(speed == fold[0])[0])
    assert unstable[at] == stable[at] == fold[1]
    assert np.isnan(stable[at - 1])  # further down a large D7 may bring a second fold
    assert np.isfinite(stable[at:]).sum() > 10
    hopf = int(np.flatnonzero(speed == 8.0)[0])
    assert unstable[hopf] == 0.0
    assert np.isnan(unstable[hopf + 1])


def test_the_quiet_state_is_dashed_where_it_grows() -> None:
    # A second Hopf point at eps = -D1/D7 = 0.0625: quiet again above 8.5 m/s.
    form = replace(PAPER_NORMAL_FORM, D1=0.03125, D7=-0.5)
    with journal_style():
        axes = new_figure().subplots()
        draw_branches(axes, [form_curve(form, 7.0, 9.0)])
    zero = [one for one in axes.lines if np.nanmax(np.abs(one.get_ydata())) == 0.0]
    spans = {one.get_linestyle(): one.get_xdata()[np.isfinite(one.get_ydata())] for one in zero}
    assert set(spans) == {'-', '--'}
    assert (spans['--'].min(), spans['--'].max()) == pytest.approx((8.0, 8.5), abs=0.01)
    assert not np.any((spans['-'] > 8.01) & (spans['-'] < 8.49))


def test_the_branches_of_a_supercritical_form_leave_zero_at_v_c() -> None:
    speed, unstable, stable = branch_points(SUPERCRITICAL, 7.0, 9.0)
    assert np.isnan(unstable).all()
    assert stable[speed == 8.0] == 0.0
    assert np.isnan(stable[speed < 8.0]).all()


def test_lines_points_and_bands_are_all_there() -> None:
    branch = limit_cycles(paper_rig())
    paper = form_curve(PAPER_NORMAL_FORM, 6.0, 9.0, 'paper', colour='#111111')
    v = np.linspace(7, 8, 5)
    edges = {'stable': (v, 4e-4 + 0 * v, 6e-4 + 0 * v)}
    banded = Curve('banded', v, 0 * v, 5e-4 + 0 * v, bands=edges, colour='#222222')
    states = [SteadyState(v, 6.8e-4, 1e-5, 'up', 60) for v in (8.2, 8.4)]
    figure = bifurcation_diagram(
        [branch_curve(branch, 'full', colour='#000000'), paper, banded], 6.0, 9.0, {'': states}
    )
    axes = figure.axes[0]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ['full', 'paper', 'banded', 'speed up']
    stable = axes.get_lines()[0]
    drawn = np.asarray(stable.get_ydata(), dtype=float)
    assert np.nanmax(drawn) == pytest.approx(1e3 * branch.amplitude.max())
    assert axes.get_xlim() == (6.0, 9.0)
    assert len(axes.collections) >= 2  # the band and the error bars
    dashes = [line.get_linestyle() for line in axes.get_lines()[:4]]
    assert dashes == ['-', '--', '-', '--']


def test_a_picture_of_nothing_has_an_axis() -> None:
    nothing = np.full(3, np.nan)
    empty = Curve('none', np.linspace(6, 9, 3), nothing, nothing)
    figure = bifurcation_diagram([empty], 6.0, 9.0)
    assert figure.axes[0].get_ylim()[1] == 1.0


# --- bands ----------------------------------------------------------------------------


def test_the_bands_hold_the_branch_and_so_many_of_the_draws() -> None:
    one = identified_form()
    bands = bands_of_draws(one, 6.0, 9.0)
    speed, lower, upper = bands['unstable']
    inside = np.abs(speed - 7.2) < 0.02
    truth = one.form.unstable_amplitude(speed)
    assert np.all((lower < truth)[inside] & (truth < upper)[inside])
    fresh = [form.unstable_amplitude(7.2) for form in one.draws(2000, seed=99)]
    low, high = (np.interp(7.2, speed, edge) for edge in (lower, upper))
    assert np.mean((fresh > low) & (fresh < high)) == pytest.approx(0.95, abs=0.03)


def test_a_form_taken_as_exact_has_no_band() -> None:
    assert bands_of_draws(IdentifiedNormalForm(PAPER_NORMAL_FORM), 6.0, 9.0) == {}


# --- the figures ----------------------------------------------------------------------


@pytest.mark.parametrize('form', [PAPER_NORMAL_FORM, SUPERCRITICAL])
def test_the_measured_points_stand_where_they_were_measured(form: NormalForm) -> None:
    one = identification_of(form)
    up = [state for state in one.steady_states if state.direction == 'up']
    for figure in (hysteresis_loop(one), identified_diagram(one)):
        points = [
            container.lines[0].get_xydata()
            for axes in figure.axes
            for container in axes.containers
            if container.get_label() == 'speed up'
        ]
        assert len(points) == 1
        expected = [(state.speed, 1e3 * state.amplitude) for state in up]
        np.testing.assert_allclose(points[0], expected, rtol=1e-12)
        assert '(m/s)' in words(figure)
        assert '(mm)' in words(figure)


def test_the_hysteresis_loop_names_the_observed_speeds_and_the_panels() -> None:
    figure = hysteresis_loop(identification_of(), {'a': (6.0, 2e-5), 'd': (7.2, 6.3e-4)})
    text = words(figure)
    for part in ('$v_c$ observed\n7.70 m/s', '$v_n$ observed\n6.51 m/s', '(a)', '(d)'):
        assert part in text
    nothing = identification_of(observed=ObservedCriticalSpeeds())
    assert 'observed' not in words(hysteresis_loop(nothing))


def test_no_measured_point_is_cut_by_the_axis() -> None:
    one = identification_of()
    states = [replace(state, amplitude=0.0) for state in one.steady_states[:2]]
    (axes, *_) = hysteresis_loop(replace(one, steady_states=states)).axes
    low, high = axes.get_ylim()
    assert -0.1 * high < low < 0.0


# --- the run ----------------------------------------------------------------------------


def test_an_hour_of_samples_is_a_small_picture_with_its_extremes() -> None:
    seconds = np.arange(0.0, 3600.0, 0.01)
    speed = 6.0 + 0.01 * np.random.default_rng(0).standard_normal(seconds.size)
    speed[200_000] = 8.0
    speed[300_000:310_000] = np.nan
    record = Record({'speed': Series((1e9 * seconds).astype(np.int64), speed)}, 'a')
    figure = run_overview(record, (seconds, 1e-4 + 0.0 * seconds))
    (curve, *_) = figure.axes[0].lines
    curve.set_gid('speed')
    text = svg(figure)
    assert len(text) < 400_000
    peak = curve.get_transform().transform((2000.0, 8.0))[1] * 72.0 / figure.dpi
    top = 72.0 * figure.get_figheight() - peak
    heights = re.findall(r'L [\d.]+ ([\d.]+)', text[text.index('id="speed"') :].split('</g>')[0])
    assert min(map(float, heights)) == pytest.approx(top, abs=0.3)


def test_the_overview_marks_the_events_at_their_time() -> None:
    stamps = np.arange(0, 100 * 10**9, 10**8)
    record = Record({'speed': Series(stamps, np.linspace(6.0, 8.0, stamps.size))}, 'a')
    numbers = {'speed_mps': 7.0, 'amplitude_m': 6e-4}
    events = [Event(40 * 10**9, 'limit_cycle', Level.ERROR, 0, '', '', '', numbers)]
    time = np.linspace(0.0, 100.0, 50)
    figure = run_overview(record, (time, 1e-4 + 0.0 * time), events, (6.4, 8.0))
    x, y = line(figure, 'limit cycle')
    assert (x[0], y[0]) == (40.0, pytest.approx(0.6))
    assert '$v_n$' in words(figure)
    assert words(run_overview(Record({}, 'empty'), (np.zeros(0), np.zeros(0))))


# --- the response ------------------------------------------------------------------------


def test_a_stretch_that_cannot_be_analysed_says_so_panel_by_panel() -> None:
    stamps = np.arange(100) * 10_000_000
    short = Record({'lateral': Series(stamps, 1e-4 * np.sin(0.2 * np.arange(100)))}, 'short')
    response = response_of(short, 7.0, 2.84)
    assert 'not known' in words(response_panels(response, 'a'))
    lost = Record({'lateral': Series(stamps, np.full(100, np.nan))}, 'lost')
    response = response_of(lost, 7.0, 2.84)
    assert list(response.unknown) == ['time history']
    assert response.kind == 'not known'
    assert words(response_panels(response)).count('not known') == 4


@pytest.mark.parametrize(('diameter', 'cut'), [(0.3, 'revolution'), (None, 'hunting')])
def test_without_an_encoder_a_diameter_tells_the_revolutions(
    diameter: float | None, cut: str
) -> None:
    time = np.arange(6000) / 100.0
    wave = 1e-3 * np.sin(2 * np.pi * 2.8 * time) + 1e-4 * np.sin(2 * np.pi * 7.64 * time)
    record = Record({'lateral': Series(np.arange(6000) * 10_000_000, wave)}, 'no encoder')
    response = response_of(record, 7.2, 2.84, diameter)
    assert response.section is not None
    assert response.section.cut == cut
    assert response.spectrum is not None
    assert (response.spectrum.line('roughness') is not None) == (cut == 'revolution')


def state(speed: float, direction: str, amplitude: float, **more: Any) -> SteadyState:
    return SteadyState(speed, amplitude, 0.01 * amplitude, direction, 60, **more)  # type: ignore[arg-type]


def test_without_a_loop_four_speeds_are_spread_evenly() -> None:
    states = [state(6.0 + 0.2 * k, 'up', 1e-5) for k in range(10)]
    assert [round(one.speed, 1) for one in four_states(states)] == [6.0, 6.6, 7.2, 7.8]
    assert len(four_states(states[:2])) == 2
    assert four_states([]) == []


def test_a_sweep_gives_its_ramps_where_it_has_no_plateaus() -> None:
    ends = [state(6.0, 'up', 1e-5), state(8.8, 'up', 7e-4)]
    up = [state(6.2 + 0.2 * k, 'up', 2e-5, kind='ramp') for k in range(9)]
    down = [state(6.6 + 0.2 * k, 'down', 6e-4, kind='ramp') for k in range(9)]
    a, b, c, d = four_states([*ends, *up, *down])
    assert (a.speed, c.speed) == (6.0, 8.8)
    assert (b.direction, d.direction) == ('up', 'down')
    assert b.speed == pytest.approx(d.speed)
    pair = either_side([*ends, *up, *down], 7.9)
    assert [round(one.speed, 1) for one in pair] == [7.8, 8.8]


def test_either_side_of_v_c_are_settled_neighbours_on_the_way_up() -> None:
    states = [
        state(7.6, 'up', 2e-5),
        state(7.8, 'up', 3e-5),
        replace(state(8.0, 'up', 2e-4), amplitude_std=1e-4),  # the jump itself
        state(8.2, 'up', 6.8e-4),
        state(7.9, 'down', 6.7e-4),
    ]
    pair = either_side(states, 7.9)
    assert [one.speed for one in pair] == [7.8, 8.2]
    assert either_side(states, None) == []
    assert either_side(states, 9.0) == []
