from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made import FLUTTER, changed, flutter_runs, rig_settings, without
from records_made import held_speeds

from hunt_ros.bag import read_record
from hunt_ros.cli.identify import describe
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Hold, Profile
from hunt_ros.dynamics.simulation import Kick, SensorModel, SimulationSettings, simulate
from hunt_ros.errors import IdentificationError
from hunt_ros.identification import IdentificationSettings, identify
from hunt_ros.identification.bracket import contradicts
from hunt_ros.identification.likelihood import trajectory_fit
from hunt_ros.identification.preparation import Recording, runs_in
from hunt_ros.identification.result import reason_in
from hunt_ros.samples import Record, Series

DATA = FLUTTER.parent


@pytest.fixture(scope='module')
def from_trajectories(identified):
    return identified('trajectories')


@pytest.fixture(scope='module')
def from_staircase(identified):
    return identified('staircase')


@pytest.fixture(scope='module')
def from_sweep(identified):
    return identified('sweep')


def within(number, truth, factor=1.0):
    low = number.value - factor * (number.value - number.low)
    return low <= truth <= number.value + factor * (number.high - number.value)


def test_known_coefficients_come_back_from_free_trajectories(from_trajectories):
    found = from_trajectories.coefficients
    for name, share in (('D1', 0.04), ('D4', 0.05), ('D15', 0.05), ('D7', 0.35), ('D10', 0.5)):
        assert found[name].value == pytest.approx(getattr(PAPER_NORMAL_FORM, name), rel=share)
        assert within(found[name], getattr(PAPER_NORMAL_FORM, name), 1.8)
    assert from_trajectories.v_c.value == pytest.approx(8.0, rel=0.005)
    assert from_trajectories.v_n.value == pytest.approx(6.4059, rel=0.004)
    assert from_trajectories.criticality == 'subcritical'
    form = from_trajectories.normal_form.form
    np.testing.assert_allclose(
        form.unstable_amplitude([7.0, 7.4]),
        PAPER_NORMAL_FORM.unstable_amplitude([7.0, 7.4]),
        rtol=0.03,
    )


def test_one_staircase_of_the_full_model_gives_its_fold_and_branches(from_staircase):
    assert from_staircase.v_n.value == pytest.approx(6.433, abs=0.05)
    assert abs(from_staircase.v_c.value - 8.0) < max(0.12, 2.0 * from_staircase.v_c.std)
    form = from_staircase.normal_form.form
    np.testing.assert_allclose(
        form.stable_amplitude([7.2, 8.0, 8.8]), [635e-6, 678e-6, 703e-6], rtol=0.02
    )
    _, low, high = from_staircase.branch('unstable', [6.6, 7.2])
    truth = np.array([379e-6, 237e-6])
    assert (0.97 * low <= truth).all()
    assert (truth <= 1.03 * high).all()


def test_a_long_hold_without_an_amplitude_makes_no_small_error_bar():
    """At 8 m/s the limit cycle turns with the roller and has no amplitude."""
    speeds = (6.2, 7.0, 7.6, 8.4, 8.0, 7.4, 6.8, 6.2)
    for seed in range(3):
        result = identify([held_speeds(speeds, 60.0, 4.0, seed, forcing=2e-5)])
        assert abs(result.v_c.value - 8.0) < 3.0 * result.v_c.std
        assert result.fit.converged


def stepped(hold_s, seed):
    """Steps of the full model up and down without roughness, under random forcing."""
    settings = SimulationSettings(
        sample_rate_hz=100.0, broadband=2e-5, lateral_sensor=SensorModel(noise=5e-6)
    )
    profile = Profile(tuple(Hold(float(v), hold_s) for v in (6.2, 7.0, 7.8, 8.4, 7.6, 6.8, 6.2)))
    return simulate(paper_rig(), settings, profile, seed=seed)


def test_the_same_steps_held_four_times_as_long_tell_no_less():
    wide, narrow = [], []
    for seed in range(2):
        short, long = (identify([stepped(hold_s, seed)]) for hold_s in (25.0, 103.0))
        assert long.normal_form is not None
        for number, truth in ((long.v_c, 8.0), (long.v_n, 6.433)):
            assert within(number, truth, 1.5)
        # A v_c that the short one does not bound from above is as wide as can be.
        wide.append([short.v_c.std if short.v_c else np.inf, short.v_n.std])
        narrow.append([long.v_c.std, long.v_n.std])
    assert np.all(np.sum(narrow, axis=0) <= np.sum(wide, axis=0))


