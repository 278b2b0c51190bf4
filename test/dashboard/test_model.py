"""What the page shows, without a browser and without ROS."""

from __future__ import annotations

import json
import math
import pickle

import numpy as np
import pytest
from told_made import FORM, REPLAY, STATUS

from hunt_ros.dashboard.model import PageModel, PageSettings
from hunt_ros.dashboard.spectra import Waterfall
from hunt_ros.dashboard.traces import Trace
from hunt_ros.dashboard.view import View, changes
from hunt_ros.dashboard.words import Words
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM


def shown(model: PageModel, now_s: float) -> dict:
    """Return the sections that a browser gets: JSON without NaN."""
    return json.loads(json.dumps(changes(View(), model.view(now_s)), allow_nan=False))


@pytest.fixture
def model() -> PageModel:
    return PageModel(PageSettings(), FORM)


def test_a_detector_that_falls_silent_never_leaves_its_last_level(model) -> None:
    model.take_status(10**9, {**STATUS, 'level': 'OK', 'since_s': '0.5'}, now_s=50.0)
    status = shown(model, 50.1)['sections']['status']
    assert (status['level'], status['since_s']) == ('OK', 0.5)
    later = shown(model, 50.9)['sections']['status']
    assert (later['level'], later['since_s']) == ('STALE', None)
    assert later['state'] == later['region'] == 'unknown'
    assert 'last word: OK, quiet' in later['why']


def tiles(model: PageModel, now_s: float) -> dict[str, dict]:
    return {tile['key']: tile for tile in shown(model, now_s)['sections']['numbers']}


def test_a_forecast_stands_with_its_interval(model) -> None:
    told = {'level': 'OK', 'forecast_v_c': '8.012', 'forecast_v_c_std': '0.1'}
    model.take_health({'name': 'rig/hunting_detector', **told}, 51.0)
    forecast = tiles(model, 51.0)['forecast']
    assert (forecast['text'], forecast['note']) == ('8.01', '7.82 … 8.21')


@pytest.mark.parametrize(
    ('values', 'key', 'text', 'note'),
    [
        ({}, 'amplitude', '0.020', '± 0.001'),
        ({}, 'growth', '–', ''),
        ({}, 'margin', '> 100', ''),
        ({}, 'to_v_n', '−0.80', 'v_n 6.40'),
        ({'speed_mps': '1.2e-20', 'amplitude_m': '1.1e-7'}, 'speed', '0.00', ''),
        ({'amplitude_m': '1.1e-7', 'amplitude_std_m': '3e-8'}, 'amplitude', '0.000', '± 0.000'),
        ({'amplitude_m': '7.094e-4', 'amplitude_std_m': 'nan'}, 'amplitude', '0.709', ''),
        ({'state': 'limit_cycle', 'margin': 'nan'}, 'margin', 'LOST', 'beyond A_u'),
        ({'state': 'limit_cycle'}, 'time', 'NOW', 'it is reached'),
        ({'time_to_limit_cycle_s': '4.21'}, 'time', '4.2', ''),
        ({'region': 'unstable', 'margin': 'nan'}, 'margin', 'NONE', 'rest is unstable'),
        ({'region': 'stable', 'margin': 'inf'}, 'margin', '∞', 'motion decays'),
        ({'normal_form': '', 'margin': 'nan'}, 'margin', '–', 'no normal form'),
        ({'growth_rate_per_s': '-0.313'}, 'growth', '−0.31', ''),
        # Both ends of an interval that read the same say nothing, and neither does a chance of 0.
        ({'escape_probability_low': '0', 'escape_probability_high': '0.001'}, 'escape', '< 1', ''),
        ({'escape_probability': '0.93', 'escape_chance_next_minute': '0.99'}, 'escape', '93',
         '1 min: 99'),
    ],
)  # fmt: skip
def test_numbers_have_fixed_decimals_and_lost_is_a_word(model, values, key, text, note) -> None:
    model.take_status(10**9, {**STATUS, **values}, now_s=50.0)
    tile = tiles(model, 50.0)[key]
    assert (tile['text'], tile['note']) == (text, note)


