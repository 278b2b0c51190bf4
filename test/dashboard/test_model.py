"""What the page shows, without a browser and without ROS."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from hunt_ros.dashboard.model import PageModel, PageSettings
from hunt_ros.dashboard.view import View, changes
from hunt_ros.detection.acceptance import form_words
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.errors import ConfigError

FORM = IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([1e-3, 0, 0, 0, 0, 0]))
STATUS = {
    'level': 'WARN',
    'name': 'hunting',
    'message': 'hysteresis region: a disturbance can start hunting',
    'state': 'quiet',
    'region': 'hysteresis',
    'alarm': 'False',
    'speed_mps': '7.2',
    'amplitude_m': '2e-05',
    'amplitude_std_m': '1e-06',
    'growth_rate_per_s': 'nan',
    'escape_probability': '0.0004',
    'margin': 'inf',
    'frequency_hz': '2.8',
    'normal_form': form_words(FORM),
}


def shown(model: PageModel, now_s: float) -> dict:
    """Return the sections that a browser gets: JSON without NaN."""
    return json.loads(json.dumps(changes(View(), model.view(now_s)), allow_nan=False))


@pytest.fixture
def model() -> PageModel:
    return PageModel(PageSettings(), FORM)


def test_before_the_first_word_the_page_is_stale_and_says_so(model) -> None:
    status = shown(model, 100.0)['sections']['status']
    assert status['level'] == 'STALE'
    assert status['silent']
    assert 'silent' in status['why']


def test_a_detector_that_falls_silent_never_leaves_its_last_level(model) -> None:
    model.take_status(10**9, {**STATUS, 'level': 'OK'}, now_s=50.0)
    assert shown(model, 50.1)['sections']['status']['level'] == 'OK'
    later = shown(model, 50.9)['sections']['status']
    assert later['level'] == 'STALE'
    assert later['state'] == later['region'] == 'unknown'
    assert 'last word: OK, quiet' in later['why']


def test_numbers_stand_with_their_uncertainty_and_what_is_unknown_is_a_dash(model) -> None:
    model.take_status(10**9, STATUS, now_s=50.0)
    tiles = {tile['key']: tile for tile in shown(model, 50.0)['sections']['numbers']}
    assert (tiles['amplitude']['text'], tiles['amplitude']['unit']) == ('0.0200', 'mm')
    assert tiles['amplitude']['note'] == '± 0.0010 mm'
    assert tiles['growth']['text'] == '–'
    assert tiles['escape']['text'] == '< 0.1'
    assert tiles['margin']['text'] == '–'
    model.take_health(
        {
            'name': 'rig/hunting_detector',
            'level': 'OK',
            'message': '',
            'forecast_v_c': '8.012',
            'forecast_v_c_std': '0.1',
        },
        50.0,
    )
    tiles = {tile['key']: tile for tile in shown(model, 50.0)['sections']['numbers']}
    assert (tiles['forecast']['text'], tiles['forecast']['note']) == ('8.01', '7.82 … 8.21 m/s')


def test_a_rig_at_rest_has_no_speed_and_a_small_amplitude_one_power_of_ten(model) -> None:
    still = {**STATUS, 'speed_mps': '1.2e-20', 'amplitude_m': '1.1e-7', 'amplitude_std_m': '3e-8'}
    model.take_status(10**9, still, now_s=50.0)
    tiles = {tile['key']: tile for tile in shown(model, 50.0)['sections']['numbers']}
    assert tiles['speed']['text'] == '0.000'
    power = tiles['amplitude']['text'].partition('e')[2]
    assert power
    assert tiles['amplitude']['note'].endswith(f'e{power} mm')


def test_only_the_form_that_the_detector_uses_is_drawn(model) -> None:
    model.take_status(10**9, STATUS, now_s=50.0)
    drawn = shown(model, 50.0)['sections']['diagram']
    assert drawn['v_c_mps'] == pytest.approx(8.0)
    assert drawn['v_n_mps'] == pytest.approx(PAPER_NORMAL_FORM.nonlinear_critical_speed)
    assert set(drawn['bands']) == {'stable', 'unstable'}
    model.take_status(2 * 10**9, {**STATUS, 'normal_form': 'v_c 7.500 m/s'}, now_s=51.0)
    assert shown(model, 51.0)['sections']['diagram'] is None
    other = IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([4e-3, 0, 0, 0, 0, 0]))
    assert model.take_form(other.to_yaml()) == ''
    assert shown(model, 51.0)['sections']['diagram'] is None
    model.take_status(3 * 10**9, {**STATUS, 'normal_form': form_words(other)}, now_s=52.0)
    assert shown(model, 52.0)['sections']['diagram']['v_c_std_mps'] == pytest.approx(0.0632, 1e-2)
    assert 'not YAML' in model.take_form('{')


def test_no_peak_of_the_signal_is_lost_and_a_gap_breaks_the_line(model) -> None:
    stamps = np.arange(0, 3 * 10**9, 10**6)
    values = np.zeros(stamps.size)
    values[1234] = 5e-3
    gone = (stamps > 2 * 10**9) & (stamps < 2.5 * 10**9)
    for part in np.array_split(np.arange(stamps.size)[~gone], 37):
        model.take_samples('lateral', stamps[part], values[part])
    rows = shown(model, 50.0)['streams']['lateral']['rows']
    assert max(row[2] for row in rows if row[2] is not None) == 5.0
    assert [row[1] for row in rows].count(None) == 1
    assert len(rows) < 200


def test_the_spectrum_names_hunting_and_the_lines_of_the_roller(model) -> None:
    seconds = np.arange(0.0, 12.0, 2e-3)
    hunting, roller = 2.8, 7.2 / (math.pi * 0.3)
    y = 1e-4 * np.sin(2 * math.pi * hunting * seconds) + 2e-5 * np.sin(
        2 * math.pi * roller * seconds
    )
    model.take_samples('lateral', (1e9 * seconds).astype(np.int64), y)
    model.take_status(12 * 10**9, STATUS, now_s=50.0)
    view = shown(model, 50.0)
    spectrum = view['sections']['spectrum']
    lines = {line['name']: line['hz'] for line in spectrum['lines']}
    assert lines == pytest.approx(
        {'hunting': 2.8, 'roller': roller, '2 x roller': 2 * roller}, 1e-3
    )
    amplitude = dict(zip(spectrum['frequency_hz'], spectrum['amplitude'], strict=True))
    top = max(amplitude, key=amplitude.__getitem__)
    assert top == pytest.approx(hunting, abs=0.1)
    assert amplitude[top] == pytest.approx(0.1, rel=0.2)
    assert len(view['streams']['waterfall']['rows']) == 1


def test_the_waterfall_of_a_long_run_keeps_its_size_and_its_strongest_lines(model) -> None:
    waterfall = model._waterfall
    frequency = np.array([1.0, 2.8, 7.0])
    for second in range(1000):
        strong = 1e-3 if second == 321 else 1e-6
        waterfall.append(float(second), frequency, np.array([1e-6, strong, 1e-6]))
    rows = list(waterfall.rows)
    assert 100 < len(rows) <= 240
    assert max(max(row[1:]) for row in rows) == 60
    assert rows == sorted(rows)


def test_a_clock_that_is_set_back_begins_a_new_picture(model) -> None:
    model.take_samples('lateral', np.arange(10**9, 2 * 10**9, 10**7), np.ones(100))
    model.take_status(90 * 10**9, STATUS, now_s=50.0)
    before = model.view(50.0)
    model.take_status(5 * 10**9, STATUS, now_s=50.1)
    model.take_samples('lateral', np.arange(5 * 10**9, 6 * 10**9, 10**7), np.ones(100))
    change = changes(before, model.view(50.2))['streams']
    assert change['lateral']['fresh']
    assert change['lateral']['rows'][0][0] == 5.0


def test_a_node_that_tells_nothing_any_more_is_stale(model) -> None:
    model.take_health({'name': 'rig/yaw_sensor', 'level': 'OK', 'rate_hz': '999.8'}, 10.0)
    (node,) = shown(model, 11.0)['sections']['nodes']
    assert (node['level'], node['rate_hz']) == ('OK', 999.8)
    (node,) = shown(model, 20.0)['sections']['nodes']
    assert (node['level'], node['rate_hz']) == ('STALE', 0.0)
    assert 'silent for 10 s' in node['message']


def test_profile_interlock_and_emergency_stop_are_shown_where_the_drive_tells(model) -> None:
    assert shown(model, 10.0)['sections']['drive'] is None
    status = {
        'speed_mps': '7.1', 'target_mps': '7.2', 'profile': 'sweep', 'profile_state': 'running',
        'profile_elapsed_s': '30.0', 'profile_remaining_s': '90.0', 'interlock': 'measure',
        'interlock_state': 'tripped', 'interlock_cause': 'no status for 0.3 s',
        'emergency_stop': 'True', 'safe_speed_mps': '5.0', 'speed_ceiling_mps': 'nan',
    }  # fmt: skip
    model.take_speed_status(status, 10.0)
    drive = shown(model, 10.1)['sections']['drive']
    assert drive['progress'] == 0.25
    assert drive['emergency_stop']
    assert not drive['silent']
    assert drive['speed_ceiling_mps'] is None
    assert shown(model, 12.0)['sections']['drive']['silent']


def test_an_alarm_tells_who_acknowledged_it(model) -> None:
    alarm = {'began_s': 1.0, 'acknowledged_by': 'Mia', 'cause': 'limit cycle'}
    model.take_alarms(json.dumps({'alarms': [alarm]}))
    assert shown(model, 1.0)['sections']['alarms'][0]['acknowledged_by'] == 'Mia'
    model.take_alarms('no JSON')
    model.take_event(3 * 10**9, {'event': 'escaping', 'level': 'ERROR', 'since_s': '2.5'})
    (event,) = shown(model, 1.0)['sections']['events']
    assert (event['event'], event['since_s']) == ('escaping', 2.5)


def test_a_setting_that_is_impossible_is_named() -> None:
    with pytest.raises(ConfigError, match='spectrum_max_hz'):
        PageSettings(spectrum_max_hz=0.0)