def test_a_fit_that_has_not_converged_says_so_and_gives_no_number(records, monkeypatch):
    monkeypatch.setattr(trajectory_fit, '_REACHED', 0.0)
    result = identify(records['sweep'])
    document = result.to_json()
    assert document['fit']['converged'] is False
    assert all(document[key] is None for key in ('v_c', 'v_n', 'hysteresis_width'))
    assert document['criticality'] == 'subcritical'  # rest and cycle were seen at one speed
    assert all(value is None for value in document['coefficients'].values())
    assert result.normal_form is None
    assert 'not converged' in reason_in(result.unknown, 'v_c')
    assert document['fit']['lack_of_fit_p'] is None
    assert not any('intervals are' in line for line in result.warnings), 'there are none'
    record = records['sweep'][0]
    louder = Record(dict(changed(record, lateral=lambda y: 1.4 * y)), 'louder')
    assert not any('contradict' in line for line in identify([record, louder]).warnings)


def test_a_rig_that_hunts_for_a_fiftieth_of_the_time_gets_its_form(make):
    runs = [make(v, 400.0, i, forcing=1e-5) for i, v in enumerate((6.2, 6.8, 7.4))]
    knots, speeds = (0.0, 20.0, 40.0, 50.0, 60.0, 75.0), (7.6, 7.6, 9.0, 9.0, 6.0, 6.0)
    runs.append(make(lambda t: np.interp(t, knots, speeds), knots[-1], 15, forcing=1e-5))
    result = identify(runs)
    amplitude = np.concatenate([envelope.amplitude for envelope in result.envelopes])
    assert np.mean(amplitude > 0.4 * np.nanmax(amplitude)) < 0.03
    assert within(result.v_c, 8.0, 1.5)
    assert within(result.v_n, 6.4059, 1.5)
    assert result.normal_form is not None


def test_one_continuous_sweep_with_bumps_gives_a_usable_form(from_sweep):
    assert from_sweep.normal_form is not None
    assert from_sweep.v_n.value == pytest.approx(6.433, abs=0.05)
    assert from_sweep.v_c.value == pytest.approx(8.0, abs=0.2)
    np.testing.assert_allclose(
        from_sweep.normal_form.form.unstable_amplitude([6.6, 7.2]), [379e-6, 237e-6], rtol=0.08
    )


def test_the_json_has_the_public_keys_and_no_nan(from_staircase):
    document = json.loads(json.dumps(from_staircase.to_json(), allow_nan=False))
    assert {
        'v_c', 'v_n', 'hysteresis_width', 'coefficients', 'criticality', 'length_scale_m',
        'supercritical_probability', 'hysteresis_below',
        'time_scale_s', 'coordinate', 'branches', 'steady_states', 'observed', 'disturbance_m',
        'four_point', 'fit', 'normal_form', 'warnings',
    } <= set(document)  # fmt: skip
    assert set(document['v_c']) == {'value', 'std', 'ci95'}
    assert set(document['coefficients']) == {'D1', 'D4', 'D7', 'D10', 'D15'}
    assert {'speed_mps', 'stable_amplitude_m', 'unstable_amplitude_m'} <= set(
        document['branches'][0]
    )
    assert {'speed_mps', 'amplitude_m', 'amplitude_std_m', 'direction', 'cycles'} <= set(
        document['steady_states'][0]
    )
    observed = document['observed']
    assert set(observed) == {
        'v_c', 'v_c_between_mps', 'v_n', 'v_n_between_mps', 'hysteresis_width', 'step_mps',
    }  # fmt: skip
    low, high = observed['v_c_between_mps']
    assert low < observed['v_c'] < high
    assert high - low <= observed['step_mps'] + 1e-9
    assert document['scales_from'] == {'length': 'rig of the paper', 'time': 'rig of the paper'}
    assert document['effective']['coefficients'] == ['D7', 'D10', 'D15']
    assert document['effective']['speeds_mps'] == pytest.approx([6.0, 8.8], abs=0.05)
    assert document['fit']['segments'] >= 1
    assert document['fit']['lack_of_fit'] == bool(document['fit']['lack_of_fit_because'])
    assert {'law', 'segments', 'residual_rms_m', 'lack_of_fit'} <= set(document['fit'])
    assert document['coordinate'] == 'amplitude'