def test_digits_change_four_times_a_second_and_the_level_at_once(model) -> None:
    seen, levels = set(), set()
    for step in range(40):
        level = 'ERROR' if step % 2 else 'OK'
        told = {**STATUS, 'level': level, 'speed_mps': f'{7 + 0.01 * step}'}
        model.take_status((1 + step) * 50_000_000, told, 50.0 + 0.05 * step)
        sections = shown(model, 50.0 + 0.05 * step)['sections']
        seen.add(sections['numbers'][0]['text'])
        levels.add(sections['status']['level'] == level)
    assert 7 <= len(seen) <= 9
    assert levels == {True}


def test_a_silence_breaks_trail_amplitude_and_envelope(model) -> None:
    for second in (*np.arange(1.0, 3.0, 0.05), *np.arange(6.0, 8.0, 0.05)):
        model.take_status(round(1e9 * second), STATUS, float(second))
    streams = shown(model, 8.0)['streams']
    assert [row[0] for row in streams['trail']['rows']].count(None) == 1
    broken = [row[0] for row in streams['amplitude']['rows'] if row[1] is None]
    assert broken == [pytest.approx(2.95)]


def test_a_replay_is_one_until_nodes_of_a_rig_speak(model) -> None:
    assert shown(model, 10.0)['sections']['replay'] is None
    model.take_health(REPLAY, 10.0)
    replay = shown(model, 10.1)['sections']['replay']
    assert (replay['name'], replay['at_s'], replay['length_s']) == ('day_3', 12.3, 254.0)
    assert (replay['state'], replay['rate']) == ('plays', 0.1)
    # One that is held up for a while is not taken for a rig.
    assert shown(model, 60.0)['sections']['replay']['name'] == 'day_3'
    model.take_health({'name': 'rig/lateral_sensor', 'level': 'OK'}, 61.0)
    assert shown(model, 61.0)['sections']['replay'] is None


@pytest.mark.parametrize(
    ('told', 'after_s', 'silent'),
    [
        ({}, 4.0, False),  # at a tenth of its speed a status comes every 0.5 s
        ({}, 6.0, True),
        ({'rate': '10.0'}, 1.0, True),
        ({'playing': 'False'}, 3600.0, False),
    ],
)
def test_a_slow_replay_is_no_silence_and_a_paused_one_neither(
    model, told, after_s, silent
) -> None:
    model.take_health(REPLAY | told, 50.0)
    model.take_status(10**9, STATUS, now_s=50.0)
    assert shown(model, 50.0 + after_s)['sections']['status']['silent'] is silent


def test_before_the_first_word_of_a_replay_nothing_is_good(model) -> None:
    waits = {key: text for key, text in REPLAY.items() if key not in ('playing', 'rate')}
    model.take_health(waits | {'listening': 'False'}, 50.0)
    sections = shown(model, 50.0)['sections']
    assert sections['replay']['state'] == 'waits for a detector'
    assert sections['status']['silent']
    assert 'good' not in sections['status']['why']


def test_recording_time_and_disk_are_told_as_long_as_the_recorder_speaks(model) -> None:
    assert shown(model, 10.0)['sections']['recorder'] is None
    health = {
        'name': 'rig/bag_recorder', 'level': 'OK', 'path': '/lab/rec/hunt_1.active',
        'recorded_s': '754.0', 'bytes': '73456789', 'free_bytes': '61e9',
    }  # fmt: skip
    model.take_health(health, 10.0)
    recorder = shown(model, 10.1)['sections']['recorder']
    assert (recorder['recording'], recorder['recorded_s']) == ('hunt_1', 754.0)
    assert (recorder['bytes'], recorder['free_bytes']) == (73456789.0, 61e9)
    model.take_health({'name': 'rig/bag_recorder', 'level': 'OK'}, 11.0)
    assert shown(model, 11.0)['sections']['recorder']['recording'] == ''
    assert shown(model, 20.0)['sections']['recorder'] is None


