"""What a user meets on the command line: help, one-line errors, exit codes, JSON without NaN."""

from __future__ import annotations

import json
from pathlib import Path
from unittest import mock

import pytest
from made import PAPER

from hunt_ros.bag import read_record
from hunt_ros.cli.main import VERBS, main, module_of, parser_of
from hunt_ros.cli.support.options import Parser, settings_of
from hunt_ros.cli.support.output import Found, tell
from hunt_ros.detection import DetectorConfig
from hunt_ros.detection.output import EVENT_NUMBERS
from hunt_ros.samples import known


@pytest.mark.parametrize('verb', VERBS)
def test_every_verb_has_help_with_an_example(verb, capsys) -> None:
    with pytest.raises(SystemExit) as exit_:
        main([verb, '--help'])
    assert exit_.value.code == 0
    assert f'example:\n  hunt {verb}' in capsys.readouterr().out


def test_the_program_lists_its_verbs(capsys) -> None:
    with pytest.raises(SystemExit):
        main(['--help'])
    out = capsys.readouterr().out
    assert all(verb in out for verb in VERBS)


def test_replay_of_a_simulated_bump_tells_what_happened(capsys, tmp_path) -> None:
    bag, form = tmp_path / 'bump', tmp_path / 'form.yaml'
    form.write_text(PAPER.to_yaml())
    held = 'profile: [{hold: {speed_mps: 7.2, duration_s: 40}}]'
    profile = ['--profile', held, '--rate', '200', '--kick', '20:0.0006']
    assert main(['simulate', str(bag), *profile, '--seed', '4']) == 0
    capsys.readouterr()
    assert main(['replay', str(bag), '--normal-form', str(form), '--json', '-']) == 0
    result = json.loads(capsys.readouterr().out)
    names = [event['event'] for event in result['events']]
    assert names.index('escaping') < names.index('limit_cycle')
    escaping = result['events'][names.index('escaping')]
    assert 20.0 <= escaping['t_s'] < 23.0
    assert escaping['level'] == 'ERROR'
    for event in result['events']:
        assert {'since_s', 'test', 'cause', 'normal_form', *EVENT_NUMBERS} < set(event)
    assert escaping['unstable_amplitude_m'] == pytest.approx(0.26e-3, rel=0.05)
    (alarm,) = result['alarms']['alarms']
    assert (alarm['began_s'], alarm['decided_s']) == (escaping['since_s'], escaping['t_s'])
    summary = result['summary']
    assert set(summary['level_time_s']) == {'OK', 'WARN', 'ERROR', 'STALE'}
    assert escaping['test'] == 'escape_probability', 'the form has decided'
    assert 0.0 <= escaping['hunting_probability'] <= 1.0

    assert sum(summary['level_time_s'].values()) == pytest.approx(40.0, abs=0.5)
    assert summary['region_time_s']['hysteresis'] == pytest.approx(40.0, abs=1.0)
    assert summary['max_amplitude_m'] == pytest.approx(0.635e-3, rel=0.1)


def test_json_never_holds_nan(tmp_path) -> None:
    assert known(float('nan')) is None
    assert known(float('inf')) is None
    with pytest.raises(ValueError, match='not JSON compliant'):
        tell(Found({'x': float('nan')}, []), str(tmp_path / 'x.json'))