def test_the_parameter_file_holds_the_form_and_its_covariance(from_staircase):
    form = from_staircase.normal_form
    back = IdentifiedNormalForm.from_yaml(form.to_yaml())
    assert back.form == form.form
    assert back.std('v_c') == pytest.approx(from_staircase.v_c.std, rel=1e-3)
    for name, number in from_staircase.coefficients.items():
        assert back.std(name) == pytest.approx(number.std, rel=1e-3)
    matrix = form.covariance
    np.testing.assert_allclose(matrix, matrix.T)
    size = np.sqrt(np.diag(matrix))
    assert np.linalg.eigvalsh(matrix / np.outer(size, size)).min() > -1e-9
    assert len(back.draws(100)) == len(back.sample) == 64


def test_a_rig_that_runs_in_reverse_has_the_form_it_has_ahead(records, from_sweep):
    (sweep,) = records['sweep']
    result = identify([changed(sweep, speed=np.negative, roller=np.negative)])
    assert result.v_c.value == pytest.approx(from_sweep.v_c.value, abs=5e-3)
    assert result.v_n.value == pytest.approx(from_sweep.v_n.value, abs=5e-3)


def test_resolution_and_scale_of_the_speed_enter_the_intervals(records, from_sweep):
    settings = IdentificationSettings(speed_resolution_mps=0.2, speed_scale_std=0.01)
    coarse = identify(records['sweep'], settings)
    assert coarse.v_n.std > np.hypot(0.2 / np.sqrt(12), 0.064) * 0.99
    assert coarse.v_c.std > from_sweep.v_c.std
    assert coarse.normal_form.std('v_c') > 0.08
    # A branch at a speed is as uncertain as the speed is.
    wide, narrow = (one.branch('stable', [7.0]) for one in (coarse, from_sweep))
    assert wide[2][0] - wide[1][0] > 2.0 * (narrow[2][0] - narrow[1][0])


def read_in_steps(record: Record, step: float) -> Record:
    speed = record['speed']
    coarse = Series(speed.stamps_ns, step * np.round(speed.values / step))
    return replace(record, channels={**record, 'speed': coarse})


def test_a_coarse_reading_of_the_speed_is_seen_and_enters_the_intervals(records, from_sweep):
    step = 0.05
    result = identify([read_in_steps(one, step) for one in records['sweep']])
    assert any('in steps of 0.05 m/s' in warning for warning in result.warnings)
    assert not any('in steps of' in warning for warning in from_sweep.warnings)
    added = math.sqrt(max(result.v_n.std**2 - from_sweep.v_n.std**2, 0.0))
    assert added == pytest.approx(step / math.sqrt(12.0), rel=0.3)


def staircase_of(make, forcing: float) -> Record:
    up = np.linspace(5.7, 8.5, 12)
    levels = np.repeat(np.concatenate([up, up[::-1]]), 2)
    times = (20.0 * np.arange(24.0)[:, None] + [0.0, 18.0]).ravel()
    return make(lambda t: np.interp(t, times, levels), 480.0, 1, forcing=forcing)


def test_each_hold_of_a_coarse_speed_has_a_speed_of_its_own(make):
    """Limit cycles are known much better than such a speed: they would bend the law to it."""
    fine = staircase_of(make, 3e-6)
    coarse = identify(read_in_steps(fine, 0.08))
    assert coarse.v_c.value == pytest.approx(identify(fine).v_c.value, abs=0.03)
    assert coarse.v_n.low < PAPER_NORMAL_FORM.nonlinear_critical_speed < coarse.v_n.high


def test_a_coarse_speed_that_is_held_from_the_first_instant_is_read():
    """Its first hold was looked for before the record: `identify` ended with a ValueError."""
    record = held_speeds((5.0, 5.6, 6.2), 60.0, 4.0, 3, forcing=1e-5)
    result = identify(read_in_steps(record, 0.05))
    assert any('in steps of' in warning for warning in result.warnings)


def test_the_line_of_a_roller_tells_its_diameter_where_nobody_did(make):
    plain = staircase_of(make, 2e-5)
    lateral, speed = plain['lateral'], plain['speed']
    running = np.interp(lateral.seconds(), speed.seconds(), speed.values)
    angle = np.cumsum(running) * 0.01 * 2.0 / 1.3
    rough = Series(lateral.stamps_ns, lateral.values + 1e-4 * np.cos(angle))
    record = replace(plain, channels={'lateral': rough, 'speed': speed})
    found = identify(record)
    assert any('a roller of 1.3 m by its line' in warning for warning in found.warnings)
    told = identify(record, IdentificationSettings(roller_diameter_m=1.3))
    assert found.v_n.value == pytest.approx(told.v_n.value, abs=0.05)