def test_a_mark_stands_among_the_events(model) -> None:
    model.take_status(3 * 10**9, STATUS, 1.0)
    model.take_mark('bump\u202e at joint 3')
    (event,) = shown(model, 1.0)['sections']['events']
    assert (event['event'], event['cause'], event['at_s']) == ('mark', 'bump at joint 3', 3.0)


def test_only_the_form_that_the_detector_uses_is_drawn(model) -> None:
    model.take_status(10**9, STATUS, now_s=50.0)
    drawn = shown(model, 50.0)['sections']['diagram']
    assert drawn['v_c'] == pytest.approx(8.0)
    assert drawn['v_n'] == pytest.approx(PAPER_NORMAL_FORM.nonlinear_critical_speed)
    assert set(drawn['bands']) == {'stable', 'unstable'}
    model.take_status(2 * 10**9, {**STATUS, 'normal_form': 'v_c 7.500 m/s'}, now_s=51.0)
    assert shown(model, 51.0)['sections']['diagram'] is None
    other = IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([4e-3, 0, 0, 0, 0, 0]))
    assert model.take_form(other.to_yaml()) == ''
    assert shown(model, 51.0)['sections']['diagram'] is None
    model.take_status(3 * 10**9, {**STATUS, 'normal_form': other.words}, now_s=52.0)
    assert shown(model, 52.0)['sections']['diagram']['v_c_std'] == pytest.approx(0.0632, 1e-2)
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


def test_an_hour_at_1_khz_leaves_the_samples_that_are_shown_and_no_more() -> None:
    trace, block = Trace(1e3), np.arange(0, 10**9, 10**6)
    for second in range(3600):
        trace.append(second * 10**9 + block, np.zeros(1000))
    assert len(pickle.dumps(trace)) < 500_000, '16 bytes a sample, whether anybody asks or not'
    assert trace.samples()[0].size == 20_000


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


def test_the_waterfall_of_a_long_run_keeps_its_size_and_its_strongest_lines() -> None:
    waterfall = Waterfall(PageSettings().spectrum_max_hz)
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


def test_one_stamp_from_the_future_does_not_stop_a_trace(model) -> None:
    stamps = np.arange(10**9, 2 * 10**9, 10**7)
    model.take_samples('lateral', stamps, np.ones(100))
    model.take_samples('lateral', np.array([10**15]), np.ones(1))
    for second in range(1, 4):
        model.take_samples('lateral', stamps + second * 10**9, np.ones(100))
    assert shown(model, 50.0)['streams']['lateral']['rows'][-1][0] > 4.9


def test_a_node_that_tells_nothing_any_more_is_stale(model) -> None:
    model.take_health({'name': 'rig/yaw_sensor', 'level': 'OK', 'rate_hz': '999.8'}, 10.0)
    (node,) = shown(model, 11.0)['sections']['nodes']
    assert (node['level'], node['rate_hz']) == ('OK', 999.8)
    (node,) = shown(model, 20.0)['sections']['nodes']
    assert (node['level'], node['rate_hz']) == ('STALE', 0.0)
    assert 'silent for 10 s' in node['message']


@pytest.mark.parametrize(
    ('namespace', 'own', 'others'),
    [
        ('rig', ['rig/yaw_sensor', 'rig/daq/yaw_sensor'], ['rig2/yaw_sensor', 'other/rig/a', 'a']),
        ('/lab/rig/', ['/lab/rig/yaw_sensor'], ['rig/yaw_sensor', 'lab/yaw_sensor']),
        ('/', ['yaw_sensor'], ['rig/yaw_sensor']),
    ],
)
def test_what_another_rig_of_the_domain_says_of_itself_is_not_shown(
    namespace, own, others
) -> None:
    model = PageModel(PageSettings(), FORM, namespace)
    for name in (*own, *others):
        model.take_health({'name': name, 'level': 'OK', 'message': name}, 10.0)
    for name in ('other/hunting_detector', 'hunting_detector_2'):
        model.take_health({'name': name, 'level': 'OK', 'forecast_v_c': '12.345'}, 10.0)
    sections = shown(model, 10.0)['sections']
    assert {node['message'] for node in sections['nodes']} - {''} == set(own)
    assert len({node['name'] for node in sections['nodes']}) == len(sections['nodes'])
    assert '12.3' not in json.dumps(sections['numbers'])


