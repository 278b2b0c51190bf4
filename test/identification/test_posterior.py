"""What is kept of an identification: the draws, and the file that holds everything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made import LAW

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.dynamics.growth_law import GrowthLaw, GrowthScales
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.errors import IdentificationError
from hunt_ros.identification import Identification
from hunt_ros.identification.posterior import QUANTITIES, Posterior, rank_correlations

SPEEDS = [6.0, 6.8, 7.2, 7.6, 8.4]


@pytest.fixture(scope='module')
def result(identified):
    return identified('sweep')


@pytest.fixture(scope='module')
def kept(result, tmp_path_factory):
    path = tmp_path_factory.mktemp('kept') / 'form.npz'
    result.save(path)
    return path


def test_a_kept_identification_says_the_same_to_the_bit(result, kept):
    again = Identification.load(kept)
    assert again.to_json() == result.to_json()
    assert repr(again) == repr(result)
    for which in ('stable', 'unstable'):
        np.testing.assert_array_equal(again.branch(which, SPEEDS), result.branch(which, SPEEDS))
    assert again.normal_form.to_yaml() == result.normal_form.to_yaml()
    assert again.records == ()


def test_it_belongs_to_the_form_of_its_parameter_file_and_to_no_other(result, kept):
    form = IdentifiedNormalForm.from_yaml(result.normal_form.to_yaml())
    assert Identification.load(kept, form).v_c == result.v_c
    other = replace(form, form=replace(form.form, D4=form.form.D4 * (1.0 + 1e-12)))
    with pytest.raises(IdentificationError, match='another normal form'):
        Identification.load(kept, other)


def test_what_is_no_identification_is_refused_in_a_line(kept, tmp_path):
    whole = kept.read_bytes()
    np.savez(tmp_path / 'other.npz', a=np.zeros(3))
    np.savez(tmp_path / 'newer.npz', head=np.array('{"version": 99}'))
    (tmp_path / 'cut.npz').write_bytes(whole[: len(whole) // 2])
    (tmp_path / 'text.npz').write_text('v_c: 8')
    (tmp_path / 'empty.npz').write_bytes(b'')
    (tmp_path / 'folder.npz').mkdir()
    names = [*(path.name for path in tmp_path.iterdir()), 'missing.npz']
    assert len(names) == 7
    for name in names:
        with pytest.raises(IdentificationError) as error:
            Identification.load(tmp_path / name)
        assert name in str(error.value)
        assert '\n' not in str(error.value)
    with pytest.raises(IdentificationError, match='cannot write'):
        Identification.load(kept).save(tmp_path / 'nowhere' / 'form.npz')


def test_a_branch_is_the_one_of_the_json_and_nan_where_there_is_none(result):
    value, low, high = result.branch('unstable', SPEEDS)
    assert np.isnan(value[[0, 4]]).all()
    assert (low[1:4] < value[1:4]).all()
    assert (value[1:4] < high[1:4]).all()
    point = result.branches[20]
    value, low, high = result.branch('stable', [point.speed])
    np.testing.assert_allclose([value[0], low[0], high[0]], _numbers(point.stable), rtol=1e-12)
    with pytest.raises(IdentificationError, match='lower'):
        result.branch('lower', SPEEDS)


def _numbers(uncertain):
    return [uncertain.value, uncertain.low, uncertain.high]


def test_what_hangs_together_is_drawn_together(result):
    both = [QUANTITIES.index(name) for name in ('D4', 'D15')]
    # Cubic and quintic term share what the limit cycle shows.
    assert rank_correlations(result.posterior.table[:, both])[0, 1] < -0.5
    fold = result.to_json()['fold_amplitude_m']
    low, high = result.branch('stable', [result.v_n.value + 1e-3])[0], fold['value']
    assert abs(low[0] / high - 1.0) < 0.1


def test_it_shows_itself_in_a_line_and_as_a_figure(result):
    assert len(repr(result)) < 200
    assert str(result.v_c) in repr(result)
    assert result.plot().axes
    unknown = replace(result, v_n=None, unknown={'v_n': 'no fold'}, normal_form=None)
    assert 'v_n not known' in repr(unknown)
    assert unknown.plot().axes


def test_limit_cycles_that_a_law_has_far_below_its_fold_belong_to_nothing():
    """Stop and go: hunting was seen at 19.9 m/s and while it died; the law has cycles at 7.4."""
    scales = GrowthScales(14.02, 2.726e-3, 0.0485, 0.0386, 5.0)
    p = [-2.505, 5.408, 3.909, 8.507, -0.4906, -9.041, -9.693, 6.6e-3, 0.6519, 1.0]
    law, speeds = GrowthLaw(np.array(p), scales), (1.44, 19.9)
    assert np.isfinite(law.steady_amplitudes(7.44)[1]).all()
    posterior = Posterior(law, np.tile(law.p, (20, 1)), np.full(20, np.nan), speeds)
    v_n = posterior.number('v_n').value
    assert v_n == pytest.approx(15.86, abs=0.05)
    for form in (posterior.identified(0.0).form, *posterior.forms):
        assert form.saddle_node()[0] == pytest.approx(v_n, rel=2e-3)
    for point in posterior.branch_points():
        assert (point.stable is not None) == (point.speed >= v_n)


@pytest.fixture(scope='module')
def posterior():
    """Of the paper's form, v_n known to 0.03 m/s and v_c to 0.05 m/s."""
    rng = np.random.default_rng(1)
    p = np.tile(LAW.p, (400, 1))
    p[:, 0] += 0.02 * rng.standard_normal(400)
    p[:, 5] *= 1.0 + 0.01 * rng.standard_normal(400)
    return Posterior(LAW, p, np.full(400, np.nan), (6.2, 8.8))


