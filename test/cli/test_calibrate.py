"""`hunt calibrate`: known displacements in, a file that a sensor node takes out."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from hunt_ros.cli.main import main
from hunt_ros.drivers.calibration import Calibration

ROOT = Path(__file__).parents[2]
_POINTS = '1=-8.01,3=-4,5=0.02,7=3.99,9=8'


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _refused(arguments: list[str], capsys) -> str:
    assert main(['calibrate', *arguments]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


def test_points_become_a_file_that_a_sensor_takes(folder, capsys) -> None:
    arguments = ['lateral.yaml', '--unit', 'mm', '--points', _POINTS, '--range', '0.1,9.9']
    assert main(['calibrate', *arguments, '--picture', 'lateral.svg', '--json', '-']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['gain']['value'] == pytest.approx(2.0005e-3)
    assert found['gain']['std'] == pytest.approx(found['residual_std'] / 40**0.5)
    low, high = found['gain']['ci95']
    assert high - low > 2.0 * 3.18 * found['gain']['std'], 'three degrees of freedom'
    residuals = [point['residual'] for point in found['points']]
    assert sum(residuals) == pytest.approx(0.0, abs=1e-12)
    assert all(point['residual_std'] > 0.0 for point in found['points'])
    assert not found['warnings']
    calibration = Calibration.read('lateral.yaml', 'lateral')
    assert calibration.range == (0.1, 9.9)
    assert calibration.apply([5.0])[0] == pytest.approx(0.0, abs=2e-5)
    assert '</svg>' in Path('lateral.svg').read_text()


def test_the_old_file_is_kept_with_a_date(folder, capsys) -> None:
    Path('yaw.yaml').write_text('by hand')
    arguments = ['yaw.yaml', '--sensor', 'yaw', '--points=-1=-0.1,1=0.1', '--json', '-']
    assert main(['calibrate', *arguments]) == 0
    found = json.loads(capsys.readouterr().out)
    assert Path(found['kept']).read_text() == 'by hand'
    assert found['kept'].startswith('yaw.yaml.20')
    assert found['kept'].endswith('.bak')
    assert found['gain']['std'] is None, 'two points tell nothing of their scatter'
    assert Calibration.read('yaw.yaml', 'yaw').gain == pytest.approx(0.1)


def test_points_that_bend_are_named_and_a_table_takes_them(folder, capsys) -> None:
    Path('points.csv').write_text(
        'reading,known\n# a comment\n' + ''.join(f'{x},{x + 0.05 * x * x}\n' for x in range(8))
    )
    arguments = ['lateral.yaml', '--csv', 'points.csv', '--unit', 'mm']
    assert main(['calibrate', *arguments]) == 1
    assert '--table' in capsys.readouterr().out
    assert main(['calibrate', *arguments, '--table', '--picture', 'lateral.png']) == 0
    assert Calibration.read('lateral.yaml', 'lateral').apply([4.0])[0] == pytest.approx(4.8e-3)
    assert Path('lateral.png').stat().st_size > 1000


def test_a_person_is_guided_and_the_sensor_is_read_at_each_displacement(
    folder, capsys, monkeypatch
) -> None:
    monkeypatch.setattr('sys.stdin', io.StringIO('0\nfive\n5\n\n'))
    driver = ['--driver', 'replay', '--set', f'bag={ROOT / "bags/kick_decays"}', '--rate', '100']
    arguments = ['lateral.yaml', '--unit', 'mm', *driver, '--seconds', '0.2', '--json', '-']
    assert main(['calibrate', *arguments]) == 0
    text = capsys.readouterr()
    assert [point['known'] for point in json.loads(text.out)['points']] == [0.0, 5e-3]
    assert text.err.count('known displacement, mm') == 4
    assert "'five' is no number" in text.err


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--points', '1=1'], '1 points, expected two'),
        (['--points', '1=1,1=2'], 'two different readings'),
        (['--points', '1=1,2'], "'2', expected READING=KNOWN"),
        (['--points', '1=1,2=much'], "'much', expected a number"),
        (['--points', '1=1,2=nan'], "'nan', expected a number"),
        (
            ['--points', '1=0,2=1,3=0.5', '--table'],
            'row 3: 0.5 after 1, expected monotonic values',
        ),
        (['--points', '1=1,2=2', '--unit', 'furlong'], '--unit furlong: expected one of m, mm'),
        (['--points', '1=1,2=2', '--range', '3,2'], '--range 3,2'),
        (['--points', '1=1,2=2', '--set', 'bag=x'], '--set: has an effect with --driver only'),
        (['--points', '1=1,2=2', '--picture', 'a.gif'], '--picture a.gif'),
        (['--csv', 'nowhere.csv'], 'nowhere.csv: cannot read it'),
        (['--csv', 'three.csv'], 'three.csv: row 1: 3 columns'),
        (['--driver', 'telepathy'], "driver 'telepathy': unknown, those there are: "),
        (['--driver', 'modbus', '--set', 'pot=1'], '--set pot=1: expected NAME=VALUE'),
        (['--driver', 'modbus', '--set', 'port=1'], 'modbus tcp 127.0.0.1:1 device 1: cannot'),
        ([], 'one of the arguments --points --csv --driver is required'),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(folder, capsys, arguments, words) -> None:
    Path('three.csv').write_text('1,2,3\n')
    Path('lateral.yaml').write_text('old')
    assert words in _refused(['lateral.yaml', *arguments], capsys)
    assert Path('lateral.yaml').read_text() == 'old'
    assert not list(folder.glob('*.bak'))