def test_an_alarm_tells_who_acknowledged_it(model) -> None:
    alarm = {'began_s': 1.0, 'acknowledged_by': 'Mia', 'cause': 'limit cycle'}
    model.take_alarms(json.dumps({'alarms': [alarm]}))
    assert shown(model, 1.0)['sections']['alarms'][0]['acknowledged_by'] == 'Mia'
    model.take_alarms('no JSON')
    model.take_event(3 * 10**9, {'event': 'escaping', 'level': 'ERROR', 'since_s': '2.5'})
    (event,) = shown(model, 1.0)['sections']['events']
    assert (event['event'], event['since_s']) == ('escaping', 2.5)


@pytest.mark.parametrize(
    ('said', 'shown_as'),
    [
        (
            'the speed 7.200 m/s is above v_c = 8.000 m/s',
            'the speed 25.92 km/h is above v_c = 28.80 km/h',
        ),
        ('v_c 8.013 +/- 0.042 m/s, v_n 6.41 m/s', 'v_c 28.85 +/- 0.15 km/h, v_n 23.1 km/h'),
        ('between 6.35 and 7 m/s only', 'between 22.9 and 25.2 km/h only'),
        ('8.01 m/s (95 %: 7.81 to 8.21), 3 levels', '28.8 km/h (95 %: 28.1 to 29.6), 3 levels'),
        ('0.4 m/s^2 and 0.3 m/s2 of 2.8 Hz', '0.4 m/s^2 and 0.3 m/s2 of 2.8 Hz'),
    ],
)
def test_a_sentence_tells_speeds_in_the_unit_of_the_rig(said, shown_as) -> None:
    assert Words('km/h').in_unit(said) == shown_as
    assert Words().in_unit(said) == said


def test_kilometres_an_hour_are_one_setting_for_all_numbers_of_the_page() -> None:
    model = PageModel(PageSettings(speed_unit='km/h'), FORM)
    model.take_status(10**9, STATUS | {'message': 'v is 7.2 m/s'}, now_s=50.0)
    drive = {'speed_mps': '7.2', 'target_mps': '7.5', 'speed_ceiling_mps': 'nan'}
    model.take_speed_status(drive, 50.0)
    model.take_event(10**9, {'event': 'quiet', 'speed_mps': '5.0', 'message': 'at 5.00 m/s'})
    view = shown(model, 50.0)
    sections = view['sections']
    numbers = {tile['key']: (tile['text'], tile['unit']) for tile in sections['numbers']}
    assert (numbers['speed'], numbers['to_v_c']) == (('25.9', 'km/h'), ('+2.9', 'km/h'))
    assert numbers['amplitude'] == ('0.020', 'mm')
    assert sections['status']['speed'] == pytest.approx(25.92)
    assert sections['status']['why'] == 'v is 25.9 km/h'
    assert sections['diagram']['v_c'] == pytest.approx(28.8)
    assert sections['diagram']['stable'][0][-1] == pytest.approx(sections['diagram']['high'], 1e-3)
    assert sections['drive']['target'] == pytest.approx(27.0)
    (event,) = sections['events']
    assert (event['speed'], event['cause']) == (pytest.approx(18.0), 'at 18.0 km/h')
    assert view['streams']['trail']['rows'][0][0] == pytest.approx(25.92)
    assert '_mps' not in json.dumps(sections), 'what is shown has one unit'
    assert model.drive_mps('speed_mps', 50.0) == 7.2
