"""The parameter file of a normal form: it comes back as it went, and bad values are named."""

from __future__ import annotations

import math
from array import array
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from hunt_ros.dynamics.identified import PARAMETERS, IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS, PAPER_NORMAL_FORM, NormalForm
from hunt_ros.errors import ConfigError

positive = st.floats(1e-6, 1e6)
coefficient = st.floats(-1e9, 1e9)
words = st.text(st.characters(codec='ascii', categories=('L', 'N')), min_size=1, max_size=12)


@st.composite
def identified(draw: st.DrawFn) -> IdentifiedNormalForm:
    form = NormalForm(
        critical_speed=draw(positive),
        **{name: draw(coefficient) for name in COEFFICIENTS},
        length_scale=draw(positive),
        time_scale=draw(positive),
        frequency_hz=draw(positive),
    )
    root = np.array(draw(st.lists(st.floats(-1e3, 1e3), min_size=36, max_size=36))).reshape(6, 6)
    return IdentifiedNormalForm(
        form, root @ root.T, draw(st.dictionaries(words, words, max_size=3))
    )


def group_of(text: str) -> dict[str, Any]:
    group: dict[str, Any] = yaml.safe_load(text)['/**']['ros__parameters']['normal_form']
    return group


def with_group(group: dict[str, Any], node: str = '/**') -> str:
    text: str = yaml.safe_dump({node: {'ros__parameters': {'normal_form': group}}})
    return text


@given(identified())
def test_a_parameter_file_comes_back_as_it_went_to_the_last_bit(one: IdentifiedNormalForm) -> None:
    again = IdentifiedNormalForm.from_yaml(one.to_yaml())
    assert again.form == one.form
    np.testing.assert_array_equal(again.covariance, one.covariance)
    assert dict(again.provenance) == dict(one.provenance)
    assert again.to_yaml() == one.to_yaml()


@given(identified())
def test_the_file_is_one_a_ros_node_can_load(one: IdentifiedNormalForm) -> None:
    # rcl takes scalars and lists of one type each; a float written '4e7' would be a string.
    group = group_of(one.to_yaml())
    for name in (*PARAMETERS, 'length_scale', 'time_scale', 'frequency_hz'):
        assert type(group[name]) is float
    assert {type(x) for x in group['covariance']} == {float}
    assert {type(x) for x in group['provenance']} == {str}


@pytest.mark.parametrize('node', ['hunting_detector', '/rig/hunting_detector', '/**'])
def test_the_group_is_found_under_any_node_name(node: str) -> None:
    group = group_of(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml())
    assert IdentifiedNormalForm.from_yaml(with_group(group, node)).form == PAPER_NORMAL_FORM
    bare = yaml.safe_dump({'normal_form': group})
    assert IdentifiedNormalForm.from_yaml(bare).form == PAPER_NORMAL_FORM


def test_scales_covariance_and_provenance_may_be_left_out() -> None:
    paper = PAPER_NORMAL_FORM
    short = {'v_c': paper.critical_speed, **{k: getattr(paper, k) for k in COEFFICIENTS}}
    one = IdentifiedNormalForm.from_yaml(with_group(short))
    assert one.form == paper
    assert not one.covariance.any()
    assert one.provenance == {}


def test_numbers_that_yaml_takes_for_words_are_numbers_as_they_are_for_ros() -> None:
    one = IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([1e-5] * 6))
    text = one.to_yaml()
    assert '0.0485' in text
    assert '1.0e-05' in text
    written = text.replace('0.0485', '485e-4').replace('1.0e-05', '1e-5')
    again = IdentifiedNormalForm.from_yaml(written)
    assert again.form.length_scale == 0.0485
    np.testing.assert_array_equal(again.covariance, one.covariance)


def test_the_covariance_may_come_as_the_array_that_rclpy_hands_out() -> None:
    one = IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    group = group_of(one.to_yaml())
    group['covariance'] = array('d', group['covariance'])
    again = IdentifiedNormalForm.from_parameters(group)
    np.testing.assert_array_equal(again.covariance, one.covariance)


@pytest.mark.parametrize('name', PARAMETERS)
@pytest.mark.parametrize('value', ['fast', None, True, [1.0], {}, math.nan, math.inf, 10**400])
def test_a_bad_number_is_named_with_the_file(name: str, value: object) -> None:
    group = group_of(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml())
    group[name] = value
    with pytest.raises(ConfigError) as caught:
        IdentifiedNormalForm.from_yaml(with_group(group), 'form.yaml')
    message = str(caught.value)
    assert name in message
    assert 'form.yaml' in message
    assert '\n' not in message


