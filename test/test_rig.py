"""A rig is described once: every node and every verb takes what it needs from one file."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import fields
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from made import record_of

from hunt_ros.bag import read_record, write_record
from hunt_ros.cli.main import main
from hunt_ros.detection import DetectorConfig
from hunt_ros.errors import ConfigError
from hunt_ros.rig import PARAMETERS, Rig, told_by
from hunt_ros.settings import Settings
from hunt_ros.suite import NODES, PAGE, SENSORS

ROOT = Path(__file__).parents[1]
SHIPPED = ROOT / 'config' / 'rig.yaml'


def _file(folder: Path, text: str, section: str = '/**') -> Path:
    path = folder / 'my_rig.yaml'
    path.write_text(f'{section}:\n  ros__parameters: {{{text}}}\n')
    return path


@pytest.fixture(scope='module')
def bag(tmp_path_factory) -> Path:
    """A recording of rig A, with the lateral displacement in millimetres under another name."""
    motion = 1e-3 * np.sin(2.0 * np.pi * 2.8 * np.arange(400) / 100.0)
    record = record_of(1.0 + np.arange(400) / 100.0, lateral=motion, speed=7.0)
    return write_record(tmp_path_factory.mktemp('bags') / 'bag', record, notes={'rig': 'rig A'})


def test_the_file_of_the_package_describes_a_rig_of_every_parameter() -> None:
    text = SHIPPED.read_text()
    rig = told_by(Rig(), '', [(str(SHIPPED), text)])
    assert rig.roller_diameter_m == 0.3
    assert rig.safe_speed_mps < rig.speed_ceiling_mps
    assert text.count('roller_diameter_m') == 1


def test_what_the_file_of_the_package_only_mentions_can_be_taken_as_it_stands() -> None:
    text = re.sub(
        r'^(  +)# (\w+: )', r'\1\2', SHIPPED.read_text(encoding='utf-8'), flags=re.MULTILINE
    )
    rig = told_by(Rig(), '', [(str(SHIPPED), text)])
    assert rig.sources == ('lateral=/daq/ch0.data[3]*0.001',)
    assert rig.speed_unit == 'km/h'


def test_a_parameter_of_the_rig_is_the_same_in_every_node() -> None:
    pytest.importorskip('rclpy', reason='the extra ros is not installed')
    known = {item.name: item for item in fields(Rig)}
    kinds = {
        kind
        for node in {'support.sensor', *NODES} - set(SENSORS.values())
        if node != PAGE or find_spec('tornado')  # of the extra dashboard
        for kind in vars(import_module(f'hunt_ros.nodes.{node}')).values()
        if isinstance(kind, type) and issubclass(kind, Settings)
    }
    shared = set()
    for kind in kinds:
        for item in fields(kind):
            if item.name in PARAMETERS:
                shared.add(item.name)
                assert item.default == known[item.name].default, (kind, item.name)
                assert item.metadata == known[item.name].metadata, (kind, item.name)
    assert {'roller_diameter_m', 'lines', 'rig_name'} <= shared


@pytest.mark.parametrize(
    ('text', 'section', 'words'),
    [
        ('roller_diameter_mm: 300', '/**', ['roller_diameter_mm', 'roller_diameter_m, in m']),
        ('roler_diameter_m: 0.3', '/**', ['roler_diameter_m', 'expected roller_diameter_m']),
        ('roller_diameter_m: 300.0', '/**', ['roller_diameter_m', '300.0', '10 m']),
        ('roller_diameter_m: wide', '/**', ['roller_diameter_m', 'wide', 'a number']),
        ('channels: [lateral, jaw]', '/**', ['channels', 'jaw', 'yaw']),
        ('channels: [lateral, speed, speed]', '/**', ['channels', 'twice']),
        ('prior_v_c: [8.0]', '/**', ['prior_v_c', 'standard deviation']),
        ('prior_v_c: [8.0, -0.2]', '/**', ['prior_v_c', 'negative, got -0.2']),
        ('prior_v_c: [eight, 0.2]', '/**', ['prior_v_c', 'eight', 'a number']),
        ('lines: 1.0', '/**', ['lines', '1.0', 'a list']),
        ('rig_name: a, rig_name: b', '/**', ['rig_name', 'twice']),
        ('rig_name: yes', '/**', ['rig_name', 'True', 'a text', 'in quotes']),
        ('channels: lateral', '/**', ['channels', 'lateral', 'a list']),
        ('channels: [[lateral]]', '/**', ['channels', 'unknown']),
        ('safe_speed_mps: 9.0, speed_ceiling_mps: 8.0', '/**', ['safe_speed_mps', '9', '8']),
        ('lines: [1.0]', '/**/hunting_detecter', ['hunting_detecter', 'hunting_detector']),
        ('sources: [lateral]', '/**', ['lateral', 'NAME=SOURCE']),
        ('sources: ["lateral=/daq/ch0.data[0]"]', '/**', ['/daq/ch0', '/rig/lateral']),
        ('rig_name: rig B', '/**', ['rig A', 'rig B']),
    ],
)
def test_a_rig_that_cannot_be_is_one_line(bag, tmp_path, capsys, text, section, words) -> None:
    path = _file(tmp_path, text, section)
    for verb in ('replay', 'identify', 'report'):
        assert main([verb, str(bag), '--rig', str(path)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert all(word in line for word in words), line
        assert str(path) in line or str(bag) in line or 'channel' in line


def test_the_sources_of_a_rig_need_no_option(bag, tmp_path) -> None:
    path = _file(tmp_path, 'sources: ["lateral=/rig/lateral.position[0]*1000"], rig_name: rig A')
    assert main(['export', str(bag), str(tmp_path / 'out.csv'), '--rig', str(path)]) == 0
    with (tmp_path / 'out.csv').open() as table:
        rows = list(csv.reader(table))
    values = [float(row[1]) for row in rows[1:]]
    truth = 1000.0 * read_record(bag)['lateral'].values
    assert values == pytest.approx(truth.tolist())


def test_an_option_wins_over_the_rig_and_a_later_file_over_an_earlier(bag, tmp_path) -> None:
    text = 'length_scale_m: 0.1, time_scale_s: 0.02, rig_name: rig A'
    first = _file(tmp_path, text)
    second = tmp_path / 'second.yaml'
    second.write_text(
        '/**/normal_form_identifier: {ros__parameters: {time_scale_s: 0.05}}\n'
        '/**/hunting_detector: {ros__parameters: {time_scale_s: 0.07}}\n'
    )
    out = tmp_path / 'result.json'
    words = ['--rig', str(first), '--rig', str(second), '--set', 'length_scale_m=0.2']
    main(['identify', str(bag), *words, '--json', str(out)])
    result = json.loads(out.read_text())
    assert (result['length_scale_m'], result['time_scale_s']) == (0.2, 0.05)


def test_the_rig_of_a_detector_is_checked_as_that_of_a_file() -> None:
    for values in ({'lines': (200.0,)}, {'channels': ('speed',)}, {'wheel_diameter_m': 0.9}):
        with pytest.raises(ConfigError) as from_detector:
            DetectorConfig(**values)
        with pytest.raises(ConfigError) as from_rig:
            Rig(**values)
        assert str(from_detector.value) == str(from_rig.value)
