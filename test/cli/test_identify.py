from __future__ import annotations

import json
import re

import pytest
from made import FLUTTER, sweep_bag

from hunt_ros.cli.main import main
from hunt_ros.cli.support.options import Parser
from hunt_ros.cli.support.recordings import add_recordings, settings_of
from hunt_ros.dynamics.growth_law import GrowthLaw
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import HuntError
from hunt_ros.identification import Identification


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return sweep_bag(tmp_path_factory.mktemp('bags'), 4)


def test_a_bag_gives_json_and_a_parameter_file(bag, tmp_path, capsys):
    out, target = tmp_path / 'form.yaml', tmp_path / 'result.json'
    words = ['identify', str(bag), '--out', str(out), '--json', str(target)]
    assert main([*words, '--ignore', '10:12']) == 0
    document = json.loads(target.read_text())
    form = IdentifiedNormalForm.from_yaml(out.read_text(), str(out))
    assert document['v_c']['value'] == pytest.approx(form.form.critical_speed)
    assert document['v_n']['value'] == pytest.approx(6.43, abs=0.1)
    assert 'v_n' in capsys.readouterr().out
    # Beside the parameter file stands all that was learnt.
    whole = Identification.load(out.with_suffix('.npz'), form)
    assert whole.to_json() == document


def test_a_disk_that_refuses_leaves_no_form_without_its_identification(
    bag, tmp_path, monkeypatch, capsys
):
    def refuse(path, content, what):
        raise HuntError(f'{path}: cannot write the {what} (No space left on device)')

    monkeypatch.setattr('hunt_ros.cli.identify.write_whole', refuse)
    assert main(['identify', str(bag), '--out', str(tmp_path / 'form.yaml')]) == 2
    assert 'form.npz: cannot write the identification' in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]


@pytest.mark.skipif(not FLUTTER.is_dir(), reason='the flutter recordings are not on this machine')
def test_three_days_of_the_flutter_rig_are_bracketed(tmp_path, capsys):
    chosen = [
        path
        for path in sorted(FLUTTER.glob('*.mat'))
        if re.search(r'_V(198|250|25[589])_', path.name)
    ]
    bags = []
    for path in chosen:
        speed = float(re.search(r'_V(\d+)_', path.name).group(1)) / 10.0
        bags.append(str(tmp_path / path.stem))
        channels = ['--channel', 'lateral=data[1]*0.47', '--channel', f'speed={speed}']
        assert main(['import', str(path), bags[-1], *channels, '--rate', '250']) == 0
    capsys.readouterr()
    words = ['--set', 'length_scale_m=0.1', '--json', '-']
    assert main(['identify', *bags, *words]) == 1
    document = json.loads(capsys.readouterr().out)
    # Kicks died up to 23.7 m/s, and some at 25.9 m/s; hunting was seen down to 19.8 m/s.
    seen = document['bracket']
    assert seen['criticality'] == 'subcritical'
    assert 23.5 <= seen['v_c_above_mps'] <= 25.9
    v_c = document['v_c']
    assert v_c is None or v_c['ci95'][1] > seen['v_c_above_mps']


def test_a_fold_is_told_where_no_critical_speed_is(bag, tmp_path, monkeypatch):
    monkeypatch.setattr(GrowthLaw, 'critical_speed', None)
    out, target = tmp_path / 'form.yaml', tmp_path / 'result.json'
    assert main(['identify', str(bag), '--out', str(out), '--json', str(target)]) == 1
    document = json.loads(target.read_text())
    assert document['v_n']['value'] == pytest.approx(6.43, abs=0.1)
    # With v_n, the width would tell v_c.
    assert document['v_c'] is document['hysteresis_width'] is None
    assert 'v_c is not known' in document['unknown']['hysteresis_width']
    assert not out.exists()


def test_an_option_that_is_short_for_a_setting_is_that_setting() -> None:
    parser = Parser()
    add_recordings(parser)
    words = ['bag', '--prior-v-c', '8.0:0.1', '--length-scale', '0.05']
    words += ['--set', 'lines=', '--set', 'seed=3']
    found = settings_of(parser.parse_args(words))
    assert (found.prior_v_c, found.length_scale_m, found.lines) == ((8.0, 0.1), 0.05, ())
    assert found.seed == 3