@pytest.mark.parametrize(
    ('key', 'value', 'complaint'),
    [
        ('covariance', [1.0] * 20, '21 numbers'),
        ('covariance', [-1.0] + [0.0] * 20, 'negative variance'),
        ('covariance', [math.nan] * 21, 'finite'),
        ('covariance', [math.inf] + [0.0] * 20, 'finite'),
        ('covariance', ['wide'] * 21, '21 numbers'),
        ('covariance', 'wide', '21 numbers'),
        ('covariance', [[1.0], [1.0, 2.0]], '21 numbers'),
        ('draws', [1.0] * 7, 'draws must be six numbers each, got 7 in all'),
        ('draws', ['a'] * 6, "draws must be six numbers each, got 'a'"),
        ('draws', [1.0] * 5 + [math.inf], 'draws must be finite, got inf'),
        ('draws', 'many', "draws must be six numbers each, got 'many'"),
    ],
)
def test_bad_numbers_are_refused_in_one_line(key: str, value: object, complaint: str) -> None:
    group = group_of(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml()) | {key: value}
    with pytest.raises(ConfigError, match=complaint) as caught:
        IdentifiedNormalForm.from_yaml(with_group(group), 'form.yaml')
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('provenance', ['a line', 7, {'bags': 'a'}, [None, 3], None])
def test_an_odd_provenance_never_stops_a_detector(provenance: object) -> None:
    group = group_of(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml())
    group['provenance'] = provenance
    assert IdentifiedNormalForm.from_yaml(with_group(group)).form == PAPER_NORMAL_FORM


@given(st.text(max_size=80))
@settings(max_examples=300)
def test_any_text_that_is_no_parameter_file_is_a_config_error_in_one_line(text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        IdentifiedNormalForm.from_yaml(text, 'form.yaml')
    assert 'form.yaml' in str(caught.value)
    assert '\n' not in str(caught.value)


def test_draws_have_the_covariance_they_come_from() -> None:
    std = np.array([0.05, 0.004, 60.0, 0.02, 90.0, 1.0e6])
    correlation = np.eye(6)
    correlation[2, 5] = correlation[5, 2] = -0.8
    one = IdentifiedNormalForm(PAPER_NORMAL_FORM, correlation * np.outer(std, std))
    draws = np.array([IdentifiedNormalForm(form).vector for form in one.draws(20000, seed=3)])
    # Of each parameter on its own scale: their variances span sixteen powers of ten.
    assert np.abs((draws.mean(0) - one.vector) / std).max() < 4.0 / 141.0
    np.testing.assert_allclose(draws.std(0), std, rtol=0.02)
    assert np.corrcoef(draws.T)[2, 5] == pytest.approx(-0.8, abs=0.02)


def test_a_sample_is_kept_in_the_file_and_drawn_from() -> None:
    rng = np.random.default_rng(5)
    plain = IdentifiedNormalForm(PAPER_NORMAL_FORM)
    sample = plain.vector * (1.0 + 0.01 * rng.exponential(size=(64, 6)))
    one = replace(plain, covariance=np.cov(sample.T), sample=sample)
    assert one.fingerprint != plain.fingerprint
    again = IdentifiedNormalForm.from_yaml(one.to_yaml())
    assert again.fingerprint == one.fingerprint
    np.testing.assert_array_equal(again.sample, sample)
    drawn = np.array([IdentifiedNormalForm(form).vector for form in again.draws(200)])
    np.testing.assert_array_equal(np.unique(drawn, axis=0), np.unique(sample, axis=0))
    few = np.array([IdentifiedNormalForm(form).vector for form in again.draws(9)])
    assert few.shape == (9, 6)


def test_the_form_of_another_rig_is_refused_and_one_without_a_name_is_not() -> None:
    form = IdentifiedNormalForm(PAPER_NORMAL_FORM, rig_name='rig A')
    kept = IdentifiedNormalForm.from_yaml(form.to_yaml())
    assert kept.rig_name == 'rig A'
    assert kept.fingerprint == IdentifiedNormalForm(PAPER_NORMAL_FORM).fingerprint
    kept.refuse_other('rig A')
    kept.refuse_other('')
    IdentifiedNormalForm(PAPER_NORMAL_FORM).refuse_other('rig B')
    with pytest.raises(ConfigError, match=r"x\.yaml: identified on rig 'rig A', expected 'rig B'"):
        kept.refuse_other('rig B', 'x.yaml')


@pytest.mark.parametrize(('without', 'known'), [(0, True), (3, True), (4, False), (30, False)])
def test_a_fold_that_too_few_of_the_sample_have_is_not_known(without: int, known: bool) -> None:
    own = IdentifiedNormalForm(PAPER_NORMAL_FORM).vector
    sample = np.tile(own, (64, 1))
    sample[:without, 5] = 0.0  # without an end of growth there is no fold
    found = IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([1e-4] * 6), sample=sample)
    assert (found.nonlinear_critical_speed is not None) == known
    assert ('v_n' in found.words) == known