def test_the_line_of_another_wheel_is_taken_out_by_the_angle_of_the_roller(records, from_sweep):
    (sweep,) = records['sweep']
    lateral, roller = sweep['lateral'], sweep['roller']
    angle = np.interp(lateral.stamps_ns, roller.stamps_ns, roller.values)
    geared = changed(sweep, lateral=lateral.values + 3e-5 * np.cos(0.6 * angle))
    result = identify([geared])
    assert any("at 0.6 times the roller's turn" in warning for warning in result.warnings)
    for found, known in ((result.v_c, from_sweep.v_c), (result.v_n, from_sweep.v_n)):
        assert abs(found.value - known.value) < 0.3 * known.std
        assert found.std < 1.2 * known.std


def test_scales_are_only_units(records, from_sweep):
    settings = IdentificationSettings(length_scale_m=0.1, time_scale_s=0.1)
    other = identify(records['sweep'], settings)
    assert other.v_n.value == pytest.approx(from_sweep.v_n.value, rel=1e-3)
    # Units that the user did not give are said, and where they are from.
    assert dict(other.scales_from) == {'length': 'given', 'time': 'given'}
    assert not any('time_scale_s' in warning for warning in other.warnings)
    assert any('time_scale_s' in warning for warning in from_sweep.warnings)
    told = '\n'.join(describe(from_sweep))
    assert 'rig of the paper' in told
    assert 'effective between 6 and 8.8 m/s: D7, D10, D15' in told
    speeds = [6.8, 7.6]
    np.testing.assert_allclose(
        other.normal_form.form.unstable_amplitude(speeds),
        from_sweep.normal_form.form.unstable_amplitude(speeds),
        rtol=1e-2,
    )
    ratio = other.coefficients['D1'].value / from_sweep.coefficients['D1'].value
    assert ratio == pytest.approx(2.591, rel=0.01)


def test_a_rig_without_roller_angle_and_yaw_is_served_and_told(records):
    result = identify([without(records['sweep'][0], 'roller', 'yaw')])
    assert result.v_n.value == pytest.approx(6.433, abs=0.06)
    assert any('no roller angle' in warning for warning in result.warnings)


def test_a_supercritical_rig_of_other_size_has_no_fold(make):
    form = NormalForm(12.0, 0.2, -1500.0, -0.1, 0.0, 0.0, frequency_hz=4.0)
    speeds = (10.5, 11.5, 12.3, 12.8, 13.4, 14.0, 11.8, 12.5)
    blow = [(5.0, 2e-4)]
    runs = [make(v, 60.0, i, form=form, forcing=5e-6, kicks=blow) for i, v in enumerate(speeds)]
    result = identify(runs)
    assert result.criticality == 'supercritical'
    assert result.v_c.value == pytest.approx(12.0, abs=0.1)
    assert result.v_n is None
    assert result.hysteresis_width is None
    assert result.normal_form is not None
    assert result.to_json()['v_n'] is None


def test_every_law_drawn_is_one_that_a_rig_can_have(from_staircase):
    result = from_staircase
    low, high = result.speeds
    forcing = float(np.median(result.posterior.intensity))
    for law in result.posterior.drawn:
        assert np.all(np.diff(law.growth_rate(np.linspace(low, high, 9), 0.0)) > 0.0)
        seen = result.bracket.why.values()
        assert not any(contradicts(law, lambda speed: forcing, event) for event in seen)
    assert result.v_c.high - result.v_c.low < 6.0 * result.v_c.std


def test_one_speed_only_says_so(make):
    record = make(7.2, 120.0, 1, forcing=5e-6, kicks=[(20.0, 1.5e-4)])
    result = identify([record])
    assert result.v_c is None
    assert result.normal_form is None
    assert all(value is None for value in result.coefficients.values())
    said = next(line for line in result.warnings if 'one speed only' in line)
    # The small motion before and after the kick shows the growth rate: with its deviation.
    rate, std = (float(x) for x in re.search(r'rate (\S+) \+/- (\S+) 1/s', said).groups())
    form = PAPER_NORMAL_FORM
    eps = 7.2 / form.critical_speed - 1.0
    true = (form.D1 * eps + form.D7 * eps**2) / form.time_scale
    assert abs(rate - true) < 3.0 * std


