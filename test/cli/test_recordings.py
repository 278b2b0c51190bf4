"""The verbs info, import and export: exit codes, one-line errors, JSON keys."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bags_made import chunks_of
from made import record_of

from hunt_ros.bag import BagWriter, read_record, write_record
from hunt_ros.cli.main import main
from hunt_ros.samples import Record, Series

BAGS = Path(__file__).parents[2] / 'bags'


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    stamps = 10**18 + np.arange(500) * 10_000_000
    channels = {
        name: Series(stamps, 0.05 * np.sin(np.arange(500.0) + number))
        for number, name in enumerate(('lateral', 'yaw', 'roller', 'speed'))
    }
    record = Record(channels, '', {'rig': 'a', 'operator': 'b'})
    with chunks_of(4096):
        return write_record(tmp_path / 'run', record)


def output(capsys) -> dict:
    return json.loads(capsys.readouterr().out)


def test_info_of_a_sound_recording(bag: Path, capsys) -> None:
    assert main(['info', str(bag), '--json', '-']) == 0
    document = output(capsys)
    assert set(document) == {
        'path', 'size_bytes', 'files', 'start_ns', 'duration_s', 'messages', 'notes', 'topics',
        'problems',
    }  # fmt: skip
    assert document['messages'] == 2000
    assert document['notes'] == {'rig': 'a', 'operator': 'b'}
    assert document['problems'] == []
    rates = {topic['name']: topic['rate_hz'] for topic in document['topics']}
    assert list(rates) == ['/rig/lateral', '/rig/roller', '/rig/speed', '/rig/yaw']
    assert rates['/rig/lateral'] == pytest.approx(100.0)


def test_info_repairs_what_cannot_even_be_opened_in_full(
    bag: Path, tmp_path: Path, capsys
) -> None:
    data = (bag / 'run_0.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(data[: len(data) * 3 // 10])
    assert main(['info', str(tmp_path / 'cut.mcap')]) == 1
    assert 'not_closed' in capsys.readouterr().out
    words = ['info', str(tmp_path / 'cut.mcap'), '--repair', str(tmp_path / 'saved')]
    assert main([*words, '--json', '-']) == 0
    document = output(capsys)['repair']
    assert 0 < document['messages'] < 2000
    assert document['lost_bytes'] > 0
    assert len(read_record(tmp_path / 'saved')['lateral']) == document['saved']['/rig/lateral']
    assert main(words) == 2  # never over what is there
    assert 'exists already' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('verb', 'code'), [('replay', 0), ('check', 0), ('identify', 1), ('info', 1)]
)
def test_a_recording_that_was_cut_is_used_and_said_to_be_damaged(
    tmp_path: Path, verb: str, code: int
) -> None:
    seconds = np.arange(2000) / 100.0
    hit = 1e-3 * np.exp(0.5 * (5.0 - seconds)) * np.sin(18.0 * seconds) * (seconds > 5.0)
    noise = 5e-6 * np.random.default_rng(3).standard_normal(2000)
    bag = write_record(tmp_path / 'bag', record_of(seconds, lateral=hit + noise, speed=7.0))
    (whole,), cut, out = bag.glob('*.mcap'), tmp_path / 'cut.mcap', tmp_path / 'out.json'
    cut.write_bytes(whole.read_bytes()[:-100])
    for file, is_damaged in ((whole, False), (cut, True)):
        expected = 0 if verb == 'info' and not is_damaged else code
        assert main([verb, str(file), '--json', str(out)]) == expected
        assert ('cut.mcap: no usable summary' in out.read_text()) == is_damaged
    assert ('no yaw channel in the recording' in out.read_text()) == (verb == 'replay')


def test_what_is_wrong_with_a_recording_is_said_by_its_export_too(bag, tmp_path, capsys) -> None:
    data = (bag / 'run_0.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(data[: len(data) // 2])
    assert main(['export', str(tmp_path / 'cut.mcap'), str(tmp_path / 'a.csv')]) == 0
    assert 'damaged: cut.mcap: no usable summary' in capsys.readouterr().err


def test_a_report_without_a_normal_form_says_why_it_failed(tmp_path: Path, capsys) -> None:
    seconds = np.arange(2000) / 100.0
    noise = 5e-6 * np.random.default_rng(3).standard_normal(2000)
    bag = write_record(tmp_path / 'bag', record_of(seconds, lateral=noise, speed=7.0))
    out = tmp_path / 'report.html'
    assert main(['report', str(bag), '--out', str(out)]) == 1
    page, why = capsys.readouterr().out.splitlines()
    assert page == str(out)
    assert re.match('no normal form: .+', why)


def test_info_of_a_recording_that_is_still_open(bag: Path, tmp_path: Path, capsys) -> None:
    with BagWriter(tmp_path / 'live') as writer:
        key = writer.topic('/a', 'std_msgs/msg/String')
        writer.write(key, 5, b'\x00\x01\x00\x00\x02\x00\x00\x00x\x00')
        writer.flush()
        assert main(['info', str(tmp_path / 'live'), '--json', '-']) == 1
        document = output(capsys)
    assert document['path'].endswith('live.active')
    assert document['messages'] == 1
    assert 'not_closed' in {problem['kind'] for problem in document['problems']}


def test_export_of_a_stretch_and_import_again(bag: Path, tmp_path: Path, capsys) -> None:
    table = tmp_path / 'out.csv'
    assert main(['export', str(bag), str(table), '--from', '1', '--to', '2', '--json', '-']) == 0
    assert output(capsys) == {'file': str(table), 'rows': 100, 'problems': []}
    words = ['import', str(table), str(tmp_path / 'again'), '--note', 'rig=c', '--json', '-']
    assert main(words) == 0
    document = output(capsys)
    assert document['channels']['yaw'] == {'samples': 100, 'rate_hz': pytest.approx(100.0)}
    again = read_record(tmp_path / 'again')
    whole = read_record(bag)
    np.testing.assert_array_equal(again['yaw'].values, whole['yaw'].values[100:200])
    np.testing.assert_array_equal(again['yaw'].stamps_ns, whole['yaw'].stamps_ns[100:200])
    assert again.notes['rig'] == 'c'


def test_import_by_the_sources_of_a_rig_and_an_option_over_them(tmp_path: Path) -> None:
    np.save(tmp_path / 'a.npy', np.arange(60.0).reshape(2, 30))
    rig = tmp_path / 'rig.yaml'
    rig.write_text('/**: {ros__parameters: {sources: ["lateral=data[0]*0.001", "speed=7"]}}')
    words = ['import', str(tmp_path / 'a.npy'), str(tmp_path / 'out'), '--rate', '10']
    assert main([*words, '--rig', str(rig), '--channel', 'speed=8']) == 0
    record = read_record(tmp_path / 'out')
    np.testing.assert_array_equal(record['lateral'].values, np.arange(30.0) * 0.001)
    assert set(record['speed'].values) == {8.0}


def test_a_recording_of_yaw_alone_is_judged_and_told_in_its_unit(tmp_path, capsys) -> None:
    """Exit code 1, "it may hunt or not" and "amplitude unknown" before, beside a limit cycle."""
    record = read_record(BAGS / 'kick_escapes')
    yaw = replace(record, channels={name: record[name] for name in ('yaw', 'roller', 'speed')})
    assert main(['replay', str(write_record(tmp_path / 'yaw', yaw))]) == 0
    said = capsys.readouterr().out
    assert 'it may hunt or not' not in said
    (cycle,) = [line for line in said.splitlines() if 'LIMIT CYCLE' in line]
    assert re.search(r'amplitude [0-9.]+ \+/- [0-9.]+ mrad', cycle)


def test_a_repair_does_not_advise_what_it_does(tmp_path: Path, capsys) -> None:
    damaged = str(Path(__file__).parents[2] / 'bags' / 'damaged.mcap')
    assert main(['info', damaged]) == 1
    assert '--repair OUT' in capsys.readouterr().out
    assert main(['info', damaged, '--repair', str(tmp_path / 'saved')]) == 0
    assert '--repair OUT' not in capsys.readouterr().out
