from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.bag.record_writer import write_record
from hunt_ros.cli.main import main
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile.speed_profile import SpeedProfile
from hunt_ros.dynamics.simulation import Kick, SensorModel, SimulationSettings, simulate
from hunt_ros.identification import Identification


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    settings = SimulationSettings(
        sample_rate_hz=100.0, broadband=8e-6, lateral_sensor=SensorModel(noise=5e-6)
    )
    profile = SpeedProfile((0.0, 140.0, 280.0), (6.0, 8.8, 6.0))
    kicks = [Kick(30.0, lateral_m=1e-4), Kick(60.0, lateral_m=1e-4), Kick(90.0, lateral_m=1e-4)]
    record = simulate(paper_rig(), settings, profile, kicks=kicks, seed=4)
    return write_record(tmp_path_factory.mktemp('bags') / 'sweep.mcap', record)


def test_a_bag_gives_json_and_a_parameter_file(bag, tmp_path, capsys):
    out, target, branches = (tmp_path / name for name in ('form.yaml', 'result.json', 'b.csv'))
    words = ['identify', str(bag), '--out', str(out), '--json', str(target)]
    assert main([*words, '--branches', str(branches), '--ignore', '10:12']) == 0
    document = json.loads(target.read_text())
    form = IdentifiedNormalForm.from_yaml(out.read_text(), str(out))
    assert document['v_c']['value'] == pytest.approx(form.form.critical_speed)
    assert document['v_n']['value'] == pytest.approx(6.43, abs=0.1)
    assert 'v_n' in capsys.readouterr().out
    header, *rows = (line.split(',') for line in branches.read_text().splitlines())
    assert header[:3] == ['speed_mps', 'stable_m', 'stable_low_m']
    assert len(rows) == len(document['branches'])
    for row, point in zip(rows, document['branches'], strict=True):
        assert float(row[0]) == point['speed_mps']
        assert (float(row[1]) if row[1] else None) == point['stable_amplitude_m']
    # Beside the parameter file stands all that was learnt.
    whole = Identification.load(out.with_suffix('.npz'), form)
    assert whole.to_json() == document


def test_json_alone_stands_on_standard_output(bag, capsys):
    main(['identify', str(bag), '--json', '-', '--prior-v-c', '8.0:0.05', '--prior-D1', '0.12'])
    document = json.loads(capsys.readouterr().out)
    assert np.isclose(document['v_c']['value'], 8.0, atol=0.15)


@pytest.mark.parametrize(
    'words',
    [
        ['--prior-v-c', 'fast'],
        ['--length-scale', '-1'],
        ['--mapping', '/nowhere.yaml'],
        ['--out', 'form.npz'],
        ['--ignore', '5:2'],
        ['--ignore', '7'],
        ['--ignore', '2:10:20'],
        ['--frequency-range', '3'],
        ['--minimum-hold', '0'],
        ['--sensor-range', '-1'],
        ['--clearance', 'wide'],
    ],
)
def test_a_wrong_option_is_one_line_and_exit_2(bag, words, capsys):
    assert main(['identify', str(bag), *words]) == 2
    assert capsys.readouterr().err.count('\n') == 1


FLUTTER = Path(__file__).parents[2] / '../shared/data/flutter_rig'


@pytest.mark.skipif(not FLUTTER.is_dir(), reason='the flutter recordings are not on this machine')
def test_days_of_the_flutter_rig_are_reported_with_their_spread(tmp_path, capsys):
    chosen = [
        path
        for path in sorted(FLUTTER.glob('*.mat'))
        if re.search(r'_V(198|20[67]|24[12]|250|25[589])_', path.name)
    ]
    bags = []
    for path in chosen:
        speed = float(re.search(r'_V(\d+)_', path.name).group(1)) / 10.0
        bags.append(str(tmp_path / path.stem))
        channels = ['--channel', 'lateral=data[1]*0.47', '--channel', f'speed={speed}']
        assert main(['import', str(path), bags[-1], *channels, '--rate', '250']) == 0
    capsys.readouterr()
    words = ['--length-scale', '0.1', '--day', r'/(\d{8})_', '--json', '-']
    assert main(['identify', *bags, *words]) == 1
    document = json.loads(capsys.readouterr().out)
    days = document['days']
    assert [day['day'] for day in days['summary']] == ['17092018', '18092018', '19092018']
    # Amplitudes of some tens of millimetres, days a few millimetres apart.
    assert 3e-4 < days['day_std_m'] < 5e-3
    assert days['stable_branch']
    for point in days['stable_branch']:
        assert point['days'] >= 2
        low, high = point['ci95_m']
        assert low < point['amplitude_m'] < high
    # Hits decayed up to 23.7 m/s and grew from 25.9 m/s on; between, it depended on the day.
    assert 23.7 <= days['highest_decay_mps'] <= 25.9
    assert 23.7 <= days['lowest_growth_mps'] <= 25.9
    assert any(rate['day_std_per_s'] > 0.3 for rate in days['growth_rates'])
    # Free motion decays below v_c only: a law that says otherwise is not believed.
    v_c, words = document['v_c'], document['warnings']
    assert v_c is None or v_c['ci95'][1] > days['highest_decay_mps']
    assert v_c or any('free motion still decayed' in warning for warning in words)


@pytest.mark.parametrize('pattern', ['2024', '(', r'(\d{9})'])
def test_a_pattern_of_days_that_does_not_fit_is_one_line_and_exit_2(bag, pattern, capsys):
    assert main(['identify', str(bag), '--day', pattern]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert '--day' in error


def test_a_bag_that_was_cut_is_used_and_said_to_be_damaged(bag, tmp_path, capsys):
    cut = tmp_path / 'cut.mcap'
    (whole,) = bag.glob('*.mcap')
    content = whole.read_bytes()
    cut.write_bytes(content[: len(content) * 9 // 10])
    main(['identify', str(cut), '--json', '-'])
    warnings = json.loads(capsys.readouterr().out)['warnings']
    assert any(warning.startswith(f'{cut}: damaged: ') for warning in warnings)


def test_the_roller_diameter_of_a_report_is_a_length(bag, tmp_path, capsys):
    words = ['report', str(bag), '--out', str(tmp_path / 'r.html'), '--roller-diameter', '-0.3']
    assert main(words) == 2
    assert '--roller-diameter' in capsys.readouterr().err