def test_the_limit_cycle_at_one_speed_says_nothing_of_the_linear_growth_rate(make):
    record = make(7.2, 120.0, 1, forcing=5e-6, start=6.3e-4)
    said = next(line for line in identify([record]).warnings if 'one speed only' in line)
    assert 'does not show its linear growth rate' in said
    assert '1/s' not in said


def test_where_only_the_limit_cycle_was_seen_no_critical_speed_is_told():
    """Hysteresis entered from above: from the limit cycle at 8.8 m/s down to rest."""
    profile = Profile(tuple(Hold(float(v), 25.0) for v in np.arange(8.8, 5.9, -0.2)))
    settings = SimulationSettings(sample_rate_hz=100.0, broadband=8e-6)
    kick = [Kick(0.5, lateral_m=6e-4)]
    for seed in range(3):
        result = identify([simulate(paper_rig(), settings, profile, kicks=kick, seed=seed)])
        assert result.v_c is None
        assert 'small motion was seen between 6 and 6.4 m/s only' in result.unknown['v_c']
        assert result.v_n.low < 6.433 < result.v_n.high
        assert result.normal_form is None
        assert result.hysteresis_width is None


def test_two_contradictory_runs_are_named(records):
    record = records['sweep'][0]
    louder = changed(record, lateral=lambda y: 1.4 * y)
    result = identify([record, Record(dict(louder), 'louder')])
    assert any('contradict' in warning and 'louder' in warning for warning in result.warnings)
    assert result.fit.lack_of_fit
    assert any('contradict' in reason for reason in result.fit.lack_of_fit_because)
    assert result.v_n is None
    assert result.normal_form is None


def test_a_critical_speed_below_the_data_is_a_forecast_from_where_they_begin(make):
    speeds = (8.2, 8.4, 8.6, 8.8, 9.0, 9.2)
    result = identify([make(v, 40.0, i, forcing=5e-6) for i, v in enumerate(speeds)])
    assert result.v_c is not None
    (said,) = (warning for warning in result.warnings if 'forecast' in warning)
    assert 'the data begin at 8.2 m/s' in said


def test_a_limit_cycle_that_stays_for_most_of_the_time_is_not_called_forced(make):
    knots = (0.0, 240.0, 480.0)
    sweep = make(lambda t: np.interp(t, knots, (6.0, 8.8, 6.0)), 500.0, 0, forcing=4e-6)
    hunting = make(8.6, 600.0, 5, start=7e-4, forcing=5e-6)
    result = identify([sweep, hunting])
    assert not any('forced, not hunting' in line for line in result.notices)
    assert within(result.v_c, 8.0, 1.5)


def test_a_dropped_out_channel_is_left_out_beside_others_and_refused_alone(records):
    record = records['sweep'][0]
    gone = Record(dict(changed(record, lateral=np.nan)), 'gone')
    with pytest.raises(IdentificationError, match='gone'):
        identify([gone])
    result = identify([record, gone])
    assert any('left out: gone' in warning for warning in result.warnings)
    assert result.v_n is not None


@pytest.mark.skipif(not FLUTTER.is_dir(), reason='the flutter recordings are not on this machine')
def test_real_flutter_recordings_give_amplitudes_and_flag_the_quintic_form():
    result = identify(flutter_runs('17*.mat'), IdentificationSettings(length_scale_m=0.1))
    assert result.v_n is None
    if result.criticality is None:
        assert 'supercritical' not in reason_in(result.unknown, 'v_n')
    assert result.fit.lack_of_fit == bool(result.fit.lack_of_fit_because)
    low, high = result.observed.v_c_between
    assert low is None or high is None or low < high
    amplitudes = {round(s.speed, 1): s.amplitude for s in result.steady_states if 'HB' in s.source}
    assert amplitudes[16.3] == pytest.approx(0.0323, rel=0.02)
    assert amplitudes[28.3] == pytest.approx(0.1098, rel=0.02)
    assert any('no roller angle' in warning for warning in result.warnings)