def test_replay_runs_criteria_and_forecast_beside_the_detector(capsys) -> None:
    bags = Path(__file__).parents[2] / 'bags'
    words = ['replay', str(bags / 'kick_escapes'), '--normal-form', str(bags / 'paper.yaml')]
    beside = ['--set', 'criteria=[cfr_213_333]', '--set', 'criteria_scale=0.03']
    assert main([*words, *beside, '--json', '-']) == 0
    result = json.loads(capsys.readouterr().out)
    assert [item['exceeded'] for item in result['criteria']] == [True, False]
    first = result['criteria'][0]
    assert first['criterion'] == 'cfr_213_333'
    assert first['index_mps2'] > first['limit_mps2'] == pytest.approx(0.03 * 0.3 * 9.80665)
    spoken = [event for event in result['events'] if event['event'].startswith('criterion')]
    assert [event['event'] for event in spoken] == ['criterion_exceeded', 'criterion_cleared']
    assert spoken[0]['speed_mps'] == pytest.approx(7.2, abs=0.01)
    assert result['summary']['forecast']['v_c_mps'] is None
    assert result['summary']['forecast']['reason'] == 'collecting speed levels'
    assert main([*words, '--set', 'forecast=off']) == 0
    printed = capsys.readouterr().out
    assert 'v_c from' not in printed
    assert 'CRITERION' not in printed


def test_simulate_runs_a_profile_whose_step_ends_by_the_amplitude(capsys, tmp_path) -> None:
    profile = tmp_path / 'until.yaml'
    profile.write_text(
        """
        profile:
        - hold: {speed_mps: 7.2, duration_s: 300, until_above_m: 5e-4}
        - hold: {speed_mps: 6.2, duration_s: 5}
        """
    )
    words = ['--profile', str(profile), '--rate', '100', '--json', '-']
    kicks = ['--kick', '5:0.0006', '--kick', '200:0.0006']
    assert main(['simulate', str(tmp_path / 'bag'), *words, *kicks]) == 0
    out, err = capsys.readouterr()
    result = json.loads(out)
    # The kick at 5 s goes beyond the unstable limit cycle, and on to 0.65 mm.
    assert 6.0 < result['duration_s'] < 100.0
    assert 'no kick at 200 s' in err
    speed = read_record(tmp_path / 'bag')['speed'].values
    assert (speed[0], speed[-1]) == pytest.approx((7.2, 6.2), abs=0.1)


@pytest.mark.parametrize(
    ('words', 'value'),
    [
        *((f'hunting_frequency_hz={number}', 3.0) for number in ('3', '3.0', '3e0', '30.0e-1')),
        ('lines=', ()),
    ],
)
def test_a_setting_may_be_written_in_any_way(words: str, value: object) -> None:
    arguments = parser_of('replay').parse_args(['replay', 'x', '--set', words])
    (config,) = settings_of(arguments, 'hunting_detector', DetectorConfig)
    assert getattr(config, words.partition('=')[0]) == value


def test_an_option_has_one_meaning_in_every_verb(capsys) -> None:
    """The same name takes the same kind of value, and says the same of it."""
    seen: dict[str, dict[object, list[str]]] = {}
    for verb in VERBS:
        parser = Parser()
        parser.description = ''
        module_of(verb).configure(parser)
        for action in parser._actions:
            for name in action.option_strings:
                kind = (action.metavar, action.nargs, type(action).__name__)
                seen.setdefault(name, {}).setdefault(kind, []).append(verb)
    for name, kinds in seen.items():
        # What is written is a file or a folder, as the verb makes one or several.
        assert len(kinds) == 1 or name == '--out', f'{name}: {kinds}'
    assert not {'--param', '--channels'} & set(seen)


def test_the_services_of_the_table_stand_in_the_page_of_the_topics() -> None:
    from hunt_ros.services import SERVICES

    page = (Path(__file__).parents[2] / 'docs/topics.md').read_text(encoding='utf-8')
    for word, service in SERVICES.items():
        assert f'| `{word}` | `{service.name}` | {service.does} |' in page


def test_a_reader_that_goes_away_leaves_the_json_that_was_asked_for(tmp_path, monkeypatch) -> None:
    """`hunt check BAG --json found.json | head -1`: the file is the result."""
    gone = mock.Mock(side_effect=BrokenPipeError)
    monkeypatch.setattr('builtins.print', gone)
    with pytest.raises(BrokenPipeError):
        tell(Found({'found': 1}, ['found']), str(tmp_path / 'found.json'))
    assert json.loads((tmp_path / 'found.json').read_text()) == {'found': 1}
