"""Whatever is wrong with what a user gives: one line that names it, exit code 2, no traceback."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from made import record_of

from hunt_ros.bag import write_record
from hunt_ros.bag.plausible import wrong_unit
from hunt_ros.cli.main import main
from hunt_ros.samples import Series

#: Times of short recordings, s.
THREE_S = 1.0 + np.arange(300) / 100.0
#: What may be wrong with a file that is named.
FAULTS = ('missing', 'folder', 'binary', 'empty', 'unreadable')
#: Every argument of every verb that names a file to read; FILE stands for it.
FILES = {
    'replay': 'replay FILE',
    'replay --normal-form': 'replay BAG --normal-form FILE',
    'replay --rig': 'replay BAG --rig FILE',
    'check': 'check FILE',
    'identify': 'identify FILE',
    'report': 'report FILE --out OUT.html',
    'info': 'info FILE',
    'info --repair': 'info FILE --repair OUT',
    'export': 'export FILE OUT.csv',
    'import': 'import FILE.csv OUT',
    'import .mat': 'import FILE.mat OUT',
    'import .npy': 'import FILE.npy OUT',
    'simulate --wheelset': 'simulate OUT --wheelset FILE',
    'normal-form': 'normal-form FILE',
    'simulate --profile': 'simulate OUT --profile FILE',
    'run --rig': 'run --simulated --rig FILE --directory OUT',
    'run --normal-form': 'run --simulated --normal-form FILE --directory OUT',
}
#: Options of every verb that take a number, one of each kind; X stands for it.
NUMBERS = {
    'demo --pace': 'demo --out OUT --pace X',
    'run --duration': 'run --simulated --directory OUT --duration X',
    'call --wait': 'call mark --wait X',
    'simulate --duration': 'simulate OUT --duration X',
    'simulate --kick time': 'simulate OUT --profile PROFILE --kick X:0.0001',
    'simulate --rate': 'simulate OUT --profile PROFILE --rate X',
    'replay --pace': 'replay BAG --live --pace X',
    'replay --from': 'replay BAG --live --from X',
    'check --duration': 'check --duration X',
    'identify --set prior_v_c': 'identify BAG --set prior_v_c=[X,0.1]',
    'identify --set length_scale_m': 'identify BAG --set length_scale_m=X',
    'plan --budget': 'plan BAG --budget X',
    'identify --set speed_scale_std': 'identify BAG --set speed_scale_std=X',
    'identify --set minimum_hold_s': 'identify BAG --set minimum_hold_s=X',
    'plan --max-escape': 'plan BAG --max-escape X',
    'report --set roller_diameter_m': 'report BAG --out OUT.html --set roller_diameter_m=X',
    'import --rate': 'import TABLE OUT --rate X',
}


@pytest.fixture(scope='module')
def bag(tmp_path_factory) -> Path:
    record = record_of(THREE_S, lateral=7.0, speed=7.0)
    return write_record(tmp_path_factory.mktemp('bags') / 'bag', record)


@pytest.fixture
def refused(bag, tmp_path, capsys):
    table = tmp_path / 'table.csv'
    table.write_text('lateral,speed\n' + '0.001,7\n' * 20)
    profile, seesaw = tmp_path / 'profile.yaml', tmp_path / 'seesaw.yaml'
    profile.write_text('profile: [{hold: {speed_mps: 7, duration_s: 5}}]')
    seesaw.write_text('profile: [{seesaw: {}}]')
    here = {'BAG': bag, 'OUT': tmp_path / 'out', 'TABLE': table, 'PROFILE': profile}
    here['SEESAW'], here['FOLDER'] = seesaw, tmp_path
    here['NESTED'] = tmp_path / 'deep.yaml'
    here['NESTED'].write_text('[' * 20_000)
    here['FORM'] = tmp_path / 'form.yaml'
    here['FORM'].write_text('normal_form: {v_c: 8.0, D1: fast, D4: 1, D7: 0, D10: 0, D15: -1}')
    for word, channel in (('STILL', 'lateral'), ('MUTE', 'speed')):
        here[word] = write_record(tmp_path / channel, record_of(THREE_S, **{channel: 7.0}))

    def contents() -> dict[Path, int]:
        files = (path for path in tmp_path.rglob('*') if path.is_file())
        return {path: path.stat().st_mtime_ns for path in files}

    def check(command: str, **places: object) -> str:
        """Run a command that must be refused; return the one line it prints."""
        words = command.split()
        for name, value in {**here, **places}.items():
            words = [word.replace(name, str(value)) for word in words]
        before = contents()
        code = main(words)
        captured = capsys.readouterr()
        lines = captured.err.strip().splitlines()
        assert code == 2, captured
        assert len(lines) == 1, captured.err
        assert lines[0].startswith(f'hunt {words[0]}: ')
        assert 'Traceback' not in captured.err
        assert contents() == before, 'what is refused writes nothing'
        return lines[0]

    return check


@pytest.mark.parametrize('fault', FAULTS)
@pytest.mark.parametrize('command', FILES.values(), ids=FILES)
def test_a_file_that_cannot_be_used_is_named(refused, tmp_path, command, fault) -> None:
    file = tmp_path / 'given'
    ending = next((word[4:] for word in command.split() if word.startswith('FILE.')), '')
    place = tmp_path / f'given{ending}'
    if fault == 'folder':
        place.mkdir()
    elif fault == 'unreadable':
        place.symlink_to('/proc/self/mem')  # an error of input, for every user
    elif fault != 'missing':
        place.write_bytes({'binary': bytes(range(256)) * 8, 'empty': b''}[fault])
    assert 'given' in refused(command, FILE=file)


@pytest.mark.parametrize('command', ['run --rig PIPE --simulated', 'check BAG --rig PIPE'])
def test_a_rig_file_that_can_be_read_once_is_told_as_such(refused, tmp_path, command) -> None:
    """As of `--rig <(...)`: what is read of it a second time is empty."""
    os.mkfifo(tmp_path / 'pipe')
    assert 'expected a file, got a pipe' in refused(command, PIPE=tmp_path / 'pipe')


@pytest.mark.parametrize('verb', ['check', 'replay'])
def test_a_slip_in_the_section_of_the_detector_is_named(refused, tmp_path, verb) -> None:
    rig = tmp_path / 'rig.yaml'
    rig.write_text('/**/hunting_detector: {ros__parameters: {margin_inn: 4.0}}')
    line = refused(f'{verb} BAG --rig RIG', RIG=rig)
    assert 'unknown margin_inn, expected margin_in' in line


def test_a_folder_of_recordings_names_them(refused, tmp_path) -> None:
    for name in 'dbca':
        (tmp_path / 'runs' / name).mkdir(parents=True)
        (tmp_path / 'runs' / name / 'run_0.mcap').write_bytes(b'')
    line = refused('info RUNS', RUNS=tmp_path / 'runs')
    assert line.endswith('it holds a, b, c and 1 more: name them one by one')


@pytest.mark.parametrize('command', ['info RUNS', 'replay RUNS', 'info RUNS --repair OUT'])
def test_recordings_thrown_together_are_not_read_as_one(refused, bag, tmp_path, command) -> None:
    (tmp_path / 'runs').mkdir()
    for day in ('monday', 'tuesday'):
        shutil.copy(next(bag.glob('*.mcap')), tmp_path / 'runs' / f'{day}.mcap')
    line = refused(command, RUNS=tmp_path / 'runs')
    assert 'monday.mcap and tuesday.mcap are not of one recording' in line


@pytest.mark.parametrize('command', ['info ONE', 'import ONE OUT'])
def test_a_bag_of_ros_1_is_told_what_converts_it(refused, tmp_path, command) -> None:
    (tmp_path / 'one.bag').write_bytes(b'#ROSBAG V2.0\n')
    assert 'rosbags-convert --src one.bag' in refused(command, ONE=tmp_path / 'one.bag')


@pytest.mark.parametrize('number', ['nan', 'inf', '-inf', '-3', '1e300', 'seven', ''])
@pytest.mark.parametrize('command', NUMBERS.values(), ids=NUMBERS)
def test_a_number_that_makes_no_sense_is_named_with_its_option(refused, command, number) -> None:
    line = refused(command, X=number)
    option = next(
        word for word in reversed(command[: command.index('X')].split()) if word.startswith('--')
    )
    assert option in line or option.removeprefix('--').replace('-', '_') in line, line


@pytest.mark.parametrize(
    ('command', 'part'),
    [
        ('replay', 'bag'),
        ('identify BAG --set margin_in=1', 'expected NAME=VALUE with one of channels'),
        ('identify FORM', '"hunt import" makes one'),
        ('replay STILL', 'speed'),
        ('replay MUTE', 'lateral'),
        ('replay BAG --set margin_in=-1', 'margin_in'),
        ('replay BAG --set nonsense=1', 'nonsense'),
        ('replay BAG --set channels=[lateral,smell]', 'smell'),
        ('replay BAG --normal-form FORM', 'form.yaml: D1'),
        ('simulate FOLDER', 'exists'),
        ('simulate OUT --profile PROFILE --rate 1e6 --duration 1000', '--rate'),
        ('simulate OUT --profile PROFILE --rate 0.1', 'too few to show hunting of 2.84 Hz'),
        ('simulate OUT --profile PROFILE --kick 50:1e-4', '--kick'),
        ('import TABLE OUT --rate 9 --channel heave=a', 'heave'),
        ('import TABLE BAG --rate 9', 'exists'),
        ('export BAG OUT.xls', '.xls'),
        ('export BAG TABLE', 'exists'),
        ('export BAG OUT.csv --channel a=/rig/lateral.effort[0]', 'there is no [0]'),
        ('replay BAG --live --from 10 --to 5', '--to'),
        ('replay BAG --from 1', '--from: only with --live'),
        ('replay BAG --namespace lab', '--namespace: only with --live'),
        ('export BAG OUT.csv --from 2 --to 1', '--to'),
        ('simulate OUT --profile PROFILE --kick 2:1000', 'throws the wheelset off'),
        ('simulate OUT --profile SEESAW', 'seesaw.yaml, step 1 (seesaw): duration_s is missing'),
        ('run --simulated --directory TABLE/sub', 'table.csv'),
        ('demo --out TABLE', 'table.csv'),
        ('demo --out /proc/nobody', '/proc/nobody'),
        ('simulate TABLE/sub --profile PROFILE', 'table.csv'),
        ('export BAG TABLE/sub.csv', 'table.csv'),
        ('normal-form config/wheelset.yaml --json TABLE/sub', 'table.csv'),
        ('call dance', 'dance'),
        ('call emergency-stop now', 'takes no words'),
        ('run --directory OUT', '--simulated (a simulated one), --listen'),
        ('identify BAG --out FOLDER/gone/f.yaml', 'gone/f.yaml'),
        ('identify BAG --out FOLDER/form.npz', 'ends in .yaml or .yml'),
        ('report BAG --out FOLDER/report.pdf', 'ends in .html'),
        ('run --simulated --sim-time', 'only with --listen'),
        ('identify BAG --ignore 5:2', 'FROM first'),
        ('identify BAG --set lateral_range_m=-1', 'lateral_range_m'),
        ('identify BAG --ignore 7', 'expected FROM:TO'),
        ('identify BAG --set hunting_frequency_hz=0.01', 'below 0.05 Hz'),
        ('identify BAG --set prior_v_c=[8]', 'expected value and standard deviation'),
        ('report BAG --figures TABLE/sub', 'table.csv'),
        ('report BAG --compare --out OUT.html', '--compare: 1 recording, expected 2 to'),
        ('normal-form config/wheelset.yaml --plot FOLDER', 'expected a file in a folder'),
        ('export BAG OUT.csv --from 60', 'in this time, it lasts 2.990 s'),
        ('plan BAG --start 100 --set speed_ceiling_mps=9', 'above the ceiling'),
        ('replay BAG --rig bags/paper.yaml', 'is a normal form, expected --normal-form'),
        ('check BAG --namespace x', '--namespace: only for live topics'),
        ('normal-form NESTED', 'nested'),
        ("replay BAG --set '", 'NAME=VALUE'),
        ('replay BAG --set margin_in=[', 'margin_in'),
        ('replay BAG --channel heave=/a.b', 'heave'),
        ('run --simulated --namespace 1/2', '--namespace'),
        ('identify BAG --cluster tcp://127.0.0.1:1', '127.0.0.1:1'),
        ('identify BAG --cluster nonsense', 'nonsense'),
        ('calibrate OUT.yaml', '--points'),
        ('calibrate OUT.yaml --points 1=1', '1 points: expected two'),
        ('calibrate OUT.yaml --points 1=1,1=2', 'two different readings'),
        ('calibrate OUT.yaml --points 1=2,2=2', 'two different readings and displacements'),
        ('calibrate OUT.yaml --points 1=1,2', 'expected READING=KNOWN, got 2'),
        ('calibrate OUT.yaml --points 1=1,2=much', 'to 1e+12, got much'),
        ('calibrate OUT.yaml --points 1=1,2=2 --unit furlong', '--unit furlong: expected one'),
        ('calibrate OUT.yaml --points 1=1,2=2 --range 3,2', 'range: (3.0, 2.0), expected a lower'),
        ('calibrate FORM --points 1=1,2=2', 'form.yaml: is there already'),
    ],
)
def test_what_cannot_be_meant_is_refused(refused, command, part) -> None:
    assert part in refused(command)


@pytest.mark.parametrize('domain', ['233', '-1', 'rig'])
def test_a_domain_that_dds_does_not_have_is_refused_before_anything_starts(
    refused, monkeypatch, domain
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', domain)
    assert f'ROS_DOMAIN_ID={domain}' in refused('run --simulated --directory FOLDER')


@pytest.mark.parametrize('words', ['hover', '', 'replay x --speed 7', 'replay x --fres'])
def test_words_that_are_none_of_the_program_are_one_line(capsys, words) -> None:
    """An option may not be abbreviated: the letters would mean another as soon as it is added."""
    assert main(words.split()) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith('hunt')


@pytest.mark.parametrize(
    ('columns', 'part'),
    [
        ('lateral_furlong,speed', 'column lateral_furlong: unknown unit of lateral'),
        ('lateral_deg,speed', 'column lateral_deg: unknown unit of lateral'),
        ('lateral,speed_mm', 'column speed_mm: unknown unit of speed'),
        ('lateral,speed', 'channel lateral is beyond 84 m'),
    ],
)
def test_a_unit_that_is_wrong_or_unknown_is_named(refused, tmp_path, columns, part) -> None:
    table = tmp_path / 'daq.csv'
    table.write_text(f'{columns}\n' + '84,7\n-84,7\n0,7\n' * 100)
    assert part in refused('import FILE OUT --rate 100', FILE=table)


@pytest.mark.parametrize(
    'times', ['0.1 0.1 0.1 0.1 0.2 0.2 0.2 0.2', '3 3 3 3 3 3 3 3', '1 1 2 2 3 3 4 5']
)
def test_times_that_are_too_coarse_are_named(refused, tmp_path, times) -> None:
    """As a logger of 5 kHz writes them in milliseconds: most samples would be repeats."""
    table = tmp_path / 'daq.csv'
    table.write_text('t,lateral,speed\n' + ''.join(f'{time},0.001,7\n' for time in times.split()))
    assert 'lateral has 8 values at' in refused('import FILE OUT', FILE=table)


def test_channels_that_are_not_there_are_told_with_those_that_are(refused, tmp_path) -> None:
    bag = write_record(tmp_path / 'yaw', record_of(THREE_S, yaw=1e-3))
    for verb in ('replay', 'identify', 'plan', 'report'):
        line = refused(f'{verb} FILE', FILE=bag)
        assert 'is not in it, expected a topic named' in line
        assert 'it has /rig/yaw' in line


@pytest.mark.parametrize('quiet', [0, 800], ids=['always', 'a fifth of the time'])
@pytest.mark.parametrize('amplitude', [84.0, 0.7], ids=['84 mm', '0.7 mm'])
def test_a_recording_in_millimetres_is_neither_sound_nor_judged(
    refused, tmp_path, capsys, amplitude, quiet
) -> None:
    wave = amplitude * np.sin(0.18 * np.arange(1000)) * (np.arange(1000) >= quiet / 2)
    wave[1000 - quiet // 2 :] = 0.0
    record = record_of(1.0 + np.arange(1000) / 100.0, lateral=wave, speed=7.0)
    bag = write_record(tmp_path / 'mm', record)
    for verb in ('replay', 'identify'):
        assert 'lateral is beyond' in refused(f'{verb} FILE', FILE=bag)
    capsys.readouterr()
    assert main(['info', str(bag)]) == 1
    assert 'wrong_unit: channel lateral is beyond' in capsys.readouterr().out
    scaled = ['--channel', 'lateral=/rig/lateral.position[0]*0.001']
    assert main(['replay', str(bag), *scaled]) == 0


def test_numbers_that_are_the_bytes_of_another_type_are_named(refused, tmp_path, capsys) -> None:
    """The recorder that writes a JointState under the name of a Float64."""
    noise = np.abs(np.random.default_rng(0).normal(size=3000))
    record = record_of(
        1.0 + np.arange(3000) / 100.0, lateral=1e-23 * noise, yaw=5e-324, speed=1e-313
    )
    bag = write_record(tmp_path / 'bytes', record)
    for verb in ('replay', 'identify'):
        assert 'm at most: of another type than it says?' in refused(f'{verb} FILE', FILE=bag)
    capsys.readouterr()
    assert main(['check', str(bag)]) == 1
    assert 'speed unit' in capsys.readouterr().out


@pytest.mark.parametrize('wraps', [False, True])
def test_a_roller_in_degrees_is_not_taken_for_one_in_radians(refused, tmp_path, wraps) -> None:
    times = 1.0 + np.arange(1000) / 100.0
    angle = np.degrees(7.0 / 0.15 * times)
    angle = angle % 360.0 if wraps else angle
    record = record_of(times, lateral=1e-4 * np.sin(18.0 * times), speed=7.0, roller=angle)
    bag = write_record(tmp_path / 'degrees', record)
    assert 'roller is beyond' in refused('replay FILE', FILE=bag)
    assert main(['replay', str(bag), '--channel', 'roller=/rig/roller*0.0174533']) == 0


@pytest.mark.parametrize('what', ['turns', 'stands where it wraps', 'error code', 'set to zero'])
def test_a_roller_in_radians_is_not_taken_for_one_in_degrees(what) -> None:
    angle = 20.0 * np.arange(10_000) / 1000.0
    if what == 'stands where it wraps':
        angle = 1e-3 * np.random.default_rng(0).normal(size=10_000)
    angle %= 2.0 * np.pi
    if what == 'error code':
        angle[[100, 5000]] = 1e6
    if what == 'set to zero':
        angle[:5000] += 1e6
    assert wrong_unit('roller', Series(10**6 * np.arange(10_000), angle)) == ''


def test_a_unit_that_nobody_told_is_said_to_be_assumed(tmp_path, capsys) -> None:
    table = tmp_path / 'quiet.csv'  # 0.02 mm are as little in m as no rig can be blamed for
    rows = (f'{0.01 * i},{0.02 * np.sin(0.18 * i)},0.0,7' for i in range(2000))
    table.write_text('t,lateral,yaw,speed_mps\n' + '\n'.join(rows))
    bag = tmp_path / 'bag'
    assert main(['import', str(table), str(bag)]) == 0
    assert 'the file tells no unit, assumed: lateral in m, yaw in rad' in capsys.readouterr().out
    assert main(['info', str(bag)]) == 0
    assert 'units_assumed: lateral in m, yaw in rad' in capsys.readouterr().out
    main(['check', str(bag)])
    assert 'tells no unit, assumed: lateral in m, yaw in rad' in capsys.readouterr().out


def test_an_event_without_a_speed_has_a_dash() -> None:
    from hunt_ros.cli.support.screen import event_line

    event = {'stamp_ns': '0', 'event': 'quiet', 'speed_mps': 'nan', 'amplitude_m': 'nan'}
    assert 'nan' not in event_line(event, 0)
    assert event_line(event, 0).index('quiet') == event_line(
        {**event, 'speed_mps': '-7.2'}, 0
    ).index('quiet')


@pytest.mark.parametrize('words', [['info', 'BAG', '--repair', ''], ['info', 'BAG', '--json', '']])
def test_an_empty_name_is_refused(bag, capsys, words) -> None:
    """A variable of a script that was not set."""
    assert main([str(bag) if word == 'BAG' else word for word in words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "got ''" in line


def test_the_usual_place_of_a_report_is_looked_at_before_the_work(
    bag, capsys, monkeypatch
) -> None:
    monkeypatch.setattr('os.access', lambda path, mode: False)
    assert main(['report', str(bag)]) == 2
    assert 'argument --out: report.html may not be written' in capsys.readouterr().err


def test_an_error_of_the_program_is_one_line(bag, capsys, monkeypatch) -> None:
    from hunt_ros.cli import info

    def broken(arguments) -> int:
        raise TypeError('two\nlines')

    monkeypatch.setattr(info, 'run', broken)
    assert main(['info', str(bag)]) == 3
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith('hunt info: internal error (TypeError: two lines), please report it')


@pytest.mark.parametrize(
    'where', ['hunt_ros.cli.main.parser_of', 'hunt_ros.compiled.on_compilation']
)
def test_an_interrupt_is_an_interrupt_at_any_moment(bag, capsys, monkeypatch, where) -> None:
    def interrupted(*arguments) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(where, interrupted)
    assert main(['info', str(bag)]) == 130
    assert capsys.readouterr().err.strip() == 'hunt info: interrupted'