@pytest.mark.skipif(not (DATA / 'wing').is_dir(), reason='the wing is not on this machine')
def test_a_wing_that_rests_and_cycles_at_one_speed_is_subcritical_by_what_was_seen():
    records = []
    for name in ('g1', 'g3'):
        given = np.load(DATA / 'wing' / f'{name}.npz')
        stamps = np.round(1e9 * given['t']).astype(np.int64)
        channels = {x: Series(stamps, given[x]) for x in ('lateral', 'yaw', 'speed')}
        records.append(Record(channels, name))
    result = identify(records, IdentificationSettings(lines=(), hunting_frequency_hz=4.0))
    first = describe(result)[:5]
    assert 'subcritical: rest (' in first[0]
    assert 'limit cycle (' in first[0]
    assert first[1].startswith('seen: v_n between ')
    assert 'died out at' in first[1]
    assert 'stayed for' in first[1]
    low, high = result.bracket.v_n
    assert 16.0 <= low < high <= 18.4
    assert result.criticality == 'subcritical'
    assert result.observed.v_c is None
    assert result.v_c is None or result.v_c.high > 18.6


@pytest.mark.skipif(not (DATA / 'demo_without_form').is_dir(), reason='it is not on this machine')
def test_the_demo_that_was_refused_its_form_gets_it():
    result = identify(read_record(DATA / 'demo_without_form'))
    assert result.normal_form is not None
    assert within(result.v_n, 6.433, 1.5)
    assert within(result.v_c, 8.0, 1.5)


@pytest.mark.parametrize('given', ['bags/run', Path('bags/run'), ['bags/run'], [None]])
def test_what_is_no_record_is_refused_in_one_line(given):
    with pytest.raises(IdentificationError, match='expected records') as caught:
        identify(given)
    assert 'read_record' in str(caught.value)


def test_a_recording_is_read_once(records):
    read = []

    def reading():
        read.append(1)
        return records['sweep'][0]

    identify([reading])
    assert len(read) == 1


def test_one_record_needs_no_list():
    stamps = np.arange(100) * 10_000_000
    record = Record({'lateral': Series(stamps, np.zeros(100))}, 'nothing in it')
    reasons = []
    for given in (record, [record], iter([record])):
        with pytest.raises(IdentificationError) as caught:
            identify(given)
        reasons.append(str(caught.value))
    assert len(set(reasons)) == 1


def test_fast_growth_is_not_cut_out_as_a_kick(make):
    form = replace(PAPER_NORMAL_FORM, time_scale=PAPER_NORMAL_FORM.time_scale / 6.0)
    speeds = np.linspace(6.2, 9.0, 8)
    runs = [
        make(v, 12.0, 100 + i, form=form, start=start)
        for i, (v, start) in enumerate((v, start) for start in (1e-4, 8e-4) for v in speeds)
    ]
    settings = IdentificationSettings()
    found = [runs_in(Recording(one, 1, settings), form.frequency_hz, 0.0)[0] for one in runs]
    assert not any(run.kicks for some in found for run in some)


def test_fast_reversals_beside_a_line_of_the_roller_give_the_critical_speed_with_its_deviation():
    """What the beat with the line leaves in the amplitude is no law, and no quiet forcing."""
    corners = [(0.0, 6.1)]
    for _ in range(5):
        for took, to in ((12.0, 8.3), (24.0, 8.3), (12.0, 6.1), (6.0, 6.1)):
            corners.append((corners[-1][0] + took, to))
    profile = Profile((Corners(*(tuple(each) for each in zip(*corners, strict=True))),))
    settings = rig_settings(200.0, roughness=(3e-5,))
    found = [identify(simulate(paper_rig(), settings, profile, seed=seed)) for seed in range(4)]
    off = [abs(one.v_c.value - 8.0) / one.v_c.std for one in found if one.v_c is not None]
    assert len(off) >= 3
    assert sum(each < 2.5 for each in off) >= len(off) - 1


# --- a minute of one kick that stays: what it leaves open is not normal ------------------------

UP_AND_BACK = Corners((0.0, 6.0, 35.0, 41.0, 55.0), (6.0, 7.2, 7.2, 6.0, 6.0))


@pytest.mark.parametrize('seed', [13, 108, 117, 363, 365])
def test_one_kick_bounds_no_critical_speed_and_shows_where_hunting_ends(seed):
    """Where rest ends at 8 m/s, of which a minute at 7.2 m/s and below says nothing."""
    settings = replace(
        rig_settings(100.0, roughness=[20e-6]), lateral_sensor=SensorModel(5e-6, 2.0**-21)
    )
    profile = Profile((UP_AND_BACK,))
    kicks = [Kick(15.0, lateral_m=320e-6)]
    result = identify([simulate(paper_rig(), settings, profile, kicks=kicks, seed=seed)])
    assert result.v_c is None
    assert result.v_n.low < 6.433 < result.v_n.high