@pytest.fixture(scope='module')
def branches(posterior):
    """Points at which both branches are known."""
    points = posterior.branch_points()
    return [point for point in points if point.unstable is not None and point.stable is not None]


def test_a_jump_known_to_half_a_step_leaves_the_disturbance_as_open(posterior):
    fine, coarse = (
        posterior.disturbance(ObservedCriticalSpeeds(7.4, v_c_between=(7.4 - half, 7.4 + half)))
        for half in (0.001, 0.2)
    )
    assert coarse.value == fine.value
    ends = PAPER_NORMAL_FORM.unstable_amplitude([7.21, 7.59])
    assert coarse.low < ends[1]
    assert coarse.high > ends[0]
    assert fine.high - fine.low < 0.5 * (coarse.high - coarse.low)


def test_a_critical_speed_that_its_draws_do_not_bound_from_above_is_not_given(posterior):
    """In one of 25 draws rest is always stable: more than lie above an interval of 95 %."""
    for without, given in ((8, True), (16, False)):
        p = posterior.p.copy()
        p[:without, :3] = -5.0, 0.0, 0.0
        some = replace(posterior, p=p)
        assert (some.number('v_c') is not None) is given
        assert some.number('v_n') is not None


def test_the_bands_hold_the_branches_and_widen_towards_the_fold(branches):
    assert len(branches) > 15
    for point in branches:
        for one in (point.stable, point.unstable):
            assert one.low <= one.value <= one.high
    widths = [point.unstable.high - point.unstable.low for point in branches[:8]]
    assert widths[0] > 1.2 * widths[-1]


def test_the_edges_of_the_bands_are_smooth_up_to_the_fold(branches):
    speed = np.array([point.speed for point in branches])
    for edge in ('low', 'high'):
        for branch in ('stable', 'unstable'):
            line = np.array([getattr(getattr(point, branch), edge) for point in branches])
            # Amplitudes rise or fall all along an edge, but for a plateau at the fold itself.
            slopes = np.diff(line) / np.diff(speed)
            slopes = slopes[speed[:-1] > speed[0] + 0.1]
            assert (slopes > -2e-6).all() or (slopes < 2e-6).all()


def test_draws_that_have_lost_the_branch_beyond_v_c_pull_its_lower_edge_to_zero(branches):
    last = branches[-1]
    assert last.speed < 8.0
    assert last.unstable.low == pytest.approx(0.0, abs=0.5 * last.unstable.value)


@pytest.mark.parametrize('count', [0, 3])
def test_of_hardly_a_draw_nothing_is_said(count):
    drawn = Posterior(LAW, np.tile(LAW.p, (count, 1)), np.full(count, np.nan), (6.2, 8.8))
    assert set(drawn.numbers(0.0).values()) == {None}
