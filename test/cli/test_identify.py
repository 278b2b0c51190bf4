from __future__ import annotations

import json

import numpy as np
import pytest

from hunt_ros.bag.writer import write_record
from hunt_ros.cli.main import main
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import Kick, SensorModel, SimulationSettings, simulate
from hunt_ros.dynamics.speed_profile import SpeedProfile


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
    out, target = tmp_path / 'form.yaml', tmp_path / 'result.json'
    assert main(['identify', str(bag), '--out', str(out), '--json', str(target)]) == 0
    document = json.loads(target.read_text())
    form = IdentifiedNormalForm.from_yaml(out.read_text(), str(out))
    assert document['v_c']['value'] == pytest.approx(form.form.critical_speed)
    assert document['v_n']['value'] == pytest.approx(6.43, abs=0.1)
    assert 'v_n' in capsys.readouterr().out


def test_json_alone_stands_on_standard_output(bag, capsys):
    main(['identify', str(bag), '--json', '-', '--prior-v-c', '8.0:0.05', '--prior-D1', '0.12'])
    document = json.loads(capsys.readouterr().out)
    assert np.isclose(document['v_c']['value'], 8.0, atol=0.15)


@pytest.mark.parametrize(
    'words',
    [['--prior-v-c', 'fast'], ['--length-scale', '-1'], ['--mapping', '/nowhere.yaml']],
)
def test_a_wrong_option_is_one_line_and_exit_2(bag, words, capsys):
    assert main(['identify', str(bag), *words]) == 2
    assert capsys.readouterr().err.count('\n') == 1
